"""A constant force from outside."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from runner.effects.base import Confounded, Parameter, Phrase, Vector
from runner.effects.planar_box.base import Beliefs, Context, PlanarEffect, effect
from runner.effects.wording import DEGREES, Values, number
from runner.errors import check_range


@effect
@dataclass(frozen=True)
class Wind(PlanarEffect):
    """A constant force `force_n` towards the world direction `direction_rad`, at the geometric centre."""

    name: ClassVar[str] = "wind"
    label: ClassVar[str] = "a constant force from outside"
    confounded: ClassVar[tuple[Confounded, ...]] = (
        Confounded(
            "floor_tilt",
            "either is a constant force on the object, and a small slope hardly changes what presses it down",
            "Repeat with a known weight added: the pull of a tilted floor grows with the mass, a constant force does "
            "not.",
        ),
    )
    force_n: float
    direction_rad: float

    def __post_init__(self) -> None:
        check_range("wind.force_n", self.force_n, 0.0, 1e6, unit="N")
        check_range("wind.direction_rad", self.direction_rad, -10, 10, unit="rad")

    def edit_command(self, columns: np.ndarray, step_s: float) -> np.ndarray:
        out = columns.copy()
        out[:, 0] += self.force_n * math.cos(self.direction_rad)
        out[:, 1] += self.force_n * math.sin(self.direction_rad)
        return out

    @classmethod
    def parameters(cls, context: Context) -> tuple[Parameter, ...]:
        weight = context.mass_kg * context.gravity_m_s2
        return tuple(Parameter(n, "N", 0.02 * weight, -0.3 * weight, 0.3 * weight) for n in ("force_x", "force_y"))

    @classmethod
    def from_vector(cls, x: Vector, context: Context) -> Self:
        return cls(math.hypot(x[0], x[1]), math.atan2(x[1], x[0]))

    @classmethod
    def phrase(cls, of: Values, beliefs: Beliefs, target: str | None = None) -> Phrase:
        return Phrase(
            "a constant force acts from outside",
            f"{of.show('force_n', 'N')} towards {of.angle('direction_rad')} from the x axis",
            f"Add a constant force of {number(of['force_n'])} N towards {number(of['direction_rad'] * DEGREES)}° from "
            "the x axis.",
            "Look for a draught, a cable that pulls, a magnet; put a spirit level on the floor to rule out a slope.",
        )
