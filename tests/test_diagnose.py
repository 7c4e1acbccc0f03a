"""The verdict: right on what is planted, `none` where nothing is, the same for the same data seen otherwise."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path

import numpy as np
import pytest

from runner.diagnosis.next_experiment import best_experiment
from runner.diagnosis.pipeline import diagnose
from runner.diagnosis.ranking import ranking, strained
from runner.diagnosis.result import Diagnosis
from runner.diagnosis.score import read_answers, score
from runner.diagnosis.split import split
from runner.diagnosis.verdict import read_verdicts, verdict
from runner.effects import planar_box as fx
from runner.effects.vocabulary import Candidate
from runner.errors import RecordingError, ResultError
from runner.inference.contender import Contender, contend, likeliest_first
from runner.inference.doubts import doubted, faint, further, unsure
from runner.inference.evidence import NormalEquations, directions, evidence, normal_equations, sensitivities
from runner.inference.held_out import Confirmed, confirm
from runner.inference.least_squares import NONE, Explanation, Fitter
from runner.inference.outside import is_outside, said_of_outside, with_outside
from runner.inference.search import Search, search
from runner.noise.measured import measure
from runner.recording import Episode, Form, Noise, Nominal, Recording
from runner.settings import SETTINGS
from runner.storage.writing import write_json
from runner.systems.planar_box.proposals import pushes
from runner.systems.planar_box.simulator import context_of
from runner.systems.planar_box.system import PlanarBox
from runner.systems.planar_box.windows import Effects
from tests import golden
from tests.cases import fitter_of, measured_as

RATE, SECONDS = 60.0, 3.0
SIGMA = np.array([0.003, 0.003, 0.004, 0.015, 0.015, 0.02])
NOMINAL = Nominal((0.5, 0.5, 0.5), 3.0, 0.3, 9.81, RATE, noise=Noise(0.003, 0.004, 0.015, 0.02))


def recorded(effects: Effects, *, episodes: int = 6, seed: int = 3) -> Recording:
    """Pushes of a second with rests, simulated with these effects, with noise."""
    rng = np.random.default_rng(seed)
    n = int(SECONDS * RATE) + 1
    blank = np.zeros((n, 3))
    made = []
    for i in range(episodes):
        force, point = np.zeros((n, 3)), np.zeros((n, 3))
        for begin in (10, 100):
            angle = rng.uniform(-math.pi, math.pi)
            force[begin : begin + 45, :2] = rng.uniform(11, 18) * np.array([math.cos(angle), math.sin(angle)])
            point[begin : begin + 45, :2] = rng.uniform(-0.3, 0.3, 2)
        made.append(Episode(i, np.arange(n) / RATE, blank, blank, force, point))
    commanded = Recording(Path("made"), Form.PLANAR, NOMINAL, tuple(made))
    return measured_as(commanded, [effects] * episodes, rng, sigma=SIGMA, grid=8)


@pytest.fixture(scope="module")
def tilted() -> Recording:
    return recorded((fx.FloorTilt(0.02, 0.6),))


@pytest.fixture(scope="module")
def fewer(tilted: Recording) -> Recording:
    """As many episodes as a diagnosis needs here."""
    return dataclasses.replace(tilted, episodes=tilted.episodes[:4])


@pytest.fixture(scope="module")
def found(fewer: Recording) -> Diagnosis:
    return diagnose(PlanarBox(fewer), threads=1)


def test_an_effect_of_no_size_is_none() -> None:
    """A recording of the nominal model itself needs no effect."""
    diagnosis = diagnose(PlanarBox(recorded((fx.Friction(NOMINAL.friction),), episodes=4)), threads=1, advise=False)
    assert diagnosis.ranked[0].effects == ("none",)
    assert diagnosis.effects == ()
    assert diagnosis.gap_closed == 0.0
    assert not diagnosis.abstain


def test_a_tilt_is_found_with_its_twin_and_its_error(found: Diagnosis) -> None:
    """The first answer is the tilt, a constant force is named as its equal, the true values lie within 4 errors."""
    first = found.ranked[0]
    assert {first.effects, *first.equivalent} >= {("floor_tilt",), ("wind",)}
    assert first.probability > 0.9
    name = first.effects[0]
    true = {"floor_tilt": (0.02, "angle_rad"), "wind": (3 * 9.81 * math.sin(0.02), "force_n")}[name]
    value, error = first.parameters[name][true[1]], first.errors[name][true[1]]
    assert abs(value - true[0]) < 4 * error
    assert error < 0.1 * true[0]
    assert found.gap_closed > 0.5
    assert found.closure.closable_closed > 0.95


def test_probabilities_sum_to_one_and_hold_every_kind_of_answer(found: Diagnosis) -> None:
    """`none` and `unknown` are ranked like the rest."""
    assert sum(r.probability for r in found.ranked) == pytest.approx(1.0)
    assert {("none",), ("unknown",)} <= {r.effects for r in found.ranked}
    assert [r.probability for r in found.ranked] == sorted((r.probability for r in found.ranked), reverse=True)


def test_the_same_recording_gives_the_same_verdict(fewer: Recording, found: Diagnosis) -> None:
    """Bit for bit, apart from the time it took; a shifted clock changes nothing either."""
    late = dataclasses.replace(fewer, episodes=tuple(dataclasses.replace(e, t_s=e.t_s + 17.0) for e in fewer.episodes))
    again = verdict(diagnose(PlanarBox(late), threads=1, advise=False))
    first = verdict(found)
    for a, b in zip(first["ranked"], again["ranked"], strict=True):
        assert a["effects"] == b["effects"]
        assert a["probability"] == pytest.approx(b["probability"], abs=1e-6)


def turned(recording: Recording) -> Recording:
    """Return a recording of the same in a world that is turned by 90 degrees."""
    turn = np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])  # row vectors
    quarter = np.array([0, 0, math.pi / 2])
    episodes = tuple(
        dataclasses.replace(e, pose=e.pose @ turn + quarter, twist=e.twist @ turn, force_n=e.force_n @ turn)
        for e in recording.episodes
    )
    return dataclasses.replace(recording, episodes=episodes)


def assert_turned(before: dict[str, float], after: dict[str, float], errors: dict[str, float]) -> None:
    """Directions are 90 degrees further, within their errors; all else is the same."""
    for key, value in before.items():
        expected = value + math.pi / 2 if key in ("downhill_rad", "direction_rad") else value
        difference = after[key] - expected
        if key.endswith("_rad") and key != "angle_rad":
            difference = (difference + math.pi) % (2 * math.pi) - math.pi
        assert abs(difference) < max(errors[key], 1e-6)


def test_a_turned_world_turns_a_fit(fewer: Recording, found: Diagnosis) -> None:
    """Turning the world by 90 degrees adds that to the direction and leaves the size."""
    (name,), told = found.ranked[0].effects, []
    for recording in (fewer, turned(fewer)):
        fitter = fitter_of(recording)
        fit = fitter.fit(Explanation(fitter.system.vocabulary.by_name[name][:1]), (0, 1))
        told.append(fit.explanation.make(fit.x, fitter.context)[0].report())
    assert_turned(*told, found.ranked[0].errors[name])


@pytest.mark.slow
def test_a_turned_world_turns_the_answer(fewer: Recording, found: Diagnosis) -> None:
    """As it turns a fit."""
    before, after = found.ranked[0], diagnose(PlanarBox(turned(fewer)), threads=1, advise=False).ranked[0]
    assert after.effects == before.effects
    (name,) = before.effects
    assert_turned(before.parameters[name], after.parameters[name], before.errors[name])


def test_fitted_and_checked_episodes_do_not_overlap() -> None:
    """The last two check the explanation; with few episodes, the last; one alone can't be diagnosed."""
    assert split(range(8)) == (tuple(range(6)), (6, 7))
    assert split(range(3)) == ((0, 1), (2,))
    with pytest.raises(RecordingError, match="at least 2 episodes"):
        split([0])


def test_verdicts_are_written_and_scored(found: Diagnosis, tmp_path: Path) -> None:
    """A right answer scores right, another one wrong; what is missing is said."""
    write_json(tmp_path / "verdicts.json", {"a": verdict(found), "b": verdict(found)})
    (tmp_path / "answers.json").write_text(
        json.dumps(
            {
                "a": {"effects": [{"name": "floor_tilt", "severity": "strong"}], "accept": ["floor_tilt", "wind"]},
                "b": {"effects": [{"name": "mass", "severity": "strong"}], "accept": ["mass", "actuator_gain"]},
            }
        )
    )
    result = score(read_verdicts(tmp_path), read_answers(tmp_path / "answers.json"))
    assert result.cases.set_index("case")["right"].to_dict() == {"a": True, "b": False}
    assert result.summary["first_right"] == 0.5
    with pytest.raises(ResultError, match="no such file"):
        read_answers(tmp_path / "none.json")
    with pytest.raises(ResultError, match="no case has both"):
        score({}, read_answers(tmp_path / "answers.json"))


def test_what_can_be_taken_for_what_is_said(found: Diagnosis) -> None:
    """A constant force does on a level floor what a tilt does; a patch of floor does not."""
    (tilt,) = found.ranked[0].effects
    twin = {"floor_tilt": "wind", "wind": "floor_tilt"}[tilt]
    known = {r.rival: r for r in found.rivals}
    assert known[twin].alike > 0.95
    assert known[twin].confounded
    assert not known["friction_patch"].confounded
    assert found.next_push is not None
    assert "known weight" in found.next_push


def test_the_next_push_stays_within_the_forces_used_and_tells_explanations_apart(tilted: Recording) -> None:
    """What it promises is what two simulations of it differ by, and more than a push that moves nothing yields."""
    context = context_of(tilted)
    first = Explanation((Candidate(fx.Mass),)), np.array([0.1])
    second = Explanation((Candidate(fx.Friction),)), np.array([0.1])
    assert max(np.linalg.norm(p.force_n) for p in pushes(tilted, context)) <= context.force_n * (1 + 1e-12)
    system = PlanarBox(tilted)
    best = best_experiment(system, measure(system), first, second, np.diag([1e-4]), threads=1)
    assert best is not None
    assert best.log_odds > 5.0
    same = best_experiment(system, measure(system), first, first, np.diag([1e-4]), threads=1)
    assert same is not None
    assert same.log_odds == pytest.approx(0.0, abs=1e-9)


def test_what_fails_on_unseen_episodes_loses_its_lead(tilted: Recording) -> None:
    """A leader whose value the episodes left out contradict is put behind the nominal model; a true one stays."""
    fitted, held_out = split([e.index for e in tilted.episodes])
    fitter = fitter_of(tilted)
    nominal = fitter.fit(NONE, fitted)
    every = directions(fitter.system)
    true = fitter.fit(Explanation((Candidate(fx.FloorTilt),)), fitted, near=nominal)
    # as if the fitted episodes were as well explained by the opposite tilt
    wild = dataclasses.replace(true, x=-true.x)
    known = sensitivities(fitter, true, every)
    alone = normal_equations(nominal, sensitivities(fitter, nominal, every))

    def contender(around: NormalEquations, log: float) -> Contender:
        return Contender(around.fit, around, evidence(around, fitter.system), 0.0, log, {})

    for fit, stays in ((true, True), (wild, False)):
        search = Search((contender(normal_equations(fit, known), 0.0), contender(alone, -20.0)), nominal)
        confirmed = confirm(search, fitter, held_out)
        assert (confirmed.search.best.fit is fit) == stays
        assert (confirmed.after[id(fit)].total < confirmed.before.total) == stays


@pytest.mark.slow
def test_a_hair_s_breadth_is_no_effect() -> None:
    """Friction off by 0.05 % explains some of the noise's whims and nothing that matters, less than several errors."""
    hardly = recorded((fx.Friction(NOMINAL.friction * 1.0005),), episodes=4)
    diagnosis = diagnose(PlanarBox(hardly), threads=1, advise=False)
    assert diagnosis.ranked[0].effects == ("none",)


def test_a_dead_band_is_unknown_and_is_said() -> None:
    """It is not taken for the heavier body or the weaker push that it nearly is.

    What is said of a dead band of 0.6 N is found anew, to every number, by `make slow` and `make golden`.
    """
    assert golden.SMALL["small_dead_band"][0] == (fx.DeadBand(0.6),)
    lost = json.loads(golden.FILE.read_text(encoding="utf-8"))["small_dead_band"]
    assert lost["ranked"][0]["effects"] == ["unknown"]
    assert lost["abstain"]
    said = next(n for n in lost["notes"] if "dead band" in n)
    assert float(said.rstrip(".").split()[-1]) == pytest.approx(0.6, abs=0.1)
    assert all("unknown" not in r["effects"] for r in lost["ranked"][1:])
    assert sum(r["probability"] for r in lost["ranked"]) == pytest.approx(1.0)


@pytest.mark.parametrize(("planted", "outside"), [(fx.DeadBand(0.6), True), (fx.ActuatorGain(0.95), False)])
def test_a_dead_band_is_weighed_beside_what_it_nearly_is(planted: fx.PlanarEffect, outside: bool) -> None:
    """Beside a heavier body that was fitted it is the best answer where it is at work, and only there."""
    fitter = fitter_of(recorded((planted,), episodes=4))
    nominal = fitter.fit(NONE, range(3))
    heavier = fitter.fit(Explanation((Candidate(fx.Mass),)), range(3), near=nominal)
    every = directions(fitter.system)
    contenders = (contend(fitter, fit, sensitivities(fitter, fit, every)) for fit in (heavier, nominal))
    found = with_outside(Search(tuple(likeliest_first(contenders)), nominal), fitter)
    assert is_outside(found.best, fitter.system.vocabulary) is outside
    said = said_of_outside(found, fitter.system)
    assert [s.split()[-2] for s in said] == ["force_n"] * outside
    assert all(float(s.rstrip(".").split()[-1]) == pytest.approx(0.6, abs=0.1) for s in said)


@pytest.mark.slow
def test_a_weaker_push_is_no_dead_band() -> None:
    """It is as it is of a heavier body, and nothing is unknown."""
    weaker = diagnose(PlanarBox(recorded((fx.ActuatorGain(0.95),), episodes=4)), threads=1, advise=False)
    assert {weaker.ranked[0].effects, *weaker.ranked[0].equivalent} >= {("mass",), ("actuator_gain",)}
    assert not weaker.abstain
    assert not any("dead band" in n for n in weaker.notes)


@pytest.mark.parametrize(
    ("share", "known"), [(0.003, True), (0.03, False), pytest.param(0.1, False, marks=pytest.mark.slow)]
)
def test_a_gap_without_a_name_is_unknown(share: float, known: bool) -> None:
    """Several small errors of the simulator are none, however fine the sensor; ten times as large they are not."""
    friction, mass_kg = NOMINAL.friction * (1.0 + share), NOMINAL.mass_kg * (1.0 + share / 2)
    fitter = fitter_of(recorded((fx.Friction(friction), fx.Mass(mass_kg), fx.ComOffset(0.1 * share, 0.0))))
    episodes = range(4)
    found, held = search(fitter, episodes, most=0), (4, 5)
    confirmed = confirm(found, fitter, held)
    gap = fitter.measured.excess(found.nominal.total, episodes)
    assert gap > 0.6  # more than noise that is ill known
    ranked = {r.effects: r.probability for r in ranking(confirmed, gap, fitter)}
    assert (ranked["none",] > 0.9) if known else (ranked["unknown",] > 0.9)


@pytest.mark.parametrize(("effects", "alone"), [((), True), ((fx.Inertia(1.3),), False)])
def test_edges_that_are_off_are_no_gap(effects: Effects, alone: bool) -> None:
    """A box is smaller than its owner says by 2 %: plain to see, and no word; what has one is left to be explained."""
    fitter = fitter_of(recorded((fx.BodySize(0.98, 0.98), *effects)))
    episodes, held = (0, 1, 2, 3), (4, 5)
    found = search(fitter, episodes, most=0)
    gap, beside = (fitter.measured.excess(t, episodes) for t in (found.nominal.total, found.best.evidence.left))
    assert gap > SETTINGS.odds.visible_gap_excess
    assert beside < 0.1 if alone else beside > 1.0
    confirmed = confirm(found, fitter, held)
    ranked = {r.effects: r.probability for r in ranking(confirmed, gap, fitter)}
    assert (ranked["none",] > 0.9) == alone


def contended(recording: Recording, kind: type[fx.PlanarEffect], vector: list[float]) -> tuple[Fitter, Contender]:
    """An effect at a vector, as if fitted, amid its surroundings."""
    fitter = fitter_of(recording)
    fit = fitter.fit(Explanation((Candidate(kind),)), (0, 1), x=np.array(vector), iterations=0)
    around = normal_equations(fit, sensitivities(fitter, fit, directions(fitter.system)))
    return fitter, Contender(fit, around, evidence(around, fitter.system), 0.0, 0.0, {})


def test_a_tether_from_as_far_as_can_be_is_no_tether(tilted: Recording) -> None:
    """It pulls as wind does; one without slack rests on a bound as well, and is a tether."""
    context = context_of(tilted)
    stiffness, x, _, rest = fx.Tether.parameters(context)
    near = [stiffness.scale, context.centre_m[0] + context.reach_m, context.centre_m[1], rest.lower]
    far = [stiffness.scale, x.upper, context.centre_m[1], rest.lower]
    for vector, holds in ((near, True), (far, False)):
        _, contender = contended(tilted, fx.Tether, vector)
        assert contender.fit.at_bound[3]
        assert np.isfinite(contender.evidence.log) == holds


def test_a_patch_as_faint_as_texture_is_doubted(tilted: Recording) -> None:
    """However well its size is known; and so is a static friction of a few percent."""
    (cx, cy), reach = (c := context_of(tilted)).centre_m, c.reach_m
    place = [cx, cy, math.log(0.5 * reach)]
    fitter, slight = contended(tilted, fx.FrictionPatch, [0.003, *place])
    _, plain = contended(tilted, fx.FrictionPatch, [-0.3, *place])
    assert faint(slight, fitter.context) > 100.0
    assert faint(plain, fitter.context) == 0.0
    _, sticky = contended(tilted, fx.Stiction, [0.02])
    assert faint(sticky, fitter.context) > 100.0


@pytest.mark.parametrize(("share", "least", "most"), [(0.2, 920, 925), (1.5, 420, 428), (2.5, 35, 45), (2.7, 0, 0)])
def test_an_effect_near_its_own_standard_error_is_doubted(
    tilted: Recording, share: float, least: float, most: float
) -> None:
    """By how much of its error it is away from nothing."""
    fitter, some = contended(tilted, fx.MassLeak, [0.03])
    error = math.sqrt(some.evidence.covariance[0, 0])
    moved = dataclasses.replace(some, fit=dataclasses.replace(some.fit, x=np.array([share * error])))
    assert least <= unsure(moved, [], fitter.context, SETTINGS.odds.min_errors_beside_others) <= most


def test_whether_there_is_an_effect_is_asked_of_the_likeliest(tilted: Recording) -> None:
    """All single effects share its doubt, so that their order stays; where the gap is plain there is none."""
    fitter, leak = contended(tilted, fx.MassLeak, [0.03])
    _, scale = contended(tilted, fx.SensorScale, [0.5])
    error = math.sqrt(leak.evidence.covariance[0, 0])
    weak = dataclasses.replace(leak, fit=dataclasses.replace(leak.fit, x=np.array([0.2 * error])))
    weak, sure = (dataclasses.replace(c, log_posterior=p) for c, p in ((weak, -10.0), (scale, -30.0)))
    lowered = [c.log_posterior for c in doubted([weak, sure], fitter.context, 0.5, 100)]
    assert lowered[0] == pytest.approx(-10.0 - unsure(weak, [], fitter.context, math.sqrt(2.0)))
    assert lowered[0] - lowered[1] == pytest.approx(20.0)
    assert [c.log_posterior for c in doubted([weak, sure], fitter.context, 5.0, 100)] == [-10.0, -30.0]


def test_what_takes_the_simulator_further_away_is_doubted(tilted: Recording) -> None:
    """In episodes that were not fitted, and only where the gap is not plain: elsewhere the evidence decides."""
    fitter = fitter_of(tilted)
    before, held = fitter.fit(NONE, (4, 5)), dataclasses.replace(fitter, held=(fx.FloorTilt(0.02, 0.6),))
    there = held.fit(NONE, (4, 5))
    assert further(there, before, fitter, 0.1) == 0.0
    assert further(before, there, fitter, 0.1) == 100.0
    assert further(before, there, fitter, 2.0) == 0.0
    worse = dataclasses.replace(before, residual=tuple(r * math.sqrt(1.01) for r in before.residual))
    expected = 1000 * 0.01 * before.total / fitter.measured.count((4, 5))
    assert further(worse, before, fitter, 0.1) == pytest.approx(min(expected, 100.0))


def test_each_effect_of_an_answer_may_be_the_work_of_something_else(
    tilted: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    """However well it fits: one effect is no surer than 0.97, two no surer than the square of that."""
    fitter = fitter_of(tilted)
    episodes = tuple(range(len(tilted.episodes)))
    nominal = fitter.fit(NONE, episodes)
    known = sensitivities(fitter, nominal, directions(fitter.system))
    monkeypatch.setattr("runner.diagnosis.ranking.strained", lambda *_: 0.0)
    most = SETTINGS.probability.max_unknown
    for kinds in ((fx.FloorTilt,), (fx.FloorTilt, fx.Inertia)):
        fit = fitter.fit(Explanation(tuple(Candidate(k) for k in kinds)), episodes, near=nominal, iterations=2)
        around = normal_equations(fit, known)
        best = Contender(fit, around, evidence(around, fitter.system), 0.0, 0.0, {})
        confirmed = Confirmed(Search((best,), nominal), nominal, {}, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
        first = ranking(confirmed, 1.0, fitter)[0]
        assert first.probability == pytest.approx(most ** len(kinds), abs=1e-3)


def test_what_strains_the_simulator_s_trust_is_not_explained(tilted: Recording) -> None:
    """A wrong effect leaves most of a gap, and only mismatch of many times the usual size makes up for the rest."""
    fitter = fitter_of(tilted)
    episodes = tuple(range(len(tilted.episodes)))
    nominal = fitter.fit(NONE, episodes)
    known = sensitivities(fitter, nominal, directions(fitter.system))

    def strain(kind: type[fx.PlanarEffect]) -> float:
        around = normal_equations(fitter.fit(Explanation((Candidate(kind),)), episodes, near=nominal), known)
        return strained(Contender(around.fit, around, evidence(around, fitter.system), 0.0, 0.0, {}), nominal, fitter)

    assert strain(fx.FloorTilt) < 0.01
    assert strain(fx.Inertia) > 0.5
    # where nothing is claimed a simulator that has to be far off is off by something
    alone = normal_equations(nominal, known)
    none = Contender(nominal, alone, evidence(alone, fitter.system), 0.0, 0.0, {})
    assert strained(none, nominal, fitter) > 0.5
