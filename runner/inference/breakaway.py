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
from runner.settings import SETTINGS
from runner.systems.simulator import Run


def hanging(fitter: Fitter, fit: Fit) -> dict[int, int]:
    """Return the episodes of a fit with static friction that hang on a breakaway, and from which sample on they do.

    An episode of which more is left than is in the noise is looked at: were static friction a little higher or lower
    where the body stood, would the motion part from what was fitted just before that goes astray, and then be another
    by most of what it misses by? Where most of what is fitted hangs on that, it is no accident.
    """
    if not fit.explanation.discontinuous:
        return {}
    place = next(p.start for c, p in fit.explanation.parts(fitter.context) if c.effect.discontinuous)
    low, high = bounds(fit.explanation.parameters(fitter.context))
    plain, least = SETTINGS.held_out.plain_excess, SETTINGS.breakaway.min_samples
    changes = np.array(SETTINGS.breakaway.friction_changes)
    changes = np.concatenate([-changes[::-1], changes])
    out: dict[int, int] = {}
    for k, e in enumerate(fit.episodes):
        count = fitter.measured.count([e])
        # the fit may have been one to less than the whole episode
        if fitter.loss(fit.explanation, fit.x, fit.starts[k : k + 1], [e]) - count < plain * count:
            continue
        x = np.array([fit.x] * (1 + len(changes)))
        excess = x[1:, place]
        x[1:, place] = np.clip(excess + changes * (1.0 + excess), low[place], high[place])
        effects = [fit.explanation.make(row, fitter.context) for row in x]
        told, start = _foretold(fitter, effects[0], e, fit.starts[k])
        (rows,) = fitter.whitened([(e, [Run(each, start) for each in effects])])
        rows = rows.reshape(len(x), len(fitter.measured.values[e]), -1)
        sample = _parting(rows, told, fitter.system.rate_hz)
        if sample is not None and len(rows[0]) > least:
            out[e] = max(sample, least)
    left = fitter.measured.without(out).count(fit.episodes)
    return out if left >= (1.0 - SETTINGS.held_out.most) * fitter.measured.count(fit.episodes) else {}


def _parting(rows: np.ndarray, told: int, rate_hz: float) -> int | None:
    """Return where the first of some residuals (K, T, C) hangs on what tells it from the others, if it does.

    It is foretold up to a sample; one of the others must part from it shortly before that, and be far away after.
    """
    limits = SETTINGS.breakaway
    after = slice(told, told + max(round(limits.outcome_s * rate_hz), 3))
    missed = float((rows[0, after] ** 2).sum())
    found = []
    for row in rows[1:]:
        apart = np.abs(row - rows[0]).max(axis=1) > SETTINGS.odds.visible_noises
        sample = int(np.argmax(apart))
        near = apart.any() and told - limits.max_lead_s * rate_hz <= sample <= told + limits.lost_for_s * rate_hz
        if near and ((row[after] - rows[0, after]) ** 2).sum() > SETTINGS.held_out.most * missed > 0:
            found.append(sample)
    return min(found, default=None)


def _foretold(fitter: Fitter, effects: Effects, episode: int, start: np.ndarray) -> tuple[int, np.ndarray]:
    """Return how many samples of an episode are foretold by a start that is fitted to them, and that start.

    It is fitted to what has been foretold so far: what comes after must not bend it.
    """
    limits = SETTINGS.breakaway
    samples, rate_hz = len(fitter.measured.values[episode]), fitter.system.rate_hz
    lasting = max(round(limits.lost_for_s * rate_hz), 3)
    told = min(max(round(limits.first_s * rate_hz), lasting), samples)
    for _ in range(limits.max_growths):
        first = replace(fitter.parts([Span(episode, 0, told)]), held=effects)
        begun = first.fit(NONE, [0], starts=start[None], iterations=limits.start_steps, polish=False).starts[0]
        white = fitter.whitened([(episode, [Run(effects, begun)])])[0].reshape(samples, -1)
        square = np.convolve((white**2).mean(axis=1), np.full(lasting, 1.0 / lasting), mode="valid")
        astray = np.flatnonzero(square > limits.lost_mean_square)
        reached = int(astray[0]) if len(astray) else samples
        if reached <= told:
            break
        told, start = reached, begun
    return told, start
