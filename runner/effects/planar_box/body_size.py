"""A base a little larger or smaller than its owner measured it: no word of the vocabulary, but part of any mismatch."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Self

import mujoco

from runner.effects.base import Parameter, Vector
from runner.effects.planar_box.base import Context, PlanarEffect, Target
from runner.errors import check_range
from runner.physics.dry_friction import POINT_STRIDE, STRIDE


@dataclass(frozen=True)
class BodySize(PlanarEffect):
    """The edges of the base are `ratio_x` and `ratio_y` times the believed ones, mass unchanged. Not in the vocabulary.

    The load is spread over the other base, and the moment of inertia is that of the other box. Fitted as logs.
    """

    name: ClassVar[str] = "body_size"
    label: ClassVar[str] = "other edges than believed"
    ratio_x: float
    ratio_y: float

    def __post_init__(self) -> None:
        check_range("body_size.ratio_x", self.ratio_x, 0.05, 20.0)
        check_range("body_size.ratio_y", self.ratio_y, 0.05, 20.0)

    def edit_model(self, target: Target) -> None:
        model, body, view = target.model, target.body_id, target.dry_friction
        half = view["half_x"], view["half_y"]
        points = model.body_user[body, STRIDE : STRIDE + POINT_STRIDE * int(view["points"])].reshape(-1, POINT_STRIDE)
        points[:, 0] *= self.ratio_x
        points[:, 1] *= self.ratio_y
        view["half_x"], view["half_y"] = half[0] * self.ratio_x, half[1] * self.ratio_y
        view["base_x"], view["base_y"] = view["base_x"] * self.ratio_x, view["base_y"] * self.ratio_y
        view["bearing_radius"] *= min(self.ratio_x, self.ratio_y)
        # of an even box, m (hx^2 + hy^2) / 3 about the vertical
        model.body_inertia[body] *= (math.hypot(view["half_x"], view["half_y"]) / math.hypot(*half)) ** 2
        mujoco.mj_setConst(model, target.scratch)

    @classmethod
    def parameters(cls, context: Context) -> tuple[Parameter, ...]:
        return tuple(Parameter(f"log_{name}", "", 1.0, -2.0, 2.0) for name in ("ratio_x", "ratio_y"))

    @classmethod
    def from_vector(cls, x: Vector, context: Context) -> Self:
        return cls(math.exp(x[0]), math.exp(x[1]))
