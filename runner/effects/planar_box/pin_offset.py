"""A pin that is elsewhere than its path says, or touches higher or lower than believed.

The frames of robot and tracking are off against each other; and how high a finger touches, hardly anybody writes down.
The higher, the farther the load on the base lies ahead of the body: by the friction coefficient times the difference.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from runner.effects.base import Parameter, Phrase, Vector
from runner.effects.planar_box.base import Beliefs, Context, PlanarEffect, Target, effect
from runner.effects.wording import Values, number
from runner.errors import check_range


@effect
@dataclass(frozen=True)
class PinOffset(PlanarEffect):
    """The pin is at its recorded place plus (`world_x_m`, `world_y_m`), world axes, and touches `height_m` higher."""

    name: ClassVar[str] = "application_point_offset"
    label: ClassVar[str] = "a pin that is elsewhere than recorded"
    of_pin: ClassVar[bool] = True
    world_x_m: float
    world_y_m: float
    height_m: float = 0.0

    def __post_init__(self) -> None:
        check_range("application_point_offset.world_x_m", self.world_x_m, -100, 100, unit="m")
        check_range("application_point_offset.world_y_m", self.world_y_m, -100, 100, unit="m")
        check_range("application_point_offset.height_m", self.height_m, -100, 100, unit="m")

    def edit_pin(self, path: np.ndarray, step_s: float) -> np.ndarray:
        return path + np.array([self.world_x_m, self.world_y_m])

    def edit_model(self, target: Target) -> None:
        target.dry_friction["pin_height"] += self.height_m

    @classmethod
    def parameters(cls, context: Context) -> tuple[Parameter, ...]:
        # calibrations of two frames against each other are off by a few hundredths of what is tracked
        scale, most = 0.02 * context.size_m, 0.5 * context.size_m
        along = tuple(Parameter(f"world_{axis}_m", "m", scale, -most, most) for axis in "xy")
        # anywhere between base and top, which are no bounds: what is found there may be off by its error
        half, believed = context.half_size_m[2], context.pin_height_m
        return (*along, Parameter("height_m", "m", 0.5 * half, -2 * half - believed, 2 * half - believed))

    @classmethod
    def from_vector(cls, x: Vector, context: Context) -> Self:
        return cls(x[0], x[1], x[2])

    @classmethod
    def phrase(cls, of: Values, beliefs: Beliefs, target: str | None = None) -> Phrase:
        return Phrase(
            "the pin touches the object elsewhere than recorded",
            f"off by {of.longs('world_x_m', 'world_y_m', 'height_m')} along the world's x, y and up",
            f"Add ({number(of['world_x_m'])}, {number(of['world_y_m'])}) m to the recorded path of the pin, and "
            f"{number(of['height_m'])} m to `pin.height`.",
            "Let the pin touch the object from two sides and compare the gap that is computed with none; measure how "
            "high it touches.",
        )
