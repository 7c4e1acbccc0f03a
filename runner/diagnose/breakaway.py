"""What hangs on a breakaway: whether a push just starts a body that static friction holds, or just doesn't.

Friction that differs by a fraction of a per cent from place to place, as on any floor, decides that, and it makes all
the difference to what follows. No simulator that does not know the floor so well predicts it, so what comes after says
nothing about the explanation: it is left out of the fit.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from runner.diagnose.fit import NONE, Fit, Fitter, bounds
from runner.simulate import Run

# An episode whose fit leaves so much beyond the noise, in squared noises, is looked at: would it leave less than
# such a share of that, were static friction by such a share of it higher or lower where the body stood?
LEFT, STILL_LEFT, UNEVEN = 1.0, 0.15, (-0.02, -0.01, -0.005, -0.0025, 0.0025, 0.005, 0.01, 0.02)
APART = 1.0  # noises by which the motions with and without that differ from where on it hangs on it
START_STEPS = 6
SHORTEST = 10  # samples that are left of an episode at least


def hanging(fitter: Fitter, fit: Fit) -> dict[int, int]:
    """Return the episodes of a fit with static friction that hang on a breakaway, and from which sample on they do."""
    places = [part.start for kind, part in fit.explanation.parts(fitter.context) if kind.jumps]
    out: dict[int, int] = {}
    if not places:
        return out
    for k, e in enumerate(fit.episodes):
        count = fitter.measured.count([e])
        left = fit.loss[k] - count
        if left < LEFT * count:
            continue
        other = min((_otherwise(fitter, fit, k, places[0], by) for by in UNEVEN), key=lambda o: o.total)
        if other.total - count < STILL_LEFT * left:
            out[e] = max(_parting(fitter, fit, k, other), SHORTEST)
    return out


def _otherwise(fitter: Fitter, fit: Fit, k: int, place: int, by: float) -> Fit:
    """Fit the start of one episode with another static friction; `place` is where the vector holds its excess."""
    low, high = bounds(fit.explanation.parameters(fitter.context))
    x = fit.x.copy()
    x[place] = np.clip(x[place] + by * (1.0 + x[place]), low[place], high[place])
    held = replace(fitter, held=fit.explanation.make(x, fitter.context))
    found = held.fit(NONE, [fit.episodes[k]], starts=fit.starts[k : k + 1], iterations=START_STEPS)
    return replace(found, explanation=fit.explanation, x=x)


def _parting(fitter: Fitter, fit: Fit, k: int, other: Fit) -> int:
    """Return the first sample at which the motions of two fits of an episode, from one start, differ by the noise."""
    runs = [Run(f.explanation.make(f.x, fitter.context), other.starts[0]) for f in (fit, other)]
    one, two = fitter.simulator.predict(fit.episodes[k], runs)
    return int(np.argmax((np.abs(one - two) > APART * fitter.measured.sigma).any(axis=1)))
