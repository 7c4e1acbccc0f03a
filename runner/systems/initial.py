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

    The first half of them says where everything is, the second how fast it goes.

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

    def errors(self, signals: Signals, windows: Windows) -> FloatArray:
        """Return how far the starts of windows may be from their guesses, (W, S); by default all as far."""
        return np.tile(self.scale(signals.sigma), (len(windows), 1))

    @abstractmethod
    def guess(self, signals: Signals, episode: int) -> FloatArray:
        """Return a rough start of an episode from its first samples, (S,)."""

    @abstractmethod
    def guess_windows(self, signals: Signals, windows: Windows, *, smooth: bool) -> FloatArray:
        """Return a start of each window, (W, S): from its first sample, or `smooth` from the samples around that."""


def told_around(valid: NDArray[np.bool_], first: int, reach: int, *, least: int = 1) -> slice:
    """Return the samples around one that tell of it: so many to each side, at the edge of an episode to one.

    Where a channel was lost they go on until they hold `reach + 1` readings of it, or back where too few follow. Each
    channel is looked at by itself, as sensors need not read at the same samples; one that reads nothing has no say.

    Args:
        valid: What counts of the channels of an episode, (T, C).
        first: The sample.
        reach: How many to each side.
        least: A channel with fewer readings there was lost. Of one that reads at every sample that is as many as are
            needed; of one whose sensor is slower than the others' any reading will do, as more are far away.
    """
    begin, end = max(0, first - reach), min(len(valid), first + reach + 1)
    lost, near = valid[begin:end].sum(axis=0) < least, slice(begin, end)
    if not lost.any():
        return near
    lost &= valid.any(axis=0)
    for there in map(np.flatnonzero, valid.T[lost]):
        after = there[there >= begin][: reach + 1]
        own = after if len(after) >= least else there[-reach - 1 :]
        near = slice(min(near.start, int(own[0])), max(near.stop, int(own[-1]) + 1))
    return near


def level_around(values: FloatArray, valid: NDArray[np.bool_], first: int, reach: int, *, least: int = 1) -> FloatArray:
    """Return the median of each channel over the samples around one, (C,); 0 of one that reads nothing.

    Args:
        values: Of an episode, (T, C).
        valid: What of them counts, (T, C).
        first: The sample.
        reach: See `told_around`, channel by channel.
        least: See there.
    """
    out = np.zeros(values.shape[1])
    for c in np.flatnonzero(valid.any(axis=0)):
        near = told_around(valid[:, [c]], first, reach, least=least)
        out[c] = np.median(values[near, c][valid[near, c]])
    return out
