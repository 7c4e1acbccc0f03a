"""Search for the explanation: none, one effect, or several by forward selection with a beam.

Around the fits so far every further effect promises a gain (a linear model, one batch of simulations). The promising
ones are fitted; a fit that falls hopelessly behind is not finished. Explanations are then compared by evidence. A
search may begin where an earlier look ended (see `runner.inference.multiple_shooting`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from runner.effects.vocabulary import Candidate, Vocabulary
from runner.inference.evidence import (
    Evidence,
    NormalEquations,
    Sensitivities,
    clip,
    directions,
    evidence,
    joined,
    normal_equations,
    predicted_gain,
    sensitivities,
)
from runner.inference.least_squares import NONE, Explanation, Fit, Fitter

MOST_EFFECTS = 3
BEAM = 2
RESTED = 30  # steps of the nominal fit: where its start states are not at rest, any effect seems to help
CANDIDATES = 8  # fitted per explanation in the beam, from the second effect on
FINISHED = 4  # leaders whose fit is carried on until it rests
SURVEYED = 7  # explanations of one size that are compared by evidence
ONE_MORE = 15.0  # log prior odds against each further effect
# An effect must matter: lower the mean square residual by this, in squared noises, and by this share of what
# the nominal model leaves. Less is what any simulator's own small errors would offer to explain.
WORTH, WORTH_SHARE = 0.03, 0.004
STALLED = 0.5  # of what fewer effects left: where a second one leaves more than that, it is not a third that is missing
NEAR = 1000.0  # log odds within which an explanation is worth adding to
SETTLED = 0.03  # of the nominal model's excess: where the leader leaves less, nothing else is worth adding to
CLOSE, FEWEST = 0.5, 5  # squared noises: where the nominal model leaves less, promises hold; so many are fitted anyway
# Sizes, in prior widths, at which an effect that makes the motion jump is tried; and how far, and how often, its fit is
# taken over the edges of its hollow, once it has explained such a share.
SIZES, OVER, CLIMBS, PART = np.geomspace(0.15, 4.0, 14), (0.85, 1.1, 1.3), 3, 0.2
CLIMBED, CLIMB_STEPS = 0.02, 5  # share that a climb has to take off to be followed by another; steps of its fits
# Of the nominal model's excess: where a fit leaves less, and no more than the noise, promises of further effects hold.
LINEAR = 0.1
OFFERED = 0.25  # of `worth`: near a good fit, an effect that promises less is not tried
Key = tuple[Candidate, ...]


@dataclass(frozen=True)
class Contender:
    """A fitted explanation amid its surroundings, and its evidence.

    `log_posterior` includes the prior odds against many effects, and against effects that hardly matter.
    """

    fit: Fit
    around: NormalEquations = field(repr=False)
    evidence: Evidence
    log_posterior: float
    gains: dict[Candidate, tuple[float, np.ndarray]] = field(repr=False)


@dataclass(frozen=True)
class WarmStart:
    """Where a fit may begin: an explanation, its parameters, (p,), start states, (E, S), and the loss there."""

    explanation: Explanation
    x: np.ndarray
    starts: np.ndarray
    total: float


@dataclass(frozen=True)
class Beginning:
    """What an earlier look left: seeds by their effects, and single effects that are not to be tried alone again."""

    seeds: dict[Key, WarmStart] = field(default_factory=dict)
    ruled_out: frozenset[Key] = frozenset()


@dataclass(frozen=True)
class Search:
    """All contenders, likeliest first, and the fit of the nominal model."""

    contenders: tuple[Contender, ...]
    nominal: Fit

    @property
    def best(self) -> Contender:
        """The likeliest."""
        return self.contenders[0]


def search(
    fitter: Fitter,
    episodes: Sequence[int],
    *,
    most: int = MOST_EFFECTS,
    starts: np.ndarray | None = None,
    beginning: Beginning | None = None,
    pieces: bool = False,
) -> Search:
    """Fit and compare explanations of up to `most` effects on these episodes.

    `starts` are start states to begin with, (E, S). `pieces` says that they are pieces of episodes: short, so that few
    steps will do.
    """
    every = directions(fitter.system)
    nominal = fitter.fit(NONE, episodes, starts=starts, iterations=RESTED)
    count = fitter.measured.count(episodes)
    seeds, ruled_out = ({}, frozenset()) if beginning is None else (dict(beginning.seeds), beginning.ruled_out)
    alone = sensitivities(fitter, nominal, every)
    contenders = [contend(fitter, nominal, alone)]
    worth = WORTH * count + WORTH_SHARE * max(nominal.total - count, 0.0)

    def worthy(fit: Fit, *known: Sensitivities) -> Contender:
        contender = contend(fitter, fit, *known)
        lacks = worth - (nominal.total - fit.total) if len(fit.explanation.candidates) == 1 else 0.0
        return replace(contender, log_posterior=contender.log_posterior - 0.5 * max(lacks, 0.0))

    beam, seen = contenders[:1], {NONE.candidates}
    candidates = FEWEST if pieces else CANDIDATES
    for size in range(1, most + 1):
        fits: list[Fit] = []
        reached = [s.total for s in seeds.values()] + [c.fit.total for c in contenders if size > 1]
        target = min(reached, default=np.inf)
        for contender in beam:
            offers = _offers(contender, fitter)
            left = contender.fit.total - count
            if size == 1 and pieces:
                nonlinear = {o[1] for o in offers if o[1].effect.discontinuous or len(o[1].starts(fitter.context))}
                offers = [o for i, o in enumerate(offers) if i < CANDIDATES or o[1] in nonlinear]
            elif size == 1 and left < CLOSE * count:
                offers = [o for i, o in enumerate(offers) if i < FEWEST or o[0] > OFFERED * worth]
            elif size > 1:
                if left < worth:
                    continue  # nothing is left that would be worth an effect
                if left < min(LINEAR * (nominal.total - count), count):
                    offers = [o for o in offers[:candidates] if o[0] > OFFERED * worth]
                else:
                    # far from a good fit the linear promise misleads: the commonest effects are always tried
                    offers = [o for i, o in enumerate(offers) if i < candidates or o[1].effect.common]
            for _, candidate, vector in offers:
                explanation, x = joined(contender.fit, candidate, vector)
                key = key_of(explanation)
                # what has a place may have missed it without what is in now
                anew = size > 1 and left > CLOSE * count and len(candidate.starts(fitter.context)) > 0
                if key in ruled_out or (key in seen and not anew):
                    continue
                seen.add(key)
                fit = fitter.fit(
                    explanation,
                    episodes,
                    **_beginning(fitter, explanation, x, contender.fit, seeds.pop(key, None)),
                    target=target,
                    # what begins at a place or a range of its own has some way to go before it can be judged
                    patience=0 if size == 1 and not len(candidate.starts(fitter.context)) else 1 if pieces else 3,
                    iterations=8 if size == 1 or pieces else 12,
                    polish=False,
                )
                if candidate.effect.discontinuous and fit.total - count > CLOSE * count:
                    fit = _over_edges(fitter, fit, contender.fit)
                if size == 1 or _gain(fit, contenders) > worth:
                    fits = _with(fits, fit)
                    target = min(target, fit.total)
        for key in [k for k in seeds if len(k) == size]:
            seed = seeds.pop(key)
            seen.add(key)
            begin = _beginning(fitter, seed.explanation, seed.x, nominal, seed)
            fit = fitter.fit(
                seed.explanation, episodes, **begin, target=target, patience=3, iterations=12, polish=False
            )
            if size > 1 and _gain(fit, contenders) <= worth:
                continue
            fits = _with(fits, fit)
            target = min(target, fit.total)
        if not fits:
            if any(len(key) > size for key in seeds):
                continue  # where several are far ahead of each alone, only they come from before
            break
        fits = _finished(fitter, sorted(fits, key=lambda f: f.total), count, BEAM if pieces else FINISHED)
        around_best = sensitivities(fitter, fits[0], every)
        new = [worthy(fit, around_best, alone) for fit in fits[:SURVEYED]]
        best = max(c.log_posterior for c in contenders)
        left_before = min(c.fit.total for c in contenders) - count
        contenders += new
        new.sort(key=lambda c: -c.log_posterior)
        if size > 1:
            least = min(new, key=lambda c: c.fit.total)
            for whole in () if pieces else {id(c): c for c in (least, new[0])}.values():
                for fit in _without_one(fitter, whole, contenders, episodes):
                    fewer, key = worthy(fit, around_best, alone), key_of(fit.explanation)
                    seen.add(key)
                    others = [c for c in contenders if key_of(c.fit.explanation) != key]
                    same = [c for c in contenders if key_of(c.fit.explanation) == key]
                    # a fit that found a better place takes the place of the one before
                    if all(fewer.log_posterior >= c.log_posterior for c in same):
                        contenders = [*others, fewer]
                        new = [*(c for c in new if key_of(c.fit.explanation) != key), fewer]
            new.sort(key=lambda c: -c.log_posterior)
            if new[0].log_posterior < best:
                break
        if size > 1 and min(c.fit.total for c in new) - count > STALLED * left_before > worth:
            break
        beam = []
        for contender in new:
            if beam and beam[0].fit.total - count < SETTLED * (nominal.total - count):
                break
            near = contender.log_posterior > new[0].log_posterior - NEAR
            if near and len(beam) < BEAM and not any(are_confounded(contender.fit, b.fit) for b in beam):
                beam.append(contender)
    contenders.sort(key=lambda c: -c.log_posterior)
    return Search(tuple(contenders), nominal)


def resumed(before: Search, fitter: Fitter) -> Beginning:
    """Return where a search of the same episodes with another account of the noise begins: where the last one ended."""
    near = [c for c in before.contenders if c.log_posterior > before.best.log_posterior - NEAR]
    fits = [c.fit for c in near if c.fit.explanation.candidates]
    tried = {key_of(f.explanation) for f in fits}
    seeds = {
        key_of(f.explanation): WarmStart(
            f.explanation, f.x, f.starts, fitter.loss(f.explanation, f.x, f.starts, f.episodes)
        )
        for f in fits
    }
    return Beginning(seeds, singles(fitter.system.vocabulary) - tried)


def _beginning(
    fitter: Fitter, explanation: Explanation, x: np.ndarray, near: Fit, seed: WarmStart | None
) -> dict[str, Any]:
    """Return where to begin a fit: from what is near, or from the seed where that leaves less."""
    if seed is None:
        new = explanation.candidates[-1]
        if new.effect.discontinuous:
            return {"x": _sized(fitter, explanation, x, near), "near": near}
        if len(new.starts(fitter.context)):
            # the amplitude that a linear model promises may overshoot; none of it is the fit that is near
            amplitude = len(x) - len(new.parameters(fitter.context))
            for _ in range(3):
                if fitter.loss(explanation, x, near.starts, near.episodes) < near.total:
                    break
                x = np.concatenate([x[:amplitude], x[amplitude : amplitude + 1] / 4, x[amplitude + 1 :]])
        return {"x": x, "near": near}
    seeded = _in_order(seed, explanation, fitter)
    by = [fitter.loss(explanation, v, s, near.episodes) for v, s in ((x, near.starts), (seeded, seed.starts))]
    return {"x": seeded, "starts": seed.starts} if by[1] < by[0] else {"x": x, "near": near}


def _sized(fitter: Fitter, explanation: Explanation, x: np.ndarray, near: Fit) -> np.ndarray:
    """Return the size of the last effect, of one parameter, that leaves least at the start states of a fit nearby."""

    def left(size: float) -> float:
        return fitter.loss(explanation, np.append(x[:-1], size), near.starts, near.episodes)

    sizes = SIZES * explanation.candidates[-1].parameters(fitter.context)[0].scale
    i = int(np.argmin([left(s) for s in sizes]))
    finer = np.linspace(sizes[max(i - 1, 0)], sizes[min(i + 1, len(sizes) - 1)], len(sizes))
    return np.append(x[:-1], min((x[-1], *finer), key=left))


def _over_edges(fitter: Fitter, fit: Fit, without: Fit) -> Fit:
    """Fit anew from other sizes of the last effect, at some of which the motion jumps, as long as that gains.

    Descents end where a push just starts the body, or just doesn't.
    """
    count = fitter.measured.count(fit.episodes)
    if fit.total - count > (1.0 - PART) * (without.total - count):
        return fit
    for _ in range(CLIMBS):
        sizes = [np.append(fit.x[:-1], fit.x[-1] * by) for by in OVER]
        tries = [
            fitter.fit(fit.explanation, fit.episodes, x=x, near=fit, iterations=CLIMB_STEPS, polish=False)
            for x in sizes
        ]
        best = min(tries, key=lambda f: f.total)
        if best.total - count > (1.0 - CLIMBED) * (fit.total - count):
            break
        fit = best
    return fit


def _in_order(seed: WarmStart, explanation: Explanation, fitter: Fitter) -> np.ndarray:
    """Return a seed's parameters in the order of an explanation of the same effects."""
    parts = dict(seed.explanation.parts(fitter.context))
    return np.concatenate([seed.x[parts[c]] for c in explanation.candidates])


def _gain(fit: Fit, contenders: Sequence[Contender]) -> float:
    """Return by how much a fit leaves less than those of fewer of its effects, whichever their variants."""
    names, size = set(fit.explanation.names), len(fit.explanation.candidates)
    simpler = [
        c.fit for c in contenders if set(c.fit.explanation.names) <= names and len(c.fit.explanation.candidates) < size
    ]
    return min(f.total for f in simpler) - fit.total


def _with(fits: list[Fit], new: Fit) -> list[Fit]:
    """Add a fit; of one explanation only the fit that leaves least is kept."""
    key = key_of(new.explanation)
    if any(f.total <= new.total for f in fits if key_of(f.explanation) == key):
        return fits
    return [*(f for f in fits if key_of(f.explanation) != key), new]


def _finished(fitter: Fitter, fits: list[Fit], count: int, leaders: int) -> list[Fit]:
    """Let the leaders come to rest, so that no further effect gains by what a longer fit would have.

    Whatever is far behind the first of them, once that has come to rest, is left as it is.
    """
    out: list[Fit] = []
    for i, fit in enumerate(fits):
        lags = out and fit.total > out[0].total + 5 * WORTH * count + 0.5 * max(out[0].total - count, 0.0)
        if i < leaders and not fit.converged and not lags:
            fit = fitter.fit(fit.explanation, fit.episodes, x=fit.x, near=fit, iterations=20)
        out.append(fit)
    return sorted(out, key=lambda f: f.total)


def _without_one(fitter: Fitter, whole: Contender, others: Sequence[Contender], episodes: Sequence[int]) -> list[Fit]:
    """Drop each effect of an explanation in turn: what came in first may have stood in for what came later.

    What is left was perhaps fitted before, but had not found the place that it has now: a patch or a tether that is far
    from where it is said to be needs the help of another effect to get there. Returns what is new, or leaves less.
    """
    before = {key_of(c.fit.explanation): c.fit.total for c in others}
    count = fitter.measured.count(episodes)
    out = []
    for candidate, part in whole.fit.explanation.parts(fitter.context):
        rest = Explanation(tuple(c for c in whole.fit.explanation.candidates if c != candidate))
        x = np.delete(whole.fit.x, part)
        reached = before.get(key_of(rest), np.inf)
        if reached - whole.fit.total > WORTH * count:
            fit = fitter.fit(rest, episodes, x=x, near=whole.fit, target=whole.fit.total, patience=3, iterations=25)
            if reached - fit.total > WORTH * count:
                out.append(fit)
    return out


def key_of(explanation: Explanation) -> Key:
    """Return an explanation's effects in an order of their own."""
    return tuple(sorted(explanation.candidates, key=lambda c: c.key))


def are_confounded(a: Fit, b: Fit) -> bool:
    """Whether two explanations differ only by effects that such recordings can't tell apart."""

    def plain(fit: Fit) -> list[tuple[str, str]]:
        return sorted(
            (min((c.effect.name, *(o.name for o in c.effect.confounded))), c.target or "")
            for c in fit.explanation.candidates
        )

    return plain(a) == plain(b)


def singles(vocabulary: Vocabulary) -> frozenset[Key]:
    """Return all explanations of one effect."""
    return frozenset((candidate,) for candidate in vocabulary)


def _offers(contender: Contender, fitter: Fitter) -> list[tuple[float, Candidate, np.ndarray]]:
    """Every effect that is not in yet, nor told apart from one that is, most promising first, with a start vector."""
    held = contender.fit.explanation.candidates
    taken = {c.name for c in held}
    alike = {(o.name, c.target) for c in held for o in c.effect.confounded}
    out = []
    for candidates in fitter.system.vocabulary.by_name.values():
        for candidate in candidates:
            if candidate.name in taken or (candidate.effect.name, candidate.target) in alike:
                continue
            if candidate in contender.gains:
                gain, vector = contender.gains[candidate]
                out.append((gain, candidate, clip(candidate, vector, fitter.context)))
    return sorted(out, key=lambda o: -o[0])


def contend(fitter: Fitter, fit: Fit, *known: Sensitivities, against: float = 0.0) -> Contender:
    """Return a fit as a contender; `against` are prior log odds that it has against it beside those of its size."""
    around = normal_equations(fit, *known)
    found = evidence(around, fitter.system)
    size = len(fit.explanation.candidates)
    gains = predicted_gain(around, fitter.system.screening_level)
    return Contender(fit, around, found, found.log - ONE_MORE * size - against, gains)
