"""Elasticity between the drive and the link of a joint."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Self

import mujoco
import numpy as np

from runner.effects.base import Parameter, Phrase, Vector
from runner.effects.mechanism import parts
from runner.effects.mechanism.base import MechanismEffect, Scope, effect
from runner.effects.mechanism.drive import add_drive, couple, drive_armature, fit_to_step, natural_rad_s, settle
from runner.effects.wording import Values
from runner.errors import check_range

DAMPING_RATIO = 0.05  # of the link against the drive, as of metal gears and belts
FRICTION_SHARE = 0.6  # of the joint's friction that sits at the drive
SOFTEST = 3.0  # usual gives: softer couplings are looked for from there
SHOWN = 6  # of the values that are looked at before a fit: so many are in the linear model
RIGID = 1e15  # N m/rad or N/m, beyond any machine: stiffer is not told from no elasticity at all


@effect
@dataclass(frozen=True)
class Compliance(MechanismEffect):
    """A spring of `stiffness` lies between drive and link, N m/rad or N/m; infinite: none. See `drive`.

    Fitted as its inverse, which is zero where the joint is rigid.
    """

    name: ClassVar[str] = "compliance"
    label: ClassVar[str] = "elasticity between drive and link"
    of_joint: ClassVar = {"stiffness": parts.stiffness_unit}
    structural: ClassVar[bool] = True
    target: str
    stiffness: float

    def __post_init__(self) -> None:
        if self.stiffness != math.inf:
            check_range("compliance.stiffness", self.stiffness, 0.0, RIGID, unit="N m/rad", lower_open=True)
        object.__setattr__(self, "structural", math.isfinite(self.stiffness))  # what is rigid needs nothing built

    @property
    def follows(self) -> Mapping[str, str]:
        return {self.target + parts.DRIVE: self.target} if math.isfinite(self.stiffness) else {}

    def swings_rad_s(self, model: mujoco.MjModel) -> float:
        return natural_rad_s(model, self.target, self.stiffness) if math.isfinite(self.stiffness) else 0.0

    def edit_spec(self, spec: mujoco.MjSpec) -> None:
        if not math.isfinite(self.stiffness):
            return
        add_drive(spec, self.target, FRICTION_SHARE)
        couple(spec, self.target, stiffness=self.stiffness, damping_ratio=DAMPING_RATIO)
        if spec.option.integrator == mujoco.mjtIntegrator.mjINT_EULER:  # takes damping of tendons explicitly
            spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST

    def edit_model(self, model: mujoco.MjModel) -> None:
        if math.isfinite(self.stiffness):
            fit_to_step(model, self.target)

    def edit_start(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        if math.isfinite(self.stiffness):
            settle(model, data, self.target)

    @classmethod
    def applies(cls, scope: Scope) -> bool:
        return parts.is_axis(scope.model, scope.target) and len(parts.actuators_on(scope.model, scope.target)) > 0

    @classmethod
    def parameters(cls, context: Scope) -> tuple[Parameter, ...]:
        give = parts.typical_reach(context) / parts.typical_force(context)
        unit = "rad/(N m)" if parts.is_hinge(context.model, context.target) else "m/N"
        return (Parameter("give", unit, 0.03 * give, 0.0, give),)

    @classmethod
    def from_vector(cls, x: Vector, context: Scope) -> Self:
        return cls(str(context.target), 1.0 / float(x[0]) if x[0] > 1.0 / RIGID else math.inf)

    @classmethod
    def starts(cls, context: Scope) -> np.ndarray:
        gives = cls.scan(context)
        return gives[:: math.ceil(len(gives) / SHOWN)][:, None]

    @classmethod
    def scan(cls, context: Scope) -> np.ndarray:
        """From what swings as fast as samples can show to what gives as much as the joint has moved.

        The valley about the true value is as wide as the resonance: twice its damping ratio, in frequency.
        """
        model, softest = context.model, SOFTEST * cls.parameters(context)[0].scale
        dof = parts.dof_of(model, context.target)
        armature, whole = float(model.dof_armature[dof]), float(model.dof_M0[dof])
        inertia = drive_armature(model, dof) * max(whole - armature, 0.0) / whole  # of link against drive
        stiffest = inertia * (math.pi / context.step_s) ** 2
        count = math.log(max(stiffest * softest, 1.0)) / (2.0 * math.log1p(2.0 * DAMPING_RATIO))
        return softest * (1.0 + 2.0 * DAMPING_RATIO) ** (-2.0 * np.arange(math.ceil(count), -1, -1))

    @classmethod
    def phrase(cls, of: Values, beliefs: Scope, target: str | None = None) -> Phrase:
        unit = parts.stiffness_unit(beliefs.model, target)
        return Phrase(
            f"drive and link of joint '{target}' are coupled elastically",
            of.scale("stiffness", unit),
            f"Give the drive of '{target}' a body and joint of its own, \"{target}{parts.DRIVE}\", with the armature "
            f"and {FRICTION_SHARE:.0%} of the friction, let the actuator act on it, and couple the two by "
            f'<fixed springlength="0" stiffness="{parts.attribute(of["stiffness"])}"><joint joint="{target}" coef="1"/>'
            f'<joint joint="{target}{parts.DRIVE}" coef="-1"/></fixed>.',
            f"Lock the drive, load '{target}', and measure how far it gives.",
        )
