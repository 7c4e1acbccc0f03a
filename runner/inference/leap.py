"""Leap to several effects at once: what the linear model around a fit says would account for what it leaves.

One effect after the other, each with fits of its own, costs a mechanism with six joints thousands of simulations, and
the first that is taken may be one that stands in for two others. The linear model has all directions already: forward
selection in it, and a check whether each that was chosen is still needed beside the others (stepwise regression,
Efroymson 1960), cost no simulation at all. Only the set that comes out is fitted, and from there the next leap is made:
what is nonlinear shows by then. What a leap has found is where the search begins, not its answer.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence, Set
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from runner.effects.vocabulary import Candidate
from runner.inference.evidence import (
    Direction,
    NormalEquations,
    Sensitivities,
    clip,
    directions,
    moved_by,
    normal_equations,
    sensitivities,
    trusted,
)
from runner.inference.least_squares import Explanation, Fit, Fitter
from runner.inference.parameters import is_out_of_range, is_possible
from runner.inference.shortlist import worth_of
from runner.settings import SETTINGS


def leap(
    fitter: Fitter, fit: Fit, every: Sequence[Direction], known: Sensitivities, worth_beside: Callable[[float], float]
) -> tuple[Fit, tuple[Fit, Sensitivities]]:
    """Return the fit that leaps from a fit lead to, each of which leaves less; the fit itself, where none does.

    And the last fit around which all directions were simulated, with what they do there: mostly the same one.

    Args:
        fitter: Of the episodes.
        fit: Where to begin.
        every: All directions.
        known: What they do around the fit.
        worth_beside: What an effect has to take off the loss where so much is left.
    """
    surveyed, barred = fit, set[Candidate]()
    for _ in range(SETTINGS.leap.max_leaps):
        room = min(fitter.system.most_effects - len(fit.explanation.candidates), SETTINGS.leap.max_effects)
        if not room:
            break
        if surveyed is not fit:
            surveyed, known = fit, sensitivities(fitter, fit, every)
        worth = worth_beside(fit.total)
        extra = chosen(normal_equations(fit, known), fitter, room, worth, barred)
        if not extra:
            break
        explanation = fit.explanation + Explanation(tuple(c for c, _ in extra))
        x = np.concatenate([fit.x, *(v for _, v in extra)])
        tried = fitter.fit(explanation, fit.episodes, x=x, near=fit, iterations=SETTINGS.leap.steps, polish=False)
        tried = _needed(fitter, tried, worth)
        tried, out = _within_range(fitter, tried)
        anew = out.intersection(c for c, _ in extra)  # without them other effects are chosen
        barred |= anew
        if tried.total < fit.total - worth:
            fit = _tied(fitter, _split(fitter, tried))
        elif not anew:
            break
    return fit, (surveyed, known)


def _within_range(fitter: Fitter, fit: Fit) -> tuple[Fit, set[Candidate]]:
    """Return a fit without the effects that it pushes out of their range, and which those are.

    Out of there they do the work of others, which would be put beside them and never in their place.
    """
    out = set[Candidate]()
    while not is_possible(fit, fitter.context):
        gone = {
            c
            for c, part in fit.explanation.parts(fitter.context)
            if is_out_of_range(c.parameters(fitter.context), fit.x[part])
        }
        out |= gone
        fit = _without(fitter, fit, gone)
    return fit, out


def _without(fitter: Fitter, fit: Fit, gone: Set[Candidate]) -> Fit:
    """Return a fit without some of its effects, the others begun where they are."""
    left = [(c, fit.x[part]) for c, part in fit.explanation.parts(fitter.context) if c not in gone]
    x = np.concatenate([np.empty(0), *(v for _, v in left)])
    rest = Explanation(tuple(c for c, _ in left))
    return fitter.fit(rest, fit.episodes, x=x, near=fit, iterations=SETTINGS.leap.steps, polish=False)


def leapt(fitter: Fitter, fit: Fit, nominal: Fit) -> Fit:
    """Return the fit, at rest, that leaps from another one lead to; that one, where none leaves less.

    Args:
        fitter: Of the episodes.
        fit: Where to begin.
        nominal: The fit without effects.
    """
    every, count = directions(fitter.system), fitter.measured.count(fit.episodes)

    def worth_beside(total: float) -> float:
        return worth_of(fitter.system, count, nominal.total, total)

    there, _ = leap(fitter, fit, every, sensitivities(fitter, fit, every), worth_beside)
    return fit if there is fit else fitter.fit(there.explanation, there.episodes, x=there.x, starts=there.starts)


@dataclass
class Linear:
    """The linear model around a fit.

    Args:
        gram: Inner products of the derivatives by own parameters, then by directions, (n, n).
        right: Of those with the residual, (n,).
        spread: How far each may move: standard deviation, (n,).
    """

    gram: np.ndarray
    right: np.ndarray
    spread: np.ndarray

    def beside(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return metric (n, n) and gradient (n,) once everything has moved as freely as it may, and how far, (n,)."""
        s = self.spread
        inner = cho_factor(np.eye(len(s)) + s[:, None] * self.gram * s, lower=True)
        solved = s[:, None] * cho_solve(inner, s[:, None] * np.column_stack([self.gram, self.right]))
        return self.gram - self.gram @ solved[:, :-1], self.right - self.gram @ solved[:, -1], -solved[:, -1]


def chosen(
    around: NormalEquations, fitter: Fitter, most: int, worth: float, barred: Set[Candidate] = frozenset()
) -> list[tuple[Candidate, np.ndarray]]:
    """Return the effects that account for what a fit leaves in the linear model around it, with where to begin.

    Args:
        around: The fit amid all directions.
        fitter: Of it.
        most: At most so many.
        worth: What each of them has to take off the loss, beside the others.
        barred: Effects that are not to be among them.
    """
    p = len(around.fit.x)
    total = around.gram.sum(axis=0)
    mismatch = np.array([d.mismatch for d in around.directions]) * fitter.system.screening_level
    scale = np.array([q.scale for q in around.fit.explanation.parameters(fitter.context)])
    linear = Linear(total[:-1, :-1], total[:-1, -1], np.concatenate([SETTINGS.leap.free_spread * scale, mismatch]))
    groups = _groups(around)
    taken: dict[Candidate, np.ndarray] = {}
    while len(taken) < most:
        metric, gradient, _ = linear.beside()
        gains = {
            (candidate, tuple(index)): gain_of(metric, gradient, index, linear.spread)
            for candidate, index in groups
            if candidate not in barred and candidate.may_join((*around.fit.explanation.candidates, *taken))
        }
        if not gains:
            break
        (candidate, index), gain = max(gains.items(), key=lambda item: item[1])
        if gain < worth:
            break
        taken[candidate] = np.array(index)
        linear.spread[taken[candidate]] = SETTINGS.leap.free_spread
        _without_the_needless(linear, taken, mismatch, p, worth)
    _, _, moved = linear.beside()
    return [(c, vector_at(c, index, moved[index], around, fitter)) for c, index in taken.items()]


def _groups(around: NormalEquations) -> list[tuple[Candidate, np.ndarray]]:
    """Return the entries that move together: all parameters of an effect, or one of the places that it may have."""
    p = len(around.fit.x)
    return [(candidate, p + np.array(way)) for candidate, ways in around.ways.items() for way in ways]


def gain_of(metric: np.ndarray, gradient: np.ndarray, index: np.ndarray, spread: np.ndarray) -> float:
    """Return what some entries would take off the loss beside all the others, but without their own mismatch.

    With it, they would have to explain what it has explained away. An amplitude estimated beside it is as uncertain as
    the one without it, and as the mismatch is wide; what is taken off is that estimate in its own errors.
    """
    uncertain = np.linalg.inv(metric[np.ix_(index, index)] + 1e-12 * np.eye(len(index)))
    amplitude = uncertain @ gradient[index]
    values, vectors = np.linalg.eigh(uncertain - np.diag(spread[index] ** 2))
    values = np.maximum(values, 1e-9 * np.diag(uncertain).max())
    return float(((vectors.T @ amplitude) ** 2 / (values * (1.0 + SETTINGS.fit.information_ridge * values))).sum())


def _without_the_needless(
    linear: Linear, taken: dict[Candidate, np.ndarray], mismatch: np.ndarray, p: int, worth: float
) -> None:
    """Take out what the others that were chosen since do as well."""
    for candidate, index in list(taken.items())[:-1]:
        linear.spread[index] = mismatch[index - p]
        metric, gradient, _ = linear.beside()
        if gain_of(metric, gradient, index, linear.spread) < worth:
            del taken[candidate]
        else:
            linear.spread[index] = SETTINGS.leap.free_spread


def vector_at(
    candidate: Candidate, index: np.ndarray, moved: np.ndarray, around: NormalEquations, fitter: Fitter
) -> np.ndarray:
    """Return where the fit of an effect begins that moves by so much along some entries of the linear model."""
    way = [int(i) - len(around.fit.x) for i in index]
    return clip(candidate, moved_by(around.directions, way, trusted(moved)), fitter.context)


def _split(fitter: Fitter, fit: Fit) -> Fit:
    """Return a fit with what all of a kind share put on each of them by itself, if that takes enough off the loss."""
    held = fit.explanation.candidates
    count = sum(len(c.each) for c in held)
    if count == len(held) or count > fitter.system.most_effects:
        return fit
    parts = [(each, fit.x[part]) for c, part in fit.explanation.parts(fitter.context) for each in c.each]
    apart = Explanation(tuple(c for c, _ in parts))
    x = np.concatenate([v for _, v in parts])
    tried = fitter.fit(apart, fit.episodes, x=x, near=fit, iterations=SETTINGS.leap.steps, polish=False)
    share = SETTINGS.leap.min_gain_per_number
    less = tried.total < fit.total - share * fit.total * (count - len(held))
    return tried if less and is_possible(tried, fitter.context) else fit


def _tied(fitter: Fitter, fit: Fit) -> Fit:
    """Return a fit with one number for what each of a kind has by itself, if hardly anything is lost by that."""
    for shared in fitter.system.vocabulary:
        parts = fit.explanation.parts(fitter.context)
        members = [part for c, part in parts if c in shared.each]
        if not shared.targets or len(members) < len(shared.targets):
            continue
        others = [(c, fit.x[part]) for c, part in parts if c not in shared.each]
        explanation = Explanation((*(c for c, _ in others), shared))
        x = np.concatenate([*(v for _, v in others), np.mean([fit.x[part] for part in members], axis=0)])
        tried = fitter.fit(explanation, fit.episodes, x=x, near=fit, iterations=SETTINGS.leap.steps, polish=False)
        near = tried.total < fit.total * (1.0 + SETTINGS.leap.min_gain_per_number * (len(members) - 1))
        if near and is_possible(tried, fitter.context):
            fit = tried
    return fit


def _needed(fitter: Fitter, fit: Fit, worth: float) -> Fit:
    """Return a fit without the effects whose absence the others would make up for, by its own derivatives."""
    information = fit.information()
    needless = []
    for candidate, part in fit.explanation.parts(fitter.context):
        others = np.setdiff1d(np.arange(len(fit.x)), np.arange(part.start, part.stop))
        h_oo, h_or, h_rr = information[part, part], information[part][:, others], information[np.ix_(others, others)]
        alone = h_oo - h_or @ np.linalg.pinv(h_rr, hermitian=True) @ h_or.T
        if fit.x[part] @ alone @ fit.x[part] < worth:
            needless.append(candidate)
    if not needless or len(needless) == len(fit.explanation.candidates):
        return fit
    less = _without(fitter, fit, set(needless))
    return less if less.total < fit.total + worth * len(needless) else fit
