"""Another mass than believed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Self

import mujoco

from runner.effects.base import Confounded, Parameter, Phrase, Vector
from runner.effects.planar_box.base import Beliefs, Context, PlanarEffect, Target, effect
from runner.effects.wording import Values, number
from runner.errors import check_range


@effect
@dataclass(frozen=True)
class Mass(PlanarEffect):
    """The body's mass; its inertia scales with it. Fitted as the log of the ratio to the nominal mass."""

    name: ClassVar[str] = "mass"
    label: ClassVar[str] = "a different mass"
    commonness: ClassVar[int] = 0
    confounded: ClassVar[tuple[Confounded, ...]] = (
        Confounded(
            "actuator_gain",
            "friction and inertia grow with the mass, so that the force per mass alone moves the object",
            "Push with a known weight added to the object: a wrong mass shrinks in proportion, a wrong force gain "
            "stays.",
        ),
    )
    mass_kg: float

    def __post_init__(self) -> None:
        check_range("mass.mass_kg", self.mass_kg, 0.0, 1e6, unit="kg", lower_open=True)

    def edit_model(self, target: Target) -> None:
        model, body = target.model, target.body_id
        ratio = self.mass_kg / model.body_mass[body]
        model.body_mass[body] *= ratio
        model.body_inertia[body] *= ratio
        mujoco.mj_setConst(model, target.scratch)

    @classmethod
    def parameters(cls, context: Context) -> tuple[Parameter, ...]:
        return (Parameter("log_mass_ratio", "", 0.15, -1.6, 1.6),)

    @classmethod
    def from_vector(cls, x: Vector, context: Context) -> Self:
        return cls(context.mass_kg * math.exp(x[0]))

    @classmethod
    def phrase(cls, of: Values, beliefs: Beliefs, target: str | None = None) -> Phrase:
        word = "heavier" if of["mass_kg"] > beliefs.mass_kg else "lighter"
        return Phrase(
            f"the object is {word} than believed",
            f"mass {of.show('mass_kg', 'kg')} instead of {number(beliefs.mass_kg)} kg",
            f"Set the mass to {number(of['mass_kg'], 4)} kg; the moments of inertia grow in proportion.",
            "Weigh the object.",
        )
