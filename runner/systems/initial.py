"""What is unknown of the state in which an episode, or a window of it, begins."""

from __future__ import annotations

from abc import ABC, abstractmethod

from runner.numerics.arrays import FloatArray
from runner.systems.channels import Signals
from runner.systems.windows import Windows


class AbstractInitialState(ABC):
    """What of the start of an episode, or of a window of it, is unknown: S numbers.

    Attributes:
        steps: For differences, (S,): small against a motion, large against rounding.
        channels: Those that measure the state itself.
    """

    steps: FloatArray
    channels: slice = slice(None)

    @property
    def size(self) -> int:
        """How many numbers."""
        return len(self.steps)

    @abstractmethod
    def scale(self, sigma: FloatArray) -> FloatArray:
        """Return how far a start may be from its guess, (S,), from the noise of each channel, (C,)."""

    @abstractmethod
    def guess(self, signals: Signals, episode: int) -> FloatArray:
        """Return a rough start of an episode from its first samples, (S,)."""

    @abstractmethod
    def guess_windows(self, signals: Signals, windows: Windows, *, smooth: bool) -> FloatArray:
        """Return a start of each window, (W, S): from its first sample, or `smooth` from the samples around that."""
