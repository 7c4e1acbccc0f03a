"""Friction that depends on the direction of sliding in the body, in two variants."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Self

from runner.effects.base import Parameter, Phrase, Vector
from runner.effects.planar_box.base import Beliefs, Context, PlanarEffect, Target, effect
from runner.effects.wording import DEGREES, Values, number, plus_minus
from runner.errors import check_range


@effect
@dataclass(frozen=True)
class AnisotropicFriction(PlanarEffect):
    """Friction mu_1 along a body axis at `angle_rad` and mu_2 across it, `ratio` = mu_1 / mu_2, their mean as believed.

    It lies on an ellipse. Where the body slides at an angle to both axes, `normality` tells where on it: 1 is slip at
    right angles to the ellipse (Goyal, Ruina & Papadopoulos 1991), 0 a coefficient for each axis, N (mu_1 u_1, mu_2
    u_2) / |u|. Fitted as (a cos 2 angle, a sin 2 angle) with a = (mu_1 - mu_2) / (mu_1 + mu_2), which is smooth where
    the effect is absent.
    """

    name: ClassVar[str] = "anisotropic_friction"
    label: ClassVar[str] = "friction that differs between two directions of the body"
    ratio: float
    angle_rad: float
    normality: float = 1.0

    def __post_init__(self) -> None:
        check_range("anisotropic_friction.ratio", self.ratio, 0.02, 50.0)
        check_range("anisotropic_friction.angle_rad", self.angle_rad, -10, 10, unit="rad")
        check_range("anisotropic_friction.normality", self.normality, 0.0, 1.0)

    def edit_model(self, target: Target) -> None:
        a = (self.ratio - 1) / (self.ratio + 1)
        friction = target.dry_friction
        friction["along"], friction["across"], friction["aniso_angle"] = 1 + a, 1 - a, self.angle_rad
        friction["normality"] = self.normality

    @classmethod
    def parameters(cls, context: Context) -> tuple[Parameter, ...]:
        return tuple(Parameter(n, "", 0.1, -0.6, 0.6) for n in ("contrast_cos", "contrast_sin"))

    @classmethod
    def from_vector(cls, x: Vector, context: Context) -> Self:
        a = math.hypot(x[0], x[1])
        return cls((1 + a) / (1 - a), 0.5 * math.atan2(x[1], x[0]))

    def report(self) -> dict[str, float]:
        # which flow it is has not been fitted
        return {"ratio": self.ratio, "angle_rad": self.angle_rad}

    @classmethod
    def phrase(cls, of: Values, beliefs: Beliefs, target: str | None = None) -> Phrase:
        more = of["ratio"] >= 1
        contrast, error = (of["ratio"] if more else 1 / of["ratio"]) - 1, of.error("ratio")
        if error is not None and not more:
            error /= of["ratio"] ** 2
        amount = plus_minus(100 * contrast, None if error is None else 100 * error, "%")
        mean, ratio = beliefs.friction, of["ratio"]
        along, across = (number(2 * mean * r / (1 + ratio)) for r in (ratio, 1.0))
        return Phrase(
            "friction depends on the direction in which the object slides",
            f"{amount} {'more' if more else 'less'} along its axis at {of.angle('angle_rad')} than across it",
            f"Make friction {along} along the object's axis at {number(of['angle_rad'] * DEGREES)}°, {across} across "
            "it.",
            "Pull the object slowly along either axis and compare the forces.",
        )


@effect
@dataclass(frozen=True)
class AxisFriction(AnisotropicFriction):
    """The variant of anisotropic friction in which each of two body axes has a coefficient of its own."""

    label: ClassVar[str] = "friction with a coefficient for each of two axes of the body"
    spoken_of: ClassVar[tuple[str, str] | None] = ("flow", "scaled")
    normality: float = 0.0
