"""Types of arrays, which of many are looked at, and lines over what is missing of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def spread_over(count: int, most: int) -> NDArray[np.int64]:
    """Return positions of at most so many of `count` things, evenly spread over all of them."""
    return np.unique(np.linspace(0, count - 1, min(most, count)).round().astype(np.int64))


def over_gaps(columns: FloatArray, at: FloatArray | None = None) -> FloatArray:
    """Return columns (T, C) with lines where they are NaN, from the last number to the next; 0 where there is none.

    Args:
        columns: Numbers and NaN; they stay as they are.
        at: Where the rows stand, ascending, (T,); None: evenly spaced.
    """
    out = np.array(columns, float)
    at = np.arange(len(out), dtype=float) if at is None else at
    for column in out.T:
        there = np.isfinite(column)
        if not there.all():
            column[~there] = np.interp(at[~there], at[there], column[there]) if there.any() else 0.0
    return out
