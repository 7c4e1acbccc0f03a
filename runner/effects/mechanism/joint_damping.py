"""Viscous friction of a joint."""

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
class JointDamping(MechanismEffect):
    """Viscous friction of a joint is `damping`, N m s/rad or N s/m. Fitted as the change from the believed one."""

    name: ClassVar[str] = "joint_damping"
    shared: ClassVar[bool] = True
    label: ClassVar[str] = "a different viscous friction"
    of_joint: ClassVar = {"damping": parts.damping_unit}
    target: str
    damping: float

    def __post_init__(self) -> None:
        check_range("joint_damping.damping", self.damping, 0.0, 1e9, unit="N m s")

    def edit_model(self, model: mujoco.MjModel) -> None:
        dofs = [parts.dof_of(model, joint) for joint in parts.sides_of(model, self.target)]
        parts.divided(model.dof_damping, dofs, self.damping)

    @classmethod
    def applies(cls, scope: Scope) -> bool:
        return parts.is_axis(scope.model, scope.target)

    @classmethod
    def parameters(cls, context: Scope) -> tuple[Parameter, ...]:
        typical = parts.typical_force(context) / parts.typical_speed(context)
        believed = float(context.model.dof_damping[parts.dof_of(context.model, context.target)])
        unit = parts.damping_unit(context.model, context.target)
        return (Parameter("damping_change", unit, max(0.1 * typical, 0.2 * believed), -believed, 10 * typical),)

    @classmethod
    def from_vector(cls, x: Vector, context: Scope) -> Self:
        believed = float(context.model.dof_damping[parts.dof_of(context.model, context.target)])
        return cls(str(context.target), max(believed + float(x[0]), 0.0))

    @classmethod
    def phrase(cls, of: Values, beliefs: Scope, target: str | None = None) -> Phrase:
        unit = parts.damping_unit(beliefs.model, target)
        believed = float(beliefs.model.dof_damping[parts.dof_of(beliefs.model, target)])
        return Phrase(
            f"joint '{target}' has {'more' if of['damping'] > believed else 'less'} viscous friction than in the model",
            f"{of.show('damping', unit)} instead of {number(believed)} {unit}",
            f'Set <joint name="{target}" damping="{parts.attribute(of["damping"])}"/>.',
            f"Move '{target}' at two steady speeds: the difference in force over that in speed is its damping.",
        )
