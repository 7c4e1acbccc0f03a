"""Resistance in proportion to velocity squared."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

from runner.effects.base import Parameter, Phrase, Vector
from runner.effects.planar_box.base import Beliefs, Context, PlanarEffect, Target, effect
from runner.effects.wording import Values, number
from runner.errors import check_range


@effect
@dataclass(frozen=True)
class AirDrag(PlanarEffect):
    """A force against the velocity of the geometric centre, in proportion to its square."""

    name: ClassVar[str] = "air_drag"
    label: ClassVar[str] = "a resistance in proportion to velocity squared"
    coefficient_n_s2_per_m2: float

    def __post_init__(self) -> None:
        check_range("air_drag.coefficient_n_s2_per_m2", self.coefficient_n_s2_per_m2, 0.0, 1e6, unit="N s2/m2")

    def edit_model(self, target: Target) -> None:
        target.dry_friction["air_drag"] = self.coefficient_n_s2_per_m2

    @classmethod
    def parameters(cls, context: Context) -> tuple[Parameter, ...]:
        return (Parameter("coefficient_n_s2_per_m2", "N s2/m2", 0.1 * context.friction_n, 0.0, 5 * context.friction_n),)

    @classmethod
    def from_vector(cls, x: Vector, context: Context) -> Self:
        return cls(x[0])

    @classmethod
    def phrase(cls, of: Values, beliefs: Beliefs, target: str | None = None) -> Phrase:
        return Phrase(
            "something resists motion with the square of the speed",
            of.show("coefficient_n_s2_per_m2", "N s²/m²"),
            f"Add a force against the velocity of {number(of['coefficient_n_s2_per_m2'])} N s²/m² times speed squared.",
            "Let the object coast from a high speed: it slows down faster the faster it is.",
        )
