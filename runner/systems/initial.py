"""What is unknown of the state in which an episode, or a window of it, begins."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import NDArray

from runner.numerics.arrays import FloatArray
from runner.systems.channels import Signals
from runner.systems.windows import Windows


class AbstractInitialState(ABC):
    """What of the start of an episode, or of a window of it, is unknown: S numbers.

    Attributes:
        steps: For differences, (S,): small against a motion, large against rounding.
        channels: Those that measure the state itself.
        settling_s: How long after a start that is a little off the others say more of that than of the model.
    """

    steps: FloatArray
    channels: slice = slice(None)
    settling_s: float = 0.0

    @property
    def size(self) -> int:
        """How many numbers."""
        return len(self.steps)

    def settled(self, valid: NDArray[np.bool_], rate_hz: float) -> NDArray[np.bool_]:
        """Return what counts of windows (W, n, C) that begin in such states."""
        out = valid.copy()
        early = out[:, : math.ceil(self.settling_s * rate_hz - 1e-9)]
        state = early[..., self.channels].copy()
        early[...] = False
        early[..., self.channels] = state
        return out

    @abstractmethod
    def scale(self, sigma: FloatArray) -> FloatArray:
        """Return how far a start may be from its guess, (S,), from the noise of each channel, (C,)."""

    @abstractmethod
    def guess(self, signals: Signals, episode: int) -> FloatArray:
        """Return a rough start of an episode from its first samples, (S,)."""

    @abstractmethod
    def guess_windows(self, signals: Signals, windows: Windows, *, smooth: bool) -> FloatArray:
        """Return a start of each window, (W, S): from its first sample, or `smooth` from the samples around that."""
