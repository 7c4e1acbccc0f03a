"""Friction that differs in one place of the floor."""

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
class FrictionPatch(PlanarEffect):
    """Friction times (1 + `change`) inside a disc of the floor, with a smooth edge."""

    name: ClassVar[str] = "friction_patch"
    label: ClassVar[str] = "friction that differs in one place of the floor"
    detection_limit: ClassVar[float] = 0.01
    texture: ClassVar[bool] = True
    change: float
    x_m: float
    y_m: float
    radius_m: float

    def __post_init__(self) -> None:
        check_range("friction_patch.change", self.change, -1.0, 20.0)
        check_range("friction_patch.x_m", self.x_m, -1e4, 1e4, unit="m")
        check_range("friction_patch.y_m", self.y_m, -1e4, 1e4, unit="m")
        check_range("friction_patch.radius_m", self.radius_m, 1e-3, 1e3, unit="m")

    def edit_model(self, target: Target) -> None:
        friction = target.dry_friction
        friction["patch"], friction["patch_radius"] = self.change, self.radius_m
        friction["patch_x"], friction["patch_y"] = self.x_m, self.y_m

    @classmethod
    def parameters(cls, context: Context) -> tuple[Parameter, ...]:
        (cx, cy), reach = context.centre_m, context.reach_m
        # what reaches further than the body has been is another floor, no patch of one
        largest = max(6 * context.size_m, reach)
        return (
            Parameter("change", "", 0.3, -0.95, 3.0),
            Parameter("x_m", "m", reach / 2, cx - 1.3 * reach, cx + 1.3 * reach, may_rest=True),
            Parameter("y_m", "m", reach / 2, cy - 1.3 * reach, cy + 1.3 * reach, may_rest=True),
            Parameter("log_radius", "", 0.6, math.log(0.3 * context.size_m), math.log(largest)),
        )

    @classmethod
    def from_vector(cls, x: Vector, context: Context) -> Self:
        return cls(x[0], x[1], x[2], math.exp(x[3]))

    @classmethod
    def starts(cls, context: Context) -> np.ndarray:
        (cx, cy), reach = context.centre_m, context.reach_m
        grid = np.linspace(-0.8, 0.8, 5) * reach
        radius = max(1.2 * context.size_m, 0.3 * reach)  # overlapping neighbours
        return np.array([[0.2, cx + a, cy + b, math.log(radius)] for a in grid for b in grid])

    @classmethod
    def phrase(cls, of: Values, beliefs: Beliefs, target: str | None = None) -> Phrase:
        word, less = ("more slippery", "lower") if of["change"] < 0 else ("less slippery", "higher")
        return Phrase(
            f"the floor is {word} in one place",
            f"friction {of.show('change', '%', 100, magnitude=True)} {less} within {of.long('radius_m')} of "
            f"{of.place()}",
            f"Multiply friction by {number(1 + of['change'])} within {number(of['radius_m'])} m of {of.place()}.",
            f"Look at the floor around {of.place()}: dirt, wear, another material.",
        )
