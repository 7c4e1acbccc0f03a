"""Friction that depends on sliding speed, in two variants: believed right at high speed, and believed right at rest.

mu(v) = mu_slide + (mu_rest - mu_slide) exp(-(v / v_s)^d): Armstrong-Helouvry, Dupont & Canudas de Wit 1994, who report
exponents d from 1/2 (Bo & Pavelescu 1982) to 2; Tustin's of 1947 is 1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from runner.effects.base import Parameter, Phrase, Vector
from runner.effects.planar_box.base import Beliefs, Context, PlanarEffect, Target, effect
from runner.effects.wording import Values, number
from runner.errors import check_range

SLOWEST_M_S = 0.01  # as Stribeck's; what falls at less is static friction, see `Stiction`


def _fastest_m_s(context: Context) -> float:
    """Return the greatest speed at which friction may bend, m/s."""
    return max(context.speed_m_s, 2.0 * SLOWEST_M_S)


@effect
@dataclass(frozen=True)
class Stribeck(PlanarEffect):
    """Friction times (1 + `change` exp(-(v / `speed_m_s`)^`exponent`)): more (or less) of it at low sliding speed."""

    name: ClassVar[str] = "stribeck"
    label: ClassVar[str] = "friction that changes with sliding speed"
    reference: ClassVar[float] = 0.0
    change: float
    speed_m_s: float
    exponent: float = 2.0

    def __post_init__(self) -> None:
        check_range("stribeck.change", self.change, -0.99, 20.0)
        check_range("stribeck.speed_m_s", self.speed_m_s, 1e-3, 100.0, unit="m/s")
        check_range("stribeck.exponent", self.exponent, 0.3, 4.0)

    def edit_model(self, target: Target) -> None:
        friction = target.dry_friction
        friction["stribeck"], friction["stribeck_reference"] = self._share(self.change), self.reference
        friction["stribeck_speed"], friction["stribeck_exponent"] = self.speed_m_s, self.exponent

    @classmethod
    def _share(cls, change: float) -> float:
        """Return by which share of the believed coefficient friction changes."""
        return change / (1.0 + cls.reference * change)

    @classmethod
    def parameters(cls, context: Context) -> tuple[Parameter, ...]:
        return (
            Parameter("share", "", 0.2, -0.8, 3.0) if not cls.reference else Parameter("share", "", 0.2, -3.0, 0.8),
            # what is not two thirds gone at the fastest that was recorded is, but for a slight bend, plain friction
            Parameter("log_speed", "", 0.8, math.log(SLOWEST_M_S / 0.2), math.log(_fastest_m_s(context) / 0.2)),
            # the range of what was measured; an exponent at an end of it is an exponent
            Parameter("log_exponent", "", 0.5, math.log(0.5), math.log(2.5), may_rest=True),
        )

    @classmethod
    def from_vector(cls, x: Vector, context: Context) -> Self:
        change = x[0] / (1.0 - cls.reference * x[0])
        return cls(float(change), 0.2 * math.exp(x[1]), math.exp(x[2]))

    @classmethod
    def starts(cls, context: Context) -> np.ndarray:
        fastest = _fastest_m_s(context)
        tried = [v for v in (0.05, 0.2, 0.8) if v < fastest] or [math.sqrt(SLOWEST_M_S * fastest)]
        return np.array([[0.15, math.log(v / 0.2), math.log(d)] for v in tried for d in (1.0, 2.0)])

    @classmethod
    def phrase(cls, of: Values, beliefs: Beliefs, target: str | None = None) -> Phrase:
        word = "higher" if of["change"] > 0 else "lower"
        fall = f"exp(−(v / {number(of['speed_m_s'])} m/s)^{number(of['exponent'], 2)})"
        share = cls._share(of["change"])
        return Phrase(
            f"friction is {word} at low speed than at high speed",
            f"{of.show('change', '%', 100, magnitude=True)} {word} below about {of.scale('speed_m_s', 'm/s')}",
            f"Multiply friction by {number(1.0 - cls.reference * share, 4)} {'−' if share < 0 else '+'} "
            f"{number(abs(share))} {fall}.",
            "Pull the object at several steady speeds and compare the forces.",
        )


@effect
@dataclass(frozen=True)
class StribeckFromRest(Stribeck):
    """The variant in which the believed coefficient is that of rest, and sliding changes it: `change` is as there."""

    label: ClassVar[str] = "friction that is as believed at rest and changes with sliding speed"
    spoken_of: ClassVar[tuple[str, str] | None] = ("reference", "rest")
    reference: ClassVar[float] = 1.0
