"""A body's centre of mass."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import mujoco

from runner.effects.base import Parameter, Phrase, Vector
from runner.effects.mechanism import parts
from runner.effects.mechanism.base import MechanismEffect, Scope, effect
from runner.effects.wording import Values, listed
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
        pos = beliefs.model.body_ipos[beliefs.model.body(target).id] + [of["x_m"], of["y_m"], of["z_m"]]
        return Phrase(
            f"the centre of mass of body '{target}' is not where the model has it",
            _amount(of, parts.UNTOLD * NEAR * parts.body_size_m(beliefs.model, target)),
            f'In <body name="{target}"> set <inertial pos="{parts.attribute(*pos)}" .../>.',
            f"Take '{target}' off and balance it on an edge.",
        )


def _amount(of: Values, untold_m: float) -> str:
    """Return how far off it is along each axis that the motion tells: along one that a body turns about none does."""
    errors = {axis: of.error(f"{axis}_m") or 0.0 for axis in "xyz"}
    told = [axis for axis, e in errors.items() if e < max(untold_m, 0.5 * abs(of[f"{axis}_m"]))]
    lacks = f"the motion does not tell {listed([a for a in 'xyz' if a not in told], 'or')}" if len(told) < 3 else ""
    off = f"off by {', '.join(axis + ' ' + of.long(axis + '_m') for axis in told)} in body axes" if told else ""
    return "; ".join(part for part in (off, lacks) if part)
