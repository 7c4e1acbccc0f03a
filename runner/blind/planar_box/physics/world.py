"""The box and all around it, as values."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from runner.errors import check_range


@dataclass(frozen=True)
class World:
    """The box, the floor, the actuator and the sensor. Every default after `gravity` is neutral. SI units, radians."""

    half_size: tuple[float, float, float]
    mass: float
    friction: float
    gravity: float = 9.81
    contact: Literal["patch", "corners"] = "patch"
    inertia: float | None = None  # about the vertical through the centre of mass; None: uniform density
    com: tuple[float, float] = (0.0, 0.0)  # body axes, from the geometric centre
    # floor
    anisotropy: tuple[float, float] = (1.0, 1.0)  # factors on friction along and across the axis
    anisotropy_angle: float = 0.0  # of the axis, body frame
    anisotropy_flow: Literal["associated", "scaled"] = "associated"
    stribeck: float = 0.0  # friction (1 + stribeck (exp(-(u / speed)^exponent) - reference))
    stribeck_speed: float = 0.1
    stribeck_exponent: float = 2.0
    stribeck_reference: float = 0.0  # 0: `friction` is that of high speed, 1: that of rest
    stiction: float = 0.0  # friction (1 + stiction exp(-(u / speed)^2)), at a speed near zero
    stiction_speed: float = 2e-3
    patch: float = 0.0  # relative change of friction in one place
    patch_place: tuple[float, float] = (0.0, 0.0)
    patch_radius: float = 0.5  # of the disc, or the standard deviation of the Gaussian
    patch_shape: Literal["disc", "gaussian"] = "disc"
    pressure: float = 0.0  # share of the load that is moved to `pressure_where`
    pressure_where: Literal["rim", "middle"] = "rim"
    tilt: float = 0.0  # angle of the floor
    downhill: float = 0.0  # world direction
    texture: float = 0.0  # standard deviation of friction over the floor, relative
    texture_seed: int = 0
    texture_length: float = 0.3  # correlation length, m
    texture_mean: float = 0.0  # taken from the field, so that friction is right on average where the box goes
    # forces
    viscous_drag: float = 0.0  # N s/m, through the geometric centre
    film: float = 0.0  # N s/m, spread over the base
    air_drag: float = 0.0  # N s2/m2
    rotational_damping: float = 0.0  # N m s
    wind: tuple[float, float] = (0.0, 0.0)  # N
    tether: float = 0.0  # N/m, from the geometric centre, slack below its rest length
    tether_place: tuple[float, float] = (0.0, 0.0)
    tether_rest: float = 0.0
    mass_leak: float = 0.0  # share per second, from the start of the episode
    # actuator
    gain: float = 1.0
    saturation: float = math.inf  # N
    misalignment: float = 0.0  # rad, counter-clockwise
    delay: float = 0.0  # s
    lag: float = 0.0  # s
    point_offset: tuple[float, float] = (0.0, 0.0)  # m, body axes
    # sensor
    observation_delay: float = 0.0  # s
    sensor_scale: float = 1.0
    # what the vocabulary has no word for
    periodic: float = 0.0  # N, a force in time along `periodic_direction`
    periodic_direction: float = 0.0
    periodic_hz: float = 1.0
    periodic_phase: float = 0.0
    cogging: float = 0.0  # N m, torque that depends on yaw: cogging sin(teeth yaw + phase)
    cogging_teeth: int = 3
    cogging_phase: float = 0.0
    deflection: float = 0.0  # N s/m, force across the velocity
    wear: float = 0.0  # 1/s, friction grows with the time in use, all episodes together
    deadband: float = 0.0  # N taken from every push
    wander: float = 0.0  # N, standard deviation of a slowly wandering force
    wander_seed: int = 0
    barrier: float = 0.0  # N/m beyond the line n . r = distance
    barrier_direction: float = 0.0  # of n
    barrier_distance: float = 0.0
    barrier_damping: float = 0.0  # N s/m
    vortex: float = 0.0  # N, peak of a force field that circles a place
    vortex_place: tuple[float, float] = (0.0, 0.0)
    vortex_radius: float = 1.0
    quantum: float = 0.0  # N, the force comes in steps
    crosstalk: float = 0.0  # 1/N, fy += crosstalk fx |fx|

    def __post_init__(self) -> None:
        for axis, value in zip("xyz", self.half_size, strict=True):
            check_range(f"world.half_size.{axis}", value, 0.0, 100.0, unit="m", lower_open=True)
        check_range("world.mass", self.mass, 0.0, 1e6, unit="kg", lower_open=True)
        check_range("world.friction", self.friction, 0.0, 10.0)
        check_range("world.gravity", self.gravity, 0.0, 1e3, unit="m/s2")
        for name in ("delay", "lag", "observation_delay", "deadband", "quantum", "tether", "tether_rest"):
            check_range(f"world.{name}", getattr(self, name), 0.0)
        check_range("world.pressure", self.pressure, 0.0, 1.0)

    @property
    def yaw_inertia(self) -> float:
        """Yaw inertia about the centre of mass, kg m2."""
        hx, hy, _ = self.half_size
        return self.mass * (hx * hx + hy * hy) / 3.0 if self.inertia is None else self.inertia
