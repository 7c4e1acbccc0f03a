"""Friction of a joint that differs between its two directions."""

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
class AsymmetricFriction(MechanismEffect):
    """Friction of motion in the positive less that in the negative direction, relative to their mean, the model's.

    For dry friction that is a constant force and the mean friction, exactly, moving and at rest. Viscous friction that
    differs is -b |v| / 2 with b the difference. Both stand in the compiled law of joints.
    """

    name: ClassVar[str] = "asymmetric_friction"
    label: ClassVar[str] = "friction that differs between the two directions"
    commonness: ClassVar[int] = 2
    confounded: ClassVar[tuple[Confounded, ...]] = (
        Confounded(
            "torque_offset",
            "dry friction that differs between the directions is a constant force and the mean friction",
            "Let go of the joint where nothing else moves it and friction is overcome by shaking: an offset moves it.",
        ),
    )
    target: str
    dry: float
    viscous: float

    def __post_init__(self) -> None:
        check_range("asymmetric_friction.dry", self.dry, -2.0, 2.0)
        check_range("asymmetric_friction.viscous", self.viscous, -2.0, 2.0)

    def edit_model(self, model: mujoco.MjModel) -> None:
        for joint in parts.sides_of(model, self.target):
            law = parts.law_of(model, joint)
            law["dry_difference"], law["viscous_difference"] = self.dry, self.viscous

    @classmethod
    def applies(cls, scope: Scope) -> bool:
        model, dof = scope.model, parts.dof_of(scope.model, scope.target)
        return parts.is_axis(model, scope.target) and (model.dof_frictionloss[dof] > 0 or model.dof_damping[dof] > 0)

    @classmethod
    def parameters(cls, context: Scope) -> tuple[Parameter, ...]:
        return Parameter("dry", "", 0.2, -2.0, 2.0), Parameter("viscous", "", 0.2, -2.0, 2.0)

    @classmethod
    def from_vector(cls, x: Vector, context: Scope) -> Self:
        return cls(str(context.target), float(x[0]), float(x[1]))

    @classmethod
    def phrase(cls, of: Values, beliefs: Scope, target: str | None = None) -> Phrase:
        model, dof = beliefs.model, parts.dof_of(beliefs.model, target)
        unit = parts.force_unit(model, target)
        offset = -0.5 * of["dry"] * float(model.dof_frictionloss[dof])
        bend = -0.5 * of["viscous"] * float(model.dof_damping[dof])
        return Phrase(
            f"joint '{target}' has other friction one way than the other",
            f"in the positive direction {of.show('dry', '%', 100)} more dry and {of.show('viscous', '%', 100)} more "
            "viscous friction than in the negative, relative to their mean",
            f'Add <general joint="{target}" gainprm="0" biastype="affine" biasprm="{parts.attribute(offset)} 0 0"/> to '
            f"the actuators. MuJoCo has no viscous friction by direction: apply {parts.attribute(bend)} |v| "
            f"besides, in {unit}.",
            f"Pull '{target}' slowly both ways with a force gauge.",
        )
