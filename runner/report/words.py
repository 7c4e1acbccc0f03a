"""Sentences: what a diagnosis found, in words that need no knowledge of the tool.

Every effect of the vocabulary has a `Phrase`: what is the case, by how much, what to put into one's simulator, and how
to check it with one's own hands. The verdict sentence at the top of the report is made of these.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
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


def phrase(system: AbstractSystem, effect: str, values: Numbers, errors: Numbers) -> Phrase:
    """Return an effect of a system's vocabulary in words; of its variants the one that has parameters of these names."""
    variants = system.vocabulary.by_name[effect]
    known = [{f.name for f in fields(v.effect)} for v in variants]  # type: ignore[arg-type]
    candidate = next(v for v, names in zip(variants, known, strict=True) if set(values) <= names)
    return candidate.effect.phrase(Values(values, errors), system.recording.nominal, candidate.target)


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
