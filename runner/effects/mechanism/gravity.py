"""Gravity: its size, and its direction in a base that is not level."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Self

import mujoco
import numpy as np

from runner.effects.base import Parameter, Phrase, Vector
from runner.effects.mechanism import contacts
from runner.effects.mechanism.base import MechanismEffect, Scope, effect
from runner.effects.mechanism.parts import attribute
from runner.effects.wording import DEGREES, Values, plus_minus
from runner.errors import check_range


@effect
@dataclass(frozen=True)
class Gravity(MechanismEffect):
    """Gravity is `ratio` times the believed one. Fitted as its log."""

    name: ClassVar[str] = "gravity"
    label: ClassVar[str] = "a different gravity"
    target_kind: ClassVar[str] = ""
    commonness: ClassVar[int] = 2
    ratio: float

    def __post_init__(self) -> None:
        check_range("gravity.ratio", self.ratio, 0.0, 100.0)

    def edit_model(self, model: mujoco.MjModel) -> None:
        model.opt.gravity *= self.ratio

    @classmethod
    def applies(cls, scope: Scope) -> bool:
        """It matters where it moves something, in some posture."""
        data = mujoco.MjData(scope.model)
        for posture in (0.0, 0.5):
            data.qpos[:] = scope.model.qpos0 + posture
            mujoco.mj_normalizeQuat(scope.model, data.qpos)
            mujoco.mj_forward(scope.model, data)
            if np.any(abs(data.qfrc_bias) > 1e-9):
                return True
        return False

    @classmethod
    def parameters(cls, context: Scope) -> tuple[Parameter, ...]:
        return (Parameter("log_gravity_ratio", "", 0.05, -2.0, 1.0),)

    @classmethod
    def from_vector(cls, x: Vector, context: Scope) -> Self:
        return cls(math.exp(x[0]))

    @classmethod
    def phrase(cls, of: Values, beliefs: Scope, target: str | None = None) -> Phrase:
        vector = of["ratio"] * beliefs.model.opt.gravity
        return Phrase(
            f"gravity pulls {'more' if of['ratio'] > 1 else 'less'} than in the model",
            f"{of.show('ratio')} times as much",
            f'Set <option gravity="{attribute(*vector)}"/>.',
            f"Gravity itself is known: {_to_check(beliefs.model)}.",
        )


def _to_check(model: mujoco.MjModel) -> str:
    """Return what to look for where it seems to pull more or less."""
    if any(contacts.is_alone(model, body) for body in contacts.moving_bodies(model)):
        return "measure a length and a time of the recording by hand"
    return "look for a counterweight, or for masses that are all wrong by one factor"


@effect
@dataclass(frozen=True)
class GravityTilt(MechanismEffect):
    """Gravity points elsewhere: the base is not level.

    It is turned by the angle of (`tilt_x_rad`, `tilt_y_rad`) so that its pull moves towards +x and +y of the world;
    where it is believed along x or y, the axes that are left take their place.
    """

    name: ClassVar[str] = "gravity"
    label: ClassVar[str] = "a base that is not level"
    target_kind: ClassVar[str] = ""
    commonness: ClassVar[int] = 2
    tilt_x_rad: float
    tilt_y_rad: float

    def __post_init__(self) -> None:
        check_range("gravity.tilt_x_rad", self.tilt_x_rad, -math.pi, math.pi, unit="rad")
        check_range("gravity.tilt_y_rad", self.tilt_y_rad, -math.pi, math.pi, unit="rad")

    def edit_model(self, model: mujoco.MjModel) -> None:
        model.opt.gravity = tilted(model.opt.gravity, self.tilt_x_rad, self.tilt_y_rad)

    @classmethod
    def applies(cls, scope: Scope) -> bool:
        return scope.model.nv > 0 and bool(np.any(scope.model.opt.gravity))

    @classmethod
    def parameters(cls, context: Scope) -> tuple[Parameter, ...]:
        return tuple(Parameter(f"tilt_{axis}_rad", "rad", 0.03, -0.8, 0.8) for axis in "xy")

    @classmethod
    def from_vector(cls, x: Vector, context: Scope) -> Self:
        return cls(float(x[0]), float(x[1]))

    @classmethod
    def phrase(cls, of: Values, beliefs: Scope, target: str | None = None) -> Phrase:
        vector = tilted(beliefs.model.opt.gravity, of["tilt_x_rad"], of["tilt_y_rad"])
        errors = [of.error("tilt_x_rad"), of.error("tilt_y_rad")]
        towards = [
            f"{plus_minus(DEGREES * of[f'tilt_{axis}_rad'], None if e is None else DEGREES * e, '°')} towards {axis}"
            for axis, e in zip("xy", errors, strict=True)
        ]
        flies = all(contacts.is_alone(beliefs.model, body) for body in contacts.moving_bodies(beliefs.model))
        return Phrase(
            "gravity leans in the frame that poses are measured in" if flies else "the base is not level",
            " and ".join(towards),
            f'Set <option gravity="{attribute(*vector)}"/>.',
            "Hold a plumb line into the view of what tracks." if flies else "Put a spirit level on the base.",
        )


def tilted(gravity: np.ndarray, tilt_x_rad: float, tilt_y_rad: float) -> np.ndarray:
    """Return a vector (3,) of the same length that is turned towards two axes at right angles to it."""
    angle = math.hypot(tilt_x_rad, tilt_y_rad)
    size = float(np.linalg.norm(gravity))
    if angle == 0.0 or size == 0.0:
        return gravity.copy()
    down = gravity / size
    axes = []
    for axis in np.eye(3)[np.argsort(abs(down) > 0.9, kind="stable")][:2]:  # those that it isn't along
        for other in [down, *axes]:
            axis = axis - (axis @ other) * other
        axes.append(axis / np.linalg.norm(axis))
    towards = (tilt_x_rad * axes[0] + tilt_y_rad * axes[1]) / angle
    return size * (math.cos(angle) * down + math.sin(angle) * towards)
