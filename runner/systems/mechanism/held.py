"""Commands that are held from one sample to the next, on a grid of physics steps."""

from __future__ import annotations

import numpy as np

from runner.numerics.arrays import FloatArray


def even_times(count: int, step_s: float) -> FloatArray:
    """Return times from 0 in even steps, (count,)."""
    return np.arange(count, dtype=np.float64) * step_s


def step_means(t_s: FloatArray, held: FloatArray, edges_s: FloatArray, before: FloatArray) -> FloatArray:
    """Return the mean of a held signal over each step: exact, whatever the clock.

    Args:
        t_s: Times from which the values are held, (T,), rising.
        held: The values, (T, K); the last is held for ever.
        edges_s: Borders of the steps, (n + 1,), rising.
        before: What was held before the first, (K,).

    Returns:
        (n, K).
    """
    first, last = min(t_s[0], edges_s[0]) - 1.0, max(t_s[-1], edges_s[-1]) + 1.0
    knots = np.concatenate([[first], t_s, [last]])
    values = np.vstack([before, held])
    integral = np.vstack([np.zeros(held.shape[1]), np.cumsum(values * np.diff(knots)[:, None], axis=0)])
    k = np.searchsorted(knots, edges_s, side="right") - 1
    at = integral[k] + values[np.minimum(k, len(values) - 1)] * (edges_s - knots[k])[:, None]
    return np.diff(at, axis=0) / np.diff(edges_s)[:, None]
