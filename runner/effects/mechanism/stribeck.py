"""Dry friction of a joint that falls with speed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Self

import mujoco
import numpy as np

from runner.effects.base import Parameter, Phrase, Vector
from runner.effects.mechanism import parts
from runner.effects.mechanism.base import MechanismEffect, Scope, effect
from runner.effects.wording import Values
from runner.errors import check_range


@effect
@dataclass(frozen=True)
class Stribeck(MechanismEffect):
    """Dry friction is Fc (1 + relative_excess exp(-(|v| / speed)^exponent)), Fc the model's `frictionloss`.

    Fc is friction at high speed. What was measured of exponents goes from 1/2 to 2, Tustin's of 1947 is 1
    (Armstrong-Helouvry, Dupont & Canudas de Wit 1994). Solved in the compiled law of joints. `speed` in rad/s or m/s,
    fitted as the log of its ratio to a share of the usual speed; at that speed 63 % of the excess are gone, whatever
    the exponent.
    """

    name: ClassVar[str] = "stribeck"
    label: ClassVar[str] = "dry friction that falls with speed"
    of_joint: ClassVar = {"speed": parts.speed_unit}
    target: str
    relative_excess: float
    speed: float
    exponent: float = 2.0

    def __post_init__(self) -> None:
        check_range("stribeck.relative_excess", self.relative_excess, -1.0, 100.0)
        check_range("stribeck.speed", self.speed, 0.0, 1e6, unit="rad/s", lower_open=True)
        check_range("stribeck.exponent", self.exponent, 0.1, 20.0)

    def edit_model(self, model: mujoco.MjModel) -> None:
        for joint in parts.sides_of(model, self.target):
            law = parts.law_of(model, joint)
            law["excess"], law["excess_speed"], law["excess_power"] = self.relative_excess, self.speed, self.exponent

    @classmethod
    def applies(cls, scope: Scope) -> bool:
        """Without any dry friction in the model there is nothing that an excess could be relative to."""
        dry = scope.model.dof_frictionloss[parts.dof_of(scope.model, scope.target)]
        return parts.is_axis(scope.model, scope.target) and dry > 0.0

    @classmethod
    def parameters(cls, context: Scope) -> tuple[Parameter, ...]:
        return (
            Parameter("relative_excess", "", 0.3, -0.9, 5.0),
            Parameter("log_speed_ratio", "", 1.0, -3.0, 3.0, may_rest=True),
            # as of a box; an exponent at an end of what was measured is an exponent
            Parameter("log_exponent", "", 0.5, math.log(0.5), math.log(2.5), may_rest=True),
        )

    @classmethod
    def from_vector(cls, x: Vector, context: Scope) -> Self:
        speed = 0.2 * parts.typical_speed(context) * math.exp(x[1])
        return cls(str(context.target), float(x[0]), speed, math.exp(x[2]))

    @classmethod
    def starts(cls, context: Scope) -> np.ndarray:
        """Of one exponent: what another does differently, a fit finds, and each start is a motion for each joint."""
        return np.array([[0.3, ratio, math.log(2.0)] for ratio in (-1.2, 0.0, 1.2)])

    @classmethod
    def phrase(cls, of: Values, beliefs: Scope, target: str | None = None) -> Phrase:
        unit = parts.speed_unit(beliefs.model, target)
        more = of["relative_excess"] > 0
        factor = f"1 {of['relative_excess']:+.3g} exp(-(|v| / {of['speed']:.3g})^{of['exponent']:.3g})"
        return Phrase(
            f"dry friction of joint '{target}' {'falls' if more else 'rises'} with speed",
            f"at rest it is {of.show('relative_excess', '%', 100, magnitude=True)} {'more' if more else 'less'} than "
            f"at speed, and has changed by two thirds of that at {of.scale('speed', unit)}",
            f'MuJoCo has no such friction: keep frictionloss of <joint name="{target}"> and, before each step, '
            f"multiply it by {factor}.",
            f"Drive '{target}' at several slow steady speeds and note the force of each.",
        )
