"""How the local cube that the operator feels follows the best estimate: all at once, or in ways that limit the jump.

At an update the best estimate of the remote's state and parameters changes. To give it to the shown cube at once is
a jump: of position, of velocity, and of the force that the same motion takes. A policy says what share of the
difference the shown cube takes over at a tick. Estimation goes on beside it, and knows nothing of the policy.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import NamedTuple

from runner.config import registered
from runner.errors import check_range


class Difference(NamedTuple):
    """From the shown cube to the best estimate of it, at a tick.

    Attributes:
        position_m, angle_rad, velocity_m_s, rate_rad_s: Sizes of the differences of the state.
        parameters: Largest relative difference of an estimated parameter.
        speed_m_s, turning_rad_s: Of the best estimate.
        pushed: Whether a push has acted since the last tick.
        interval_s: Since the last tick.
    """

    position_m: float
    angle_rad: float
    velocity_m_s: float
    rate_rad_s: float
    parameters: float
    speed_m_s: float
    turning_rad_s: float
    pushed: bool
    interval_s: float


class Share(NamedTuple):
    """The share of each difference that the shown cube takes over, 0 to 1."""

    position: float
    angle: float
    velocity: float
    rate: float
    parameters: float


ALL, NOTHING = Share(1.0, 1.0, 1.0, 1.0, 1.0), Share(0.0, 0.0, 0.0, 0.0, 0.0)


class AbstractFollow(ABC):
    """A policy of taking over a new estimate."""

    @abstractmethod
    def share(self, difference: Difference) -> Share:
        """Return what is taken over at a tick."""


@registered("follow")
@dataclass(frozen=True)
class Immediate(AbstractFollow):
    """Take over everything at once."""

    def share(self, difference: Difference) -> Share:
        return ALL


@registered("follow")
@dataclass(frozen=True)
class Unaware(Immediate):
    """Take a received state for the present one, however old it is: what the published method does on a slow link."""


@registered("follow")
@dataclass(frozen=True)
class RateLimited(AbstractFollow):
    """Correct at most so fast; `parameters_1_s` is relative."""

    velocity_m_s: float = 0.5
    rate_rad_s: float = 1.0
    acceleration_m_s2: float = 10.0
    angular_acceleration_rad_s2: float = 20.0
    parameters_1_s: float = 2.0

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:
            check_range(name, getattr(self, name), 0.0, 1e6, lower_open=True)

    def share(self, difference: Difference) -> Share:
        limits = (
            (self.velocity_m_s, difference.position_m),
            (self.rate_rad_s, difference.angle_rad),
            (self.acceleration_m_s2, difference.velocity_m_s),
            (self.angular_acceleration_rad_s2, difference.rate_rad_s),
            (self.parameters_1_s, difference.parameters),
        )
        return Share(*(min(1.0, limit * difference.interval_s / size) if size else 1.0 for limit, size in limits))


@registered("follow")
@dataclass(frozen=True)
class Blended(AbstractFollow):
    """Differences fade with this time constant."""

    time_s: float = 0.2

    def __post_init__(self) -> None:
        check_range("time_s", self.time_s, 1e-6, 1e3, unit="s")

    def share(self, difference: Difference) -> Share:
        return Share(*[1.0 - math.exp(-difference.interval_s / self.time_s)] * 5)


@registered("follow")
@dataclass(frozen=True)
class FreeSpace(AbstractFollow):
    """Take over everything, but only while no push acts: then nothing is felt."""

    def share(self, difference: Difference) -> Share:
        return NOTHING if difference.pushed else ALL


@registered("follow", "dead_band")
@dataclass(frozen=True)
class PerceptualDeadBand(AbstractFollow):
    """Leave alone what can't be felt, and take over at once what can: Weber's law.

    A change is felt if it is more than a fixed fraction of what is there already. Measured were about 7 % for the force
    between finger and thumb (Pang, Tan and Durlach 1991), and 8 % for the size of a movement of the forearm (Jones,
    Hunter and Irwin 1992), which is used for speed here. As the force for the same motion is in proportion to the mass,
    the fraction of force is used for parameters. (Parts of that force are felt less well: viscosity by 19 to 34 %
    depending on the method, Jones, Hunter and Lafontaine 1997.) Below `slowest` speeds the fraction is taken of those.
    The sense of position is taken to be absolute, 2 degrees, or 12 mm at the hand's distance from the elbow; these two
    and the slowest speeds are choices, not measurements.
    """

    force: float = 0.07
    speed: float = 0.08
    position_m: float = 0.012
    angle_rad: float = 0.035
    slowest_m_s: float = 0.05
    slowest_rad_s: float = 0.1

    def __post_init__(self) -> None:
        for name in ("force", "speed"):
            check_range(name, getattr(self, name), 0.0, 1.0)
        check_range("position_m", self.position_m, 0.0, 10.0, unit="m")
        check_range("angle_rad", self.angle_rad, 0.0, math.pi, unit="rad")
        check_range("slowest_m_s", self.slowest_m_s, 0.0, 100.0, unit="m/s")
        check_range("slowest_rad_s", self.slowest_rad_s, 0.0, 100.0, unit="rad/s")

    def share(self, difference: Difference) -> Share:
        d = difference
        return Share(
            float(d.position_m > self.position_m),
            float(d.angle_rad > self.angle_rad),
            float(d.velocity_m_s > self.speed * max(d.speed_m_s, self.slowest_m_s)),
            float(d.rate_rad_s > self.speed * max(d.turning_rad_s, self.slowest_rad_s)),
            float(d.parameters > self.force),
        )
