"""Levenberg-Marquardt descents of many least-squares problems side by side, each with a damping of its own.

Where the linear model of a block's residuals holds, its damping falls and the steps become Gauss-Newton's; where a step
gains nothing, it rises and they become short ones downhill (Levenberg 1944, Marquardt 1963, with the diagonal of the
normal matrix as scale). How a step is found, what it is worth and when nothing more is to be gained depends on the
problem: it makes the attempts. This module keeps the dampings, and which blocks go on.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

Point = TypeVar("Point")


@dataclass(frozen=True)
class Schedule:
    """How the damping of a block, a share of the diagonal of its normal matrix, follows what its steps gained.

    Args:
        first: To begin with.
        easing: It is divided by this after a step that gained what was promised.
        stiffening: It is multiplied by this after a step that was refused.
        least: It never falls below this.
        least_refused: After a refused step it is at least this.
        most: A block whose damping has risen to this after a refused step goes no further.
    """

    first: float
    easing: float = 10.0
    stiffening: float = 20.0
    least: float = 0.0
    least_refused: float = 0.0
    most: float = np.inf

    def after(self, damping: np.ndarray, eased: np.ndarray | bool, refused: np.ndarray | bool) -> np.ndarray:
        """Return the dampings (n,) after an attempt."""
        higher = np.where(refused, np.maximum(damping * self.stiffening, self.least_refused), damping)
        return np.where(eased, np.maximum(damping / self.easing, self.least), higher)

    def ends_at(self, damping: np.ndarray) -> np.ndarray:
        """Return whose dampings (n,) are the last: a block whose step is refused goes no further, (n,)."""
        return self.after(damping, eased=False, refused=True) >= self.most


@dataclass(frozen=True)
class Trial(Generic[Point]):
    """What came of one step of each of the n blocks that go on; one word for all of them, or one for each, (n,).

    Args:
        point: Where all blocks stand now, those whose step was refused where they stood.
        eased: Whose step was taken and gained what the linear model had promised.
        refused: Whose step was not taken. A block that is neither keeps its damping: its step gained less than was
            promised, or its derivatives were taken anew instead.
        rests: Which need no further step.
    """

    point: Point
    eased: np.ndarray | bool = False
    refused: np.ndarray | bool = False
    rests: np.ndarray | bool = False


# (iteration, where all blocks stand, which of them go on (n,), their dampings (n,))
Step = Callable[[int, Point, np.ndarray, np.ndarray], Trial[Point]]


def descend(step: Step[Point], point: Point, schedule: Schedule, *, iterations: int, blocks: int = 1) -> Point:
    """Return where all blocks stand once none of them goes on, or after so many iterations.

    Args:
        step: Attempts a damped step of each block that goes on.
        point: Where to begin.
        schedule: Of the dampings.
        iterations: At most so many attempts.
        blocks: How many there are.
    """
    damping, going = np.full(blocks, schedule.first), np.arange(blocks)
    for iteration in range(iterations):
        if not len(going):
            break
        attempt = step(iteration, point, going, damping[going])
        point = attempt.point
        stuck = attempt.refused & schedule.ends_at(damping[going])
        damping[going] = schedule.after(damping[going], attempt.eased, attempt.refused)
        going = going[~(attempt.rests | stuck)]
    return point


def damped(normal: np.ndarray, damping: np.ndarray) -> np.ndarray:
    """Return normal matrices (n, p, p) with their diagonals raised by shares (n,) of themselves."""
    return normal + np.einsum("n,nii->ni", damping, normal)[..., None] * np.eye(normal.shape[-1])
