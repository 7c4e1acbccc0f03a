"""A report says in sentences what was found, and sums it up in the terminal."""

from __future__ import annotations

import copy
import io
import math
import re
from dataclasses import fields, replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from rich.console import Console

from runner.diagnosis.notes import doubts, notes
from runner.diagnosis.result import Abstention, Flights, Nearest
from runner.diagnosis.verdict import verdict
from runner.effects.planar_box import EFFECTS
from runner.effects.planar_box.com_offset import ComOffset
from runner.effects.wording import percent, percent_between, plus_minus
from runner.inference.least_squares import Explanation
from runner.localise.likeness import Likeness
from runner.recording.data import BelievedPin
from runner.report import html, sections, unknown, words
from runner.report.next_steps import next_steps
from runner.report.sections import _place
from runner.report.statement import caveats
from runner.report.terminal import summary
from runner.systems.channels import Scatter
from runner.systems.planar_box.system import PlanarBox
from tests.report_case import changed, diagnosis, ranked, said

pytestmark = pytest.mark.usefixtures("undrawn")


@pytest.fixture(scope="module")
def found() -> Any:
    """A diagnosis that found the friction."""
    return diagnosis()


def pinned(system: PlanarBox) -> PlanarBox:
    """Return the same that a pin pushes."""
    recording = system.recording
    return PlanarBox(replace(recording, nominal=replace(recording.nominal, pin=BelievedPin(0.005, 0.2))))


def printed(diagnosis: Any, width: int = 160) -> str:
    """Return the summary as it stands in a terminal."""
    out = io.StringIO()
    Console(file=out, width=width).print(summary(diagnosis))
    return out.getvalue()


def test_verdict_sentence_of_one_effect(found: Any) -> None:
    """What, how much, how sure, and how much better, in two sentences."""
    assert words.verdict(found) == (
        "The floor is more slippery than believed: friction 0.2704 ± 0.0012 instead of 0.300 (probability 0.98). "
        "With it the simulator misses 87 % less on episodes that were not fitted; what is left is the noise of the "
        "measurement."
    )


def test_verdict_says_which_way(found: Any) -> None:
    """A coefficient above the believed one is a less slippery floor."""
    top = ranked(("friction",), 0.9, parameters={"friction": {"mu": 0.35}}, errors={"friction": {"mu": 0.01}})
    assert words.verdict(changed(found, ranked=(top,))).startswith("The floor is less slippery than believed")


def test_verdict_of_two_effects(found: Any) -> None:
    """Both are named with their values."""
    top = ranked(
        ("friction", "floor_tilt"),
        0.9,
        parameters={"friction": {"mu": 0.27}, "floor_tilt": {"angle_rad": 0.02, "downhill_rad": -1.0}},
        errors={"friction": {"mu": 0.001}, "floor_tilt": {"angle_rad": 0.0005, "downhill_rad": 0.02}},
    )
    text = words.verdict(changed(found, ranked=(top,)))
    assert text.startswith(
        "Two things differ from the model: the floor is more slippery than believed (friction 0.2700"
    )
    assert "the floor is not level (it slopes by 1.15 ± 0.03°" in text
    assert "With them the simulator misses" in text


def test_verdict_of_none(found: Any) -> None:
    """The model will do, and nothing is to be changed."""
    nothing = changed(found, ranked=(ranked(("none",), 0.97), ranked(("wind",), 0.03)), effects=(), gap_closed=0.0)
    assert words.verdict(nothing) == (
        "The simulator as believed will do: what it misses needs no effect to explain it "
        "(2.2 times the noise: small errors of any simulator) (probability 0.97). "
        "The likeliest alternative is wind (probability 0.03)."
    )
    assert next_steps(nothing)[0].startswith("Keep your model.")


def test_verdict_of_unknown(found: Any) -> None:
    """It says that no effect explains the gap, and how near the nearest comes."""
    order = (ranked(("unknown",), 0.9), ranked(("friction",), 0.1, gap_closed=0.4))
    text = words.verdict(changed(found, ranked=order))
    assert text.startswith("Something is going on that none of the known effects explains (probability 0.90).")
    assert "With the nearest of them, friction, the simulator misses 40 % less" in text


def test_what_is_unknown_is_told_by_what_comes_near_and_by_how_it_looks(found: Any) -> None:
    """Value and closure of the nearest, where most is left, what speaks against each, and what the rest goes with."""
    table = found.closure.table.assign(after=lambda t: t["noise"] * np.where(t["channel"] == "wz", 3.0, 1.1))
    values = {"parameters": found.ranked[0].parameters, "errors": found.ranked[0].errors, "gap_closed": 0.87}
    near, far = (
        ranked(("friction",), 0.08, **values),
        ranked(("wind",), 0.01, parameters={"wind": {"force_n": 0.4, "direction_rad": 1.0}}),
    )
    looks = (Likeness("fx_n", "towards world x [N]", 0.12, (("its speed", 0.48), ("the time", 0.2))),)
    helps = Abstention(
        (Nearest(near, 0.87, 0.76, 0.06, 0.08, 0.0, ()), Nearest(far, -0.1, 0.45, 0.3, 1.2, 45.6, ("wind",))),
        found.where,
        looks,
    )
    closure = SimpleNamespace(**{**vars(found.closure), "table": table})
    unsure = changed(found, ranked=(ranked(("unknown",), 0.9), near, far), abstention=helps, closure=closure)
    shown = " ".join(printed(unsure).split())
    for part in (
        "The floor is more slippery than believed: friction 0.2704 ± 0.0012 instead of 0.300. With that the simulator "
        "misses 87 % less on episodes that were not fitted. Against it: it leaves 24 % of what is missed where it "
        "was fitted.",
        "With that the simulator does not come closer on episodes that were not fitted. Against it: it leaves 55 % of "
        "what is missed where it was fitted, it does not hold on episodes that were not fitted: more "
        "is missed there than without it, it is 46 natural log units less likely than the first and wind does not "
        "stand out of its own error.",
        "With the nearest, what is left is 1.6 times the noise, most of it in the yaw rate (88 %).",
        "Towards world x: 0.12 N is missing (root mean square). It goes along with its speed (48 %) and the time "
        "(20 %).",
    ):
        assert part in shown
        assert part in " ".join(said(html.render(unsure)).split())
    worse = replace(helps.nearest[0], gap_closed=0.2, left_unseen=0.6)
    (text,) = unknown.nearest(changed(unsure, abstention=replace(helps, nearest=(worse,))))
    assert "the simulator misses 20 % less" in text
    assert "does not hold on episodes that were not fitted: 80 % is left there." in text


def test_what_flights_alone_say_is_told_where_the_answer_is_another(found: Any) -> None:
    """In the terminal, on the page with what to do, and in the verdict as data, with what it is made of."""
    sentence = "Before the first hit, flights alone are explained by gravity: that leaves the noise."
    flights = Flights(("gravity",), 0.97, {"gravity": {"tilt_x_rad": 0.01}}, {"gravity": {}}, 0.9, sentence, "Cut it.")
    order = (ranked(("unknown",), 0.97), ranked(("friction",), 0.03, gap_closed=0.4))
    unsure = changed(found, ranked=order, flights=flights)
    page = said(html.render(unsure))
    assert f"{sentence} Cut it." in " ".join(printed(unsure).split())
    assert f"What flights alone say. {sentence}" in page
    assert next_steps(unsure)[0] == "Cut it."
    assert page.count("Cut it.") == 1
    told = verdict(unsure)
    assert told["notes"][-1] == f"{sentence} Cut it."
    assert told["flights"]["effects"] == ["gravity"]
    assert "flights" not in verdict(found)
    assert "flights" not in said(html.render(found))


def test_the_noise_of_a_sensor_is_not_what_counts_as_noise_after_a_hit(found: Any) -> None:
    """The table has what the sensor shows, and beside it what no model foretells once something was hit."""
    calm = tuple(np.arange(len(v)) < 100 for v in found.measured.values)
    hit = replace(found.measured, scatter=Scatter(3.0 * found.measured.sensor, calm))
    row = sections.noise(changed(found, measured=hit))[0]
    assert row["sigma"] == "0.50 mm"
    assert row["source"].endswith("; after a hit 1.5 mm counts as noise")
    assert "after a hit" not in sections.noise(found)[0]["source"]


def test_a_correction_that_does_not_help_is_not_praised(found: Any) -> None:
    """A gap that grew is told as one."""
    assert "does not come closer" in words.verdict(changed(found, gap_closed=-0.2))


def test_what_cannot_be_told_apart_is_said(found: Any) -> None:
    """Equivalent explanations are named on the page and in the terminal, with a way to decide."""
    twin = ranked(
        ("mass",), 0.99, parameters={"mass": {"mass_kg": 4.0}}, errors={"mass": {"mass_kg": 0.01}},
        equivalent=(("actuator_gain",),),
        equal_numbers={("actuator_gain",): ({"actuator_gain": {"gain": 0.75}}, {"actuator_gain": {"gain": 0.002}})},
    )  # fmt: skip
    both = changed(found, ranked=(twin,), next_push="To tell mass from actuator gain: add a known weight.")
    for text in (said(html.render(both)), " ".join(printed(both).split())):
        assert "These data would fit actuator gain in the place of mass just as well: nothing in the recording" in text
        assert "To tell mass from actuator gain: add a known weight." in text
    assert any("Weigh the object." in step for step in next_steps(both))
    decide, then, *_ = next_steps(both)
    assert decide.startswith("Decide between mass and actuator gain, which more recordings like this one can't tell")
    assert then.startswith("Should it be mass: take the corrected model")
    assert sum("add a known weight." in step for step in next_steps(both)) == 1
    other = next_steps(changed(both, next_push="Next push: along x."))
    assert other[0].endswith("which more recordings like this one can't tell apart; a measurement of another kind may.")
    assert "Next push: along x." in other
    amount = "actuator gain (0.750 ± 0.002 times the command)"
    assert f"or {amount}" in " ".join(printed(both).split())
    assert amount in said(html.render(both))
    (entry,) = verdict(both)["ranked"]
    assert entry["equivalent_parameters"] == [{"actuator_gain": {"gain": 0.75}}]


def test_a_number_that_is_not_told_stands_as_in_the_file(found: Any) -> None:
    """In the corrected model it is what was believed; what the fit has come to is beside it."""
    system = copy.copy(found.system)
    system.as_told = lambda effects, errors: tuple(replace(e, y_m=0.0) for e in effects if errors)
    numbers, errors = {"x_m": 0.011, "y_m": -0.002}, {"x_m": 0.001, "y_m": 0.02}
    fitted = ranked(
        ("com_offset",), 0.97, values=(ComOffset(0.011, -0.002),), parameters={"com_offset": numbers},
        errors={"com_offset": errors},
    )  # fmt: skip
    page = said(html.render(changed(found, ranked=(fitted,), system=system)))
    assert "com_offset.x_m 0.0110 ± 0.0010 m" in page
    assert "com_offset.y_m 0 m (not told: 0 ± 0.02 m)" in page


@pytest.mark.parametrize("variant", [k for kinds in EFFECTS.values() for k in kinds], ids=lambda k: k.__name__)
def test_every_effect_has_its_words(found: Any, variant: Any) -> None:
    """No effect of the vocabulary is described by its parameters' names, and all its numbers are numbers."""
    names = [f.name for f in fields(variant) if f.name != "target"]
    values = dict.fromkeys(names, 1.25)
    system = pinned(found.system) if variant.of_pin else found.system
    word = next(c.name for c in (*system.vocabulary, *system.vocabulary.outside) if c.effect is variant)
    phrase = words.phrase(system, word, values, dict.fromkeys(names, 0.05))
    assert "phrase" in vars(variant) or "phrase" in vars(variant.__base__)
    assert "±" in phrase.amount
    for text in (phrase.what, phrase.amount, phrase.remedy, phrase.check):
        assert text
        assert "?" not in text and "nan" not in text  # noqa: PT018
        assert not re.search(r"_(m|rad|n|s|kg)\b", text)


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (0.27712, 0.00104, "0.2771 ± 0.0010"),
        (0.27712, 0.0026, "0.277 ± 0.003"),
        (4.2259, 0.1, "4.23 ± 0.10"),
        (-41.48, 12.0, "−41 ± 12"),
        (1234.0, 40.0, "1230 ± 40"),
        (0.5, math.nan, "0.500"),
        (0.5, None, "0.500"),
        (-2.18e-10, 36.0, "0 ± 40"),
        (-0.004, 0.03, "0 ± 0.03"),
        (-0.006, 0.03, "−0.01 ± 0.03"),
    ],
)
def test_numbers_are_rounded_to_their_error(value: float, error: float | None, text: str) -> None:
    """The error keeps one digit, two below 2, and the value goes as far as the error; what is nothing then is 0."""
    assert plus_minus(value, error) == text


def test_terminal_summary(found: Any) -> None:
    """The verdict, the ranking and the miss of every channel."""
    text = printed(found)
    assert "The floor is more slippery than believed" in text
    assert re.search(r"0\.98 +friction +87 %\s+friction 0\.2704 ± 0\.0012 instead of 0\.300 *\n", text)
    assert re.search(r"position x \[mm\] +4\.5 +0\.55 +0\.50", text)
    assert "It took 12 s of wall time, and 20 s of CPU time in all threads together" in " ".join(text.split())


def test_nothing_is_said_of_commands_where_there_are_none(found: Any) -> None:
    """What is tossed is recorded again in another motion."""
    tossed = copy.copy(found.system)
    tossed.commanded = False
    unsure = changed(found, ranked=(ranked(("friction",), 0.85, parameters={"friction": {"mu": 0.27}}),))
    for system, said_of in ((found.system, True), (tossed, False)):
        assert any("command" in step for step in next_steps(changed(unsure, system=system))) is said_of
        assert ("The same commands" in said(html.render(changed(found, system=system)))) is said_of


def test_what_can_hardly_be_told_apart_is_one_sentence(found: Any) -> None:
    """Several rivals of one effect, and those of another, without beginning anew for each pair."""
    rivals = [
        SimpleNamespace(effect=effect, rival=rival, confounded=True)
        for effect, rival in (("friction", "mass"), ("friction", "inertia"), ("wind", "floor_tilt"))
    ]
    assert words.confounded(changed(found, rivals=tuple(rivals))) == (
        "Such data can hardly tell mass or inertia from friction; nor floor tilt from wind."
    )


def test_every_note_is_a_sentence_and_stands_once(found: Any) -> None:
    """Notes of a recording come without a full stop, and are among those of the diagnosis, too."""
    note = "'x' is not measured (NaN) in 3 of 90 rows"
    noted = changed(found, notes=(note, "A caveat."), recording=replace(found.recording, notes=(note,)))
    assert caveats(noted) == (f"{note}.", "A caveat.")
    assert f"Note: {note}." in printed(noted)
    assert "\nWarning: it jumps." in printed(changed(found, notes=("warning: it jumps",)))


def fitted(found: Any, widths: float) -> Any:
    """Return an explanation by the friction, so many widths of its prior off."""
    explanation = Explanation((found.system.vocabulary.by_name["friction"][0],))
    scale = explanation.parameters(found.system.context)[0].scale
    fit = SimpleNamespace(converged=True, explanation=explanation, x=np.array([widths * scale]))
    return SimpleNamespace(fit=fit)


def test_much_more_than_usual_is_to_be_seen_by_hand(found: Any) -> None:
    """A number far out of its prior may stand in for another cause."""
    (far,) = doubts(found.system, found.measured, fitted(found, -5.0))
    assert far.startswith("By how much friction differs from the model is more than 4 times what")
    assert doubts(found.system, found.measured, fitted(found, 3.0)) == ()


def test_what_speaks_against_the_numbers_stands_beside_them(found: Any) -> None:
    """Under the headline, before any figure; of what is no answer it is one note among others."""
    doubt = "The fit had not come to rest: try `runner gap`."
    for order, beside in ((found.ranked, True), ((ranked(("unknown",), 0.9),), False)):
        noted = changed(found, doubts=(doubt,), ranked=order)
        page, text = html.render(noted), printed(noted)
        assert (page.index("had not come to rest") < page.index('class="facts"')) is beside
        assert (f"Note: {doubt}" in text) is not beside
        assert text.count("had not come to rest") == 1


def test_lost_samples_are_no_outliers(found: Any) -> None:
    """What was not measured is not said to stick out of its neighbours."""
    measured = found.measured
    values, valid = ([np.array(v) for v in of] for of in (measured.values, measured.valid))
    values[0][:9], valid[0][:9] = np.nan, False
    lost = replace(measured, values=tuple(values), valid=tuple(valid))
    assert not any("stick out" in n for n in notes(found.system, lost, (1, 2)))
    valid[0][20, 0] = False
    said = notes(found.system, replace(lost, valid=tuple(valid)), (1, 2))
    assert "1 value sticks out of its neighbours and was left out: position x at 0.33 s of episode 3." in said
    valid[0][30:33, 1] = valid[1][5, 1] = False
    said = notes(found.system, replace(lost, valid=tuple(valid)), (1, 2))
    assert any(n.endswith("left out: 4 of position y and 1 of position x; in episodes 3 (4) and 4 (1).") for n in said)


@pytest.mark.parametrize(
    ("share", "low", "high", "text"),
    [
        (0.87, 0.85, 0.89, "87 % (85–89 %)"),
        (0.99, 0.988, 0.992, "99.0 % (98.8–99.2 %)"),
        (0.993, 0.98, 0.996, "99.3 % (98.0–99.6 %)"),
        (0.9982, 0.9981, 0.9983, "99.82 % (99.81–99.83 %)"),
        (0.87, -0.1, 0.89, "87 % (−10–89 %)"),
        (0.5, 0.50001, 0.50002, "50 %"),
        (0.88, 0.8798, 0.8802, "88 %"),
    ],
)
def test_ends_of_an_interval_differ(share: float, low: float, high: float, text: str) -> None:
    """As many decimals as that takes, alike in all three figures."""
    assert percent_between(share, low, high) == text


@pytest.mark.parametrize(
    ("share", "text"),
    [
        (0.87, "87 %"),
        (0.994, "99.4 %"),
        (0.999, "99.9 %"),
        (0.99974, "99.97 %"),
        (1.0, "100 %"),
        (4e-5, "0.004 %"),
        (0.0, "0 %"),
    ],
)
def test_nearly_all_is_not_all(share: float, text: str) -> None:
    """Of a gap of thousands of noises a hundredth of a per cent is still tens of them."""
    assert percent(share) == text


def test_cells_come_joint_by_joint_in_the_order_of_their_numbers() -> None:
    """The digits of a joint's name are no place, and the places of two joints are not mixed."""
    cells = [
        "'joint_9' at 0.2 to 0.8 rad",
        "'joint_1' at 1.5 to 2.0 rad",
        "'joint_9' at -1.0 to 0.2 rad",
        "'joint_1' at -0.5 to 1.5 rad",
    ]
    assert sorted(cells, key=lambda c: _place(c, ())) == [cells[i] for i in (3, 1, 2, 0)]
    speeds = ["high speed (1.4 to 2.3 of the usual)", "low speed (0.003 to 0.63 of the usual)"]
    assert sorted(speeds, key=lambda c: _place(c, ())) == speeds[::-1]


def test_a_word_means_the_variant_that_was_fitted() -> None:
    """A word may have several laws: what it is said to mean is the one whose numbers stand beside it."""
    several = 0
    numbers = {c: {f.name for f in fields(cast(Any, c))} for classes in EFFECTS.values() for c in classes}
    for name, classes in EFFECTS.items():
        for effect in classes if not any(c.of_pin for c in classes) else ():
            values = dict.fromkeys(numbers[effect], 0.1)
            twins = [c.label for c in classes if values.keys() <= numbers[c]]
            assert words.label(diagnosis().system, name, values) in twins
            several += len({c.label for c in classes}) > 1
    assert several
