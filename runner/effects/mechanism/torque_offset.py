"""A constant torque or force on a joint."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import mujoco

from runner.effects.base import Confounded, Parameter, Phrase, Vector
from runner.effects.mechanism import parts
from runner.effects.mechanism.base import MechanismEffect, Scope, effect
from runner.effects.wording import Values
from runner.errors import check_range


@effect
@dataclass(frozen=True)
class TorqueOffset(MechanismEffect):
    """A constant `offset` acts on a joint, N m or N. It stands in the compiled law of joints."""

    name: ClassVar[str] = "torque_offset"
    label: ClassVar[str] = "a constant torque"
    of_joint: ClassVar = {"offset": parts.force_unit}
    confounded: ClassVar[tuple[Confounded, ...]] = (
        Confounded(
            "asymmetric_friction",
            "dry friction that differs between the directions is a constant force and the mean friction",
            "Let go of the joint where nothing else moves it and friction is overcome by shaking: an offset moves it.",
        ),
    )
    target: str
    offset: float

    def __post_init__(self) -> None:
        check_range("torque_offset.offset", self.offset, -1e9, 1e9, unit="N m")

    def edit_model(self, model: mujoco.MjModel) -> None:
        parts.law_of(model, self.target)["offset"] = self.offset

    @classmethod
    def applies(cls, scope: Scope) -> bool:
        return parts.is_axis(scope.model, scope.target)

    @classmethod
    def parameters(cls, context: Scope) -> tuple[Parameter, ...]:
        force = parts.typical_force(context)
        return (
            Parameter("offset", parts.force_unit(context.model, context.target), 0.1 * force, -3 * force, 3 * force),
        )

    @classmethod
    def from_vector(cls, x: Vector, context: Scope) -> Self:
        return cls(str(context.target), float(x[0]))

    @classmethod
    def phrase(cls, of: Values, beliefs: Scope, target: str | None = None) -> Phrase:
        bias = parts.attribute(of["offset"])
        return Phrase(
            f"something pulls joint '{target}' steadily to one side",
            of.show("offset", parts.force_unit(beliefs.model, target)),
            f'Add <general joint="{target}" gainprm="0" biastype="affine" biasprm="{bias} 0 0"/> to the actuators.',
            f"Command nothing, shake '{target}' out of its friction, and see where it creeps.",
        )
