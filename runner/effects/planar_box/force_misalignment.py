"""A push that points in another direction than commanded."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from runner.effects.base import Parameter, Phrase, Stage, Vector
from runner.effects.planar_box.base import Beliefs, Context, PlanarEffect, effect
from runner.effects.wording import DEGREES, Values, number
from runner.errors import check_range


@effect
@dataclass(frozen=True)
class ForceMisalignment(PlanarEffect):
    """The real force is the commanded one turned about the vertical by `angle_rad`, counter-clockwise."""

    name: ClassVar[str] = "force_misalignment"
    label: ClassVar[str] = "a push that is turned by a constant angle"
    stage: ClassVar[Stage] = Stage.APPLICATION
    of_command: ClassVar[bool] = True
    angle_rad: float

    def __post_init__(self) -> None:
        check_range("force_misalignment.angle_rad", self.angle_rad, -3.2, 3.2, unit="rad")

    def edit_command(self, columns: np.ndarray, step_s: float) -> np.ndarray:
        c, s = math.cos(self.angle_rad), math.sin(self.angle_rad)
        turn = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])  # row vectors: v @ turn
        return (columns.reshape(-1, 4, 3) @ turn).reshape(-1, 12)

    @classmethod
    def parameters(cls, context: Context) -> tuple[Parameter, ...]:
        return (Parameter("angle_rad", "rad", 0.1, -1.5, 1.5),)

    @classmethod
    def from_vector(cls, x: Vector, context: Context) -> Self:
        return cls(x[0])

    @classmethod
    def phrase(cls, of: Values, beliefs: Beliefs, target: str | None = None) -> Phrase:
        return Phrase(
            "the push points in another direction than commanded",
            f"turned by {of.angle('angle_rad')} counter-clockwise",
            f"Turn every commanded force by {number(of['angle_rad'] * DEGREES)}° counter-clockwise.",
            "Check the mounting of the pusher, and the axes in which commands are given.",
        )
