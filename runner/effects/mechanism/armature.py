"""Reflected inertia of a joint's drive."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import mujoco

from runner.effects.base import Confounded, Parameter, Phrase, Vector
from runner.effects.mechanism import parts
from runner.effects.mechanism.base import MechanismEffect, Scope, effect
from runner.effects.wording import Values, number
from runner.errors import check_range


@effect
@dataclass(frozen=True)
class Armature(MechanismEffect):
    """The drive's inertia at the joint is `armature`, kg m2 or kg. Fitted as the change from the believed one."""

    name: ClassVar[str] = "armature"
    shared: ClassVar[bool] = True
    label: ClassVar[str] = "a different inertia of the drive"
    of_joint: ClassVar = {"armature": parts.inertia_unit}
    confounded: ClassVar[tuple[Confounded, ...]] = (
        Confounded(
            "inertia",
            "a body that turns about a fixed axis shows its own inertia and its drive's as one sum",
            "Move the body without its drive.",
        ),
    )
    target: str
    armature: float

    def __post_init__(self) -> None:
        check_range("armature.armature", self.armature, 0.0, 1e9, unit="kg m²")

    def edit_model(self, model: mujoco.MjModel) -> None:
        model.dof_armature[parts.dof_of(model, parts.drive_side(model, self.target))] = self.armature

    @classmethod
    def applies(cls, scope: Scope) -> bool:
        return parts.is_axis(scope.model, scope.target)

    @classmethod
    def parameters(cls, context: Scope) -> tuple[Parameter, ...]:
        dof = parts.dof_of(context.model, context.target)
        believed, whole = float(context.model.dof_armature[dof]), float(context.model.dof_M0[dof])
        unit = parts.inertia_unit(context.model, context.target)
        return (Parameter("armature_change", unit, 0.1 * whole, -believed, 5 * whole),)

    @classmethod
    def from_vector(cls, x: Vector, context: Scope) -> Self:
        believed = float(context.model.dof_armature[parts.dof_of(context.model, context.target)])
        return cls(str(context.target), max(believed + float(x[0]), 0.0))

    @classmethod
    def phrase(cls, of: Values, beliefs: Scope, target: str | None = None) -> Phrase:
        unit = parts.inertia_unit(beliefs.model, target)
        believed = float(beliefs.model.dof_armature[parts.dof_of(beliefs.model, target)])
        return Phrase(
            f"the drive of joint '{target}' has {'more' if of['armature'] > believed else 'less'} inertia than in the "
            "model",
            f"{of.show('armature', unit)} instead of {number(believed)} {unit}",
            f'Set <joint name="{target}" armature="{parts.attribute(of["armature"])}"/>.',
            "Look up the rotor's inertia: at the joint it is that times the gear ratio squared.",
        )
