"""What is measured of a body that moves in space, how noisily, and what is believed of it beforehand."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from runner.errors import ConfigError, RecordingError, check_range, check_vector
from runner.estimation.space.dynamics import MOTION, WRENCH, Motion, cross
from runner.estimation.space.inertial import SCALE, SIZE
from runner.teleop.link import NoiseConfig

READ = MOTION + WRENCH  # numbers of a reading beside the wrench


@dataclass(frozen=True)
class SensorConfig:
    """Standard deviations of white normal noise, the same along each axis, and where the grip is.

    Attributes:
        acceleration_m_s2: Of the accelerometer at the tracked point.
        angular_acceleration_rad_s2: Of the angular acceleration.
        force_n: At the grip.
        torque_n_m: At the grip.
        grip_m: From the tracked point, body axes.
    """

    acceleration_m_s2: float = 0.05
    angular_acceleration_rad_s2: float = 0.5
    force_n: float = 0.05
    torque_n_m: float = 0.003
    grip_m: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        check_range("acceleration_m_s2", self.acceleration_m_s2, 0.0, 1e3, unit="m/s2", lower_open=True)
        check_range(
            "angular_acceleration_rad_s2", self.angular_acceleration_rad_s2, 0.0, 1e4, unit="rad/s2", lower_open=True
        )
        check_range("force_n", self.force_n, 0.0, 1e4, unit="N", lower_open=True)
        check_range("torque_n_m", self.torque_n_m, 0.0, 1e4, unit="N m", lower_open=True)
        check_vector("grip_m", self.grip_m, 3, unit="m", limit=100.0)

    def sd(self, noise: NoiseConfig) -> np.ndarray:
        """Return the standard deviations of a reading beside its wrench, (18,).

        Raises:
            ConfigError: If a pose or a velocity would be exact.
        """
        of_motion = (noise.position_m, noise.angle_rad, noise.velocity_m_s, noise.rate_rad_s)
        for name, value in zip(("position_m", "angle_rad", "velocity_m_s", "rate_rad_s"), of_motion, strict=True):
            if value <= 0:
                raise ConfigError(f"link.noise.{name}: must be above 0 to weigh what is measured, got {value:g}.")
        return np.repeat([*of_motion, self.acceleration_m_s2, self.angular_acceleration_rad_s2], 3)

    @property
    def wrench_sd(self) -> np.ndarray:
        """Standard deviations at the grip, (6,)."""
        return np.repeat([self.force_n, self.torque_n_m], 3)

    @property
    def to_point(self) -> np.ndarray:
        """What makes the wrench at the tracked point of that at the grip, (6, 6)."""
        out = np.eye(WRENCH)
        out[3:, :3] = cross(np.array(self.grip_m))
        return out

    @property
    def wrench_root(self) -> np.ndarray:
        """A root of the covariance of the wrench at the tracked point, (6, 6)."""
        return self.to_point * self.wrench_sd


@dataclass(frozen=True)
class SpacePrior:
    """What is believed of a body beforehand.

    Attributes:
        x: Ten free numbers, (10,), or of each lane (N, 10); see `inertial`.
        scale: Standard deviation of the logarithm of its density.
        shape: Of each of the ten numbers besides: of how far mass reaches and sits, in half sizes.
    """

    x: np.ndarray
    scale: float = math.log(2)
    shape: float = 0.3

    def __post_init__(self) -> None:
        check_range("prior.scale", self.scale, 0.0, 10.0, lower_open=True)
        check_range("prior.shape", self.shape, 0.0, 10.0, lower_open=True)
        if self.x.shape[-1] != SIZE or not np.isfinite(self.x).all():
            raise ConfigError(f"prior.x: must be {SIZE} finite numbers, got {self.x!r}.")

    @property
    def covariance(self) -> np.ndarray:
        """Of the ten numbers, (10, 10)."""
        return self.shape**2 * np.eye(SIZE) + (0.5 * self.scale) ** 2 * np.outer(SCALE, SCALE)


@dataclass(frozen=True)
class Reading:
    """What is measured at one time, of N lanes.

    Attributes:
        motion: Pose and velocity, each (N, ...).
        acceleration: Specific force at the tracked point and angular acceleration, body axes, (N, 6).
        wrench: At the grip, body axes, (N, 6); None: nobody holds the body, and none acts.

    A NaN in position, velocity, rate or acceleration is a number that did not arrive; a turn of NaNs likewise.
    """

    motion: Motion
    acceleration: np.ndarray
    wrench: np.ndarray | None = None

    def __post_init__(self) -> None:
        turn = self.motion.turn
        known = ~np.isnan(turn).any(axis=(-1, -2))
        off = np.abs(turn.swapaxes(-1, -2) @ turn - np.eye(3)).max(axis=(-1, -2))
        if (off[known] > 1e-6).any() or (np.linalg.det(turn[known]) < 0).any():
            raise RecordingError("reading: a turn is not a rotation matrix.")
        if self.wrench is not None and not np.isfinite(self.wrench).all():
            raise RecordingError("reading: a wrench is not finite; without one the motion between readings is unknown.")
        for name, part in (("position", self.motion.position), ("acceleration", self.acceleration)):
            if np.isinf(part).any():
                raise RecordingError(f"reading: {name} is infinite.")

    def of(self, lanes: np.ndarray) -> Reading:
        """Return the reading of some lanes."""
        wrench = None if self.wrench is None else self.wrench[lanes]
        return Reading(self.motion.of(lanes), self.acceleration[lanes], wrench)
