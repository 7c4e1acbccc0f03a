"""The vector of an explanation's parameters: its bounds, and steps for differences within them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from runner.effects.base import Parameter


def bounds(parameters: Sequence[Parameter]) -> tuple[np.ndarray, np.ndarray]:
    """Return lower and upper bounds, each (p,)."""
    return np.array([p.lower for p in parameters]), np.array([p.upper for p in parameters])


def on_bound(parameters: Sequence[Parameter], x: np.ndarray) -> np.ndarray:
    """Return which parameters are on one of their bounds, (p,)."""
    low, high = bounds(parameters)
    width = np.maximum(high - low, 1e-12)
    return (x - low < 1e-6 * width) | (high - x < 1e-6 * width)


def is_out_of_range(parameters: Sequence[Parameter], x: np.ndarray) -> bool:
    """Whether the data push an effect out of its range: it is absent, or is not what is going on."""
    return bool((on_bound(parameters, x) & ~np.array([p.may_rest for p in parameters], dtype=bool)).any())


def difference_steps(parameters: Sequence[Parameter], x: np.ndarray, share: float) -> np.ndarray:
    """Return steps of a share of each prior width for one-sided differences that stay inside the bounds, (p,)."""
    _, high = bounds(parameters)
    steps = np.array([p.scale * share for p in parameters])
    return np.where(x + steps > high, -steps, steps) if len(steps) else steps
