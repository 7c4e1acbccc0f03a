"""Static friction above kinetic friction."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from runner.effects.base import Parameter, Phrase, Vector
from runner.effects.planar_box.base import Beliefs, Context, PlanarEffect, Target, effect
from runner.effects.wording import Values, number
from runner.errors import check_range

# below the least, nothing that is measured sixty times a second tells the speed; above the most it is Stribeck's
USUAL_M_S, SPEEDS_M_S = 2e-3, (5e-4, 0.02)


@effect
@dataclass(frozen=True)
class Stiction(PlanarEffect):
    """Friction times (1 + `excess` exp(-(v / `speed_m_s`)^2)): a point at rest is held by more than a sliding one.

    The excess is gone within some millimetres a second (Armstrong-Helouvry 1991). Slower still it makes no difference
    but that of a force that does, or does not, start the body.
    """

    name: ClassVar[str] = "stiction"
    label: ClassVar[str] = "a static friction above the kinetic one"
    discontinuous: ClassVar[bool] = True
    detection_limit: ClassVar[float] = 0.08
    excess: float
    speed_m_s: float = USUAL_M_S

    def __post_init__(self) -> None:
        check_range("stiction.excess", self.excess, 0.0, 20.0)
        check_range("stiction.speed_m_s", self.speed_m_s, 1e-4, 0.1, unit="m/s")

    def edit_model(self, target: Target) -> None:
        target.dry_friction["stiction"], target.dry_friction["stiction_speed"] = self.excess, self.speed_m_s

    @classmethod
    def parameters(cls, context: Context) -> tuple[Parameter, ...]:
        low, high = (math.log(v / USUAL_M_S) for v in SPEEDS_M_S)
        return (
            Parameter("excess", "", 0.3, 0.0, 3.0),
            Parameter("log_speed", "", 0.7, low, high, may_rest=True),
        )

    @classmethod
    def from_vector(cls, x: Vector, context: Context) -> Self:
        return cls(x[0], USUAL_M_S * math.exp(x[1]))

    @classmethod
    def starts(cls, context: Context) -> np.ndarray:
        # the motion hardly changes until a push fails to start it: look at several sizes
        return np.array([[s, math.log(v / USUAL_M_S)] for s in (0.1, 0.3, 0.8) for v in (USUAL_M_S, 8e-3)])

    @classmethod
    def phrase(cls, of: Values, beliefs: Beliefs, target: str | None = None) -> Phrase:
        return Phrase(
            "more force is needed to start the object than to keep it sliding",
            f"friction at rest is {of.show('excess', '%', 100)} above sliding friction",
            f"Set static friction to {number(1 + of['excess'])} times sliding friction, "
            f"falling off within {number(1000 * of['speed_m_s'], 2)} mm/s.",
            "Raise a pull slowly until the object starts, and compare with the force that keeps it going.",
        )
