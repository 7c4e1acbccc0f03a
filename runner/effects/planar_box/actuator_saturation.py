"""A push that is limited."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from runner.effects.base import Parameter, Phrase, Stage, Vector
from runner.effects.planar_box.base import Beliefs, Context, PlanarEffect, effect
from runner.effects.wording import Values, number
from runner.errors import check_range


@effect
@dataclass(frozen=True)
class ActuatorSaturation(PlanarEffect):
    """The push is at most `limit_n`. Fitted as the share of the largest commanded force that is cut off."""

    name: ClassVar[str] = "actuator_saturation"
    label: ClassVar[str] = "a push that is limited"
    stage: ClassVar[Stage] = Stage.LIMIT
    of_command: ClassVar[bool] = True
    limit_n: float

    def __post_init__(self) -> None:
        check_range("actuator_saturation.limit_n", self.limit_n, 0.0, 1e9, unit="N")

    def edit_command(self, columns: np.ndarray, step_s: float) -> np.ndarray:
        size = np.linalg.norm(columns[:, :3], axis=1)
        return columns * np.minimum(1.0, self.limit_n / np.maximum(size, 1e-300))[:, None]

    @classmethod
    def parameters(cls, context: Context) -> tuple[Parameter, ...]:
        return (Parameter("cut_share", "", 0.2, 0.0, 0.95),)

    @classmethod
    def from_vector(cls, x: Vector, context: Context) -> Self:
        return cls(context.force_n * (1 - x[0]))

    @classmethod
    def starts(cls, context: Context) -> np.ndarray:
        """Return shares of every size: the largest push of all may be one of few, and far above the limit."""
        return np.array([[s] for s in (0.1, 0.3, 0.5, 0.7)])

    @classmethod
    def phrase(cls, of: Values, beliefs: Beliefs, target: str | None = None) -> Phrase:
        return Phrase(
            "the push is limited",
            f"to {of.show('limit_n', 'N')}",
            f"Limit the magnitude of the commanded force to {number(of['limit_n'])} N.",
            "Command the largest push against a force gauge.",
        )
