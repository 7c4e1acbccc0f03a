"""Resistance in proportion to velocity, in two variants: under the base, and of the body as a whole."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

from runner.effects.base import Parameter, Phrase, Vector
from runner.effects.planar_box.base import Beliefs, Context, PlanarEffect, Target, effect
from runner.effects.wording import Values, number
from runner.errors import check_range


@effect
@dataclass(frozen=True)
class ViscousFilm(PlanarEffect):
    """A film under the base that resists each point's slip in proportion to it; it resists turning as well."""

    name: ClassVar[str] = "viscous_drag"
    label: ClassVar[str] = "a viscous film under the base"
    spoken_of: ClassVar[tuple[str, str] | None] = ("acts", "film")
    film_n_s_per_m: float

    def __post_init__(self) -> None:
        check_range("viscous_drag.film_n_s_per_m", self.film_n_s_per_m, 0.0, 1e6, unit="N s/m")

    def edit_model(self, target: Target) -> None:
        target.dry_friction["film"] = self.film_n_s_per_m

    @classmethod
    def parameters(cls, context: Context) -> tuple[Parameter, ...]:
        return (Parameter("film_n_s_per_m", "N s/m", 0.1 * context.friction_n, 0.0, 5 * context.friction_n),)

    @classmethod
    def from_vector(cls, x: Vector, context: Context) -> Self:
        return cls(x[0])

    @classmethod
    def phrase(cls, of: Values, beliefs: Beliefs, target: str | None = None) -> Phrase:
        return Phrase(
            "a viscous film under the base resists sliding",
            of.show("film_n_s_per_m", "N s/m"),
            f"Add a film under the base, which resists turning as well, of {number(of['film_n_s_per_m'])} N s/m.",
            "Let the object coast at different speeds: the deceleration grows with speed.",
        )


@effect
@dataclass(frozen=True)
class ViscousDrag(PlanarEffect):
    """A force against the velocity of the geometric centre, in proportion to it; it does not resist turning."""

    name: ClassVar[str] = "viscous_drag"
    label: ClassVar[str] = "a resistance in proportion to velocity"
    coefficient_n_s_per_m: float

    def __post_init__(self) -> None:
        check_range("viscous_drag.coefficient_n_s_per_m", self.coefficient_n_s_per_m, 0.0, 1e6, unit="N s/m")

    def edit_model(self, target: Target) -> None:
        linear = slice(target.dofs.start, target.dofs.stop - (3 if target.dofs.stop - target.dofs.start == 6 else 1))
        target.model.dof_damping[linear] += self.coefficient_n_s_per_m

    @classmethod
    def parameters(cls, context: Context) -> tuple[Parameter, ...]:
        return (Parameter("coefficient_n_s_per_m", "N s/m", 0.1 * context.friction_n, 0.0, 5 * context.friction_n),)

    @classmethod
    def from_vector(cls, x: Vector, context: Context) -> Self:
        return cls(x[0])

    @classmethod
    def phrase(cls, of: Values, beliefs: Beliefs, target: str | None = None) -> Phrase:
        return Phrase(
            "something resists motion in proportion to speed",
            of.show("coefficient_n_s_per_m", "N s/m"),
            f"Add linear damping of {number(of['coefficient_n_s_per_m'])} N s/m.",
            "Let the object coast at different speeds: the deceleration grows with speed.",
        )
