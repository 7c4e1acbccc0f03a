"""Static friction above kinetic friction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from runner.effects.base import Parameter, Phrase, Vector
from runner.effects.planar_box.base import Beliefs, Context, PlanarEffect, Target, effect
from runner.effects.wording import Values, number
from runner.errors import check_range


@effect
@dataclass(frozen=True)
class Stiction(PlanarEffect):
    """Friction of a point at rest exceeds that of a sliding one by the share `excess`."""

    name: ClassVar[str] = "stiction"
    label: ClassVar[str] = "a static friction above the kinetic one"
    discontinuous: ClassVar[bool] = True
    detection_limit: ClassVar[float] = 0.08
    excess: float

    def __post_init__(self) -> None:
        check_range("stiction.excess", self.excess, 0.0, 20.0)

    def edit_model(self, target: Target) -> None:
        target.dry_friction["stiction"] = self.excess

    @classmethod
    def parameters(cls, context: Context) -> tuple[Parameter, ...]:
        return (Parameter("excess", "", 0.3, 0.0, 3.0),)

    @classmethod
    def from_vector(cls, x: Vector, context: Context) -> Self:
        return cls(x[0])

    @classmethod
    def starts(cls, context: Context) -> np.ndarray:
        # the motion hardly changes until a push fails to start it: look at several sizes
        return np.array([[s] for s in (0.1, 0.3, 0.8)])

    @classmethod
    def phrase(cls, of: Values, beliefs: Beliefs, target: str | None = None) -> Phrase:
        return Phrase(
            "more force is needed to start the object than to keep it sliding",
            f"friction at rest is {of.show('excess', '%', 100)} above sliding friction",
            f"Set static friction to {number(1 + of['excess'])} times sliding friction.",
            "Raise a pull slowly until the object starts, and compare with the force that keeps it going.",
        )
