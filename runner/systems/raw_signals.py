"""Measured channels with a rough level of their noise, before that is known better."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from runner.numerics.arrays import FloatArray
from runner.numerics.differences import rounding_noise, white_noise
from runner.recording import Span


@dataclass(frozen=True)
class RawSignals:
    """Measured channels as they are, before their noise is known better: a `Signals`."""

    values: tuple[FloatArray, ...]
    valid: tuple[FloatArray, ...]
    sigma: FloatArray
    spans: tuple[Span, ...]


def raw(
    values: Sequence[FloatArray], times: Sequence[FloatArray], stated: FloatArray, shown: Sequence[FloatArray]
) -> RawSignals:
    """Return channels with their stated noise, or where there is none a rough one.

    Args:
        values: Of each episode, (T, C), NaN where not measured.
        times: Of each episode, (T,), s.
        stated: Standard deviations, (C,); NaN: not stated.
        shown: What shows the noise, as `values`, where values themselves do not.
    """
    rough = [_rough_noise(times, [v[:, c] for v in shown]) for c in range(len(stated))]
    sigma = np.where(np.isfinite(stated), stated, rough)
    spans = tuple(Span(e, 0, len(v)) for e, v in enumerate(values))
    return RawSignals(tuple(values), tuple(np.isfinite(v) for v in values), sigma, spans)


def _rough_noise(times: Sequence[FloatArray], values: Sequence[FloatArray]) -> float:
    """Return the noise of a channel, (T,) for each episode, if it is white."""
    white = white_noise(zip(times, values, strict=True))
    spread = float(spreads([v[:, None] for v in values])[0])
    return max(0.0 if np.isnan(white) else white, rounding_noise(values), 1e-4 * spread, 1e-6)


def spreads(values: Sequence[FloatArray]) -> FloatArray:
    """Return the standard deviation of each channel over all episodes, each (T, C): (C,); 0 of what has no values."""
    columns = [column[np.isfinite(column)] for column in np.concatenate(values).T]
    return np.array([np.std(column) if len(column) else 0.0 for column in columns])
