"""What hangs on a breakaway: whether a push just starts a body that static friction holds, or just doesn't.

Friction that differs by a fraction of a per cent from place to place, as on any surface, decides that, and it makes
all the difference to what follows. No simulator that does not know the surface so well predicts it, so what comes after
says nothing about the explanation: it is left out of the fit.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from runner.effects.base import Effects
from runner.inference.least_squares import NONE, Fit, Fitter
from runner.inference.parameters import bounds
from runner.recording import Span
from runner.systems.simulator import Run

# An episode whose fit leaves so much beyond the noise, in squared noises, is looked at: were static friction by such a
# share of it higher or lower where the body stood, would the motion part from what was fitted just before that goes
# astray, and so long after be another by such a share of what it misses by?
LEFT, UNEVEN = 1.0, np.array([-0.02, -0.01, -0.005, -0.0025, 0.0025, 0.005, 0.01, 0.02])
BEFORE_S, AFTER_S, ANOTHER = 0.4, 0.5, 0.5
# A motion is astray where it leaves such a mean square, in squared noises, for so long; two have parted at so many.
ASTRAY, LASTING_S, APART = 5.0, 0.15, 1.0
# The start is fitted to what has been foretold so far, from so much on: what comes after must not bend it.
FIRST_S, START_STEPS, GROWTHS = 0.2, 4, 8
SHORTEST = 10  # samples that are left of an episode at least
MOST = 0.5  # share of what is fitted that may hang on breakaways; more of it is no accident


def hanging(fitter: Fitter, fit: Fit) -> dict[int, int]:
    """Return the episodes of a fit with static friction that hang on a breakaway, and from which sample on they do."""
    if not fit.explanation.discontinuous:
        return {}
    place = next(p.start for c, p in fit.explanation.parts(fitter.context) if c.effect.discontinuous)
    low, high = bounds(fit.explanation.parameters(fitter.context))
    out: dict[int, int] = {}
    for k, e in enumerate(fit.episodes):
        count = fitter.measured.count([e])
        # the fit may have been one to less than the whole episode
        if fitter.loss(fit.explanation, fit.x, fit.starts[k : k + 1], [e]) - count < LEFT * count:
            continue
        x = np.array([fit.x] * (1 + len(UNEVEN)))
        excess = x[1:, place]
        x[1:, place] = np.clip(excess + UNEVEN * (1.0 + excess), low[place], high[place])
        effects = [fit.explanation.make(row, fitter.context) for row in x]
        told, start = _foretold(fitter, effects[0], e, fit.starts[k])
        rows = fitter.whitened(e, [Run(each, start) for each in effects])
        rows = rows.reshape(len(x), len(fitter.measured.values[e]), -1)
        sample = _parting(rows, told, fitter.system.rate_hz)
        if sample is not None and len(rows[0]) > SHORTEST:
            out[e] = max(sample, SHORTEST)
    left = fitter.measured.without(out).count(fit.episodes)
    return out if left >= (1.0 - MOST) * fitter.measured.count(fit.episodes) else {}


def _parting(rows: np.ndarray, told: int, rate_hz: float) -> int | None:
    """Return where the first of some residuals (K, T, C) hangs on what tells it from the others, if it does.

    It is foretold up to a sample; one of the others must part from it shortly before that, and be far away after.
    """
    after = slice(told, told + max(round(AFTER_S * rate_hz), 3))
    missed = float((rows[0, after] ** 2).sum())
    found = []
    for row in rows[1:]:
        apart = np.abs(row - rows[0]).max(axis=1) > APART
        sample = int(np.argmax(apart))
        near = apart.any() and told - BEFORE_S * rate_hz <= sample <= told + LASTING_S * rate_hz
        if near and ((row[after] - rows[0, after]) ** 2).sum() > ANOTHER * missed > 0:
            found.append(sample)
    return min(found, default=None)


def _foretold(fitter: Fitter, effects: Effects, episode: int, start: np.ndarray) -> tuple[int, np.ndarray]:
    """Return how many samples of an episode are foretold by a start that is fitted to them, and that start."""
    samples, rate_hz = len(fitter.measured.values[episode]), fitter.system.rate_hz
    lasting = max(round(LASTING_S * rate_hz), 3)
    told = min(max(round(FIRST_S * rate_hz), lasting), samples)
    for _ in range(GROWTHS):
        first = replace(fitter.parts([Span(episode, 0, told)]), held=effects)
        begun = first.fit(NONE, [0], starts=start[None], iterations=START_STEPS, polish=False).starts[0]
        white = fitter.whitened(episode, [Run(effects, begun)])[0].reshape(samples, -1)
        square = np.convolve((white**2).mean(axis=1), np.full(lasting, 1.0 / lasting), mode="valid")
        astray = np.flatnonzero(square > ASTRAY)
        reached = int(astray[0]) if len(astray) else samples
        if reached <= told:
            break
        told, start = reached, begun
    return told, start
