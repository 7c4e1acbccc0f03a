"""A torque that repeats with the position of a joint: cogging, an eccentric gear."""

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
from runner.effects.wording import Values, length
from runner.errors import check_range

USUAL_CYCLES = 4.0
# per turn: an eccentric gear has one
FEWEST_CYCLES = 0.9
# over the way that was recorded: what has less neither turns round there nor comes back, as any smooth force, such as a
# weight that the model has elsewhere
FEWEST_SEEN = 0.5
TRIED_CYCLES = (1.0, 2.0, 3.0, 4.0, 6.0, 7.0, 8.0, 12.0, 24.0)  # per turn: eccentric gears, poles and slots


@effect
@dataclass(frozen=True)
class TorqueRipple(MechanismEffect):
    """A torque amplitude sin(2 pi cycles q + phase), q in turns of a hinge (cycles per turn) or m (cycles per m).

    Fitted by its sine and cosine parts, about the believed zero of the joint. It acts on the drive's side.
    """

    name: ClassVar[str] = "torque_ripple"
    label: ClassVar[str] = "a torque that depends on the position"
    of_joint: ClassVar = {"amplitude": parts.force_unit}
    commonness: ClassVar[int] = 3
    amplitudes: ClassVar[int] = 2
    target: str
    amplitude: float
    cycles: float
    phase_rad: float

    def __post_init__(self) -> None:
        check_range("torque_ripple.amplitude", self.amplitude, 0.0, 1e9, unit="N m")
        check_range("torque_ripple.cycles", self.cycles, 0.0, 1e6, lower_open=True)
        check_range("torque_ripple.phase_rad", self.phase_rad, -7.0, 7.0, unit="rad")

    def edit_model(self, model: mujoco.MjModel) -> None:
        law = parts.law_of(model, parts.drive_side(model, self.target))
        turn = 1.0 if parts.is_hinge(model, self.target) else 2.0 * math.pi
        law["ripple_sin"] = self.amplitude * math.cos(self.phase_rad)
        law["ripple_cos"] = self.amplitude * math.sin(self.phase_rad)
        law["ripple_rate"] = self.cycles * turn

    @classmethod
    def applies(cls, scope: Scope) -> bool:
        return parts.is_axis(scope.model, scope.target) and len(parts.actuators_on(scope.model, scope.target)) > 0

    @classmethod
    def parameters(cls, context: Scope) -> tuple[Parameter, ...]:
        force, unit = parts.typical_force(context), parts.force_unit(context.model, context.target)
        usual = _usual_cycles(context)
        return (
            Parameter("sine", unit, 0.1 * force, -3 * force, 3 * force),
            Parameter("cosine", unit, 0.1 * force, -3 * force, 3 * force),
            # at the fewest it is some smooth force, which a spring beside it may bend into any other
            Parameter("log_cycles_ratio", "", 1.0, math.log(_fewest_cycles(context) / usual), 3.5),
        )

    @classmethod
    def from_vector(cls, x: Vector, context: Scope) -> Self:
        cycles = _usual_cycles(context) * math.exp(x[2])
        return cls(str(context.target), math.hypot(x[0], x[1]), cycles, math.atan2(x[1], x[0]))

    @classmethod
    def starts(cls, context: Scope) -> np.ndarray:
        sine, cosine, cycles = cls.parameters(context)
        tried = (math.log(cycle / USUAL_CYCLES) for cycle in TRIED_CYCLES)
        return np.array([[0.3 * sine.scale, 0.3 * cosine.scale, ratio] for ratio in tried if ratio >= cycles.lower])

    @classmethod
    def units(cls, context: Scope) -> Mapping[str, str]:
        return {
            **super().units(context),
            "cycles": "1/turn" if parts.is_hinge(context.model, context.target) else "1/m",
        }

    @classmethod
    def phrase(cls, of: Values, beliefs: Scope, target: str | None = None) -> Phrase:
        hinge = parts.is_hinge(beliefs.model, target)
        unit, per = parts.force_unit(beliefs.model, target), "turn" if hinge else "m"
        rate = of["cycles"] * (1.0 if hinge else 2.0 * math.pi)
        angle = f"{parts.attribute(rate)} q {'+' if of['phase_rad'] >= 0 else '-'} {abs(of['phase_rad']):.3g}"
        kind, turned = ("torque", "Turn") if hinge else ("force", "Move")
        every = "" if hinge else f", or once in {length(1.0 / of['cycles'])}"
        return Phrase(
            f"the {kind} of joint '{target}' varies with its position, as by cogging or an eccentric gear",
            f"by {of.show('amplitude', unit)} to either side, {of.show('cycles')} times per {per}{every}",
            f"MuJoCo has no such {kind}: before each step add {parts.attribute(of['amplitude'])} "
            f"sin({angle}) to qfrc_applied of joint '{target}'.",
            f"{turned} '{target}' slowly by hand with the drive off and feel for notches.",
        )


def _usual_cycles(scope: Scope) -> float:
    """Return the cycles, per turn or m, that the fitted ones are compared with: of a slide, so many over its way."""
    if parts.is_hinge(scope.model, scope.target):
        return max(USUAL_CYCLES, 2.0 * _fewest_cycles(scope))
    return USUAL_CYCLES * _once(scope)


def _fewest_cycles(scope: Scope) -> float:
    """Return the fewest cycles, per turn or m, that are told from a smooth force on the way that was recorded."""
    seen = FEWEST_SEEN * _once(scope)
    return max(FEWEST_CYCLES, seen) if parts.is_hinge(scope.model, scope.target) else seen


def _once(scope: Scope) -> float:
    """Return how many cycles, per turn or m, are one over the way that the joint was recorded on."""
    way = 2.0 * parts.typical_reach(scope)
    return 2.0 * math.pi / way if parts.is_hinge(scope.model, scope.target) else 1.0 / way
