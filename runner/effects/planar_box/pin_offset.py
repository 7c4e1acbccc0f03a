"""A pin that is elsewhere than its path says: the frames of robot and tracking are off against each other."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from runner.effects.base import Parameter, Phrase, Vector
from runner.effects.planar_box.base import Beliefs, Context, PlanarEffect, effect
from runner.effects.wording import Values, number
from runner.errors import check_range


@effect
@dataclass(frozen=True)
class PinOffset(PlanarEffect):
    """The pin is at its recorded place plus (`world_x_m`, `world_y_m`), world axes: it touches the body elsewhere."""

    name: ClassVar[str] = "application_point_offset"
    label: ClassVar[str] = "a pin that is elsewhere than recorded"
    of_pin: ClassVar[bool] = True
    world_x_m: float
    world_y_m: float

    def __post_init__(self) -> None:
        check_range("application_point_offset.world_x_m", self.world_x_m, -100, 100, unit="m")
        check_range("application_point_offset.world_y_m", self.world_y_m, -100, 100, unit="m")

    def edit_pin(self, path: np.ndarray, step_s: float) -> np.ndarray:
        return path + np.array([self.world_x_m, self.world_y_m])

    @classmethod
    def parameters(cls, context: Context) -> tuple[Parameter, ...]:
        # calibrations of two frames against each other are off by a few hundredths of what is tracked
        scale, most = 0.02 * context.size_m, 0.5 * context.size_m
        return tuple(Parameter(f"world_{axis}_m", "m", scale, -most, most) for axis in "xy")

    @classmethod
    def from_vector(cls, x: Vector, context: Context) -> Self:
        return cls(x[0], x[1])

    @classmethod
    def phrase(cls, of: Values, beliefs: Beliefs, target: str | None = None) -> Phrase:
        return Phrase(
            "the pin touches the object elsewhere than recorded",
            f"off by ({of.long('world_x_m')}, {of.long('world_y_m')}) along the world's x and y",
            f"Add ({number(of['world_x_m'])}, {number(of['world_y_m'])}) m to the recorded path of the pin.",
            "Let the pin touch the object from two sides and compare the gap that is computed with none.",
        )
