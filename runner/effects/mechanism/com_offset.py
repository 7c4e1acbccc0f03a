"""A body's centre of mass."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import mujoco

from runner.effects.base import Parameter, Phrase, Vector
from runner.effects.mechanism import parts
from runner.effects.mechanism.base import MechanismEffect, Scope, effect
from runner.effects.mechanism.contacts import is_free
from runner.effects.wording import Values
from runner.errors import check_range

NEAR = 0.1  # of the size of its body: how far off one is believed to be


@effect
@dataclass(frozen=True)
class ComOffset(MechanismEffect):
    """The centre of mass of a body is off the believed one, body axes; the inertia about it is unchanged."""

    name: ClassVar[str] = "com_offset"
    label: ClassVar[str] = "a centre of mass elsewhere"
    target_kind: ClassVar[str] = "body"
    target: str
    x_m: float
    y_m: float
    z_m: float

    def __post_init__(self) -> None:
        for key in ("x_m", "y_m", "z_m"):
            check_range(f"com_offset.{key}", getattr(self, key), -1e3, 1e3, unit="m")

    def edit_model(self, model: mujoco.MjModel) -> None:
        model.body_ipos[model.body(self.target).id] += (self.x_m, self.y_m, self.z_m)

    @classmethod
    def applies(cls, scope: Scope) -> bool:
        return parts.can_turn(scope.model, scope.target)

    @classmethod
    def parameters(cls, context: Scope) -> tuple[Parameter, ...]:
        size = parts.body_size_m(context.model, context.target)
        return tuple(Parameter(f"{axis}_m", "m", NEAR * size, -3 * size, 3 * size) for axis in "xyz")

    @classmethod
    def from_vector(cls, x: Vector, context: Scope) -> Self:
        return cls(str(context.target), float(x[0]), float(x[1]), float(x[2]))

    @classmethod
    def phrase(cls, of: Values, beliefs: Scope, target: str | None = None) -> Phrase:
        told = _told(of, beliefs.model, target)
        taken = "Balance" if is_free(beliefs.model, target) else f"Take '{target}' off and balance"
        written = {f"{axis}_m": of[f"{axis}_m"] if axis in told else 0.0 for axis in "xyz"}
        return Phrase(
            f"the centre of mass of body '{target}' is not where the model has it",
            _amount(of, told),
            parts.to_give_of(beliefs.model, cls, target, **written),
            f"{taken} it on an edge.",
        )

    def as_told(self, model: mujoco.MjModel, errors: Mapping[str, float]) -> ComOffset:
        """Return it where the motion tells it; along other axes the centre of mass stays where it was believed."""
        told = _told(Values(self.report(), errors), model, self.target)
        return replace(self, **{f"{axis}_m": 0.0 for axis in "xyz" if axis not in told})


def _told(of: Values, model: mujoco.MjModel, target: str | None) -> list[str]:
    return parts.axes_told(of, parts.UNTOLD * NEAR * parts.body_size_m(model, target))


def _amount(of: Values, told: Sequence[str]) -> str:
    """Return how far off it is along each axis that the motion tells."""
    each = ", ".join(f"{axis} {of.long(f'{axis}_m', *(f'{a}_m' for a in told))}" for axis in told)
    off = f"off by {each} in body axes" if told else ""
    return "; ".join(part for part in (off, parts.said_of_others(told)) if part)
