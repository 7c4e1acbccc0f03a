"""Problems for descents: curves over time that share parameters, each episode with a level of its own."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from runner.inference.variable_projection import Basis, FitPoint, Residuals, orthonormal


@dataclass
class Curves(ABC):
    """A problem; starts are levels, (E, 1).

    Args:
        measured: Each curve, (n,).
        gained_share: Of what the step before promised.
        taken: Where derivatives were taken, (p,) each.
    """

    measured: Sequence[NDArray[np.float64]]
    gained_share: float = field(default=1.0, kw_only=True)
    taken: list[NDArray[np.float64]] = field(default_factory=list, kw_only=True)

    @abstractmethod
    def residuals(self, x: NDArray[np.float64], starts: NDArray[np.float64]) -> Residuals:
        """See `Problem`."""

    @abstractmethod
    def slopes(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the derivatives by the parameters, of each episode the same, (n, p)."""

    def linearise(
        self,
        x: NDArray[np.float64],
        starts: NDArray[np.float64],
        basis: Basis | None,
        *,
        checked: bool,
        there: Residuals | None = None,
    ) -> FitPoint:
        """See `Problem`."""
        self.taken.append(x)
        left, slopes = there or self.residuals(x, starts), self.slopes(x)
        around = Basis(*zip(*[orthonormal(np.ones((len(slopes), 1))) for _ in starts], strict=True))
        each = [slopes] * len(starts)
        return FitPoint(x, starts, left.each, each, left.spread, around, fresh=True, gained_share=self.gained_share)

    def best(
        self, x: NDArray[np.float64], starts: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """See `Problem`."""
        left = np.array([[r @ r for r in self.residuals(x, starts[:, k]).each] for k in range(starts.shape[1])]).T
        return starts[np.arange(len(starts)), left.argmin(axis=1)], left.min(axis=1)
