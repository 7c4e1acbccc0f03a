"""Windows: short stretches of a recording, all of one length, and what went on in each of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from runner.numerics.arrays import spread_over


@dataclass(frozen=True)
class Windows:
    """Windows of one length, in samples: `episode` and `first` sample of each, both (W,), and `samples` of each."""

    episode: np.ndarray
    first: np.ndarray
    samples: int

    def __len__(self) -> int:
        return len(self.episode)

    def of(self, arrays: Sequence[np.ndarray]) -> np.ndarray:
        """Return what arrays (T, ...), one per episode, hold in each window: (W, samples, ...)."""
        steps = np.arange(self.samples)
        return np.stack([arrays[e][f + steps] for e, f in zip(self.episode, self.first, strict=True)])

    def some(self, count: int) -> Windows:
        """Return so many of them at most, spread over all."""
        return self.at(spread_over(len(self), count))

    def at(self, chosen: np.ndarray) -> Windows:
        """Return those at some positions, (k,), or of a mask, (W,)."""
        return Windows(self.episode[chosen], self.first[chosen], self.samples)

    def chunks(self, size: int) -> list[tuple[slice, Windows]]:
        """Return them in portions of at most `size`."""
        parts = [slice(begin, begin + size) for begin in range(0, len(self), size)]
        return [(part, Windows(self.episode[part], self.first[part], self.samples)) for part in parts]


def windows_of(lengths: Sequence[int], samples: int, episodes: Sequence[int] | None = None) -> Windows:
    """Return windows end to end that share their border samples; what is left at the end of an episode is left out.

    Args:
        lengths: Samples of each episode.
        samples: Steps of a window; it then has one more sample than that.
        episodes: Which episodes; None: all.
    """
    chosen = range(len(lengths)) if episodes is None else episodes
    pairs = [(e, f) for e in chosen for f in range(0, lengths[e] - samples, samples)]
    index = np.array(pairs, dtype=int).reshape(-1, 2)
    return Windows(index[:, 0], index[:, 1], samples + 1)


@dataclass(frozen=True)
class Labels:
    """What went on in each window, and where.

    Args:
        table: One row per window: `episode` ("episode 3"), `t_s` of its middle, a column of text or None for each
            factor of `AbstractSystem.factors`, and any numbers that describe it.
        places: Of the factor `place`, if there is one: the middle of each cell by its label.
    """

    table: pd.DataFrame
    places: Mapping[str, tuple[float, float]] = field(default_factory=dict)
