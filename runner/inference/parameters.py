"""The vector of an explanation's parameters: its bounds, and steps for differences within them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from runner.effects.base import Parameter, Scope


class Parametrized(Protocol):
    """What has parameters."""

    def parameters(self, context: Scope) -> tuple[Parameter, ...]:
        """Return them."""


class Placed(Protocol):
    """An explanation at a vector of its parameters, (p,): a fit, or where one may begin."""

    @property
    def explanation(self) -> Parametrized:
        """The explanation."""

    @property
    def x(self) -> np.ndarray:
        """Its parameters, (p,)."""


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


def is_possible(at: Placed, context: Scope) -> bool:
    """Whether an explanation is one: out of its range an effect does the work of another, and may leave least of all.

    What it leaves is no mark for others, then, and nothing is put beside it.
    """
    return not is_out_of_range(at.explanation.parameters(context), at.x)


def difference_steps(parameters: Sequence[Parameter], x: np.ndarray, share: float) -> np.ndarray:
    """Return steps of a share of each prior width for one-sided differences that stay inside the bounds, (p,)."""
    _, high = bounds(parameters)
    steps = np.array([p.scale * share for p in parameters])
    return np.where(x + steps > high, -steps, steps) if len(steps) else steps
