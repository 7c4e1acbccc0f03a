"""Another friction than believed between the body and the pin that pushes it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Self

from runner.effects.base import Parameter, Phrase, Vector
from runner.effects.planar_box.base import Beliefs, Context, PlanarEffect, Target, effect
from runner.effects.wording import Values, number
from runner.errors import check_range

PIN = "pin"  # the target, as it stands in a verdict: friction[pin]
LEAST = 1e-3  # a believed coefficient below it is taken for it, so that a ratio to it makes sense


@effect
@dataclass(frozen=True)
class PinFriction(PlanarEffect):
    """The friction coefficient between body and pin. Fitted as the log of the ratio to the nominal one."""

    name: ClassVar[str] = "friction"
    label: ClassVar[str] = "a different friction between the object and the pin that pushes it"
    of_pin: ClassVar[bool] = True
    mu: float
    target: str = PIN

    def __post_init__(self) -> None:
        check_range("friction.mu", self.mu, 0.0, 10.0)

    def edit_model(self, target: Target) -> None:
        target.dry_friction["pin_friction"] = self.mu

    @classmethod
    def parameters(cls, context: Context) -> tuple[Parameter, ...]:
        mu = max(context.pin_friction or 0.0, LEAST)
        return (Parameter("log_mu_ratio", "", 0.3, -2.5, min(max(1.6, math.log(1.0 / mu)), math.log(10.0 / mu))),)

    @classmethod
    def from_vector(cls, x: Vector, context: Context) -> Self:
        return cls(max(context.pin_friction or 0.0, LEAST) * math.exp(x[0]))

    @classmethod
    def phrase(cls, of: Values, beliefs: Beliefs, target: str | None = None) -> Phrase:
        believed = beliefs.pin.friction if beliefs.pin else 0.0
        word = "less" if of["mu"] < believed else "more"
        return Phrase(
            f"the pin grips the object {word} than believed",
            f"friction {of.show('mu')} instead of {believed:.3f}",
            f"Set the friction coefficient between object and pin to {number(of['mu'], 4)}.",
            "Push at a slant that grows: the tangent of the angle at which the pin begins to slide is the coefficient.",
        )
