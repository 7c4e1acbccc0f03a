"""A body's mass."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Self

import mujoco

from runner.effects.base import Parameter, Phrase, Vector
from runner.effects.mechanism import contacts, parts
from runner.effects.mechanism.base import MechanismEffect, Scope, effect
from runner.effects.wording import Values, number
from runner.errors import check_range


@effect
@dataclass(frozen=True)
class Mass(MechanismEffect):
    """The mass of a body; its inertia is in proportion. Fitted as the log of the ratio to the believed mass."""

    name: ClassVar[str] = "mass"
    label: ClassVar[str] = "a different mass"
    target_kind: ClassVar[str] = "body"
    target: str
    mass_kg: float

    def __post_init__(self) -> None:
        check_range("mass.mass_kg", self.mass_kg, 0.0, 1e9, unit="kg", lower_open=True)

    def edit_model(self, model: mujoco.MjModel) -> None:
        body = model.body(self.target).id
        ratio = self.mass_kg / model.body_mass[body]
        model.body_mass[body] = self.mass_kg
        model.body_inertia[body] *= ratio

    @classmethod
    def applies(cls, scope: Scope) -> bool:
        model = scope.model
        # what is tossed moves alike whatever its mass, as long as no known force pushes it besides
        tossed = contacts.is_alone(model, scope.target) and scope.target not in scope.pushed
        moves = len(parts.joints_above(model, scope.target)) > 0
        return model.body_mass[model.body(scope.target).id] > 0 and moves and not tossed

    @classmethod
    def parameters(cls, context: Scope) -> tuple[Parameter, ...]:
        return (Parameter("log_mass_ratio", "", 0.15, -1.6, 1.6),)

    @classmethod
    def from_vector(cls, x: Vector, context: Scope) -> Self:
        believed = float(context.model.body_mass[context.model.body(context.target).id])
        return cls(str(context.target), believed * math.exp(x[0]))

    @classmethod
    def phrase(cls, of: Values, beliefs: Scope, target: str | None = None) -> Phrase:
        believed = float(beliefs.model.body_mass[beliefs.model.body(target).id])
        ratio = of["mass_kg"] / believed
        return Phrase(
            f"body '{target}' is {'heavier' if ratio > 1 else 'lighter'} than in the model",
            f"{of.show('mass_kg', 'kg')} instead of {number(believed)} kg",
            parts.to_give_of(beliefs.model, cls, target, mass_kg=of["mass_kg"]),
            f"Weigh '{target}'.",
        )
