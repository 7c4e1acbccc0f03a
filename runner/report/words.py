"""Sentences: what a diagnosis found, in words that need no knowledge of the tool.

Every effect of a vocabulary has a `Phrase`: what is the case, by how much, what to put into one's simulator, and how
to check it with one's own hands. The verdict sentence at the top of the report is made of these, and of the statement
that all of a report is made of (`runner.report.statement`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from typing import TYPE_CHECKING

from runner.effects.base import Phrase
from runner.effects.vocabulary import Candidate, spoken
from runner.effects.wording import Values, listed, number, percent, probability
from runner.report.statement import NONE, UNKNOWN, Kind, Left, Statement, state
from runner.settings import SETTINGS

if TYPE_CHECKING:
    from runner.diagnosis.result import Diagnosis, Ranked
    from runner.systems.base import AbstractSystem

Numbers = Mapping[str, float]
LEAST_SHARE = 0.005  # of anything: less is told as nothing
PLACE = {"x_m", "y_m", "radius_m"}  # of an effect that is somewhere
WHOLE_S = 10.0  # from here on seconds are told without decimals
LITTLE = 0.095  # over the noise: more is told as so many times the noise, 1.1 and up

CAUSES = {  # of what is left
    Left.SMALL_ERRORS: "small errors of any simulator",
    Left.DRIVE: "noise of the measured force",
    Left.SOMETHING: "something else",
}
SLOWLY = "noise of a recorded force or command makes it, or a small error of the model"


def title(effects: Sequence[str]) -> str:
    """Return effect names as they are read: `joint friction of elbow + gravity`."""
    return " + ".join(spoken(e) for e in effects)


def label(system: AbstractSystem, effect: str, values: Numbers) -> str:
    """Return what a word of a system's vocabulary means, without numbers; `values` tell of which variant it is."""
    if effect == NONE:
        return "nothing that matters differs from the model"
    if effect == UNKNOWN:
        return "something that no known effect explains"
    candidate = _variant(system, effect, values)
    target = listed(candidate.targets) or candidate.target
    return candidate.effect.label + (f" ({target})" if target else "")


def _variant(system: AbstractSystem, effect: str, values: Numbers) -> Candidate:
    variants = system.vocabulary.by_name[effect]
    known = [{f.name for f in fields(v.effect)} for v in variants]
    return next(v for v, names in zip(variants, known, strict=True) if set(values) <= names)


def phrase(system: AbstractSystem, effect: str, values: Numbers, errors: Numbers) -> Phrase:
    """Return an effect of a vocabulary in words; of its variants the one that has parameters of these names."""
    candidate = _variant(system, effect, values)
    told = [candidate.effect.phrase(Values(values, errors), system.beliefs, c.target) for c in candidate.each]
    of_first = told[0]
    if _placed_nowhere(values, errors):
        of_first = replace(of_first, amount="where and how much can't be told")
    if not candidate.targets:
        return of_first
    others = listed(candidate.targets[1:])
    alike = len({p.amount for p in told}) == 1
    # what is to be set may hang on what is believed of each: then each has a sentence of its own
    remedies = [_nameless(p.remedy, t) for p, t in zip(told, candidate.targets, strict=True)]
    same = f"{of_first.remedy} The same for {others}." if of_first.remedy else ""
    return replace(
        of_first,
        what=f"{of_first.what}, and so it is with {others}",
        amount=of_first.amount if alike else of_first.amount_of_all or of_first.amount,
        remedy=same if len(set(remedies)) == 1 else " ".join(p.remedy for p in told),
    )


def _nameless(text: str, target: str) -> str:
    """Return text without the name of its target where that stands in quotes."""
    return text.replace(f"'{target}", "'").replace(f'"{target}', '"')


def phrases(system: AbstractSystem, ranked: Ranked) -> list[Phrase]:
    """Return the phrases of an explanation's effects; none for `none` and `unknown`."""
    return [
        phrase(system, e, ranked.parameters.get(e, {}), ranked.errors.get(e, {}))
        for e in ranked.effects
        if e not in (NONE, UNKNOWN)
    ]


def amounts(system: AbstractSystem, ranked: Ranked) -> list[str]:
    """Return how much of each effect of an explanation, where that can be told; of several with the name of each."""
    told = [p.amount for p in phrases(system, ranked)]
    several = len(told) > 1
    return [f"{spoken(e)}: {a}" if several else a for e, a in zip(ranked.effects, told, strict=bool(told)) if a]


def _placed_nowhere(values: Numbers, errors: Numbers) -> bool:
    """Tell whether an effect has a place and a reach, and the reach may as well be none."""
    return set(values) >= PLACE and not errors.get("radius_m", 0.0) <= values["radius_m"]


def explanation(system: AbstractSystem, ranked: Ranked) -> str:
    """Return an explanation in one clause, without a full stop; what can't be told from it stands beside it."""
    if not ranked.effects or ranked.effects[0] in (NONE, UNKNOWN):
        return label(system, ranked.effects[0] if ranked.effects else NONE, {})
    found, (instead, whole) = phrases(system, ranked), _otherwise(system, ranked)
    told = [
        "; ".join(part for part in (p.amount, _or(instead.get(e, ()))) if part)
        for e, p in zip(ranked.effects, found, strict=True)
    ]
    tail = f"; {_or(whole)}" if whole else ""
    if len(found) == 1:
        return (f"{found[0].what}: {told[0]}" if told[0] else found[0].what) + tail
    parts = [f"{p.what} ({of})" if of else p.what for p, of in zip(found, told, strict=True)]
    count = {2: "two", 3: "three"}.get(len(parts), str(len(parts)))
    return f"{count} things differ from the model: {listed(parts)}{tail}"


def _otherwise(system: AbstractSystem, ranked: Ranked) -> tuple[dict[str, list[str]], list[str]]:
    """Return what can't be told from an explanation: what may stand in the place of each of its effects, and the rest.

    The rest are explanations that differ from it in more than one effect.
    """
    instead: dict[str, list[str]] = {}
    whole, own = [], set(ranked.effects)
    for other in equals(ranked):
        gone, come = sorted(own - set(other)), sorted(set(other) - own)
        if len(gone) == len(come) == 1:
            instead.setdefault(gone[0], []).append(label(system, come[0], {}))
        else:
            whole.append(title(other))
    return instead, whole


def _as_well(ranked: Ranked) -> list[str]:
    """Return what would fit as well as an explanation: of those that differ in one effect, that one alone."""
    out, own = [], set(ranked.effects)
    for other in equals(ranked):
        gone, come = sorted(own - set(other)), sorted(set(other) - own)
        one = len(gone) == len(come) == 1
        out.append(f"{title(come if one else other)} in the place of {title(gone if one else ranked.effects)}")
    return out


def _or(others: Sequence[str]) -> str:
    return f"or, equally well, {listed(others, 'or')}" if others else ""


def gain(said: Statement, applied: str = "With it") -> str:
    """Return how much less the simulator misses once it is corrected, and what is left; empty: not known."""
    if said.closes_nothing_seen and said.settled:
        return _gain_where_fitted(said)
    if said.gap_closed is None:
        return ""
    where = " on episodes that were not fitted" if said.held_out else ""
    if said.gap_closed < LEAST_SHARE:
        return f"{applied} the simulator does not come closer{where}."
    left = ""
    # in the same measure as the share that closed: root mean squares, noise and all
    if said.settled and said.closable_closed is not None:
        if said.in_fitted:
            left = (
                f", where no more than the noise is left; in those that were fitted it is {beyond(said)}{mostly(said)}"
            )
        elif said.left is Left.SOMETHING:
            left = f"; what is left is {beyond(said)}{mostly(said)}"
        elif said.left is Left.SMALL_ERRORS:
            left = f"; of what is left, {beyond(said)}, small errors of any simulator are the likeliest cause"
        elif said.left is Left.DRIVE:
            left = f"; what is left, {beyond(said)}, is no more than the noise of the measured force makes"
        else:
            left = "; what is left is the noise of the measurement"
    closed = closed_beyond(said)
    beyond_it = f"; of what is beyond it, in mean squares, {closed} is closed" if closed else ""
    of = f" ({in_noises(said)} noise levels, the noise itself is 1{beyond_it})" if said.noisy else ""
    return f"{applied} the simulator misses {percent(said.gap_closed)} less{where}{of}{left}."


def closed_beyond(said: Statement) -> str:
    """Return how much of what is beyond the noise is closed, where noise is much of what is missed; else nothing."""
    if not (said.settled and said.noisy and said.closable_closed is not None):
        return ""
    return percent(min(max(said.closable_closed, 0.0), 1.0))


def _gain_where_fitted(said: Statement) -> str:
    """Return how much less the simulator misses where it was fitted, for want of a gap in what was not."""
    levels = f"({in_noises(said)} noise levels)"
    sentence = f"he episodes that were not fitted hardly show a gap that could be closed {levels}"
    sentence = f"T{sentence}" if said.stretch_s is None else f"Replayed {said.stretch_s:.2g} s at a time, t{sentence}"
    if said.fitted_closed is None:
        return f"{sentence}."
    closed = percent(max(said.fitted_closed, 0.0))
    return f"{sentence}; in those that were, {closed} of what is beyond the noise is closed (mean squares)."


def in_noises(said: Statement) -> str:
    """Return what is missed of episodes that were not fitted, as believed and corrected, in noise levels."""
    before, after = said.noises or (math.nan, math.nan)
    return f"{number(before, 2)} → {number(after, 2)}" if said.corrected else number(before, 2)


def verdict(diagnosis: Diagnosis) -> str:
    """Return what was found, in one or two sentences; the same in report, log and terminal."""
    said, system = state(diagnosis), diagnosis.system
    top, others = said.top, equals(said.top)
    of = ", whichever it is" if others else ""
    chance = f"(probability {probability(top.probability)}{of})"
    if said.kind is Kind.NONE:
        tail = (
            f" The likeliest alternative is {title(said.named[0].effects)} (probability "
            f"{probability(said.named[0].probability)})."
            if said.named and said.named[0].probability > SETTINGS.probability.noteworthy
            else ""
        )
        over = "" if said.left is Left.NOISE else f" ({beyond(said)}: {CAUSES[said.left]})"
        return f"The simulator as believed will do: what it misses needs no effect to explain it{over} {chance}.{tail}"
    if said.kind is Kind.UNKNOWN:
        sentence = f"Something is going on that none of the known effects explains {chance}."
        nearest = gain(said, f"With the nearest of them, {title(said.named[0].effects)},") if said.named else ""
        return f"{sentence} {nearest}".strip()
    text = explanation(system, top)
    if said.kind is Kind.OPEN:
        rivals = [r for r in said.order[1:] if r.probability > SETTINGS.probability.noteworthy][:2]
        others = listed([f"{title(r.effects)} ({probability(r.probability)})" for r in rivals], "or")
        but = f", but it may also be {others}" if rivals else ""
        with_it = gain(said, "With the likeliest")
        return f"This recording does not settle it. Likeliest {chance}{but}: {text}. {with_it}".strip()
    with_it = gain(said, _with(said))
    return f"{text[0].upper()}{text[1:]} {chance}. {with_it}".strip()


def _with(said: Statement) -> str:
    """Return what the model is corrected by, as a sentence about the gap begins: what can't be told apart does as much.

    Those make the same motion, so that they need not be simulated one by one.
    """
    others = equals(said.top)
    if len(said.top.effects) > 1:
        return "With them"
    return "With any of these" if len(others) > 1 else "With either" if others else "With it"


def beyond(said: Statement) -> str:
    """Return how much what is left is beyond the noise, in the same measure as the share of the gap that closed."""
    if said.over_noise < LITTLE:
        return f"{percent(said.over_noise)} over the noise"
    return f"{number(1 + said.over_noise, 2)} times the noise"


def mostly(said: Statement) -> str:
    """Return in which episode most of it is left; empty: in none."""
    return "" if said.mostly_in is None else f", most of it in episode {said.mostly_in}"


def left(said: Statement) -> tuple[str, str]:
    """Return what the best model leaves, for a tile: how much, and what that is."""
    much = "noise" if said.left is Left.NOISE else beyond(said) if said.over_noise >= LEAST_SHARE else "a residual"
    what = "what is left" if said.corrected else "what is missed"
    what += " where it was fitted" if said.in_fitted else ""
    return much, what if said.left is Left.NOISE else f"{what}: {CAUSES[said.left]}"


def left_at_large(said: Statement) -> tuple[str, str]:
    """Return what the best model leaves of whole episodes: what to say in bold, and what follows it."""
    over = f", {beyond(said)}" if said.over_noise >= LEAST_SHARE else ""
    over += f" in the episodes that were fitted{mostly(said)}" if said.in_fitted else mostly(said)
    if said.left is Left.NOISE:
        return "Nothing is left", " that would matter"
    if said.left is Left.SMALL_ERRORS:
        return "Small errors are left", f"{over}: such as any simulator has, and nothing to act on"
    if said.left is Left.DRIVE:
        return "The noise of the measured force is left", f"{over}: it is replayed with what its sensor added"
    cause = "no known effect explains it" if said.kind is Kind.UNKNOWN else "part of the gap has another cause"
    return "Something is left", f"{over}: {cause}"


def memory(said: Statement, structured: str, lags: int, count: int) -> str:
    """Return what the portmanteau test says of what the best model leaves, beside what that amounts to.

    Args:
        said: What is left at large.
        structured: The channels in which it finds a memory, in words; empty: there is none.
        lags: Of the test.
        count: Samples of the channel that has most of them.
    """
    test = f"portmanteau test ({lags} lags, {count} samples)"
    if not structured:
        return f"All channels pass the {test}."
    if said.left is not Left.NOISE:
        return f"The {test} finds a memory in {structured}."
    less = f"less than {percent(LEAST_SHARE)}" if said.over_noise < LEAST_SHARE else percent(said.over_noise)
    which = "corrected simulator" if said.corrected else "simulator as believed"
    return (
        f"The {test} still finds a memory in {structured}: of many samples it finds also what is small beside the "
        f"noise. Root mean squares, the {which} misses {less} more than the noise."
    )


def left_in_windows(said: Statement, exceeds: bool, share: str, sentence: str) -> str:
    """Return what the corrected model leaves of short stretches.

    Args:
        said: What is left at large.
        exceeds: Whether short stretches show anything beyond the noise.
        share: Of the excess before the correction, in words; empty: not to be compared.
        sentence: Where it is.
    """
    if not exceeds and said.kind is Kind.UNKNOWN:
        much = f", {beyond(said)}," if said.over_noise >= LEAST_SHARE else ""
        at = "in the episodes that were fitted" if said.in_fitted else "over longer ones"
        return (
            "With the nearest explanation short stretches show no such excess. What is left"
            f"{much} shows {at}, and no known effect explains it."
        )
    if not exceeds:
        tail = f" What is left builds up over longer ones, as {SLOWLY}." if said.left is Left.SOMETHING else ""
        return f"After the correction no such excess over the noise is left in short stretches.{tail}"
    much = f"{share} of the excess over the noise" if share else "an excess over the noise"
    if said.kind is Kind.UNKNOWN:
        return f"With the nearest explanation {much} is left, which no known effect explains: {sentence}."
    if said.left is Left.SOMETHING:
        return f"After the correction {much} is left, with another cause: {sentence}."
    return f"After the correction {much} is left, too little to act on: {sentence}."


def confounded(diagnosis: Diagnosis) -> str:
    """Return which explanations these data can't tell from the first, and what comes near; empty: there is nothing."""
    said = state(diagnosis)
    others = equals(said.top)
    parts = []
    if others:
        parts.append(
            f"These data would fit {listed(_as_well(said.top), 'or')} just as well: nothing in the recording tells "
            "which of them it is."
        )
        if said.settled and said.gap_closed is not None:
            each = "Each" if len(others) > 1 else "Either"
            parts.append(f"{each} closes the gap as far: they make the same motion.")
    known = {n for e in others for n in e}
    rivals: dict[str, list[str]] = {}
    for r in diagnosis.rivals if said.settled else ():
        if r.confounded and r.rival not in known:
            rivals.setdefault(r.effect, []).append(title((r.rival,)))
    if rivals:
        pairs = [f"{listed(those, 'or')} from {title((effect,))}" for effect, those in rivals.items()]
        parts.append(f"Such data can hardly tell {'; nor '.join(pairs)}.")
    return " ".join(parts)


def effort(diagnosis: Diagnosis) -> str:
    """Return how long a diagnosis took, by the clock and of the processor, and how much was simulated in it."""
    wall, cpu = (f"{s:.0f}" if s >= WHOLE_S else number(s, 2) for s in (diagnosis.wall_s, diagnosis.cpu_s))
    return (
        f"{wall} s of wall time, and {cpu} s of CPU time in all threads together, in which "
        f"{number(diagnosis.simulated_s)} s of motion were simulated; starting the program and writing the report "
        "come on top"
    )


def equals(ranked: Ranked) -> list[tuple[str, ...]]:
    """Return the other explanations that the data can't tell from this one, without the one that holds nothing."""
    return [e for e in ranked.equivalent if e and e != (NONE,)]


def equals_with_amounts(system: AbstractSystem, ranked: Ranked) -> list[str]:
    """Return those explanations, each with how much of what this one does not hold it would be."""
    out = []
    for names in equals(ranked):
        parameters, errors = ranked.equal_numbers.get(names, ({}, {}))
        # what a trial alone has told comes without errors, and how well it is known is part of how much it is
        other = [e for e in names if e not in ranked.effects and e in errors]
        told = [p.amount for e in other if (p := phrase(system, e, parameters[e], errors[e])).amount]
        out.append(title(names) + (f" ({'; '.join(told)})" if told else ""))
    return out
