"""A tracking frame whose vertical is not gravity's."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Self

import mujoco
import numpy as np

from runner.effects.base import Parameter, Phrase, Vector
from runner.effects.mechanism import contacts
from runner.effects.mechanism.base import MechanismEffect, Scope, effect
from runner.effects.wording import DEGREES, Values, number
from runner.errors import check_range


@effect
@dataclass(frozen=True)
class FrameTilt(MechanismEffect):
    """The frame that poses are measured in is tilted: seen in it, gravity and all that stands still lean alike.

    Its true vertical points down towards its +x by `tilt_x_rad`, and towards +y by `tilt_y_rad`: in the frame, gravity
    pulls there. It is the model's world that is turned; the measured frame stays.
    """

    name: ClassVar[str] = "frame_tilt"
    label: ClassVar[str] = "a tracking frame that is not level"
    target_kind: ClassVar[str] = ""
    commonness: ClassVar[int] = 2
    tilt_x_rad: float
    tilt_y_rad: float

    def __post_init__(self) -> None:
        check_range("frame_tilt.tilt_x_rad", self.tilt_x_rad, -math.pi, math.pi, unit="rad")
        check_range("frame_tilt.tilt_y_rad", self.tilt_y_rad, -math.pi, math.pi, unit="rad")

    def edit_model(self, model: mujoco.MjModel) -> None:
        angle = math.hypot(self.tilt_x_rad, self.tilt_y_rad)
        if angle == 0.0:
            return
        turn = np.empty(4)
        # -z turns towards x about -y, towards y about +x
        mujoco.mju_axisAngle2Quat(turn, np.array([self.tilt_y_rad, -self.tilt_x_rad, 0.0]) / angle, angle)
        gravity = np.array(model.opt.gravity)
        mujoco.mju_rotVecQuat(model.opt.gravity, gravity, turn)
        for g in np.flatnonzero(model.geom_bodyid == 0):
            _turned(model.geom_pos[g], model.geom_quat[g], turn)
        for b in range(1, model.nbody):
            if int(model.body_parentid[b]) == 0 and not contacts.is_free(model, model.body(b).name):
                _turned(model.body_pos[b], model.body_quat[b], turn)

    @classmethod
    def applies(cls, scope: Scope) -> bool:
        model = scope.model
        names = [model.body(b).name for b in range(1, model.nbody)]
        return any(contacts.is_free(model, n) and contacts.touches(model, n) for n in names)

    @classmethod
    def parameters(cls, context: Scope) -> tuple[Parameter, ...]:
        return tuple(Parameter(f"tilt_{axis}_rad", "rad", 0.02, -0.5, 0.5) for axis in "xy")

    @classmethod
    def from_vector(cls, x: Vector, context: Scope) -> Self:
        return cls(float(x[0]), float(x[1]))

    @classmethod
    def phrase(cls, of: Values, beliefs: Scope, target: str | None = None) -> Phrase:
        return Phrase(
            "the frame in which poses are measured is not level",
            f"gravity leans {of.angle('tilt_x_rad')} towards its x and {of.angle('tilt_y_rad')} towards its y",
            f"Turn the measured poses by {number(DEGREES * math.hypot(of['tilt_x_rad'], of['tilt_y_rad']))} degrees so "
            "that z points up, or calibrate the cameras anew.",
            "Hold a plumb line into the view of what tracks, and see whether it is along z.",
        )


def _turned(position: np.ndarray, quaternion: np.ndarray, turn: np.ndarray) -> None:
    """Turn a pose about the origin, in place."""
    before, old = np.array(position), np.array(quaternion)
    mujoco.mju_rotVecQuat(position, before, turn)
    mujoco.mju_mulQuat(quaternion, turn, old)
