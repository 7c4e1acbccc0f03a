"""A push that follows the command with a lag."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from runner.effects.base import Parameter, Phrase, Stage, Vector, longer_than_commands
from runner.effects.planar_box.base import Beliefs, Context, PlanarEffect, effect
from runner.effects.wording import Values, number
from runner.errors import check_range
from runner.numerics.recursive_filter import filtered


@effect
@dataclass(frozen=True)
class ActuatorLag(PlanarEffect):
    """The push follows the command with a first-order lag of time constant `time_constant_s`."""

    name: ClassVar[str] = "actuator_lag"
    label: ClassVar[str] = "a push that follows the command with a lag"
    stage: ClassVar[Stage] = Stage.TIMING
    of_command: ClassVar[bool] = True
    time_constant_s: float

    def __post_init__(self) -> None:
        check_range("actuator_lag.time_constant_s", self.time_constant_s, 0.0, 100.0, unit="s")

    def edit_command(self, columns: np.ndarray, step_s: float) -> np.ndarray:
        if self.time_constant_s < 1e-6:
            return columns
        # exact for a command held over a step: state after it, and its mean over it
        decay = math.exp(-step_s / self.time_constant_s)
        after = filtered(columns.T, 1 - decay, 0.0, decay).T
        before = np.vstack([np.zeros(columns.shape[1]), after[:-1]])
        return columns + (before - columns) * (self.time_constant_s / step_s) * (1 - decay)

    @classmethod
    def parameters(cls, context: Context) -> tuple[Parameter, ...]:
        return (Parameter("time_constant_s", "s", 0.08, 0.0, 2.0),)

    @classmethod
    def sizes(cls, context: Context) -> np.ndarray:
        return longer_than_commands(*cls.parameters(context))

    @classmethod
    def from_vector(cls, x: Vector, context: Context) -> Self:
        return cls(max(x[0], 0.0))

    @classmethod
    def phrase(cls, of: Values, beliefs: Beliefs, target: str | None = None) -> Phrase:
        return Phrase(
            "the push follows the command with a lag",
            f"time constant {of.show('time_constant_s', 'ms', 1e3)}",
            f"Pass the command through a first-order lag of {number(1e3 * of['time_constant_s'])} ms.",
            "Record the force after a step of the command with a force gauge.",
        )
