"""Another friction coefficient than believed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Self

from runner.effects.base import Parameter, Phrase, Vector
from runner.effects.planar_box.base import Beliefs, Context, PlanarEffect, Target, effect
from runner.effects.wording import Values, number
from runner.errors import check_range


@effect
@dataclass(frozen=True)
class Friction(PlanarEffect):
    """The friction coefficient everywhere. Fitted as the log of the ratio to the nominal one."""

    name: ClassVar[str] = "friction"
    label: ClassVar[str] = "a different friction coefficient"
    mu: float

    def __post_init__(self) -> None:
        check_range("friction.mu", self.mu, 0.0, 10.0)

    def edit_model(self, target: Target) -> None:
        target.dry_friction["mu"] = self.mu
        model = target.model
        for pair in range(model.npair):
            if model.geom_bodyid[model.pair_geom2[pair]] == target.body_id:
                model.pair_friction[pair, :2] = self.mu

    @classmethod
    def parameters(cls, context: Context) -> tuple[Parameter, ...]:
        # up to 1.6, or what a floor that is believed to be ice may turn out to have
        mu = max(context.friction, 1e-3)
        return (Parameter("log_mu_ratio", "", 0.15, -2.5, min(max(1.6, math.log(1.0 / mu)), math.log(10.0 / mu))),)

    @classmethod
    def from_vector(cls, x: Vector, context: Context) -> Self:
        return cls(max(context.friction, 1e-3) * math.exp(x[0]))

    @classmethod
    def phrase(cls, of: Values, beliefs: Beliefs, target: str | None = None) -> Phrase:
        word = "more slippery" if of["mu"] < beliefs.friction else "less slippery"
        return Phrase(
            f"the floor is {word} than believed",
            f"friction {of.show('mu')} instead of {beliefs.friction:.3f}",
            f"Set the friction coefficient between object and floor to {number(of['mu'], 4)}.",
            "Pull the object slowly with a spring scale: force over weight is the coefficient.",
        )
