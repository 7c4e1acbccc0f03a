"""Noise beneath a motion: what third differences leave of samples in a row."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from runner.numerics.arrays import FloatArray

OF_WHITE = 20.0  # variances of white noise in third differences: 1 + 9 + 9 + 1


def white_noise(series: Iterable[tuple[FloatArray, FloatArray]]) -> float:
    """Return the standard deviation of the noise of a channel, if it is white and the motion smooth; NaN: too little.

    Args:
        series: Times, (T,), s, rising, and values, (T,), NaN where not measured, of each episode.
    """
    third = np.concatenate([np.empty(0), *(third_differences(t, v) for t, v in series)])
    return float(np.median(np.abs(third))) / 0.6745 / np.sqrt(OF_WHITE) if len(third) else np.nan


def third_differences(t_s: FloatArray, values: FloatArray) -> FloatArray:
    """Return what differences that leave nothing of a parabola leave of each four samples in a row.

    They are divided differences by the times as they are, as clocks are uneven and samples are lost, and as large as
    those of an even clock: white noise has 20 times its variance in them.

    Args:
        t_s: Times, (T,), s, rising.
        values: (T,), NaN where not measured.

    Returns:
        (N - 3,), of the N that were measured; empty where those are fewer than four.
    """
    there = np.isfinite(values)
    if there.sum() < 4:
        return np.empty(0)
    steps = np.diff(t_s[there])
    a, b, c = steps[:-2], steps[1:-1], steps[2:]
    ab, bc, abc = a + b, b + c, a + b + c
    weights = np.stack([-1 / (a * ab * abc), 1 / (a * b * bc), -1 / (ab * b * c), 1 / (abc * bc * c)])
    weights *= np.sqrt(OF_WHITE / np.sum(weights**2, axis=0))
    return np.sum(weights * np.lib.stride_tricks.sliding_window_view(values[there], 4).T, axis=0)
