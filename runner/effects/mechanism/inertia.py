"""A body's inertia."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Self

import mujoco

from runner.effects.base import Parameter, Phrase, Vector
from runner.effects.mechanism import parts
from runner.effects.mechanism.base import MechanismEffect, Scope, effect
from runner.effects.wording import Values
from runner.errors import check_range


@effect
@dataclass(frozen=True)
class Inertia(MechanismEffect):
    """Inertia of a body about its centre of mass times `ratio`, its mass unchanged. Fitted as the log of the ratio."""

    name: ClassVar[str] = "inertia"
    label: ClassVar[str] = "a different inertia"
    target_kind: ClassVar[str] = "body"
    commonness: ClassVar[int] = 2
    target: str
    ratio: float

    def __post_init__(self) -> None:
        check_range("inertia.ratio", self.ratio, 0.0, 1e3, lower_open=True)

    def edit_model(self, model: mujoco.MjModel) -> None:
        model.body_inertia[model.body(self.target).id] *= self.ratio

    @classmethod
    def applies(cls, scope: Scope) -> bool:
        return parts.can_turn(scope.model, scope.target)

    @classmethod
    def parameters(cls, context: Scope) -> tuple[Parameter, ...]:
        return (Parameter("log_inertia_ratio", "", 0.25, -2.5, 2.5),)

    @classmethod
    def from_vector(cls, x: Vector, context: Scope) -> Self:
        return cls(str(context.target), math.exp(x[0]))

    @classmethod
    def phrase(cls, of: Values, beliefs: Scope, target: str | None = None) -> Phrase:
        believed = beliefs.model.body_inertia[beliefs.model.body(target).id]
        return Phrase(
            f"body '{target}' turns {'harder' if of['ratio'] > 1 else 'more easily'} than in the model, "
            "though its mass is right",
            f"its inertia is {of.show('ratio')} times the believed one",
            f'In the <inertial> of <body name="{target}"> set '
            f'diaginertia="{parts.attribute(*(of["ratio"] * believed))}".',
            f"Hang '{target}' from a pivot and time its swing.",
        )
