"""The fits of one size that a search goes on with: the best of each explanation, carried on until they rest."""

from __future__ import annotations

from collections.abc import Sequence, Set

import numpy as np

from runner.inference.contender import Contender, least_gain
from runner.inference.evidence import clip
from runner.inference.least_squares import Explanation, Fit, Fitter
from runner.inference.parameters import is_possible
from runner.inference.warm_start import Key, key_of
from runner.settings import SETTINGS
from runner.systems.base import AbstractSystem


def worth_of(system: AbstractSystem, count: int, nominal: float, left: float) -> float:
    """Return what an effect has to take off the loss to be worth its name.

    A model's form is never quite right, so a large gap leaves remains that have no cause of their own. Where a machine
    is believed to have no friction at all, though, such a share is more than all else that is wrong with it, which is
    then held against what is left.

    Args:
        system: Of which kind.
        count: How many measurements there are.
        nominal: Loss of the nominal model.
        left: That of the explanation that leaves least so far.
    """
    share = SETTINGS.search.min_gain_share * max(nominal - count, 0.0)
    share = min(share, (1.0 - system.worth_another) * max(left - count, 0.0))
    return least_gain(count) + share


def gain(fit: Fit, contenders: Sequence[Contender]) -> float:
    """Return by how much a fit leaves less than those of fewer of its effects, whichever their variants."""
    names, size = set(fit.explanation.names), len(fit.explanation.candidates)
    simpler = [
        c.fit
        for c in contenders
        if set(c.fit.explanation.names) <= names
        and len(c.fit.explanation.candidates) < size
        and np.isfinite(c.log_posterior)
    ]
    return min(f.total for f in simpler) - fit.total


def with_fit(fits: list[Fit], new: Fit) -> list[Fit]:
    """Add a fit; of one explanation only the fit that leaves least is kept."""
    key = key_of(new.explanation)
    if any(f.total <= new.total for f in fits if key_of(f.explanation) == key):
        return fits
    return [*(f for f in fits if key_of(f.explanation) != key), new]


def finished(fitter: Fitter, fits: list[Fit], count: int, leaders: int, *, steps: int) -> list[Fit]:
    """Let the leaders come to rest, in so many steps, so that no further effect gains by what a longer fit would have.

    Whatever is far behind the first of them, once that has come to rest, is left as it is.
    """
    out: list[Fit] = []
    behind, further = SETTINGS.search.lag_gains * SETTINGS.search.min_gain_excess, SETTINGS.fit.behind_share
    for i, fit in enumerate(fits):
        mark = min((f.total for f in out if is_possible(f, fitter.context)), default=np.inf)
        lags = fit.total > mark + behind * count + further * max(mark - count, 0.0)
        if i < leaders and not fit.converged and not lags:
            fit = fitter.fit(fit.explanation, fit.episodes, x=fit.x, near=fit, iterations=steps)
        if i < leaders and not lags and fit.total - count > least_gain(count):
            fit = _from_elsewhere(fitter, fit, count, steps=steps)
        out.append(fit)
    return sorted(out, key=lambda f: f.total)


def _from_elsewhere(fitter: Fitter, fit: Fit, count: int, *, steps: int) -> Fit:
    """Fit anew from what does nearly the same, as long as that takes off what is worth an effect.

    Which of them leads furthest shows in the first steps: that one alone is carried on.
    """
    first, rest = min(SETTINGS.fit.screening_steps, steps), SETTINGS.fit.rest_share
    while True:
        tries = []
        for candidate, part in fit.explanation.parts(fitter.context):
            for vector in candidate.elsewhere(fit.x[part], fitter.context):
                x = fit.x.copy()
                x[part] = clip(candidate, vector, fitter.context)
                tries.append(_towards(fitter, fit, fit.explanation, x, fit, first))
        best = min(tries, key=lambda f: f.total, default=fit)
        if steps > first and not best.converged and best is not fit:
            best = _towards(fitter, fit, best.explanation, best.x, best, steps - first)
        if fit.total - best.total < max(least_gain(count), rest * (fit.total - count)):
            return fit
        fit = best


def _towards(fitter: Fitter, goal: Fit, what: Explanation, x: np.ndarray, near: Fit, steps: int) -> Fit:
    """Fit from parameters, (p,), and start states near a fit's, as long as that may leave as little as a goal."""
    patience = SETTINGS.fit.patience_steps
    return fitter.fit(what, goal.episodes, x=x, near=near, target=goal.total, patience=patience, iterations=steps)


def without_one(
    fitter: Fitter,
    whole: Contender,
    others: Sequence[Contender],
    episodes: Sequence[int],
    ruled_out: Set[Key] = frozenset(),
) -> list[Fit]:
    """Drop each effect of an explanation in turn: what came in first may have stood in for what came later.

    What is left was perhaps fitted before, but had not found the place that it has now: a patch or a tether that is far
    from where it is said to be needs the help of another effect to get there. Returns what is new, or leaves less, of
    what is not ruled out.
    """
    before = {key_of(c.fit.explanation): c.fit.total for c in others}
    count = fitter.measured.count(episodes)
    out = []
    for candidate, part in whole.fit.explanation.parts(fitter.context):
        rest = whole.fit.explanation.without(candidate)
        x = np.delete(whole.fit.x, part)
        reached = before.get(key_of(rest), np.inf)
        if key_of(rest) not in ruled_out and reached - whole.fit.total > least_gain(count):
            fit = _towards(fitter, whole.fit, rest, x, whole.fit, SETTINGS.fit.refit_steps)
            if reached - fit.total > least_gain(count):
                out.append(fit)
    return out
