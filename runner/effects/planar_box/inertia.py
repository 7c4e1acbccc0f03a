"""Another moment of inertia than believed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Self

import mujoco

from runner.effects.base import Parameter, Phrase, Vector
from runner.effects.planar_box.base import Beliefs, Context, PlanarEffect, Target, effect
from runner.effects.wording import Values, number
from runner.errors import check_range


@effect
@dataclass(frozen=True)
class Inertia(PlanarEffect):
    """Inertia times `ratio`, mass unchanged. Fitted as the log of the ratio."""

    name: ClassVar[str] = "inertia"
    label: ClassVar[str] = "a different moment of inertia"
    ratio: float

    def __post_init__(self) -> None:
        check_range("inertia.ratio", self.ratio, 0.02, 50.0)

    def edit_model(self, target: Target) -> None:
        target.model.body_inertia[target.body_id] *= self.ratio
        mujoco.mj_setConst(target.model, target.scratch)

    @classmethod
    def parameters(cls, context: Context) -> tuple[Parameter, ...]:
        return (Parameter("log_inertia_ratio", "", 0.25, -2.0, 1.6),)

    @classmethod
    def from_vector(cls, x: Vector, context: Context) -> Self:
        return cls(math.exp(x[0]))

    @classmethod
    def phrase(cls, of: Values, beliefs: Beliefs, target: str | None = None) -> Phrase:
        word = "harder" if of["ratio"] > 1 else "easier"
        moment = of["ratio"] * beliefs.yaw_inertia_kg_m2
        return Phrase(
            f"the object is {word} to turn than believed",
            f"moment of inertia {of.show('ratio')} times the believed one, {number(moment)} kg m²",
            f"Set the moment of inertia about the vertical to {number(moment, 4)} kg m².",
            "Hang the object from a wire, let it swing about the vertical, and time it against a known body.",
        )
