"""What a delay does to a box, whether it is one of the command or of the measurement."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from runner.effects.base import Confounded, Parameter, Stage, Vector
from runner.effects.planar_box.base import Context, Motion, PlanarEffect, ahead, late

WHY = "all that is measured comes later after the command, by the same time"
ADVICE = (
    "Add an event that is timed by itself, such as an impact or a second sensor: only a late measurement shifts it."
)


def confounded_with(name: str) -> tuple[Confounded, ...]:
    """Return that no recording of a box tells a delay from the other one."""
    return (Confounded(name, WHY, ADVICE),)


@dataclass(frozen=True)
class Delay(PlanarEffect):
    """Everything that is measured comes `delay_s` later after the command."""

    stage: ClassVar[Stage] = Stage.TIMING
    delay_s: float

    def edit_command(self, columns: np.ndarray, step_s: float) -> np.ndarray:
        return late(columns, self.delay_s, step_s)

    def edit_pin(self, path: np.ndarray, step_s: float) -> np.ndarray:
        return late(path, self.delay_s, step_s, before=path[0])

    def edit_measurement(self, motion: Motion) -> Motion:
        return ahead(motion, self.delay_s)

    @classmethod
    def parameters(cls, context: Context) -> tuple[Parameter, ...]:
        return (Parameter("delay_s", "s", 0.08, 0.0, 1.0),)

    @classmethod
    def sizes(cls, context: Context) -> np.ndarray:
        """Return delays that are looked at, (k, 1): the slope at none does not tell what one as long as a push does."""
        (delay,) = cls.parameters(context)
        return delay.scale * np.array([[1.0], [2.0], [4.0]])

    @classmethod
    def from_vector(cls, x: Vector, context: Context) -> Self:
        return cls(max(x[0], 0.0))
