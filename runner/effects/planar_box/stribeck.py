"""Friction that depends on sliding speed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from runner.effects.base import Parameter, Phrase, Vector
from runner.effects.planar_box.base import Beliefs, Context, PlanarEffect, Target, effect
from runner.effects.wording import Values, number
from runner.errors import check_range


@effect
@dataclass(frozen=True)
class Stribeck(PlanarEffect):
    """Friction times (1 + `change` exp(-(v / `speed_m_s`)^2)): more (or less) of it at low sliding speed."""

    name: ClassVar[str] = "stribeck"
    label: ClassVar[str] = "friction that changes with sliding speed"
    change: float
    speed_m_s: float

    def __post_init__(self) -> None:
        check_range("stribeck.change", self.change, -0.99, 20.0)
        check_range("stribeck.speed_m_s", self.speed_m_s, 1e-3, 100.0, unit="m/s")

    def edit_model(self, target: Target) -> None:
        target.dry_friction["stribeck"], target.dry_friction["stribeck_speed"] = self.change, self.speed_m_s

    @classmethod
    def parameters(cls, context: Context) -> tuple[Parameter, ...]:
        return (
            Parameter("change", "", 0.2, -0.8, 3.0),
            Parameter("log_speed", "", 0.8, math.log(0.01 / 0.2), math.log(3.0 / 0.2)),
        )

    @classmethod
    def from_vector(cls, x: Vector, context: Context) -> Self:
        return cls(x[0], 0.2 * math.exp(x[1]))

    @classmethod
    def starts(cls, context: Context) -> np.ndarray:
        return np.array([[0.15, math.log(v / 0.2)] for v in (0.05, 0.2, 0.8)])

    @classmethod
    def phrase(cls, of: Values, beliefs: Beliefs, target: str | None = None) -> Phrase:
        word = "higher" if of["change"] > 0 else "lower"
        return Phrase(
            f"friction is {word} at low speed than at high speed",
            f"by {of.show('change', '%', 100, magnitude=True)} below about {of.show('speed_m_s', 'm/s')}",
            f"Multiply friction by 1 + {number(of['change'])} exp(−(v / {number(of['speed_m_s'])} m/s)²).",
            "Pull the object at several steady speeds and compare the forces.",
        )
