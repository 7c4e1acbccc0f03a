"""Effects between the motion and what is recorded of it; all change the predicted measurement."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from runner.effects.base import Parameter, Vector
from runner.effects.planar_box.base import Context, Motion, PlanarEffect, ahead, effect, late
from runner.errors import check_range


@effect
@dataclass(frozen=True)
class ObservationDelay(PlanarEffect):
    """The measured state is `delay_s` older than its time stamp.

    The state at the first time stamp is then that of `delay_s` before any command: for an observer it is the same as
    a command that comes late, and is simulated so.
    """

    name: ClassVar[str] = "observation_delay"
    label: ClassVar[str] = "a measurement that is older than its time stamp"
    of_sensor: ClassVar[bool] = True
    delay_s: float

    def __post_init__(self) -> None:
        check_range("observation_delay.delay_s", self.delay_s, 0.0, 100.0, unit="s")

    def edit_command(self, columns: np.ndarray, step_s: float) -> np.ndarray:
        return late(columns, self.delay_s, step_s)

    def edit_measurement(self, motion: Motion) -> Motion:
        return ahead(motion, self.delay_s)

    @classmethod
    def parameters(cls, context: Context) -> tuple[Parameter, ...]:
        return (Parameter("delay_s", "s", 0.08, 0.0, 1.0),)

    @classmethod
    def from_vector(cls, x: Vector, context: Context) -> Self:
        return cls(max(x[0], 0.0))


@effect
@dataclass(frozen=True)
class SensorScale(PlanarEffect):
    """Measured lengths and velocities are `ratio` times the true ones. Fitted as its log."""

    name: ClassVar[str] = "sensor_scale"
    label: ClassVar[str] = "measured lengths that are a multiple of the true ones"
    of_sensor: ClassVar[bool] = True
    ratio: float

    def __post_init__(self) -> None:
        check_range("sensor_scale.ratio", self.ratio, 0.01, 100.0)

    def edit_measurement(self, motion: Motion) -> Motion:
        scale = np.array([self.ratio, self.ratio, 1.0])
        return Motion(motion.t_s, motion.pose * scale, motion.twist * scale)

    @classmethod
    def parameters(cls, context: Context) -> tuple[Parameter, ...]:
        return (Parameter("log_ratio", "", 0.05, -1.0, 1.0),)

    @classmethod
    def from_vector(cls, x: Vector, context: Context) -> Self:
        return cls(math.exp(x[0]))
