"""A load that rests on the base more along one of its axes than along another, or on two of its ends."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from runner.effects.base import Parameter, Phrase, Vector
from runner.effects.planar_box.base import Beliefs, Context, PlanarEffect, Target, effect
from runner.effects.wording import DEGREES, Values, number
from runner.errors import check_range


@effect
@dataclass(frozen=True)
class PressureShape(PlanarEffect):
    """The pressure is that of an even load times exp(xx p^2 + xy p q + yy q^2), p and q body axes over the base's rms
    radius: a flat body that is not quite flat bears in the middle (all below 0), at two ends, or on the rim.

    How a body turns while a pin pushes it slowly is decided by how friction is spread under it (Goyal, Ruina &
    Papadopoulos 1991), in each direction by itself, so that one number for rim and middle does not do. A force that
    flings a body across a floor says little more of the load than that number, hence this belongs to pins. The centre
    of the load is where the moments have it, as ever.
    """

    name: ClassVar[str] = "contact_pressure"
    label: ClassVar[str] = "a base that bears on some of its parts"
    spoken_of: ClassVar[tuple[str, str] | None] = ("shape", "quadratic")
    of_pin: ClassVar[bool] = True
    xx: float
    xy: float
    yy: float

    def __post_init__(self) -> None:
        for key in ("xx", "xy", "yy"):
            check_range(f"contact_pressure.{key}", getattr(self, key), -100.0, 100.0)

    def edit_model(self, target: Target) -> None:
        points = target.dry_friction.points
        x, y, weight = points[:, 0], points[:, 1], points[:, 2]
        p, q = np.array([x, y]) / math.sqrt(np.average(x**2 + y**2, weights=weight))
        log = self.xx * p**2 + self.xy * p * q + self.yy * q**2
        loaded = weight * np.exp(log - np.max(log))
        points[:, 2] = loaded / loaded.sum() * weight.sum()

    @classmethod
    def parameters(cls, context: Context) -> tuple[Parameter, ...]:
        return tuple(Parameter(key, "", 0.5, -6.0, 6.0) for key in ("xx", "xy", "yy"))

    @classmethod
    def from_vector(cls, x: Vector, context: Context) -> Self:
        return cls(x[0], x[1], x[2])

    @classmethod
    def phrase(cls, of: Values, beliefs: Beliefs, target: str | None = None) -> Phrase:
        # the axis along which the load lies furthest out
        angle = 0.5 * math.atan2(of["xy"], of["xx"] - of["yy"])
        numbers = ", ".join(of.show(key) for key in ("xx", "xy", "yy"))
        return Phrase(
            "the base bears on some of its parts more than on others",
            f"the load reaches furthest along the object's axis at {number(angle * DEGREES)}° (shape {numbers}, where "
            "0 is even)",
            "Spread the load over the base as `shape` in corrected.yaml has it: exp(xx p² + xy p q + yy q²) times an "
            "even one.",
            "Put the object on carbon paper, or look at the wear of its base.",
        )
