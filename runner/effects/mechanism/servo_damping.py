"""A position servo's damping gain."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Self

import mujoco

from runner.effects.base import Confounded, Parameter, Phrase, Vector
from runner.effects.mechanism.base import MechanismEffect, Scope, effect
from runner.effects.mechanism.parts import attribute
from runner.effects.mechanism.servo_gain import is_servo
from runner.effects.wording import Values, number
from runner.errors import check_range


@effect
@dataclass(frozen=True)
class ServoDamping(MechanismEffect):
    """kv of a position servo is `ratio` times the believed one. Fitted as its log."""

    name: ClassVar[str] = "servo_damping"
    shared: ClassVar[bool] = True
    label: ClassVar[str] = "a servo of another damping"
    target_kind: ClassVar[str] = "actuator"
    commonness: ClassVar[int] = 2
    confounded: ClassVar[tuple[Confounded, ...]] = (
        Confounded(
            "joint_damping",
            "a servo below its limit damps its joint just as viscous friction does",
            "Switch the servo off, let its joint swing or turn it by hand, and record that: friction alone damps it.",
        ),
    )
    target: str
    ratio: float

    def __post_init__(self) -> None:
        check_range("servo_damping.ratio", self.ratio, 0.0, 1e4)

    def edit_model(self, model: mujoco.MjModel) -> None:
        model.actuator_biasprm[model.actuator(self.target).id, 2] *= self.ratio

    @classmethod
    def applies(cls, scope: Scope) -> bool:
        """Without kv in the model what damps is `joint_damping`."""
        kv = -float(scope.model.actuator_biasprm[scope.model.actuator(scope.target).id, 2])
        return is_servo(scope.model, scope.target) and kv > 0.0

    @classmethod
    def parameters(cls, context: Scope) -> tuple[Parameter, ...]:
        return (Parameter("log_kv_ratio", "", 0.3, -4.0, 4.0),)

    @classmethod
    def from_vector(cls, x: Vector, context: Scope) -> Self:
        return cls(str(context.target), math.exp(x[0]))

    @classmethod
    def phrase(cls, of: Values, beliefs: Scope, target: str | None = None) -> Phrase:
        believed = -float(beliefs.model.actuator_biasprm[beliefs.model.actuator(target).id, 2])
        return Phrase(
            f"servo '{target}' damps {'more' if of['ratio'] > 1 else 'less'} than in the model",
            f"kv is {of.show('ratio')} times the believed {number(believed)}",
            f'Set <position name="{target}" kv="{attribute(of["ratio"] * believed)}"/>.',
            f"Read the D gain of '{target}' from its controller.",
            f"kv is {of.show('ratio')} times the believed one of each",
        )
