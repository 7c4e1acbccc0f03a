"""What simulates a recorded object: commands and starts in, predicted channels out, with any set of effects."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Generator, Iterable, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from runner.effects.base import Effects
from runner.numerics.arrays import FloatArray
from runner.recording import Span
from runner.systems.windows import Windows

ALIKE_SHARE = 0.9  # of the steps of the longest that is simulated beside it


@dataclass(frozen=True)
class Run:
    """One open-loop simulation: the effects that are in the model, and the start that it begins from, (S,)."""

    effects: Effects
    start: FloatArray


def alike(steps: Sequence[int]) -> list[list[int]]:
    """Return which of runs of so many steps are simulated side by side: of about one length, as the longest sets it.

    What a shorter one does beyond its end costs time and is thrown away.
    """
    out: list[list[int]] = []
    for i in sorted(range(len(steps)), key=lambda i: -steps[i]):
        if out and steps[i] >= ALIKE_SHARE * steps[out[-1][0]]:
            out[-1].append(i)
        else:
            out.append([i])
    return out


def of_each(
    rows: Iterable[FloatArray], asked: Sequence[tuple[int, Sequence[Run]]], spans: Sequence[Span], channels: int
) -> list[FloatArray]:
    """Return what was predicted of all runs, one after the other, (T, C), as that of each episode, (len(runs), T, C).

    Args:
        rows: Of the runs, in their order.
        asked: The episodes with their runs.
        spans: What of the recording each of those is.
        channels: C.
    """
    left = iter(rows)
    each = ([next(left) for _ in runs] for _, runs in asked)
    return [np.reshape(of, (len(of), s.end - s.begin, channels)) for s, of in zip(spans, each, strict=True)]


class AbstractSimulator(ABC):
    """Simulates a recording's commands open loop, many sets of effects and starts at once.

    Attributes:
        simulated_s: How much has been simulated so far, in seconds of the object's time.
    """

    simulated_s: float

    @abstractmethod
    def predict_each(self, asked: Sequence[tuple[int, Sequence[Run]]]) -> list[FloatArray]:
        """Return the predicted channels of runs of several episodes, or spans, (len(runs), T, C) of each.

        All at once: cores that one run of one episode leaves idle simulate the others.
        """

    def predict(self, episode: int, runs: Sequence[Run]) -> FloatArray:
        """Return the predicted channels at the samples of an episode, or span, (len(runs), T, C)."""
        return self.predict_each([(episode, runs)])[0]

    def surveying(self) -> AbstractSimulator:
        """Return a simulator of the same that may be coarser, and cheaper.

        What it predicts differs from a prediction by about the noise, which is nothing to how a prediction *changes*
        with an effect.
        """
        return self

    @contextmanager
    def survey(self) -> Generator[AbstractSimulator]:
        """Give the simulator that is `surveying`; what it simulates counts as simulated by this one, too."""
        other = self.surveying()
        before_s = other.simulated_s
        try:
            yield other
        finally:
            if other is not self:
                self.simulated_s += other.simulated_s - before_s

    @abstractmethod
    def parts(self, spans: Sequence[Span]) -> AbstractSimulator:
        """Return a simulator of parts of what this one simulates; `episode` counts what that is."""

    @abstractmethod
    def predict_windows(
        self, effects: Effects, windows: Windows, starts: FloatArray, disturbance: FloatArray | None = None
    ) -> FloatArray:
        """Return the predicted channels in windows, each begun anew.

        Args:
            effects: What is in the model.
            windows: W of them.
            starts: As `AbstractInitialState.guess_windows` has them, K for each: (W, K, S): states that are *shown* by
                the sensors with these effects, the model starts from the true ones behind them.
            disturbance: A constant generalised force in each, (K, D) or (W, K, D).

        Returns:
            (W, K, samples, C), the first of the samples the start.
        """

    @abstractmethod
    def seen_start(self, effects: Effects, start: FloatArray) -> FloatArray:
        """Return the true start (S,) that sensors with these effects show as the given one."""
