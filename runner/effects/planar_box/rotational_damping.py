"""Resistance to turning in proportion to the yaw rate."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

from runner.effects.base import Parameter, Phrase, Vector
from runner.effects.planar_box.base import Beliefs, Context, PlanarEffect, Target, effect
from runner.effects.wording import Values, number
from runner.errors import check_range


@effect
@dataclass(frozen=True)
class RotationalDamping(PlanarEffect):
    """A moment against the yaw rate, in proportion to it."""

    name: ClassVar[str] = "rotational_damping"
    label: ClassVar[str] = "a resistance to turning in proportion to the yaw rate"
    coefficient_n_m_s: float

    def __post_init__(self) -> None:
        check_range("rotational_damping.coefficient_n_m_s", self.coefficient_n_m_s, 0.0, 1e6, unit="N m s")

    def edit_model(self, target: Target) -> None:
        target.model.dof_damping[target.dofs.stop - 1] += self.coefficient_n_m_s

    @classmethod
    def parameters(cls, context: Context) -> tuple[Parameter, ...]:
        moment = 0.1 * context.friction_n * context.size_m
        return (Parameter("coefficient_n_m_s", "N m s", moment, 0.0, 50 * moment),)

    @classmethod
    def from_vector(cls, x: Vector, context: Context) -> Self:
        return cls(x[0])

    @classmethod
    def phrase(cls, of: Values, beliefs: Beliefs, target: str | None = None) -> Phrase:
        return Phrase(
            "something resists turning in proportion to the yaw rate",
            of.show("coefficient_n_m_s", "N m s"),
            f"Add rotational damping of {number(of['coefficient_n_m_s'])} N m s about the vertical.",
            "Spin the object and watch how its yaw rate falls.",
        )
