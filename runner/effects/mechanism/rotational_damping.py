"""Resistance to the turning of a free body."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import mujoco

from runner.effects.base import Parameter, Phrase, Vector
from runner.effects.mechanism import contacts, parts
from runner.effects.mechanism.base import MechanismEffect, Scope, effect
from runner.effects.wording import Values
from runner.errors import check_range

SLOWED = 0.3  # share of a spin that is lost in a second, for a size that one would not be surprised to meet


@effect
@dataclass(frozen=True)
class RotationalDamping(MechanismEffect):
    """Turning of a free body is resisted by `damping_n_m_s` times its rate."""

    name: ClassVar[str] = "rotational_damping"
    label: ClassVar[str] = "resistance to turning"
    target_kind: ClassVar[str] = "body"
    commonness: ClassVar[int] = 2
    target: str
    damping_n_m_s: float

    def __post_init__(self) -> None:
        check_range("rotational_damping.damping_n_m_s", self.damping_n_m_s, 0.0, 1e6, unit="N m s")

    def edit_model(self, model: mujoco.MjModel) -> None:
        first = int(model.body(self.target).dofadr[0]) + 3
        model.dof_damping[first : first + 3] += self.damping_n_m_s

    @classmethod
    def applies(cls, scope: Scope) -> bool:
        return contacts.is_free(scope.model, scope.target)

    @classmethod
    def parameters(cls, context: Scope) -> tuple[Parameter, ...]:
        inertia = float(context.model.body_inertia[context.model.body(context.target).id].mean())
        return (Parameter("damping_n_m_s", "N m s", SLOWED * inertia, 0.0, 100.0 * inertia),)

    @classmethod
    def from_vector(cls, x: Vector, context: Scope) -> Self:
        return cls(str(context.target), max(float(x[0]), 0.0))

    @classmethod
    def phrase(cls, of: Values, beliefs: Scope, target: str | None = None) -> Phrase:
        return Phrase(
            f"something slows the turning of body '{target}'",
            of.show("damping_n_m_s", "N m s"),
            f"Add {parts.attribute(of['damping_n_m_s'])} N m s to dof_damping of the three turns of '{target}' (MJCF "
            "has one damping for all six of a free joint).",
            f"Let '{target}' spin in the air, and see how its rate falls.",
        )
