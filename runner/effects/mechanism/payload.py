"""Something that a model lacks, fixed to a body: a tool, a lens, a battery, a bundle of cable.

It changes the body's mass, where that is, and how it turns, all three by one mass at one point: m at d from the centre
of mass of a body of mass M and inertia I (matrices, in the body's axes) makes

    M' = M + m,   c' = c + m d / M',   I' = I + (m M / M') (|d|^2 1 - d d^T)   (Steiner)
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import mujoco
import numpy as np

from runner.effects.base import Parameter, Phrase, Stage, Vector
from runner.effects.mechanism import parts
from runner.effects.mechanism.base import MechanismEffect, Scope, effect
from runner.effects.mechanism.mass import Mass
from runner.effects.wording import Values, listed
from runner.errors import check_range

USUAL_SHIFT = 0.2  # of the body's size: how far its centre of mass moves
FARTHEST_SHIFT = 3.0
NEAREST, FURTHEST = -3.5, 2.5  # logs: beyond the centre of mass of both, in sizes of the body


@effect
@dataclass(frozen=True)
class Payload(MechanismEffect):
    """A point mass on a body, at a place in its axes.

    Fitted by what a motion shows first: how far the centre of mass of both is from the believed one, along each axis,
    and by the log of how far beyond that the payload is, in sizes of the body. It is the heavier the nearer it is.
    """

    name: ClassVar[str] = "payload"
    label: ClassVar[str] = "something attached that the model lacks"
    target_kind: ClassVar[str] = "body"
    stage: ClassVar[Stage] = Stage.ATTACHED
    commonness: ClassVar[int] = 2
    target: str
    mass_kg: float
    x_m: float
    y_m: float
    z_m: float

    def __post_init__(self) -> None:
        check_range("payload.mass_kg", self.mass_kg, 0.0, 1e9, unit="kg")
        for key in ("x_m", "y_m", "z_m"):
            check_range(f"payload.{key}", getattr(self, key), -1e3, 1e3, unit="m")

    def edit_model(self, model: mujoco.MjModel) -> None:
        if self.mass_kg == 0.0:
            return
        body = model.body(self.target).id
        mass = float(model.body_mass[body])
        away = np.array([self.x_m, self.y_m, self.z_m]) - model.body_ipos[body]
        turn = np.zeros(9)
        mujoco.mju_quat2Mat(turn, model.body_iquat[body])
        axes = turn.reshape(3, 3)
        total = mass + self.mass_kg
        added = self.mass_kg * mass / total * (away @ away * np.eye(3) - np.outer(away, away))
        moments, axes = np.linalg.eigh(axes * model.body_inertia[body] @ axes.T + added)
        axes[:, 0] *= np.linalg.det(axes)  # a turn, and no mirror
        model.body_mass[body] = total
        model.body_ipos[body] += self.mass_kg / total * away
        model.body_inertia[body] = moments
        mujoco.mju_mat2Quat(model.body_iquat[body], axes.ravel())

    @classmethod
    def applies(cls, scope: Scope) -> bool:
        return Mass.applies(scope) and parts.can_turn(scope.model, scope.target)

    @classmethod
    def parameters(cls, context: Scope) -> tuple[Parameter, ...]:
        size = parts.body_size_m(context.model, context.target)
        usual, farthest = USUAL_SHIFT * size, FARTHEST_SHIFT * size
        return (
            *(Parameter(f"shift_{axis}_m", "m", usual, -farthest, farthest) for axis in "xyz"),
            Parameter("log_beyond", "", 1.0, NEAREST, FURTHEST, may_rest=True),
        )

    @classmethod
    def from_vector(cls, x: Vector, context: Scope) -> Self:
        model, body = context.model, context.model.body(context.target).id
        shift, beyond_m = np.asarray(x[:3]), parts.body_size_m(model, context.target) * math.exp(x[3])
        far = float(np.linalg.norm(shift))
        away = shift * (1.0 + beyond_m / far) if far else shift
        place = model.body_ipos[body] + away
        return cls(str(context.target), float(model.body_mass[body]) * far / beyond_m, *map(float, place))

    @classmethod
    def starts(cls, context: Scope) -> np.ndarray:
        """Return a little to each side: of what is not there nothing tells on which side it is."""
        shifts = 0.5 * np.diag([p.scale for p in cls.parameters(context)[:3]])
        return np.pad(np.concatenate([shifts, -shifts]), ((0, 0), (0, 1)))

    @classmethod
    def phrase(cls, of: Values, beliefs: Scope, target: str | None = None) -> Phrase:
        told = _told(of, beliefs.model, target)
        where = [f"{axis} {of.long(axis + '_m')}" for axis in told]
        lacks = [axis for axis in "xyz" if axis not in told]
        written = _written({key: of[key] for key in ("mass_kg", "x_m", "y_m", "z_m")}, told, beliefs.model, target)
        return Phrase(
            f"something that the model lacks is attached to body '{target}': a tool, a payload or a part",
            f"{of.show('mass_kg', 'kg')}{' at ' + listed(where) + ' in body axes' if where else ''}"
            + (f"; the motion does not tell {listed(lacks, 'or')}" if lacks else ""),
            parts.to_give_of(beliefs.model, cls, target, **written),
            f"Look what '{target}' carries, or weigh it.",
        )

    def as_told(self, model: mujoco.MjModel, errors: Mapping[str, float]) -> Payload:
        """Return it where the motion tells it; along other axes it lies beside the body's centre of mass."""
        values = dict(self.report())
        return replace(self, **_written(values, _told(Values(values, errors), model, self.target), model, self.target))


def _told(of: Values, model: mujoco.MjModel, target: str | None) -> list[str]:
    """Return the axes along which the motion tells where it is: along one that a body turns about none does."""
    untold_m = parts.UNTOLD * parts.body_size_m(model, target)
    return [axis for axis in "xyz" if (of.error(f"{axis}_m") or 0.0) < untold_m]


def _written(
    values: Mapping[str, float], told: Sequence[str], model: mujoco.MjModel, target: str | None
) -> dict[str, float]:
    """Return values of which those that the motion does not tell are the body's centre of mass."""
    centre = dict(zip("xyz", model.body_ipos[model.body(target).id].tolist(), strict=True))
    place = {f"{axis}_m": values[f"{axis}_m"] if axis in told else centre[axis] for axis in "xyz"}
    return {"mass_kg": values["mass_kg"], **place} if math.isfinite(values["mass_kg"]) else dict(values)
