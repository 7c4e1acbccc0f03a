"""The noise of a measured force: what was commanded is known, what a sensor shows is not."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from runner.numerics.arrays import FloatArray

ORDER = 5  # of differences that leave next to nothing of what a hand or an arm does, and most of white noise
OF_MEANS, OF_SMOOTH = 0.5, 1.5  # powers of cos^2 between those of single samples (0), of means of two (1), and of more


def force_noise(series: Iterable[FloatArray]) -> float:
    """Return the standard deviation of the noise of a recorded force, in its unit; 0: it has none.

    That of white noise that is as dense at low frequencies. A force that is held, or changes smoothly, has none: most
    differences of the first vanish, and those of the second become less from order to order.

    Noise whose density by frequency w falls with cos(w / 2)^(2 p) has (k + 1) / (k + 1 + p) times the variance of white
    noise in differences of the order k + 1 that it has in those of the order k: p is 0 of samples as they are, 1 of
    means of two, as a line between samples leaves them, and more of what is smooth.

    Args:
        series: The force of each episode, (T,).
    """
    series = tuple(series)
    sizes = []
    for order in (ORDER, ORDER + 1):
        change = np.abs(np.concatenate([np.empty(0), *(np.diff(f, order) for f in series)]))
        sizes.append(float(np.median(change)) / 0.6745 / math.sqrt(math.comb(2 * order, order)) if len(change) else 0.0)
    lower, higher = sizes
    if not (lower > 0.0 and higher > 0.0):
        return 0.0
    p = (ORDER + 1) * ((lower / higher) ** 2 - 1.0)
    if p > OF_SMOOTH:
        return 0.0
    return lower * math.sqrt(2 * ORDER + 2) if p > OF_MEANS else lower
