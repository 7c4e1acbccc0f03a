"""What an actuator exerts of what it should."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Self

import mujoco

from runner.effects.base import Parameter, Phrase, Vector
from runner.effects.mechanism.base import MechanismEffect, Scope, effect
from runner.effects.mechanism.parts import attribute
from runner.effects.wording import Values
from runner.errors import check_range

LINEAR_GAINS = (int(mujoco.mjtGain.mjGAIN_FIXED), int(mujoco.mjtGain.mjGAIN_AFFINE))
LINEAR_BIASES = (int(mujoco.mjtBias.mjBIAS_NONE), int(mujoco.mjtBias.mjBIAS_AFFINE))


@effect
@dataclass(frozen=True)
class ActuatorGain(MechanismEffect):
    """The force of an actuator is `gain` times what the model has, up to the same limit. Fitted as its log."""

    name: ClassVar[str] = "actuator_gain"
    shared: ClassVar[bool] = True
    label: ClassVar[str] = "a force that is a multiple of the modelled one"
    target_kind: ClassVar[str] = "actuator"
    target: str
    gain: float

    def __post_init__(self) -> None:
        check_range("actuator_gain.gain", self.gain, 0.0, 1e3)

    def edit_model(self, model: mujoco.MjModel) -> None:
        actuator = model.actuator(self.target).id
        model.actuator_gainprm[actuator] *= self.gain
        if int(model.actuator_biastype[actuator]) != LINEAR_BIASES[0]:
            model.actuator_biasprm[actuator] *= self.gain

    @classmethod
    def applies(cls, scope: Scope) -> bool:
        actuator = scope.model.actuator(scope.target).id
        gain, bias = int(scope.model.actuator_gaintype[actuator]), int(scope.model.actuator_biastype[actuator])
        return gain in LINEAR_GAINS and bias in LINEAR_BIASES

    @classmethod
    def parameters(cls, context: Scope) -> tuple[Parameter, ...]:
        return (Parameter("log_gain", "", 0.15, -1.6, 1.6),)

    @classmethod
    def from_vector(cls, x: Vector, context: Scope) -> Self:
        return cls(str(context.target), math.exp(x[0]))

    @classmethod
    def phrase(cls, of: Values, beliefs: Scope, target: str | None = None) -> Phrase:
        actuator = beliefs.model.actuator(target).id
        gain = of["gain"] * beliefs.model.actuator_gainprm[actuator, 0]
        motor = int(beliefs.model.actuator_biastype[actuator]) == LINEAR_BIASES[0]
        if motor:
            gear = attribute(of["gain"] * beliefs.model.actuator_gear[actuator, 0])
            remedy = f'Set <motor name="{target}" gear="{gear}"/>, or gainprm="{attribute(gain)}".'
        else:
            remedy = f"Multiply gainprm and biasprm (kp and kv) of actuator '{target}' by {attribute(of['gain'])}."
        return Phrase(
            f"actuator '{target}' exerts {'more' if of['gain'] > 1 else 'less'} than in the model",
            f"{of.show('gain')} times as much",
            remedy,
            f"Command a constant to '{target}' against a force gauge, several times.",
        )
