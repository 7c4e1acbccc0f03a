"""Effects between the commanded and the real push; all change the command, outside the engine."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np
import scipy  # loads its parts when they are first used, which is longer than a short run takes

from runner.effects.base import Parameter, Vector
from runner.effects.planar_box.base import Context, Motion, PlanarEffect, ahead, effect, late
from runner.errors import check_range


@effect
@dataclass(frozen=True)
class ActuatorGain(PlanarEffect):
    """The real force is `gain` times the commanded one. Fitted as its log."""

    name: ClassVar[str] = "actuator_gain"
    label: ClassVar[str] = "a real force that is a multiple of the commanded one"
    gain: float

    def __post_init__(self) -> None:
        check_range("actuator_gain.gain", self.gain, 0.0, 100.0)

    def edit_command(self, columns: np.ndarray, step_s: float) -> np.ndarray:
        return self.gain * columns

    @classmethod
    def parameters(cls, context: Context) -> tuple[Parameter, ...]:
        return (Parameter("log_gain", "", 0.15, -1.6, 1.6),)

    @classmethod
    def from_vector(cls, x: Vector, context: Context) -> Self:
        return cls(math.exp(x[0]))


@effect
@dataclass(frozen=True)
class ActuatorDelay(PlanarEffect):
    """The command takes effect `delay_s` late."""

    name: ClassVar[str] = "actuator_delay"
    label: ClassVar[str] = "a push that comes late"
    delay_s: float

    def __post_init__(self) -> None:
        check_range("actuator_delay.delay_s", self.delay_s, 0.0, 100.0, unit="s")

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
class ActuatorLag(PlanarEffect):
    """The push follows the command with a first-order lag of time constant `time_constant_s`."""

    name: ClassVar[str] = "actuator_lag"
    label: ClassVar[str] = "a push that follows the command with a lag"
    time_constant_s: float

    def __post_init__(self) -> None:
        check_range("actuator_lag.time_constant_s", self.time_constant_s, 0.0, 100.0, unit="s")

    def edit_command(self, columns: np.ndarray, step_s: float) -> np.ndarray:
        if self.time_constant_s < 1e-6:
            return columns
        # exact for a command held over a step: state after it, and its mean over it
        decay = math.exp(-step_s / self.time_constant_s)
        after = scipy.signal.lfilter([1 - decay], [1, -decay], columns, axis=0)
        before = np.vstack([np.zeros(columns.shape[1]), after[:-1]])
        return columns + (before - columns) * (self.time_constant_s / step_s) * (1 - decay)

    @classmethod
    def parameters(cls, context: Context) -> tuple[Parameter, ...]:
        return (Parameter("time_constant_s", "s", 0.08, 0.0, 2.0),)

    @classmethod
    def from_vector(cls, x: Vector, context: Context) -> Self:
        return cls(max(x[0], 0.0))


@effect
@dataclass(frozen=True)
class ActuatorSaturation(PlanarEffect):
    """The push is at most `limit_n`. Fitted as the share of the largest commanded force that is cut off."""

    name: ClassVar[str] = "actuator_saturation"
    label: ClassVar[str] = "a push that is limited"
    limit_n: float

    def __post_init__(self) -> None:
        check_range("actuator_saturation.limit_n", self.limit_n, 0.0, 1e9, unit="N")

    def edit_command(self, columns: np.ndarray, step_s: float) -> np.ndarray:
        size = np.linalg.norm(columns[:, :3], axis=1)
        return columns * np.minimum(1.0, self.limit_n / np.maximum(size, 1e-300))[:, None]

    @classmethod
    def parameters(cls, context: Context) -> tuple[Parameter, ...]:
        return (Parameter("cut_share", "", 0.2, 0.0, 0.95),)

    @classmethod
    def from_vector(cls, x: Vector, context: Context) -> Self:
        return cls(context.force_n * (1 - x[0]))

    @classmethod
    def starts(cls, context: Context) -> np.ndarray:
        return np.array([[s] for s in (0.1, 0.3)])


@effect
@dataclass(frozen=True)
class ApplicationPointOffset(PlanarEffect):
    """The push acts at the commanded point plus (`x_m`, `y_m`), body axes."""

    name: ClassVar[str] = "application_point_offset"
    label: ClassVar[str] = "a push that acts elsewhere on the body"
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


@effect
@dataclass(frozen=True)
class ForceMisalignment(PlanarEffect):
    """The real force is the commanded one turned about the vertical by `angle_rad`, counter-clockwise."""

    name: ClassVar[str] = "force_misalignment"
    label: ClassVar[str] = "a push that is turned by a constant angle"
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


@dataclass(frozen=True)
class DeadBand(PlanarEffect):
    """Of every push `force_n` is lost, and one that is weaker does nothing. Not in the vocabulary."""

    name: ClassVar[str] = "unknown"
    label: ClassVar[str] = "a dead band of the push"
    force_n: float

    def __post_init__(self) -> None:
        check_range("dead_band.force_n", self.force_n, 0.0, 1e9, unit="N")

    def edit_command(self, columns: np.ndarray, step_s: float) -> np.ndarray:
        size = np.linalg.norm(columns[:, :3], axis=1)
        return columns * (np.maximum(size - self.force_n, 0.0) / np.maximum(size, 1e-300))[:, None]

    @classmethod
    def parameters(cls, context: Context) -> tuple[Parameter, ...]:
        return (Parameter("force_n", "N", 0.1 * context.friction_n, 0.0, context.force_n),)

    @classmethod
    def from_vector(cls, x: Vector, context: Context) -> Self:
        return cls(max(x[0], 0.0))
