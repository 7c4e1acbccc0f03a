"""The shape of the friction cone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import mujoco
import numpy as np

from runner.effects.base import Parameter, Phrase, Vector
from runner.effects.mechanism import contacts
from runner.effects.mechanism.base import MechanismEffect, Scope, effect
from runner.effects.wording import Values
from runner.errors import check_range

OTHER = {"elliptic": "pyramidal", "pyramidal": "elliptic"}
SWITCHED = 0.01  # of the fitted number: there is nothing between the two cones, any more than none is the other one
KINDS = {0: "pyramidal", 1: "elliptic"}


@effect
@dataclass(frozen=True)
class FrictionCone(MechanismEffect):
    """Contacts have the other friction cone of the two that MuJoCo has; `elliptic` is 1 or 0.

    A pyramidal one lets friction be larger towards its corners than along its sides, and pushes bodies that slide off
    the surface; bodies have none. It is one option of the model: named for the first body that touches anything.
    """

    name: ClassVar[str] = "friction_cone"
    label: ClassVar[str] = "another friction cone"
    switch: ClassVar[bool] = True
    target_kind: ClassVar[str] = "body"
    commonness: ClassVar[int] = 2
    target: str
    elliptic: float

    def __post_init__(self) -> None:
        check_range("friction_cone.elliptic", self.elliptic, 0.0, 1.0)

    def edit_model(self, model: mujoco.MjModel) -> None:
        model.opt.cone = round(self.elliptic)

    @classmethod
    def applies(cls, scope: Scope) -> bool:
        return contacts.is_first_in_contact(scope.model, scope.target)

    @classmethod
    def parameters(cls, context: Scope) -> tuple[Parameter, ...]:
        return (Parameter("switched", "", 1.0, 0.0, 2.0),)

    @classmethod
    def from_vector(cls, x: Vector, context: Scope) -> Self:
        believed = int(context.model.opt.cone)
        return cls(str(context.target), float(1 - believed if x[0] > SWITCHED else believed))

    @classmethod
    def starts(cls, context: Scope) -> np.ndarray:
        return np.ones((1, 1))

    @classmethod
    def phrase(cls, of: Values, beliefs: Scope, target: str | None = None) -> Phrase:
        kind = KINDS[int(of["elliptic"] >= 0.5)]
        return Phrase(
            f"the friction of body '{target}' has {'an' if kind == 'elliptic' else 'a'} {kind} cone",
            f"instead of {OTHER[kind]}",
            f'Set <option cone="{kind}"/>.',
            "Slide a body along several directions of the surface: real friction is the same in all of them.",
        )
