"""Other start states of what hits something: drawn from what its flight tells, the best of them fitted.

A hair's breadth decides which corner hits first, and a descent stays on the side on which it began. In the air a start
is told as by any smooth model, with a covariance; starts drawn from it fall on all sides that the flight leaves open.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.linalg import solve_triangular

from runner.inference.least_squares import NONE, Explanation, Fit, Fitter
from runner.inference.parameters import bounds
from runner.numerics.arrays import FloatArray
from runner.settings import SETTINGS


def improved_starts(held: Fitter, episodes: Sequence[int], starts: FloatArray) -> FloatArray:
    """Return start states of some episodes, (E, S), from which less is left; those given where none is found.

    Args:
        held: With the effects in its model that they are for.
        episodes: Which.
        starts: Fitted ones, (E, S).
    """
    spans = held.until_hit(episodes)
    if not spans:
        return starts
    order = list(episodes)
    at = [order.index(s.episode) for s in spans]
    steps = SETTINGS.fit.restart_steps
    flown = held.parts(spans).fit(NONE, range(len(spans)), starts=starts[at], iterations=steps)
    # the same draws whatever they are for: explanations are compared by what they leave
    normal = np.random.default_rng(0).normal(size=(starts.shape[1], SETTINGS.fit.drawn_starts))
    moved = [solve_triangular(_invertible(r), normal, check_finite=False).T for r in flown.basis.r]
    chosen = starts.copy()
    chosen[at], _ = held.best_starts((), flown.starts[:, None] + np.array(moved), [order[k] for k in at])
    before = held.fit(NONE, order, starts=starts, iterations=0)
    after = held.fit(NONE, order, starts=chosen, iterations=steps, polish=False)
    return np.where((after.loss < before.loss)[:, None], after.starts, starts)


def begun_elsewhere(
    fitter: Fitter, fit: Fit, starts: FloatArray, *, thoroughly: bool
) -> tuple[FloatArray, FloatArray] | None:
    """Return parameters, (p,), and start states, (E, S), from which a fit leaves less; None: there are none.

    Args:
        fitter: Of the fit.
        fit: It.
        starts: Where others begin, (E, K, S); what a flight tells is tried besides.
        thoroughly: Whether what hits something is tried with other parameters, too.
    """
    held = replace(fitter, held=fit.explanation.make(fit.x, fitter.context))
    x, begin = fit.x, improved_starts(held, fit.episodes, held.best_starts((), starts, fit.episodes)[0])
    if thoroughly and fitter.until_hit(fit.episodes):
        x, begin = _searched(fitter, fit.explanation, x, begin, fit.episodes)
    left = fitter.loss(fit.explanation, x, begin, fit.episodes)
    return None if left > fit.total - SETTINGS.held_out.stuck_loss else (x, begin)


def _searched(
    fitter: Fitter, explanation: Explanation, x: FloatArray, starts: FloatArray, episodes: Sequence[int]
) -> tuple[FloatArray, FloatArray]:
    """Return parameters, (p,), and start states, (E, S), that leave least of what is tried one parameter at a time.

    A pattern search (Hooke and Jeeves 1961), the starts drawn anew at each try: through a hit the derivatives that a
    descent follows are those of one side, and end where the next begins.
    """
    parameters = explanation.parameters(fitter.context)
    low, high = bounds(parameters)
    steps = SETTINGS.fit.hit_difference_share * np.diag([p.scale for p in parameters])

    def left(at: FloatArray) -> tuple[float, FloatArray]:
        held = replace(fitter, held=explanation.make(at, fitter.context))
        found = improved_starts(held, episodes, starts)
        return held.loss(NONE, np.empty(0), found, episodes), found

    least, starts = left(x)
    for way in (*steps, *-steps):
        while True:
            at = np.clip(x + way, low, high)
            less, found = left(at)
            if not less < least - SETTINGS.held_out.stuck_loss:
                break
            x, least, starts = at, less, found
    return x, starts


def _invertible(triangle: FloatArray) -> FloatArray:
    """Return a triangle (S, S) with what nothing tells of held where it is."""
    size = np.abs(np.diag(triangle))
    untold = size < SETTINGS.fit.information_ridge * size.max()
    out = triangle.copy()
    out[untold, :], out[:, untold] = 0.0, 0.0
    out[untold, untold] = 1e12
    return out
