"""Dry friction of a joint."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import mujoco

from runner.effects.base import Parameter, Phrase, Vector
from runner.effects.mechanism import parts
from runner.effects.mechanism.base import MechanismEffect, Scope, effect
from runner.effects.wording import Values, number
from runner.errors import check_range


@effect
@dataclass(frozen=True)
class JointFriction(MechanismEffect):
    """Dry friction of a joint is `friction`, N m or N. Fitted as the change from the believed one."""

    name: ClassVar[str] = "joint_friction"
    shared: ClassVar[bool] = True
    label: ClassVar[str] = "a different dry friction"
    of_joint: ClassVar = {"friction": parts.force_unit}
    target: str
    friction: float

    def __post_init__(self) -> None:
        check_range("joint_friction.friction", self.friction, 0.0, 1e9, unit="N m")

    def edit_model(self, model: mujoco.MjModel) -> None:
        dofs = [parts.dof_of(model, joint) for joint in parts.sides_of(model, self.target)]
        parts.divided(model.dof_frictionloss, dofs, self.friction)

    @classmethod
    def applies(cls, scope: Scope) -> bool:
        return parts.is_axis(scope.model, scope.target)

    @classmethod
    def parameters(cls, context: Scope) -> tuple[Parameter, ...]:
        force = parts.typical_force(context)
        believed = float(context.model.dof_frictionloss[parts.dof_of(context.model, context.target)])
        unit = parts.force_unit(context.model, context.target)
        return (Parameter("friction_change", unit, max(0.1 * force, 0.2 * believed), -believed, 3 * force),)

    @classmethod
    def from_vector(cls, x: Vector, context: Scope) -> Self:
        believed = float(context.model.dof_frictionloss[parts.dof_of(context.model, context.target)])
        return cls(str(context.target), max(believed + float(x[0]), 0.0))

    @classmethod
    def phrase(cls, of: Values, beliefs: Scope, target: str | None = None) -> Phrase:
        unit = parts.force_unit(beliefs.model, target)
        believed = float(beliefs.model.dof_frictionloss[parts.dof_of(beliefs.model, target)])
        return Phrase(
            f"joint '{target}' has {'more' if of['friction'] > believed else 'less'} dry friction than in the model",
            f"{of.show('friction', unit)} instead of {number(believed)} {unit}",
            f'Set <joint name="{target}" frictionloss="{parts.attribute(of["friction"])}"/>.',
            f"Pull '{target}' slowly both ways with a force gauge: half the difference is its dry friction.",
        )
