"""What hangs on a breakaway: whether a push just starts a body that static friction holds, or just doesn't.

Friction that differs by a fraction of a per cent from place to place, as on any floor, decides that, and it makes all
the difference to what follows. No simulator that does not know the floor so well predicts it, so what comes after says
nothing about the explanation: it is left out of the fit.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from runner.diagnose.fit import NONE, Fit, Fitter, bounds
from runner.recording import Span
from runner.simulate import Effects, Run

# An episode whose fit leaves so much beyond the noise, in squared noises, is looked at: were static friction by such a
# share of it higher or lower where the body stood, would the motion, so long after the fit goes astray, be another by
# such a share of what it misses by?
LEFT, UNEVEN = 1.0, (-0.02, -0.01, -0.005, -0.0025, 0.0025, 0.005, 0.01, 0.02)
AFTER_S, ANOTHER = 0.5, 0.5
# A motion is astray where so many samples in a row leave such a mean square, in squared noises.
ASTRAY, IN_A_ROW = 5.0, 10
APART = 1.0  # noises by which the motions with and without that differ from where on it hangs on it
# The start is fitted to what has been foretold so far, from so much on: what comes after must not bend it.
FIRST_S, START_STEPS, GROWTHS = 0.2, 4, 8
SHORTEST = 10  # samples that are left of an episode at least


def hanging(fitter: Fitter, fit: Fit) -> dict[int, int]:
    """Return the episodes of a fit with static friction that hang on a breakaway, and from which sample on they do."""
    places = [part.start for kind, part in fit.explanation.parts(fitter.context) if kind.jumps]
    low, high = bounds(fit.explanation.parameters(fitter.context))
    after = round(AFTER_S * fitter.simulator.recording.nominal.rate_hz)
    out: dict[int, int] = {}
    for k, e in enumerate(fit.episodes if places else ()):
        count = fitter.measured.count([e])
        if fit.loss[k] - count < LEFT * count:
            continue
        x = np.array([fit.x] * (1 + len(UNEVEN)))
        excess = x[1:, places[0]]
        x[1:, places[0]] = np.clip(excess + UNEVEN * (1.0 + excess), low[places[0]], high[places[0]])
        effects = [fit.explanation.make(row, fitter.context) for row in x]
        told, start = _foretold(fitter, effects[0], e, fit.starts[k])
        rows = fitter.whitened(e, [Run(each, start) for each in effects]).reshape(
            len(x), -1, len(fitter.measured.sigma)
        )
        missed = (rows[0, told : told + after] ** 2).sum()
        changed = ((rows[1:, told : told + after] - rows[0, told : told + after]) ** 2).sum(axis=(1, 2))
        if missed > 0 and changed.max() > ANOTHER * missed:
            apart = np.abs(rows[1 + int(np.argmax(changed))] - rows[0]).max(axis=1)
            out[e] = max(int(np.argmax(apart > APART)), SHORTEST)
    return out


def _foretold(fitter: Fitter, effects: Effects, episode: int, start: np.ndarray) -> tuple[int, np.ndarray]:
    """Return how many samples of an episode are foretold by a start that is fitted to them, and that start."""
    samples = len(fitter.measured.values[episode])
    told = min(round(FIRST_S * fitter.simulator.recording.nominal.rate_hz), samples)
    for _ in range(GROWTHS):
        first = replace(fitter.parts([Span(episode, 0, told)]), held=effects)
        begun = first.fit(NONE, [0], starts=start[None], iterations=START_STEPS, polish=False).starts[0]
        white = fitter.whitened(episode, [Run(effects, begun)])[0].reshape(samples, -1)
        square = np.convolve((white**2).mean(axis=1), np.full(IN_A_ROW, 1.0 / IN_A_ROW), mode="valid")
        astray = np.flatnonzero(square > ASTRAY)
        reached = int(astray[0]) if len(astray) else samples
        if reached <= told:
            break
        told, start = reached, begun
    return told, start
