"""A push that loses a fixed force: no word of the vocabulary, but weighed lest it be taken for one that is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from runner.effects.base import Parameter, Stage, Vector
from runner.effects.planar_box.base import Context, PlanarEffect
from runner.errors import check_range


@dataclass(frozen=True)
class DeadBand(PlanarEffect):
    """Of every push `force_n` is lost, and one that is weaker does nothing. Not in the vocabulary."""

    name: ClassVar[str] = "unknown"
    label: ClassVar[str] = "a dead band of the push"
    stage: ClassVar[Stage] = Stage.DEAD_BAND
    of_command: ClassVar[bool] = True
    force_n: float

    def __post_init__(self) -> None:
        check_range("dead_band.force_n", self.force_n, 0.0, 1e9, unit="N")

    def edit_command(self, columns: np.ndarray, step_s: float) -> np.ndarray:
        size = np.linalg.norm(columns[:, :3], axis=1)
        return columns * (np.maximum(size - self.force_n, 0.0) / np.maximum(size, 1e-300))[:, None]

    @classmethod
    def parameters(cls, context: Context) -> tuple[Parameter, ...]:
        return (Parameter("force_n", "N", 0.1 * context.friction_n, 0.0, context.force_n),)

    @classmethod
    def from_vector(cls, x: Vector, context: Context) -> Self:
        return cls(max(x[0], 0.0))
