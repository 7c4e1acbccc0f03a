"""Play between the drive and the link of a joint."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Self

import mujoco
import numpy as np

from runner.effects.base import Parameter, Phrase, Vector
from runner.effects.mechanism import parts
from runner.effects.mechanism.base import MechanismEffect, Scope, effect
from runner.effects.mechanism.drive import add_drive, couple, fit_to_step, settle
from runner.effects.wording import DEGREES, Values, length, plus_minus
from runner.errors import check_range


@effect
@dataclass(frozen=True)
class Backlash(MechanismEffect):
    """The link moves freely by `play` in all, rad or m, between flanks of its drive that it meets without rebound.

    The drive has the joint's armature and `friction_share_of_drive` of its dry and viscous friction; see `drive`.
    """

    name: ClassVar[str] = "backlash"
    shared: ClassVar[bool] = True
    label: ClassVar[str] = "play between drive and link"
    of_joint: ClassVar = {"play": parts.position_unit}
    structural: ClassVar[bool] = True
    target: str
    play: float
    friction_share_of_drive: float = 0.6

    def __post_init__(self) -> None:
        check_range("backlash.play", self.play, 0.0, 1e3, unit="rad")
        check_range("backlash.friction_share_of_drive", self.friction_share_of_drive, 0.0, 1.0)
        object.__setattr__(self, "structural", self.play > 0.0)  # without play there is nothing to build

    @property
    def follows(self) -> Mapping[str, str]:
        return {self.target + parts.DRIVE: self.target} if self.play > 0.0 else {}

    def edit_spec(self, spec: mujoco.MjSpec) -> None:
        if self.play > 0.0:
            add_drive(spec, self.target, self.friction_share_of_drive)
            couple(spec, self.target, play=self.play)

    def edit_model(self, model: mujoco.MjModel) -> None:
        if self.play > 0.0:
            fit_to_step(model, self.target)

    def edit_start(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        if self.play > 0.0:
            settle(model, data, self.target)

    @classmethod
    def applies(cls, scope: Scope) -> bool:
        return parts.is_axis(scope.model, scope.target) and len(parts.actuators_on(scope.model, scope.target)) > 0

    @classmethod
    def parameters(cls, context: Scope) -> tuple[Parameter, ...]:
        reach, unit = parts.typical_reach(context), parts.position_unit(context.model, context.target)
        return (
            Parameter("play", unit, 0.02 * reach, 0.0, reach),
            Parameter("friction_share_change", "", 0.25, -0.6, 0.4, may_rest=True),
        )

    @classmethod
    def from_vector(cls, x: Vector, context: Scope) -> Self:
        return cls(str(context.target), max(float(x[0]), 0.0), min(max(0.6 + float(x[1]), 0.0), 1.0))

    @classmethod
    def starts(cls, context: Scope) -> np.ndarray:
        play = cls.parameters(context)[0].scale
        return np.array([[0.3 * play, 0.0], [play, 0.0], [3 * play, 0.0]])

    @classmethod
    def phrase(cls, of: Values, beliefs: Scope, target: str | None = None) -> Phrase:
        if parts.is_hinge(beliefs.model, target):
            error = of.error("play")
            amount = plus_minus(DEGREES * of["play"], None if error is None else DEGREES * error, "°")
        else:
            amount = length(of["play"], of.error("play"))
        half = parts.attribute(0.5 * of["play"])
        return Phrase(
            f"there is play between the drive and the link of joint '{target}'",
            f"{amount} in all",
            f"Give the drive of '{target}' a body and joint of its own, \"{target}{parts.DRIVE}\", with the armature "
            f"and {of['friction_share_of_drive']:.0%} of the friction, let the actuator act on it, and couple the two "
            f'by <fixed limited="true" range="-{half} {half}"><joint joint="{target}" coef="1"/>'
            f'<joint joint="{target}{parts.DRIVE}" coef="-1"/></fixed>.',
            f"Hold the drive and rock '{target}' by hand.",
        )
