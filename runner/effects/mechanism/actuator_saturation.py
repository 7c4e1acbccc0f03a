"""An actuator's limit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Self

import mujoco
import numpy as np

from runner.effects.base import Parameter, Phrase, Vector
from runner.effects.mechanism import parts
from runner.effects.mechanism.base import MechanismEffect, Scope, effect
from runner.effects.wording import Values, number
from runner.errors import check_range

# Of the largest force that is asked for: limits that a fit may begin at, and those that are looked at before it.
SHOWN, LOOKED_AT = np.array([0.9, 0.7, 0.4]), np.geomspace(0.98, 0.15, 20)


@effect
@dataclass(frozen=True)
class ActuatorSaturation(MechanismEffect):
    """An actuator exerts at most `limit` either way, N m or N (before its gear); infinite: what the model has.

    Fitted as the share that is cut off the believed limit, or off the largest force that the commands ask for where
    there is none. A believed limit may also be too low: then the share is negative.
    """

    name: ClassVar[str] = "actuator_saturation"
    label: ClassVar[str] = "a force that is limited"
    target_kind: ClassVar[str] = "actuator"
    target: str
    limit: float

    def __post_init__(self) -> None:
        if self.limit != np.inf:
            check_range("actuator_saturation.limit", self.limit, 0.0, 1e12, unit="N m")

    def edit_model(self, model: mujoco.MjModel) -> None:
        if self.limit == np.inf:
            return
        actuator = model.actuator(self.target).id
        model.actuator_forcelimited[actuator] = 1
        model.actuator_forcerange[actuator] = (-self.limit, self.limit)

    @classmethod
    def parameters(cls, context: Scope) -> tuple[Parameter, ...]:
        lower = -4.0 if _believed(context.model, context.target) is not None else 0.0
        return (Parameter("cut_share", "", 0.3, lower, 0.98),)

    @classmethod
    def from_vector(cls, x: Vector, context: Scope) -> Self:
        return cls(str(context.target), np.inf if x[0] == 0.0 else _full(context) * (1.0 - float(x[0])))

    @classmethod
    def starts(cls, context: Scope) -> np.ndarray:
        """Return limits below what is likely reached; where there is a believed one, one above it, too."""
        higher = [] if _believed(context.model, context.target) is None else [[-0.5]]
        return np.array([*_shares(context, SHOWN)[:, None], *higher])

    @classmethod
    def scan(cls, context: Scope) -> np.ndarray:
        """A limit acts at the peaks of a force alone, which are as high as they are by chance."""
        return _shares(context, LOOKED_AT)

    @classmethod
    def units(cls, context: Scope) -> Mapping[str, str]:
        return {"limit": _unit(context.model, context.target)}

    @classmethod
    def phrase(cls, of: Values, beliefs: Scope, target: str | None = None) -> Phrase:
        believed, unit = _believed(beliefs.model, target), _unit(beliefs.model, target)
        limit = parts.attribute(of["limit"])
        return Phrase(
            f"actuator '{target}' gives no more than a limit",
            f"{of.show('limit', unit)}" + ("" if believed is None else f" instead of {number(believed)} {unit}"),
            f"Set forcerange=\"-{limit} {limit}\" on actuator '{target}'.",
            f"Look up the stall torque and current limit of '{target}', and its supply voltage under load.",
        )


def _unit(model: mujoco.MjModel, actuator: str | None) -> str:
    joint = parts.joint_of_actuator(model, actuator)
    return "N" if joint is None else parts.force_unit(model, joint)


def _believed(model: mujoco.MjModel, actuator: str | None) -> float | None:
    number_of_actuator = model.actuator(actuator).id
    if not model.actuator_forcelimited[number_of_actuator]:
        return None
    return float(abs(model.actuator_forcerange[number_of_actuator]).max())


def _shares(scope: Scope, parts_of_largest: np.ndarray) -> np.ndarray:
    """Return which shares are cut off where the limit is such parts, descending, of the largest force."""
    reached = min(_largest(scope) / _full(scope), 1.0)
    return np.minimum(1.0 - parts_of_largest * reached, 0.97)


def _largest(scope: Scope) -> float:
    """Return the largest force that was asked of the target actuator, before its gear; more than 0."""
    return max(scope.demand.get(str(scope.target), 0.0), 1e-6)


def _full(scope: Scope) -> float:
    """Return the limit of which a share is cut off."""
    believed = _believed(scope.model, scope.target)
    return _largest(scope) if believed is None else believed
