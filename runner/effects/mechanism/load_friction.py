"""Dry friction of a joint that grows with the load on it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import mujoco

from runner.effects.base import Parameter, Phrase, Vector
from runner.effects.mechanism import parts
from runner.effects.mechanism.base import MechanismEffect, Scope, effect
from runner.effects.wording import Values
from runner.errors import check_range

LEAST_FRICTION = 1e-12  # N or N m, so that MuJoCo makes a friction constraint at all


@effect
@dataclass(frozen=True)
class LoadFriction(MechanismEffect):
    """Dry friction is the model's `frictionloss` plus `share` of the load on the gear.

    The load is half of |tau_drive - tau_load|: the mean of what the actuators exert on its one side, and gravity,
    speed, springs and applied forces on the other. What is held at rest is a load of just that torque. After Duclusaud,
    Passault et al. 2025 (Rhoban/bam, M3), whose coefficient is half of `share`: they take the whole difference.
    """

    name: ClassVar[str] = "load_friction"
    label: ClassVar[str] = "dry friction that grows with the load"
    commonness: ClassVar[int] = 2
    target: str
    share: float

    def __post_init__(self) -> None:
        check_range("load_friction.share", self.share, 0.0, 10.0)

    def edit_model(self, model: mujoco.MjModel) -> None:
        if self.share == 0.0:
            return
        dof, law = parts.dof_of(model, self.target), parts.law_of(model, self.target)
        model.dof_frictionloss[dof] = max(float(model.dof_frictionloss[dof]), LEAST_FRICTION)
        law["load_share"] = self.share
        law["drive_after"] = parts.dof_of(model, parts.drive_side(model, self.target)) - dof

    @classmethod
    def applies(cls, scope: Scope) -> bool:
        """Only a joint that is driven has a gear that a load could press on."""
        return parts.is_axis(scope.model, scope.target) and len(parts.actuators_on(scope.model, scope.target)) > 0

    @classmethod
    def parameters(cls, context: Scope) -> tuple[Parameter, ...]:
        return (Parameter("share", "", 0.1, 0.0, 0.95),)

    @classmethod
    def from_vector(cls, x: Vector, context: Scope) -> Self:
        return cls(str(context.target), max(float(x[0]), 0.0))

    @classmethod
    def phrase(cls, of: Values, beliefs: Scope, target: str | None = None) -> Phrase:
        return Phrase(
            f"dry friction of joint '{target}' grows with the torque that its gear passes on",
            f"by {of.show('share', '%', 100)} of it",
            f'MuJoCo has no such friction: before each step set frictionloss of <joint name="{target}"> to the '
            f"believed one plus {of['share']:.3g} times half the difference of actuator torque and torque of the load.",
            f"Hang several weights on '{target}' and note for each the torque at which it begins to rise and to sink.",
        )
