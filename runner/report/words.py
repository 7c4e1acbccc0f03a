"""Sentences: what a diagnosis found, in words that need no knowledge of the tool.

Every effect of the vocabulary has a `Phrase`: what is the case, by how much, what to put into one's simulator, and how
to check it with one's own hands. The verdict sentence at the top of the report is made of these.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from runner.effects import EFFECTS

if TYPE_CHECKING:
    from runner.diagnosis.pipeline import Diagnosis, Ranked
    from runner.recording import Nominal

Values = Mapping[str, float]
NONE, UNKNOWN = "none", "unknown"
DEGREES = 180.0 / math.pi
SURE = 0.9  # an answer less likely than this asks for more data
HALF = 0.5  # less likely than that is not an answer
OVER = 0.05  # squared noises that the nominal model leaves: less is not worth a word
NOISE_LEFT = 0.99  # of what can be closed: the rest is as good as noise
NOTEWORTHY = 0.02  # explanations less likely than this are not worth a sentence


@dataclass(frozen=True)
class Phrase:
    """An effect in words.

    Args:
        what: What is the case, a clause without a capital letter and without numbers.
        amount: By how much, with standard errors; empty: there is nothing to add.
        remedy: What to change in a simulator, a sentence.
        check: How to confirm it without a simulator, a sentence.
    """

    what: str
    amount: str
    remedy: str
    check: str


def title(effects: Sequence[str]) -> str:
    """Return effect names as they are read: `friction + floor tilt`."""
    return " + ".join(e.replace("_", " ") for e in effects)


def label(effect: str) -> str:
    """Return what a word of the vocabulary means, without numbers."""
    if effect == NONE:
        return "nothing that matters differs from the model"
    if effect == UNKNOWN:
        return "something that no known effect explains"
    return EFFECTS[effect][0].label if effect in EFFECTS else effect.replace("_", " ")


def _mass(of: _Of) -> Phrase:
    word = "heavier" if of["mass_kg"] > of.nominal.mass_kg else "lighter"
    return Phrase(
        f"the object is {word} than believed",
        f"mass {of.show('mass_kg', 'kg')} instead of {number(of.nominal.mass_kg)} kg",
        f"Set the mass to {number(of['mass_kg'], 4)} kg; the moments of inertia grow in proportion.",
        "Weigh the object.",
    )


def _friction(of: _Of) -> Phrase:
    word = "more slippery" if of["mu"] < of.nominal.friction else "less slippery"
    return Phrase(
        f"the floor is {word} than believed",
        f"friction {of.show('mu')} instead of {of.nominal.friction:.3f}",
        f"Set the friction coefficient between object and floor to {number(of['mu'], 4)}.",
        "Pull the object slowly with a spring scale: force over weight is the coefficient.",
    )


def _com_offset(of: _Of) -> Phrase:
    return Phrase(
        "the centre of mass is off the geometric centre",
        f"by ({of.long('x_m')}, {of.long('y_m')}) along the object's own x and y",
        f"Move the centre of mass to ({number(of.nominal.com_m[0] + of['x_m'] if of.nominal.com_m else of['x_m'])}, "
        f"{number(of.nominal.com_m[1] + of['y_m'] if of.nominal.com_m else of['y_m'])}) m in body axes.",
        "Balance the object on an edge, once along each side.",
    )


def _inertia(of: _Of) -> Phrase:
    word = "harder" if of["ratio"] > 1 else "easier"
    moment = of["ratio"] * of.nominal.yaw_inertia_kg_m2
    return Phrase(
        f"the object is {word} to turn than believed",
        f"moment of inertia {of.show('ratio')} times the believed one, {number(moment)} kg m²",
        f"Set the moment of inertia about the vertical to {number(moment, 4)} kg m².",
        "Hang the object from a wire, let it swing about the vertical, and time it against a known body.",
    )


def _anisotropic_friction(of: _Of) -> Phrase:
    more = of["ratio"] >= 1
    contrast, error = (of["ratio"] if more else 1 / of["ratio"]) - 1, of.error("ratio")
    if error is not None and not more:
        error /= of["ratio"] ** 2
    amount = plus_minus(100 * contrast, None if error is None else 100 * error, "%")
    mean, ratio = of.nominal.friction, of["ratio"]
    along, across = (number(2 * mean * r / (1 + ratio)) for r in (ratio, 1.0))
    return Phrase(
        "friction depends on the direction in which the object slides",
        f"{amount} {'more' if more else 'less'} along its axis at {of.angle('angle_rad')} than across it",
        f"Make friction {along} along the object's axis at {number(of['angle_rad'] * DEGREES)}°, {across} across it.",
        "Pull the object slowly along either axis and compare the forces.",
    )


def _viscous_drag(of: _Of) -> Phrase:
    film = "film_n_s_per_m" in of
    name = "film_n_s_per_m" if film else "coefficient_n_s_per_m"
    return Phrase(
        "a viscous film under the base resists sliding" if film else "something resists motion in proportion to speed",
        of.show(name, "N s/m"),
        f"Add {'a film under the base, which resists turning as well,' if film else 'linear damping'} of "
        f"{number(of[name])} N s/m.",
        "Let the object coast at different speeds: the deceleration grows with speed.",
    )


def _air_drag(of: _Of) -> Phrase:
    return Phrase(
        "something resists motion with the square of the speed",
        of.show("coefficient_n_s2_per_m2", "N s²/m²"),
        f"Add a force against the velocity of {number(of['coefficient_n_s2_per_m2'])} N s²/m² times speed squared.",
        "Let the object coast from a high speed: it slows down faster the faster it is.",
    )


def _stribeck(of: _Of) -> Phrase:
    word = "higher" if of["change"] > 0 else "lower"
    return Phrase(
        f"friction is {word} at low speed than at high speed",
        f"by {of.show('change', '%', 100, magnitude=True)} below about {of.show('speed_m_s', 'm/s')}",
        f"Multiply friction by 1 + {number(of['change'])} exp(−(v / {number(of['speed_m_s'])} m/s)²).",
        "Pull the object at several steady speeds and compare the forces.",
    )


def _stiction(of: _Of) -> Phrase:
    return Phrase(
        "more force is needed to start the object than to keep it sliding",
        f"friction at rest is {of.show('excess', '%', 100)} above sliding friction",
        f"Set static friction to {number(1 + of['excess'])} times sliding friction.",
        "Raise a pull slowly until the object starts, and compare with the force that keeps it going.",
    )


def _friction_patch(of: _Of) -> Phrase:
    word, less = ("more slippery", "lower") if of["change"] < 0 else ("less slippery", "higher")
    return Phrase(
        f"the floor is {word} in one place",
        f"friction {of.show('change', '%', 100, magnitude=True)} {less} within {of.long('radius_m')} of {of.place()}",
        f"Multiply friction by {number(1 + of['change'])} within {number(of['radius_m'])} m of {of.place()}.",
        f"Look at the floor around {of.place()}: dirt, wear, another material.",
    )


def _contact_pressure(of: _Of) -> Phrase:
    where = "the rim" if of["share"] > 0 else "the middle"
    return Phrase(
        f"the load bears on {where} of the base more than believed",
        f"concentration {of.show('share')}, where 0 is even",
        f"Let {where} of the base carry more of the load (`share` {number(of['share'])} in corrected.yaml).",
        "Put the object on carbon paper, or look at the wear of its base.",
    )


def _rotational_damping(of: _Of) -> Phrase:
    return Phrase(
        "something resists turning in proportion to the yaw rate",
        of.show("coefficient_n_m_s", "N m s"),
        f"Add rotational damping of {number(of['coefficient_n_m_s'])} N m s about the vertical.",
        "Spin the object and watch how its yaw rate falls.",
    )


def _floor_tilt(of: _Of) -> Phrase:
    return Phrase(
        "the floor is not level",
        f"it slopes by {of.angle('angle_rad')}, downhill towards {of.angle('downhill_rad')} from the x axis",
        f"Tilt gravity by {number(of['angle_rad'] * DEGREES)}° towards {number(of['downhill_rad'] * DEGREES)}° from "
        "the x axis.",
        "Put a spirit level on the floor.",
    )


def _wind(of: _Of) -> Phrase:
    return Phrase(
        "a constant force acts from outside",
        f"{of.show('force_n', 'N')} towards {of.angle('direction_rad')} from the x axis",
        f"Add a constant force of {number(of['force_n'])} N towards {number(of['direction_rad'] * DEGREES)}° from the "
        "x axis.",
        "Look for a draught, a cable that pulls, a magnet; put a spirit level on the floor to rule out a slope.",
    )


def _tether(of: _Of) -> Phrase:
    return Phrase(
        "something pulls the object towards a fixed point like a spring",
        f"{of.show('stiffness_n_per_m', 'N/m')} towards {of.place()}, slack below {of.long('rest_length_m')}",
        f"Add a spring of {number(of['stiffness_n_per_m'])} N/m and rest length {number(of['rest_length_m'])} m to the "
        f"point {of.place()}.",
        "Look for a cable or hose that pulls.",
    )


def _mass_leak(of: _Of) -> Phrase:
    word = "loses" if of["share_per_s"] > 0 else "gains"
    return Phrase(
        f"the object {word} mass during an episode",
        f"{of.show('share_per_s', '%', 100, magnitude=True)} of it per second",
        f"Let the mass change by {number(-100 * of['share_per_s'])} % per second from the start of an episode.",
        "Weigh the object before and after an episode.",
    )


def _actuator_gain(of: _Of) -> Phrase:
    word = "stronger" if of["gain"] > 1 else "weaker"
    return Phrase(
        f"the push is {word} than commanded",
        f"{of.show('gain')} times the command",
        f"Multiply every commanded force by {number(of['gain'], 4)}.",
        "Push against a force gauge and compare with the command.",
    )


def _actuator_delay(of: _Of) -> Phrase:
    return Phrase(
        "the push comes later than commanded",
        f"by {of.show('delay_s', 'ms', 1e3)}",
        f"Delay every command by {number(1e3 * of['delay_s'])} ms.",
        "Compare the time stamps of a command and of the first motion after it, filmed with one clock in view.",
    )


def _actuator_lag(of: _Of) -> Phrase:
    return Phrase(
        "the push follows the command with a lag",
        f"time constant {of.show('time_constant_s', 'ms', 1e3)}",
        f"Pass the command through a first-order lag of {number(1e3 * of['time_constant_s'])} ms.",
        "Record the force after a step of the command with a force gauge.",
    )


def _actuator_saturation(of: _Of) -> Phrase:
    return Phrase(
        "the push is limited",
        f"to {of.show('limit_n', 'N')}",
        f"Limit the magnitude of the commanded force to {number(of['limit_n'])} N.",
        "Command the largest push against a force gauge.",
    )


def _application_point_offset(of: _Of) -> Phrase:
    return Phrase(
        "the push acts elsewhere on the object than commanded",
        f"off by ({of.long('x_m')}, {of.long('y_m')}) along the object's own x and y",
        f"Add ({number(of['x_m'])}, {number(of['y_m'])}) m to the commanded point of application, in body axes.",
        "Measure where the pusher really touches the object.",
    )


def _force_misalignment(of: _Of) -> Phrase:
    return Phrase(
        "the push points in another direction than commanded",
        f"turned by {of.angle('angle_rad')} counter-clockwise",
        f"Turn every commanded force by {number(of['angle_rad'] * DEGREES)}° counter-clockwise.",
        "Check the mounting of the pusher, and the axes in which commands are given.",
    )


def _observation_delay(of: _Of) -> Phrase:
    return Phrase(
        "the measured state is older than its time stamp",
        f"by {of.show('delay_s', 'ms', 1e3)}",
        f"Delay the simulated measurement by {number(1e3 * of['delay_s'])} ms, or correct the time stamps.",
        "Measure the latency of the tracker with a motion whose time is known.",
    )


def _sensor_scale(of: _Of) -> Phrase:
    return Phrase(
        "measured lengths are not true to scale",
        f"{of.show('ratio')} times the true ones",
        f"Divide measured positions and velocities by {number(of['ratio'], 4)}.",
        "Move the object along a ruler and compare.",
    )


PHRASES: dict[str, Callable[[_Of], Phrase]] = {
    name.removeprefix("_"): phrase
    for name, phrase in list(globals().items())
    if name.startswith("_") and name.removeprefix("_") in EFFECTS
}


def phrase(effect: str, values: Values, errors: Values, nominal: Nominal) -> Phrase:
    """Return an effect of the vocabulary in words; one without a phrase is described by its label and its values."""
    of = _Of(values, errors, nominal)
    if effect in PHRASES:
        return PHRASES[effect](of)
    amount = listed([f"{name} {of.show(name)}" for name in values])
    return Phrase(label(effect), amount, f"Add {label(effect)}: {amount}." if amount else f"Add {label(effect)}.", "")


def phrases(ranked: Ranked, nominal: Nominal) -> list[Phrase]:
    """Return the phrases of an explanation's effects; none for `none` and `unknown`."""
    return [
        phrase(e, ranked.parameters.get(e, {}), ranked.errors.get(e, {}), nominal)
        for e in ranked.effects
        if e not in (NONE, UNKNOWN)
    ]


def explanation(ranked: Ranked, nominal: Nominal) -> str:
    """Return an explanation in one clause, without a full stop."""
    if not ranked.effects or ranked.effects[0] in (NONE, UNKNOWN):
        return label(ranked.effects[0] if ranked.effects else NONE)
    found = phrases(ranked, nominal)
    if len(found) == 1:
        return f"{found[0].what}: {found[0].amount}" if found[0].amount else found[0].what
    parts = [f"{p.what} ({p.amount})" if p.amount else p.what for p in found]
    count = {2: "two", 3: "three"}.get(len(parts), str(len(parts)))
    return f"{count} things differ from the model: {listed(parts)}"


def gain(
    gap_closed: float | None, applied: str = "With it", *, held_out: bool = True, closable: float | None = None
) -> str:
    """Return how much less the simulator misses once it is corrected; empty: not known.

    `closable` is the share of what can be closed (what is missed less the noise, mean squares).
    """
    if gap_closed is None or not math.isfinite(gap_closed):
        return ""
    where = " on episodes that were not fitted" if held_out else ""
    if gap_closed < 0.005:
        return f"{applied} the simulator does not come closer{where}."
    left = ""
    if closable is not None and math.isfinite(closable):
        left = (
            "; what is left is the noise of the measurement"
            if closable >= NOISE_LEFT
            else f"; of what can be closed, all but the noise, that is {percent(closable)} (mean squares)"
        )
    return f"{applied} the simulator misses {percent(gap_closed)} less{where}{left}."


def verdict(diagnosis: Diagnosis) -> str:
    """Return what was found, in one or two sentences; the same in report, log and terminal."""
    top = likeliest(diagnosis)
    chance = f"(probability {probability(top.probability)})"
    nominal = diagnosis.recording.nominal
    found = [r for r in ordered(diagnosis) if r.effects and r.effects[0] not in (NONE, UNKNOWN)]
    several = len(top.effects) > 1
    with_it = gain(
        diagnosis.gap_closed,
        "With them" if several else "With it",
        held_out=bool(diagnosis.held_out),
        closable=diagnosis.closure.closable_closed,
    )
    if _is(top, NONE):
        tail = (
            f" The likeliest alternative is {title(found[0].effects)} (probability "
            f"{probability(found[0].probability)})."
            if found and found[0].probability > NOTEWORTHY
            else ""
        )
        over = (
            ""
            if diagnosis.nominal_excess < OVER
            else (f" (mean square {1 + diagnosis.nominal_excess:.2f} times the noise's: small errors of any simulator)")
        )
        return f"The simulator as believed will do: what it misses needs no effect to explain it{over} {chance}.{tail}"
    if _is(top, UNKNOWN):
        sentence = f"Something is going on that none of the known effects explains {chance}."
        if not found:
            return sentence
        nearest = gain(
            found[0].gap_closed,
            f"With the nearest of them, {title(found[0].effects)},",
            held_out=bool(diagnosis.held_out),
        )
        return f"{sentence} {nearest}".strip()
    text = explanation(top, nominal)
    if top.probability < HALF:
        rivals = [r for r in ordered(diagnosis)[1:] if r.probability > NOTEWORTHY][:2]
        others = listed([f"{title(r.effects)} ({probability(r.probability)})" for r in rivals], "or")
        but = f", but it may also be {others}" if rivals else ""
        return f"This recording does not settle it. Likeliest {chance}{but}: {text}."
    return f"{text[0].upper()}{text[1:]} {chance}. {with_it}".strip()


def confounded(diagnosis: Diagnosis) -> str:
    """Return which explanations these data can't tell from the first, and what comes near; empty: there is nothing."""
    top = likeliest(diagnosis)
    others = equals(top)
    parts = []
    if others:
        names = listed([title(e) for e in others], "or")
        parts.append(
            f"These data would fit {names} just as well: nothing in the recording tells it from {title(top.effects)}."
        )
    known = {n for e in others for n in e}
    for r in diagnosis.rivals if settled(diagnosis) else ():
        if r.confounded and r.rival not in known:
            parts.append(f"Such data can hardly tell {title((r.rival,))} from {title((r.effect,))}.")
    return " ".join(parts)


def equals(ranked: Ranked) -> list[tuple[str, ...]]:
    """Return the other explanations that the data can't tell from this one, without the one that holds nothing."""
    return [e for e in ranked.equivalent if e and e != (NONE,)]


def ordered(diagnosis: Diagnosis) -> list[Ranked]:
    """Return all explanations, likeliest first."""
    return sorted(diagnosis.ranked, key=lambda r: -r.probability)


def likeliest(diagnosis: Diagnosis) -> Ranked:
    """Return the likeliest explanation."""
    return ordered(diagnosis)[0]


def _is(ranked: Ranked, word: str) -> bool:
    return tuple(ranked.effects) == (word,) or (word == NONE and not ranked.effects)


def settled(diagnosis: Diagnosis) -> bool:
    """Whether the likeliest explanation names effects that one can put into a simulator."""
    return not _is(likeliest(diagnosis), NONE) and not _is(likeliest(diagnosis), UNKNOWN)


def next_steps(diagnosis: Diagnosis) -> list[str]:
    """Return what to do next, most useful first, one or two sentences each."""
    top, nominal = likeliest(diagnosis), diagnosis.recording.nominal
    steps: list[str] = []
    if _is(top, NONE):
        steps.append("Keep your model. Nothing in this recording asks for a change of it.")
        steps.append("Should it miss elsewhere, record what you care about: other speeds, loads, places on the floor.")
    elif _is(top, UNKNOWN):
        steps.append(
            "Look below at where and when the simulator misses, and at the force that is missing: regime, "
            "place, heading, speed and time of the gap are the best hint at its cause."
        )
        steps.append("Check the recording itself: time stamps, axes, calibration, whether anything touched the object.")
    else:
        found = phrases(top, nominal)
        steps.append(
            " ".join(p.remedy for p in found) + " The corrected model is ready in corrected.yaml (and model.xml, "
            "for use within runner), in the folder of this report."
        )
        if equals(top):
            others = listed([title(e) for e in equals(top)], "or")
            steps.append(
                f"Decide between {title(top.effects)} and {others} by a measurement of another kind: "
                "more recordings like this one can't."
            )
        checks = [p.check for p in found if p.check]
        for names in equals(top):
            checks += [c for n in names if (c := phrase(n, {}, {}, nominal).check) and "?" not in c and c not in checks]
        steps.append("Confirm it by hand. " + " ".join(checks))
    if diagnosis.next_push:
        text = diagnosis.next_push.strip()
        steps.append(f"Next push: {text}" + ("" if text.endswith((".", "!")) else "."))
    if top.probability < SURE:
        steps.append(
            "The answer is likely, not certain: record more episodes, with stronger and more varied pushes, "
            "and diagnose all of them together."
        )
    if settled(diagnosis):
        steps.append(
            "Record again, other pushes than before, and let the corrected model predict them: "
            "`runner gap recording=NEW model=corrected.yaml` should show the noise and no more."
        )
    return steps
