"""A position servo's proportional gain."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Self

import mujoco

from runner.effects.base import Parameter, Phrase, Vector
from runner.effects.mechanism.base import MechanismEffect, Scope, effect
from runner.effects.mechanism.parts import attribute
from runner.effects.wording import Values, number
from runner.errors import check_range


def is_servo(model: mujoco.MjModel, actuator: str | None) -> bool:
    """Whether an actuator is a position servo: kp (u - q) - kv v."""
    a = model.actuator(actuator).id
    fixed = int(model.actuator_gaintype[a]) == int(mujoco.mjtGain.mjGAIN_FIXED)
    affine = int(model.actuator_biastype[a]) == int(mujoco.mjtBias.mjBIAS_AFFINE)
    kp = float(model.actuator_gainprm[a, 0])
    return fixed and affine and kp > 0.0 and float(model.actuator_biasprm[a, 1]) == -kp


@effect
@dataclass(frozen=True)
class ServoGain(MechanismEffect):
    """kp of a position servo is `ratio` times the believed one. Fitted as its log."""

    name: ClassVar[str] = "servo_gain"
    shared: ClassVar[bool] = True
    label: ClassVar[str] = "a servo of another stiffness"
    target_kind: ClassVar[str] = "actuator"
    target: str
    ratio: float

    def __post_init__(self) -> None:
        check_range("servo_gain.ratio", self.ratio, 0.0, 1e3)

    def edit_model(self, model: mujoco.MjModel) -> None:
        actuator = model.actuator(self.target).id
        model.actuator_gainprm[actuator, 0] *= self.ratio
        model.actuator_biasprm[actuator, 1] *= self.ratio

    @classmethod
    def applies(cls, scope: Scope) -> bool:
        return is_servo(scope.model, scope.target)

    @classmethod
    def parameters(cls, context: Scope) -> tuple[Parameter, ...]:
        return (Parameter("log_kp_ratio", "", 0.2, -5.0, 5.0),)

    @classmethod
    def from_vector(cls, x: Vector, context: Scope) -> Self:
        return cls(str(context.target), math.exp(x[0]))

    @classmethod
    def phrase(cls, of: Values, beliefs: Scope, target: str | None = None) -> Phrase:
        believed = float(beliefs.model.actuator_gainprm[beliefs.model.actuator(target).id, 0])
        return Phrase(
            f"servo '{target}' is {'stiffer' if of['ratio'] > 1 else 'softer'} than in the model",
            f"kp is {of.show('ratio')} times the believed {number(believed)}",
            f'Set <position name="{target}" kp="{attribute(of["ratio"] * believed)}"/>.',
            f"Hold '{target}' at a target, load it, and measure how far it gives.",
            f"kp is {of.show('ratio')} times the believed one of each",
        )
