"""Measured lengths that are a multiple of the true ones."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from runner.effects.base import Parameter, Phrase, Stage, Vector
from runner.effects.planar_box.base import Beliefs, Context, Motion, PlanarEffect, effect
from runner.effects.wording import Values, number
from runner.errors import check_range


@effect
@dataclass(frozen=True)
class SensorScale(PlanarEffect):
    """Measured lengths and velocities are `ratio` times the true ones. Fitted as its log."""

    name: ClassVar[str] = "sensor_scale"
    label: ClassVar[str] = "measured lengths that are a multiple of the true ones"
    stage: ClassVar[Stage] = Stage.GAIN
    of_sensor: ClassVar[bool] = True
    ratio: float

    def __post_init__(self) -> None:
        check_range("sensor_scale.ratio", self.ratio, 0.01, 100.0)

    def edit_measurement(self, motion: Motion) -> Motion:
        scale = np.array([self.ratio, self.ratio, 1.0])
        return Motion(motion.t_s, motion.pose * scale, motion.twist * scale)

    @classmethod
    def parameters(cls, context: Context) -> tuple[Parameter, ...]:
        return (Parameter("log_ratio", "", 0.05, -1.0, 1.0),)

    @classmethod
    def from_vector(cls, x: Vector, context: Context) -> Self:
        return cls(math.exp(x[0]))

    @classmethod
    def phrase(cls, of: Values, beliefs: Beliefs, target: str | None = None) -> Phrase:
        return Phrase(
            "measured lengths are not true to scale",
            f"{of.show('ratio')} times the true ones",
            f"Divide measured positions and velocities by {number(of['ratio'], 4)}.",
            "Move the object along a ruler and compare.",
        )
