"""A push that acts elsewhere on the body than commanded."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from runner.effects.base import Parameter, Phrase, Stage, Vector
from runner.effects.planar_box.base import Beliefs, Context, PlanarEffect, effect
from runner.effects.wording import Values, number
from runner.errors import check_range


@effect
@dataclass(frozen=True)
class ApplicationPointOffset(PlanarEffect):
    """The push acts at the commanded point plus (`x_m`, `y_m`), body axes."""

    name: ClassVar[str] = "application_point_offset"
    label: ClassVar[str] = "a push that acts elsewhere on the body"
    stage: ClassVar[Stage] = Stage.APPLICATION
    of_command: ClassVar[bool] = True
    x_m: float
    y_m: float

    def __post_init__(self) -> None:
        check_range("application_point_offset.x_m", self.x_m, -100, 100, unit="m")
        check_range("application_point_offset.y_m", self.y_m, -100, 100, unit="m")

    def edit_command(self, columns: np.ndarray, step_s: float) -> np.ndarray:
        out = columns.copy()
        out[:, 3:6] += self.x_m * columns[:, :3]
        out[:, 6:9] += self.y_m * columns[:, :3]
        return out

    @classmethod
    def parameters(cls, context: Context) -> tuple[Parameter, ...]:
        hx, hy, _ = context.half_size_m
        return (Parameter("x_m", "m", 0.1 * hx, -2 * hx, 2 * hx), Parameter("y_m", "m", 0.1 * hy, -2 * hy, 2 * hy))

    @classmethod
    def from_vector(cls, x: Vector, context: Context) -> Self:
        return cls(x[0], x[1])

    @classmethod
    def phrase(cls, of: Values, beliefs: Beliefs, target: str | None = None) -> Phrase:
        return Phrase(
            "the push acts elsewhere on the object than commanded",
            f"off by {of.longs('x_m', 'y_m')} along the object's own x and y",
            f"Add ({number(of['x_m'])}, {number(of['y_m'])}) m to the commanded point of application, in body axes.",
            "Measure where the pusher really touches the object.",
        )
