"""A centre of mass off the geometric centre."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import mujoco

from runner.effects.base import Parameter, Phrase, Vector
from runner.effects.planar_box.base import Beliefs, Context, PlanarEffect, Target, effect
from runner.effects.wording import Values, number
from runner.errors import check_range


@effect
@dataclass(frozen=True)
class ComOffset(PlanarEffect):
    """The centre of mass lies at (`x_m`, `y_m`) from the geometric centre, body axes; inertia about it unchanged."""

    name: ClassVar[str] = "com_offset"
    label: ClassVar[str] = "a centre of mass off the geometric centre"
    x_m: float
    y_m: float

    def __post_init__(self) -> None:
        check_range("com_offset.x_m", self.x_m, -100, 100, unit="m")
        check_range("com_offset.y_m", self.y_m, -100, 100, unit="m")

    def edit_model(self, target: Target) -> None:
        target.model.body_ipos[target.body_id, :2] += (self.x_m, self.y_m)
        mujoco.mj_setConst(target.model, target.scratch)

    @classmethod
    def parameters(cls, context: Context) -> tuple[Parameter, ...]:
        hx, hy, _ = context.half_size_m
        return (
            Parameter("x_m", "m", 0.1 * hx, -0.6 * hx, 0.6 * hx),
            Parameter("y_m", "m", 0.1 * hy, -0.6 * hy, 0.6 * hy),
        )

    @classmethod
    def from_vector(cls, x: Vector, context: Context) -> Self:
        return cls(x[0], x[1])

    @classmethod
    def phrase(cls, of: Values, beliefs: Beliefs, target: str | None = None) -> Phrase:
        return Phrase(
            "the centre of mass is off the geometric centre",
            f"by {of.longs('x_m', 'y_m')} along the object's own x and y",
            f"Move the centre of mass to ({number(beliefs.centre_of_mass_m[0] + of['x_m'])}, "
            f"{number(beliefs.centre_of_mass_m[1] + of['y_m'])}) m in body axes.",
            "Balance the object on an edge, once along each side.",
        )
