"""Something that a model lacks, fixed to a body: a tool, a lens, a battery, a bundle of cable.

It changes the body's mass, where that is, and how it turns, all three by one mass at one point: m at d from the centre
of mass of a body of mass M and inertia I (matrices, in the body's axes) makes

    M' = M + m,   c' = c + m d / M',   I' = I + (m M / M') (|d|^2 1 - d d^T)   (Steiner)
"""

from __future__ import annotations

from collections.abc import Mapping
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

USUAL_SHARE, LARGEST_SHARE = 0.3, 20.0  # of the body's mass: a hand of 100 g may hold 2 kg
FARTHEST = 10.0  # times the size of the body: a tool on a wrist


@effect
@dataclass(frozen=True)
class Payload(MechanismEffect):
    """A point mass on a body, at a place in its axes.

    Fitted as a share of the body's mass, and by how far it is from the believed centre of mass along each axis.
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
        far = FARTHEST * size
        place = (Parameter(f"from_centre_{axis}_m", "m", size, -far, far, may_rest=True) for axis in "xyz")
        return (Parameter("mass_share", "", USUAL_SHARE, 0.0, LARGEST_SHARE), *place)

    @classmethod
    def from_vector(cls, x: Vector, context: Scope) -> Self:
        body = context.model.body(context.target).id
        place = context.model.body_ipos[body] + np.asarray(x[1:4])
        return cls(str(context.target), float(x[0] * context.model.body_mass[body]), *map(float, place))

    @classmethod
    def starts(cls, context: Scope) -> np.ndarray:
        """Return a little of it at either side along each axis: a descent from the centre goes astray.

        What a share does at a place hangs on the product of the two first, which makes a long valley.
        """
        sides = parts.body_size_m(context.model, context.target) * np.concatenate([np.eye(3), -np.eye(3)])
        return np.column_stack([np.full(len(sides), 0.5 * USUAL_SHARE), sides])

    @classmethod
    def phrase(cls, of: Values, beliefs: Scope, target: str | None = None) -> Phrase:
        centre = _centre(beliefs.model, target)
        told = _told(of, beliefs.model, target)
        where = listed([f"{axis} {of.long(axis + '_m')}" for axis in told])
        amount = of.show("mass_kg", "kg") + (f" at {where} in body axes" if where else "")
        written = {f"{axis}_m": of[f"{axis}_m"] if axis in told else at for axis, at in centre.items()}
        return Phrase(
            f"something that the model lacks is attached to body '{target}': a tool, a payload or a part",
            "; ".join(part for part in (amount, parts.said_of_others(told)) if part),
            parts.to_give_of(beliefs.model, cls, target, mass_kg=of["mass_kg"], **written),
            f"Look what '{target}' carries, or weigh it.",
        )

    def as_told(self, model: mujoco.MjModel, errors: Mapping[str, float]) -> Payload:
        """Return it where the motion tells it; along other axes it lies beside the body's centre of mass."""
        told = _told(Values(self.report(), errors), model, self.target)
        centre = _centre(model, self.target)
        return replace(self, **{f"{axis}_m": at for axis, at in centre.items() if axis not in told})


def _told(of: Values, model: mujoco.MjModel, target: str | None) -> list[str]:
    centre = tuple(_centre(model, target).values())
    return parts.axes_told(of, parts.UNTOLD * parts.body_size_m(model, target), centre)


def _centre(model: mujoco.MjModel, target: str | None) -> dict[str, float]:
    """Return the centre of mass of a body, in its axes, m, by axis."""
    return dict(zip("xyz", model.body_ipos[model.body(target).id].tolist(), strict=True))
