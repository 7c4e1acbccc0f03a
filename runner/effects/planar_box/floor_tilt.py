"""A floor that is not level."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from runner.effects.base import Confounded, Parameter, Phrase, Vector
from runner.effects.planar_box.base import Beliefs, Context, PlanarEffect, Target, effect
from runner.effects.wording import DEGREES, Values, number
from runner.errors import check_range


@effect
@dataclass(frozen=True)
class FloorTilt(PlanarEffect):
    """The floor slopes down by `angle_rad` towards the world direction `downhill_rad`. Fitted as its two components."""

    name: ClassVar[str] = "floor_tilt"
    label: ClassVar[str] = "a floor that is not level"
    commonness: ClassVar[int] = 0
    confounded: ClassVar[tuple[Confounded, ...]] = (
        Confounded(
            "wind",
            "either is a constant force on the object, and a small slope hardly changes what presses it down",
            "Repeat with a known weight added: the pull of a tilted floor grows with the mass, a constant force does "
            "not.",
        ),
    )
    angle_rad: float
    downhill_rad: float

    def __post_init__(self) -> None:
        check_range("floor_tilt.angle_rad", self.angle_rad, 0.0, 1.2, unit="rad")
        check_range("floor_tilt.downhill_rad", self.downhill_rad, -10, 10, unit="rad")

    def edit_model(self, target: Target) -> None:
        g = float(np.linalg.norm(target.model.opt.gravity))
        down = g * math.sin(self.angle_rad)
        target.model.opt.gravity[:] = (
            down * math.cos(self.downhill_rad),
            down * math.sin(self.downhill_rad),
            -g * math.cos(self.angle_rad),
        )

    @classmethod
    def parameters(cls, context: Context) -> tuple[Parameter, ...]:
        return tuple(Parameter(n, "rad", 0.02, -0.3, 0.3) for n in ("tilt_x", "tilt_y"))

    @classmethod
    def from_vector(cls, x: Vector, context: Context) -> Self:
        return cls(math.hypot(x[0], x[1]), math.atan2(x[1], x[0]))

    @classmethod
    def phrase(cls, of: Values, beliefs: Beliefs, target: str | None = None) -> Phrase:
        return Phrase(
            "the floor is not level",
            f"it slopes by {of.angle('angle_rad')}, downhill towards {of.angle('downhill_rad')} from the x axis",
            f"Tilt gravity by {number(of['angle_rad'] * DEGREES)}° towards {number(of['downhill_rad'] * DEGREES)}° "
            "from the x axis.",
            "Put a spirit level on the floor.",
        )
