"""What is simulated: a body, its table, what surrounds it, how it is tracked, and what no vocabulary has a word for."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from enum import Enum


class Shape(Enum):
    """What the body is."""

    CUBE = "cube"
    BOX = "box"
    CYLINDER = "cylinder"


@dataclass(frozen=True)
class Strange:
    """What the vocabulary has no word for. Every default is neutral. SI units, radians."""

    magnet_n: float = 0.0  # greatest pull towards a place a little below the table
    magnet_place: tuple[float, float] = (0.0, 0.0)
    magnet_reach_m: float = 0.1
    fan_n: float = 0.0  # force within a stream of air that blows straight over the table
    fan_direction: float = 0.0
    fan_place_m: float = 0.0  # of its middle, across that direction
    fan_width_m: float = 0.1
    magnus_kg: float = 0.0  # lift of what spins: force = magnus w x v
    loose_share: float = 0.0  # of the mass, that swings inside
    loose_hz: float = 4.0
    loose_damping: float = 0.1  # of critical
    give_m: float = 0.0  # by which the table gives under the weight of the body; it has three times its mass
    worn_m: float = 0.0  # radius of the corners on one side, of a half size at most
    worn_side: tuple[float, float, float] = (1.0, 0.0, 0.0)  # body axes
    sticky_kg_per_s: float = 0.0  # resistance, in all directions, of a sticky spot to what touches it
    sticky_place: tuple[float, float] = (0.0, 0.0)
    sticky_reach_m: float = 0.1
    marker: tuple[float, float, float] = (0.0, 0.0, 0.0)  # body axes: the point that is tracked
    yaw_drift_rad_s: float = 0.0  # of the shown orientation, about the vertical


@dataclass(frozen=True)
class World:
    """One world, whole; every default is neutral.

    Args:
        shape: What the body is.
        half_size: m, body axes; of a cylinder radius, radius and half its length along z.
        mass: kg.
        stiffness_n_per_m: Of the spring at each point that touches.
        relaxation_s: Damping of those springs over their stiffness.
        friction: Coefficient.
        gravity: m/s2.
        inertia: Ratio to that of a uniform body.
        com: m, body axes.
        lean: rad, of gravity against the normal of the table, towards x and y.
        tilt: rad, of the tracking frame's vertical, which gravity and the table's normal have both, towards x and y.
        air_drag: N s2/m2, of the motion of the centre of mass.
        rotational_damping: N m s.
        clock: Recorded seconds in a true one.
        raised_m: By which the tracker shows the body too high.
        strange: What the vocabulary has no words for.
    """

    shape: Shape
    half_size: tuple[float, float, float]
    mass: float
    stiffness_n_per_m: float
    relaxation_s: float
    friction: float
    gravity: float = 9.81
    inertia: float = 1.0
    com: tuple[float, float, float] = (0.0, 0.0, 0.0)
    lean: tuple[float, float] = (0.0, 0.0)
    tilt: tuple[float, float] = (0.0, 0.0)
    air_drag: float = 0.0
    rotational_damping: float = 0.0
    clock: float = 1.0
    raised_m: float = 0.0
    strange: Strange = field(default_factory=Strange)

    def with_strange(self, **fields: object) -> World:
        """Return the same world with something strange."""
        return replace(self, strange=replace(self.strange, **fields))

    @property
    def uniform_inertia(self) -> tuple[float, float, float]:
        """Principal moments of a uniform body, kg m2."""
        hx, hy, hz = self.half_size
        if self.shape is Shape.CYLINDER:
            across = self.mass * (hx * hx / 4.0 + hz * hz / 3.0)
            return across, across, self.mass * hx * hx / 2.0
        third = self.mass / 3.0
        return third * (hy * hy + hz * hz), third * (hx * hx + hz * hz), third * (hx * hx + hy * hy)

    @property
    def bounce_rad_s(self) -> float:
        """Frequency at which the body would bob on four of its springs, rad/s."""
        return math.sqrt(4.0 * self.stiffness_n_per_m / self.mass)

    @property
    def damping_ratio(self) -> float:
        """Of that bobbing."""
        return 0.5 * self.relaxation_s * self.bounce_rad_s
