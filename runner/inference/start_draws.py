"""Other start states of what hits something: drawn from what its flight tells, the best of them fitted.

A hair's breadth decides which corner hits first, and a descent stays on the side on which it began. In the air a start
is told as by any smooth model, with a covariance; starts drawn from it fall on all sides that the flight leaves open.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from runner.effects.base import Scope
from runner.effects.vocabulary import Candidate
from runner.inference.contender import Offer
from runner.inference.evidence import clip, joined
from runner.inference.least_squares import NONE, Fit, Fitter
from runner.inference.variable_projection import told_move
from runner.inference.warm_start import WarmStart
from runner.numerics.arrays import FloatArray
from runner.settings import SETTINGS


def improved_starts(held: Fitter, episodes: Sequence[int], starts: FloatArray) -> FloatArray:
    """Return start states of some episodes, (E, S), from which less is left; those given where none is found.

    Args:
        held: With the effects in its model that they are for.
        episodes: Which.
        starts: Fitted ones, (E, S).
    """
    order = list(episodes)
    at, flown = _flown(held, order, starts)
    if flown is None:
        return starts
    # the same draws whatever they are for: explanations are compared by what they leave
    normal = np.random.default_rng(0).normal(size=(starts.shape[1], SETTINGS.fit.drawn_starts))
    moved = [told_move(r, normal).T for r in flown.basis.r]
    chosen = starts.copy()
    chosen[at], _ = held.best_starts((), flown.starts[:, None] + np.array(moved), [order[k] for k in at])
    before = held.fit(NONE, order, starts=starts, iterations=0)
    after = held.fit(NONE, order, starts=chosen, iterations=SETTINGS.fit.restart_steps, polish=False)
    return np.where((after.loss < before.loss)[:, None], after.starts, starts)


def tried_from_the_air(fitter: Fitter, near: Fit, offered: Sequence[Offer]) -> list[WarmStart]:
    """Return where to begin fits of an explanation and one more effect each, from starts told before anything was hit.

    What shows in what follows a hit alone has starts that make up for its absence, where those are fitted without it,
    and what a small amount of it does there says little of more: so of some amounts the one is taken that leaves least.

    Args:
        fitter: Of an object that hits something.
        near: The fit of the explanation.
        offered: The effects, each with the vector that a linear model proposes.
    """
    if not offered:
        return []
    held = replace(fitter, held=near.explanation.make(near.x, fitter.context))
    at, flown = _flown(held, list(near.episodes), near.starts)
    begin = near.starts.copy()
    if flown is not None:
        begin[at] = flown.starts
    both = np.stack([begin, near.starts], axis=1)
    tried = [[joined(near, c, v) for v in _amounts(c, vector, fitter.context)] for _, c, vector in offered]
    models = [explanation.make(x, fitter.context) for some in tried for explanation, x in some]
    left = iter(fitter.losses(models, begin, near.episodes))
    out = []
    for some in tried:
        explanation, x = some[int(np.argmin([next(left) for _ in some]))]
        starts, least = fitter.best_starts(explanation.make(x, fitter.context), both, near.episodes)
        out.append(WarmStart(explanation, x, starts, float(least.sum())))
    return out


def _amounts(candidate: Candidate, vector: FloatArray, context: Scope) -> list[FloatArray]:
    """Return vectors of an effect that are tried beside the given one, (p,) each: of one number some amounts."""
    parameters = candidate.parameters(context)
    if candidate.effect.switch:
        return list(candidate.starts(context))
    if len(parameters) != 1:
        return [vector]
    sizes = parameters[0].scale * np.array(SETTINGS.fit.scanned_scales)
    return [vector, *(clip(candidate, np.array([size]), context) for size in (*-sizes, *sizes))]


def _flown(held: Fitter, episodes: list[int], starts: FloatArray) -> tuple[list[int], Fit | None]:
    """Fit start states to what some episodes show before their first hit.

    Returns:
        Which of the episodes show enough of that, by their place, and the fit of those; None where none does.
    """
    spans = held.until_hit(episodes)
    at = [episodes.index(s.episode) for s in spans]
    if not spans:
        return at, None
    steps = SETTINGS.fit.restart_steps
    return at, held.parts(spans).fit(NONE, range(len(spans)), starts=starts[at], iterations=steps)


def begun_elsewhere(fitter: Fitter, fit: Fit, starts: FloatArray, enough: float) -> FloatArray | None:
    """Return start states, (E, S), from which a fit leaves less at its parameters; None: there are none.

    Args:
        fitter: Of the fit.
        fit: It.
        starts: Where others begin, (E, K, S); what a flight tells is tried besides.
        enough: So much they have to take off the loss to be of use.
    """
    held = replace(fitter, held=fit.explanation.make(fit.x, fitter.context))
    begin = improved_starts(held, fit.episodes, held.best_starts((), starts, fit.episodes)[0])
    left = fitter.loss(fit.explanation, fit.x, begin, fit.episodes)
    return None if left > fit.total - max(enough, SETTINGS.held_out.stuck_loss) else begin
