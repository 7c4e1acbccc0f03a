"""Friction of a body with what it touches."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Self

import mujoco

from runner.effects.base import Parameter, Phrase, Vector
from runner.effects.mechanism import contacts, parts
from runner.effects.mechanism.base import MechanismEffect, Scope, effect
from runner.effects.wording import DEGREES, Values, number
from runner.errors import check_range


@effect
@dataclass(frozen=True)
class ContactFriction(MechanismEffect):
    """The Coulomb coefficient of the contacts of a body is `mu`. Fitted as the log of its ratio to the believed one."""

    name: ClassVar[str] = "friction"
    label: ClassVar[str] = "a different friction in contact"
    target_kind: ClassVar[str] = "body"
    target: str
    mu: float

    def __post_init__(self) -> None:
        check_range("friction.mu", self.mu, 0.0, 100.0)

    def edit_model(self, model: mujoco.MjModel) -> None:
        for contact in contacts.governing(model, self.target):
            contact.sliding[:] = self.mu

    @classmethod
    def applies(cls, scope: Scope) -> bool:
        model = scope.model
        return contacts.touches(model, scope.target) and contacts.believed(model, scope.target).sliding[0] > 0.0

    @classmethod
    def parameters(cls, context: Scope) -> tuple[Parameter, ...]:
        return (Parameter("log_friction_ratio", "", 0.3, -4.0, 2.5),)

    @classmethod
    def from_vector(cls, x: Vector, context: Scope) -> Self:
        believed = float(contacts.believed(context.model, context.target).sliding[0])
        return cls(str(context.target), believed * math.exp(x[0]))

    @classmethod
    def phrase(cls, of: Values, beliefs: Scope, target: str | None = None) -> Phrase:
        believed = float(contacts.believed(beliefs.model, target).sliding[0])
        return Phrase(
            f"body '{target}' has {'more' if of['mu'] > believed else 'less'} friction with what it touches than in "
            "the model",
            f"coefficient {of.show('mu')} instead of {number(believed)}",
            f'For the geoms of <body name="{target}"> set friction="{parts.attribute(of["mu"])}" and a priority above '
            "that of what they touch (else the larger friction of the two counts).",
            f"Tilt the surface until '{target}' slides: the tangent of that angle is the coefficient "
            f"({DEGREES * math.atan(of['mu']):.3g}°).",
        )
