"""Types of arrays, and which of many are looked at."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def spread_over(count: int, most: int) -> NDArray[np.int64]:
    """Return positions of at most so many of `count` things, evenly spread over all of them."""
    return np.unique(np.linspace(0, count - 1, min(most, count)).round().astype(np.int64))
