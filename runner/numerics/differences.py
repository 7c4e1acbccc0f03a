"""Differences and derivatives of samples in a row: of the noise beneath a motion, and of the motion beneath noise."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from scipy.ndimage import correlate1d

from runner.numerics.arrays import FloatArray

NORMAL_MEDIAN = 0.6745  # of the size of what is normal and has a standard deviation of one
OF_WHITE = 20.0  # variances of white noise in third differences: 1 + 9 + 9 + 1


def white_noise(series: Iterable[tuple[FloatArray, FloatArray]]) -> float:
    """Return the standard deviation of the noise of a channel, if it is white and the motion smooth; NaN: too little.

    Args:
        series: Times, (T,), s, rising, and values, (T,), NaN where not measured, of each episode.
    """
    third = np.concatenate([np.empty(0), *(third_differences(t, v) for t, v in series)])
    return float(np.median(np.abs(third))) / NORMAL_MEDIAN / np.sqrt(OF_WHITE) if len(third) else np.nan


def rounding_noise(series: Iterable[FloatArray]) -> float:
    """Return the standard deviation of the rounding of a sensor that counts, by its smallest step; else 0.

    What counts shows one value again where it hardly moves; steps of what never does are those of a motion.

    Args:
        series: Values of each episode, (T,), NaN where not measured.
    """
    moves = np.concatenate([np.empty(0), *(np.abs(np.diff(v)) for v in series)])
    steps = moves[moves > 0]
    return float(steps.min()) / math.sqrt(12.0) if len(steps) and (moves == 0).any() else 0.0


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


def smooth_derivative(values: FloatArray, window: int, degree: int, order: int = 0, step: float = 1.0) -> FloatArray:
    """Return a derivative of the polynomial through the window around each sample (Savitzky and Golay 1964).

    Within half a window of either end it means nothing. scipy.signal.savgol_filter does the same; with it comes all of
    scipy.stats, for which every command would wait for two seconds.

    Args:
        values: (T, ...), evenly spaced.
        window: How many samples, an odd number.
        degree: Of the polynomial.
        order: Of the derivative; 0: the polynomial itself.
        step: From one sample to the next.

    Returns:
        (T, ...), per `step` ** `order`.
    """
    powers = np.vander(np.arange(window) - window // 2, degree + 1, increasing=True)
    weights = math.factorial(order) * np.linalg.pinv(powers)[order] / step**order
    return np.asarray(correlate1d(values, weights, axis=0), dtype=np.float64)
