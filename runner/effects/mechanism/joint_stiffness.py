"""A spring on a joint: a cable, a hose."""

from __future__ import annotations

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
class JointStiffness(MechanismEffect):
    """A spring besides the model's: -stiffness (q - rest), N m/rad or N/m, rad or m.

    Negative, down to none at all: the model's is too stiff.
    """

    name: ClassVar[str] = "joint_stiffness"
    label: ClassVar[str] = "a spring"
    of_joint: ClassVar = {"stiffness": parts.stiffness_unit, "rest": parts.position_unit}
    target: str
    stiffness: float
    rest: float

    def __post_init__(self) -> None:
        check_range("joint_stiffness.stiffness", self.stiffness, -1e9, 1e9, unit="N m/rad")
        check_range("joint_stiffness.rest", self.rest, -1e6, 1e6, unit="rad")

    def edit_model(self, model: mujoco.MjModel) -> None:
        if self.stiffness == 0.0:
            return
        joint, address = parts.joint_of(model, self.target), _address(model, self.target)
        both, rest = _together(model, self.target, self.stiffness, self.rest)
        model.jnt_stiffness[joint], model.qpos_spring[address] = both, rest

    @classmethod
    def applies(cls, scope: Scope) -> bool:
        return parts.is_axis(scope.model, scope.target)

    @classmethod
    def parameters(cls, context: Scope) -> tuple[Parameter, ...]:
        model, reach = context.model, parts.typical_reach(context)
        typical = parts.typical_force(context) / reach
        believed = float(model.jnt_stiffness[parts.joint_of(model, context.target)])
        unit = parts.position_unit(model, context.target)
        return (
            Parameter("stiffness", parts.stiffness_unit(model, context.target), 0.1 * typical, -believed, 10 * typical),
            Parameter("rest_change", unit, reach, -5 * reach, 5 * reach, may_rest=True),
        )

    @classmethod
    def from_vector(cls, x: Vector, context: Scope) -> Self:
        rest = float(context.model.qpos_spring[_address(context.model, context.target)])
        return cls(str(context.target), float(x[0]), rest + float(x[1]))

    @classmethod
    def starts(cls, context: Scope) -> np.ndarray:
        stiffness, rest = cls.parameters(context)
        return np.array([[stiffness.scale, r * rest.scale] for r in (-1.0, 0.0, 1.0)])

    @classmethod
    def phrase(cls, of: Values, beliefs: Scope, target: str | None = None) -> Phrase:
        model = beliefs.model
        both, rest = _together(model, target, of["stiffness"], of["rest"])
        stiffness, at = parts.stiffness_unit(model, target), parts.position_unit(model, target)
        return Phrase(
            f"a spring acts on joint '{target}' that is not in the model, such as a cable or hose",
            f"{of.show('stiffness', stiffness)} about {of.show('rest', at)}",
            f'Set <joint name="{target}" stiffness="{parts.attribute(both)}" springref="{parts.attribute(rest)}"/>.',
            f"Move '{target}' by hand with the drive off and feel where it returns to.",
        )


def _together(model: mujoco.MjModel, joint: str | None, stiffness: float, rest: float) -> tuple[float, float]:
    """Return stiffness and rest of the model's spring and another as one."""
    own, own_rest = (
        float(model.jnt_stiffness[parts.joint_of(model, joint)]),
        float(model.qpos_spring[_address(model, joint)]),
    )
    both = own + stiffness
    return both, (own * own_rest + stiffness * rest) / both if both != 0.0 else own_rest


def _address(model: mujoco.MjModel, joint: str | None) -> int:
    return int(model.jnt_qposadr[parts.joint_of(model, joint)])
