"""The distance from a joint to the one before it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Self

import mujoco
import numpy as np

from runner.effects.base import Parameter, Phrase, Vector
from runner.effects.mechanism import parts
from runner.effects.mechanism.base import MechanismEffect, Scope, effect
from runner.effects.wording import Values, length
from runner.errors import check_range

SHORTEST_M = 1e-4


@effect
@dataclass(frozen=True)
class LinkLength(MechanismEffect):
    """The way from the parent joint to this joint is `ratio` times the believed one; masses stay where they are.

    What hangs on the joint moves with it. Fitted as the log of the ratio.
    """

    name: ClassVar[str] = "link_length"
    label: ClassVar[str] = "a link of another length"
    commonness: ClassVar[int] = 2
    target: str
    ratio: float

    def __post_init__(self) -> None:
        check_range("link_length.ratio", self.ratio, 0.0, 100.0, lower_open=True)

    def edit_model(self, model: mujoco.MjModel) -> None:
        shift = (self.ratio - 1.0) * _way(model, self.target)
        for joint in parts.sides_of(model, self.target):
            model.body_pos[int(model.jnt_bodyid[parts.joint_of(model, joint)])] += shift

    @classmethod
    def applies(cls, scope: Scope) -> bool:
        model, joint = scope.model, parts.joint_of(scope.model, scope.target)
        first = int(model.body_jntadr[int(model.jnt_bodyid[joint])]) == joint
        return first and float(np.linalg.norm(_way(model, scope.target))) > SHORTEST_M

    @classmethod
    def parameters(cls, context: Scope) -> tuple[Parameter, ...]:
        return (Parameter("log_length_ratio", "", 0.03, -0.7, 0.7),)

    @classmethod
    def from_vector(cls, x: Vector, context: Scope) -> Self:
        return cls(str(context.target), math.exp(x[0]))

    @classmethod
    def phrase(cls, of: Values, beliefs: Scope, target: str | None = None) -> Phrase:
        model = beliefs.model
        body = int(model.jnt_bodyid[parts.joint_of(model, target)])
        way = _way(model, target)
        pos = model.body_pos[body] + (of["ratio"] - 1.0) * way
        believed = float(np.linalg.norm(way))
        return Phrase(
            f"joint '{target}' is {'farther from' if of['ratio'] > 1 else 'nearer to'} the joint before it "
            "than in the model",
            f"{length(of['ratio'] * believed, (of.error('ratio') or 0.0) * believed)} instead of {length(believed)}",
            f'Set <body name="{model.body(body).name}" pos="{parts.attribute(*pos)}"/>.',
            "Measure from axis to axis.",
        )


def _way(model: mujoco.MjModel, joint: str | None) -> np.ndarray:
    """Return the way from the parent joint to a joint, (3,) m, in the frame of the parent of the joint's body.

    Zero where there is no joint between it and the world.
    """
    number_of_joint = parts.joint_of(model, joint)
    body = int(model.jnt_bodyid[number_of_joint])
    way = model.body_pos[body] + _turned(model.body_quat[body], model.jnt_pos[number_of_joint])
    parent, back = int(model.body_parentid[body]), np.array([1.0, 0.0, 0.0, 0.0])  # from the ancestor's frame
    while parent > 0 and model.body_jntnum[parent] == 0:
        way = model.body_pos[parent] + _turned(model.body_quat[parent], way)
        product = np.empty(4)
        mujoco.mju_mulQuat(product, model.body_quat[parent], back)
        back = product
        parent = int(model.body_parentid[parent])
    if parent == 0:
        return np.zeros(3)
    last = int(model.body_jntadr[parent]) + int(model.body_jntnum[parent]) - 1
    inverse = np.empty(4)
    mujoco.mju_negQuat(inverse, back)
    return _turned(inverse, way - model.jnt_pos[last])


def _turned(quaternion: np.ndarray, vector: np.ndarray) -> np.ndarray:
    out = np.empty(3)
    mujoco.mju_rotVecQuat(out, vector, quaternion)
    return out
