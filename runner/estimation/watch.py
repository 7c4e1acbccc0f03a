"""Freezing an estimate that is certain, and noticing that the object has changed.

A belief goes on gathering evidence while the estimate that is given out stays frozen, so that every update also says
how far the measurement was from what was expected. Its squared whitened size is chi-squared distributed while the
object is what it was. The alarm is a one-sided cumulative sum (Page 1954) of these, in standard deviations above their
mean plus `SLACK`; it is raised beyond `LIMIT`. Then the estimate is set free: the belief begins anew in the measured
state, around the last estimate, as uncertain as the prior.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from runner.estimation.belief import Belief, Prior
from runner.estimation.tracker import Tracker

INTERVAL = 1.959964  # standard deviations to either side that hold 95 %
SLACK, LIMIT = 1.0, 25.0


def excess_after(excess: float, surprise: float, count: float) -> float:
    """Return the cumulative sum after one more squared whitened innovation, of so many numbers."""
    step = (surprise - count) / np.sqrt(2 * count) - SLACK if count else 0.0
    return max(0.0, excess + step)


@dataclass(frozen=True)
class Watched:
    """A belief of one lane under watch.

    Attributes:
        belief: What is believed.
        prior: Of the parameters; where the belief begins anew, its uncertainty is the prior's.
        frozen: Parameters that are given out while they are frozen, (1, 5); None: they are not.
        excess: Cumulative sum of surprise.
        alarms: How often the object was found changed.
    """

    belief: Belief
    prior: Prior
    frozen: np.ndarray | None = None
    excess: float = 0.0
    alarms: int = 0

    @property
    def x(self) -> np.ndarray:
        """The parameters that are given out, (1, 5)."""
        return self.belief.x if self.frozen is None else self.frozen


@dataclass(frozen=True)
class Watch:
    """Updates beliefs under watch. `certain` is the half width of all 95 % intervals at which an estimate freezes."""

    tracker: Tracker
    certain: float | None

    def start(self, prior: Prior, first: np.ndarray) -> Watched:
        """Return what is believed before the first message, of one lane; `first` (1, 6) is roughly where it starts."""
        return Watched(self.tracker.start(prior, first), prior)

    def update(self, watched: Watched, pushes: np.ndarray, measured: np.ndarray) -> Watched:
        """Return what is believed after a message: commands since the one before (n, 12), and the state (1, 6)."""
        belief = self.tracker.update(watched.belief, pushes, measured)
        if self.certain is None:
            return Watched(belief, watched.prior)
        (surprise,), (count,) = belief.surprise
        # a state that was badly known is no surprise: only what is frozen is watched
        excess = 0.0 if watched.frozen is None else excess_after(watched.excess, surprise, count)
        if excess > LIMIT:
            prior = Prior(watched.x[0], watched.prior.sd)
            return Watched(self.tracker.start(prior, measured), prior, alarms=watched.alarms + 1)
        frozen = watched.frozen
        if frozen is None and (INTERVAL * belief.sd <= self.certain).all():
            frozen = belief.x
        return Watched(belief, watched.prior, frozen, excess, watched.alarms)
