"""A body's inertia: its size, and of a body that turns about every axis its shape, too.

What flies without a torque shows the ratios of its moments alone (Euler's equations hold for any multiple of them),
what a joint turns shows one moment.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Self

import mujoco
import numpy as np

from runner.effects.base import Parameter, Phrase, Vector
from runner.effects.mechanism import contacts, parts
from runner.effects.mechanism.base import MechanismEffect, Scope, effect
from runner.effects.wording import Values
from runner.errors import ConfigError, check_range

SIZE = Parameter("log_inertia_ratio", "", 0.25, -2.5, 2.5)
# of the mean square of a mass's distance from its middle along each axis: density is believed even to some 20 %
SPREAD = 0.2
FARTHEST = 3.0  # a twentieth, or twenty times as much


@effect
@dataclass(frozen=True)
class Inertia(MechanismEffect):
    """Inertia of a body on a joint about its centre of mass times `ratio`, its mass unchanged. Fitted as the log."""

    name: ClassVar[str] = "inertia"
    label: ClassVar[str] = "a different inertia"
    target_kind: ClassVar[str] = "body"
    commonness: ClassVar[int] = 2
    target: str
    ratio: float

    def __post_init__(self) -> None:
        check_range("inertia.ratio", self.ratio, 0.0, 1e3, lower_open=True)

    def edit_model(self, model: mujoco.MjModel) -> None:
        model.body_inertia[model.body(self.target).id] *= self.ratio

    @classmethod
    def applies(cls, scope: Scope) -> bool:
        return parts.can_turn(scope.model, scope.target) and not contacts.is_free(scope.model, scope.target)

    @classmethod
    def parameters(cls, context: Scope) -> tuple[Parameter, ...]:
        return (SIZE,)

    @classmethod
    def from_vector(cls, x: Vector, context: Scope) -> Self:
        return cls(str(context.target), math.exp(x[0]))

    @classmethod
    def phrase(cls, of: Values, beliefs: Scope, target: str | None = None) -> Phrase:
        return Phrase(
            f"body '{target}' turns {'harder' if of['ratio'] > 1 else 'more easily'} than in the model, "
            "by more than its mass says",
            f"its inertia is {of.show('ratio')} times what its mass makes of the model's",
            parts.to_give_of(beliefs.model, cls, target, ratio=of["ratio"]),
            f"Hang '{target}' from a pivot and time its swing.",
        )


@effect
@dataclass(frozen=True)
class FreeInertia(MechanismEffect):
    """Principal moments of inertia of a free body, its mass and their axes unchanged.

    All three are `ratio` times as large (their geometric mean is), the moment about x in proportion to that about y is
    `x_to_y` times the believed one, that about z in proportion to the geometric mean of those two `z_to_xy` times.

    Fitted as the logs of `ratio`, and of how far the mass is spread along x in proportion to y, and along z in
    proportion to both. The spread is the second moment of the mass along an axis, half the sum of the moments of
    inertia less the one about it: none is negative, so that moments fitted are always those of some body (no one larger
    than the sum of the others; Wensing, Kim and Slotine 2018).
    """

    name: ClassVar[str] = "inertia"
    label: ClassVar[str] = "other moments of inertia"
    target_kind: ClassVar[str] = "body"
    commonness: ClassVar[int] = 2
    target: str
    ratio: float
    x_to_y: float = 1.0
    z_to_xy: float = 1.0

    def __post_init__(self) -> None:
        for key in ("ratio", "x_to_y", "z_to_xy"):
            check_range(f"inertia.{key}", getattr(self, key), 0.0, 1e3, lower_open=True)

    def edit_model(self, model: mujoco.MjModel) -> None:
        body = model.body(self.target).id
        moments = _changed(model.body_inertia[body], self.ratio, self.x_to_y, self.z_to_xy)
        if _spread(moments).min() < -parts.ROUNDING * moments.max():
            shown = ", ".join(f"{moment:.4g}" for moment in moments)
            raise ConfigError(
                f"inertia[{self.target}]: no moment of inertia may be larger than the sum of the other two, got "
                f"{shown} kg m2."
            )
        model.body_inertia[body] = moments

    @classmethod
    def applies(cls, scope: Scope) -> bool:
        return parts.can_turn(scope.model, scope.target) and contacts.is_free(scope.model, scope.target)

    @classmethod
    def parameters(cls, context: Scope) -> tuple[Parameter, ...]:
        # so wide that no axis is believed better than another
        return (
            SIZE,
            Parameter("log_spread_x_to_y", "", math.sqrt(2.0) * SPREAD, -FARTHEST, FARTHEST),
            Parameter("log_spread_z_to_xy", "", math.sqrt(1.5) * SPREAD, -FARTHEST, FARTHEST),
        )

    @classmethod
    def from_vector(cls, x: Vector, context: Scope) -> Self:
        believed = np.array(context.model.body_inertia[context.model.body(context.target).id])
        # what lies in a plane has no spread across it, to within rounding
        spread = np.maximum(_spread(believed), 0.0) * _in_proportion(x[1], x[2])
        along_x, along_y, along_z = (spread.sum() - spread) / believed
        return cls(
            str(context.target),
            math.exp(x[0]),
            float(along_x / along_y),
            float(along_z / math.sqrt(along_x * along_y)),
        )

    @classmethod
    def phrase(cls, of: Values, beliefs: Scope, target: str | None = None) -> Phrase:
        model, body = beliefs.model, beliefs.model.body(target).id
        values = {key: of[key] for key in ("ratio", "x_to_y", "z_to_xy")}
        turned = abs(model.body_iquat[body][0]) < 1.0 - parts.ROUNDING
        error = of.error("ratio")
        told = error is None or error < parts.UNTOLD * SIZE.scale * of["ratio"]
        shape = (
            f"about z {of.show('z_to_xy')} times the believed one in proportion to x and y, about x "
            f"{of.show('x_to_y')} times in proportion to y"
        )
        size = f"all of them {of.show('ratio')} times" if told else "the motion does not tell how large all of them are"
        return Phrase(
            f"the moments of inertia of body '{target}' are not those of the model, by more than its mass says",
            f"{shape}; {size}{' (principal axes of the model)' if turned else ''}",
            parts.to_give_of(model, cls, target, **values),
            f"Hang '{target}' from two threads along one axis after the other, and time how it swings about each.",
        )


def _spread(moments: np.ndarray) -> np.ndarray:
    """Return the second moments of the mass along the principal axes, (3,), from the moments of inertia about them."""
    return 0.5 * moments.sum() - moments


def _changed(moments: np.ndarray, ratio: float, x_to_y: float, z_to_xy: float) -> np.ndarray:
    """Return other moments of inertia, (3,), whose proportions are so many times the given ones."""
    return np.asarray(moments) * ratio * _in_proportion(math.log(x_to_y), math.log(z_to_xy))


def _in_proportion(log_x_to_y: float, log_z_to_xy: float) -> np.ndarray:
    """Return factors along x, y and z, (3,), of these proportions and a geometric mean of one."""
    x, z = log_x_to_y, log_z_to_xy
    return np.exp([x / 2 - z / 3, -x / 2 - z / 3, 2 * z / 3])
