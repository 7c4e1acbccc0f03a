"""A recursive filter of first order, which lags and coloured noise are.

scipy.signal.lfilter does the same, bit for bit; with it comes all of scipy.stats, for which every command would wait
a second.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from runner.numerics.arrays import FloatArray


def filtered(x: np.ndarray, now: float, before: float, decay: float, start: np.ndarray | float = 0.0) -> FloatArray:
    """Return y[k] = now x[k] + before x[k - 1] + decay y[k - 1] along the last axis.

    Args:
        x: What is filtered, (..., n).
        now: Weight of the sample itself.
        before: Weight of the one before it.
        decay: What is left of y after a step.
        start: What the first y has from before, before x[-1] + decay y[-1], (...).

    Returns:
        y, (..., n).
    """
    out = np.array(x, dtype=np.float64, order="C")
    rows = out.reshape(-1, out.shape[-1])
    state = np.empty(out.shape[:-1])
    state[...] = start
    _filter(rows, state.reshape(-1), float(now), float(before), float(decay))
    return out


@njit(cache=True)
def _filter(rows: np.ndarray, state: np.ndarray, now: float, before: float, decay: float) -> None:
    for i in range(rows.shape[0]):
        left = state[i]
        for k in range(rows.shape[1]):
            value = rows[i, k]
            y = left + now * value
            left = before * value + decay * y
            rows[i, k] = y
