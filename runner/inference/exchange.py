"""One effect in the place of another, or of two: a mass that is wrong looks like a gain and a damping that are.

Forward selection never comes there where one of the two takes off more by itself, nor does leaving them out one by one.
And a descent that begins where nothing was known of the cause may end far off, where one that begins at the motion that
another effect has found does not. The linear model around a fit says what is left with one or two taken out, the other
put in and all others moved. Those that promise to make up for most of what is lost are fitted (sequential replacement;
Miller 2002, section 3.4).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Set
from itertools import combinations, permutations

import numpy as np

from runner.effects.vocabulary import Candidate
from runner.inference.contender import Contender, least_gain
from runner.inference.leap import vector_at
from runner.inference.least_squares import Explanation, Fit, Fitter, amplitudes
from runner.inference.parameters import bounds
from runner.inference.warm_start import Key, key_of
from runner.numerics.arrays import FloatArray
from runner.settings import SETTINGS

Promise = tuple[float, Explanation, FloatArray]  # the loss that is left in the linear model, of what, where to begin


def one_for_another(
    fitter: Fitter, whole: Contender, reached: Mapping[Key, float], ruled_out: Set[Key] = frozenset()
) -> list[Fit]:
    """Return fits with another effect in the place of one, begun at the motion that was found.

    Args:
        fitter: Of the explanation.
        whole: It, amid the directions of all effects.
        reached: What others have left: what is no further behind than noise could be is not fitted again.
        ruled_out: Single effects that are not put in.
    """
    least = whole.fit.total + least_gain(fitter.measured.count(whole.fit.episodes))
    near = {key for key, total in reached.items() if total < least}

    def may_be_put_in(candidate: Candidate) -> bool:
        # what has a place or a range of its own does much of what another does once it is put there, cause or not
        return not candidate.is_placed(fitter.context) and (candidate,) not in ruled_out

    promised = _promised(fitter, whole, near, 1)
    return _fitted(fitter, whole, (p for p in promised if may_be_put_in(p[1].candidates[-1])))


def one_for_two(fitter: Fitter, whole: Contender, seen: Set[Key]) -> list[Fit]:
    """Return fits with one effect in the place of two.

    Args:
        fitter: Of the explanation.
        whole: It, amid the directions of all effects.
        seen: What has been fitted, and is not fitted again.
    """
    return _fitted(fitter, whole, _promised(fitter, whole, seen, 2))


def _fitted(fitter: Fitter, whole: Contender, promised: Iterator[Promise]) -> list[Fit]:
    """Fit the most promising explanations."""
    fits: dict[Key, Fit] = {}
    for _, explanation, x in sorted(promised, key=lambda promise: promise[0]):
        key = key_of(explanation)
        if key in fits:
            continue
        if len(fits) == SETTINGS.search.most_promising:
            break
        fits[key] = _instead(fitter, whole.fit, explanation, x)
    return list(fits.values())


def other_variants(fitter: Fitter, whole: Contender, seen: Set[Key]) -> list[Fit]:
    """Return fits with the other variant of an effect that has a place in the stead of it and of one effect more.

    Friction that is as believed at rest and falls with speed looks like less friction that rises towards rest. No
    linear model says so, but the variant's numbers are about those of the other.

    Args:
        fitter: Of the explanation.
        whole: It.
        seen: What has been fitted, and is not fitted again.
    """
    fit, fits, done = whole.fit, list[Fit](), set(seen)
    parts = dict(fit.explanation.parts(fitter.context))
    for one, other in permutations(parts, 2):
        if not one.is_placed(fitter.context):
            continue
        rest = fit.explanation.without(one).without(other)
        for variant in fitter.system.vocabulary.by_name[one.name]:
            explanation = rest + Explanation((variant,))
            alike = len(variant.parameters(fitter.context)) == len(one.parameters(fitter.context))
            if variant == one or not alike or not variant.may_join(rest.candidates) or key_of(explanation) in done:
                continue
            done.add(key_of(explanation))
            x = np.concatenate([fit.x[parts[c]] for c in (*rest.candidates, one)])
            fits.append(_instead(fitter, fit, explanation, x))
    return fits


def _instead(fitter: Fitter, fit: Fit, explanation: Explanation, x: FloatArray) -> Fit:
    """Fit what may take the place of a fit, from x, (p,); it is given up where it will not come near that."""
    return fitter.fit(
        explanation,
        fit.episodes,
        x=np.clip(x, *bounds(explanation.parameters(fitter.context))),
        near=fit,
        target=fit.total,
        patience=SETTINGS.fit.patience_steps,
        iterations=SETTINGS.fit.refit_steps,
    )


def _promised(fitter: Fitter, whole: Contender, seen: Set[Key], taken: int) -> Iterator[Promise]:
    """Go through what promises enough in the place of so many effects; of each the last is what is put in."""
    fit, around, own = whole.fit, whole.around, len(whole.fit.x)
    normal = around.gram.sum(axis=0)
    # What has a place is not moved to another by a linear model. Beside an effect that is not there it may have come
    # along, to make up for what that one does wrong: then it goes with it, by its size, wherever it is.
    placed = {c for c, _ in fit.explanation.parts(fitter.context) if c.is_placed(fitter.context)}
    for some in combinations(fit.explanation.parts(fitter.context), taken):
        if placed.issuperset(c for c, _ in some):
            continue
        rest = fit.explanation
        for candidate, _ in some:
            rest = rest.without(candidate)
        out = np.concatenate([np.arange(own)[amplitudes(c, p, fitter.context)] for c, p in some])
        kept = np.setdiff1d(np.arange(own), np.concatenate([np.arange(p.start, p.stop) for _, p in some]))
        without, _ = _least(normal, out, -fit.x[out], kept)
        for candidate, ways in around.ways.items():
            explanation = rest + Explanation((candidate,))
            if not candidate.may_join(rest.candidates) or key_of(explanation) in seen:
                continue
            for way in ways:
                put_in = own + np.array(way)
                left, moved = _least(normal, out, -fit.x[out], np.concatenate([kept, put_in]))
                if without - left > SETTINGS.held_out.most * (without - fit.total):
                    begin = vector_at(candidate, put_in, moved[len(kept) :], around, fitter)
                    yield left, explanation, np.concatenate([fit.x[kept] + moved[: len(kept)], begin])


def _least(normal: FloatArray, out: np.ndarray, moved: FloatArray, free: np.ndarray) -> tuple[float, FloatArray]:
    """Return the least loss with some entries moved by so much and others free, and by how much those move.

    Args:
        normal: Inner products of [entries | residual], (n + 1, n + 1).
        out: Entries that are moved, (o,), by `moved`.
        moved: How far, (o,).
        free: Entries that are free, (f,).
    """
    lost = normal[-1, -1] + 2 * moved @ normal[out, -1] + moved @ normal[np.ix_(out, out)] @ moved
    gradient = normal[free, -1] + normal[np.ix_(free, out)] @ moved
    metric = normal[np.ix_(free, free)] + SETTINGS.fit.information_ridge * np.eye(len(free))
    step = np.asarray(-np.linalg.solve(metric, gradient), dtype=np.float64)
    return float(lost + gradient @ step), step
