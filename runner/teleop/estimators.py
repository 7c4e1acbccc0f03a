"""Estimators of the remote's mass from the motion of a local copy under the same forces.

At an update the local cube has moved for one interval T from a state that it had in common with the remote, with the
same commands but the mass m in place of the true mass M. The published rules compare the speeds at the end of the
interval and scale the mass:

    linear      m <- m |v_local| / |v_remote|          (eq. 2)
    rotational  m <- m |w_local| / |w_remote|          (eq. 5), the inertia following the mass (eq. 3: I = m s^2 / 6)

Then the local takes the remote's state, and the next interval starts.

What the rule does. Let v0 be the common speed, F the push along the motion, and let both cubes slide all the time.
Dry friction slows any mass alike, so both end at a + F T / mass, with a = v0 - mu g T the speed without the push:

    m' = m (a + F T / m) / (a + F T / M)     =>     m' - M = rho (m - M),     rho = a / v_remote.

The error is multiplied by rho, the share of the remote's speed that is *not* due to the push of this interval.
 * Speeding up from rest: rho falls as the speed grows, and the errors multiply to about n^-(1 + mu g / A) after n
   updates at acceleration A: 1.5 decades in half a second at 60 Hz with little friction, four with mu g = 1.4 A.
 * Gliding without push: rho = 1. Nothing is learnt, nothing is lost.
 * Push against the motion: rho > 1, the error grows, by as much as it shrank when the same speed was gained.
 * Start of a push from rest, v0 = 0: rho = -mu g T / v_remote = -mu g / A. The rule overshoots, beyond the start
   error where A < mu g. A start mass far below M gives the high peak at the first push that the paper shows; one far
   above gives a trough. Without friction rho = 0 and one update is enough. At one update per push (low rates) the
   rule may alternate, or diverge where A < mu g.
 * A body at rest says nothing: 0 / 0. One that sticks while the other slides breaks the premise: the ratio would
   make the mass zero (local sticks) or infinite (remote sticks). The rule holds the mass until both slide.
 * A speed through zero has opposite directions on the two sides, whose sizes are not comparable: the rule holds.

The same holds for turning, with the yaw rate, the moment of the push about the centre of mass, and the friction
torque. Pushes through the centre turn nothing, and hold it.

The guarded rule removes what harms. It knows the push, hence a = v_local - F T / m, and rho. It divides the step by
1 - rho where rho < 0: as m' - m = (rho - 1)(m - M), that goes to M at once and not beyond. It holds where rho > 1
(push against the motion). For 0 <= rho <= 1 it is the published rule.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum, IntEnum
from operator import mul
from typing import Any, ClassVar, NamedTuple

import numpy as np

from runner.config import registered
from runner.errors import check_range
from runner.physics.scene import BodyConfig, SceneConfig


class Outcome(IntEnum):
    """What an update did; stored in the frames."""

    updated = 0
    no_message = 1  # nothing arrived
    at_rest = 2  # a speed is too low to compare
    opposed = 3  # the two move in opposite directions
    not_driven = 4  # the guard: no push along the motion, so that nothing is learnt, or the error would grow
    implausible = 5  # the result lies outside the allowed range


class Compared(Enum):
    """Which rates of the two bodies an estimator compares."""

    linear = "linear"
    angular = "angular"
    both = "both"


Numbers = Sequence[float]
Cuts = tuple[slice, slice, slice]  # where position, linear and angular velocity of a body stand in qpos, qvel, qvel


class Seen(NamedTuple):
    """What the local side knows at an update.

    States come as plain numbers. Planar: position (x, y, yaw), linear (vx, vy), angular (wz,). Upright (on feet or
    corners): z after y, vz after vy. Free: position (x, y, z, qw, qx, qy, qz), linear (vx, vy, vz) in world axes,
    angular (wx, wy, wz) in body axes.

    Attributes:
        now_s: Time of the update.
        sent_s: Time stamp of the message; older than `now_s` on a slow link.
        since_s: When the two were last made equal.
        impulse_n_s: Integral of the commanded force since then, (3,), world axes.

    The local body's state is that at the time of the message, predicted from `since_s` on, also where the message is
    old (`teleop.latency`); only a local side that is unaware of the delay compares its present state, and then
    times are those on its own clock.
    """

    now_s: float
    sent_s: float
    since_s: float
    impulse_n_s: Numbers
    # all numbers of the scene as predicted, as the message says, and as the message before it said; sliced on
    # demand, as most rules need few of them
    q: Numbers
    v: Numbers
    sent_q: Numbers
    sent_v: Numbers
    common_q: Numbers
    common_v: Numbers
    local_cuts: Cuts
    remote_cuts: Cuts

    @property
    def local_position(self) -> Numbers:
        """The local body's position, before it takes over the remote's."""
        return self.q[self.local_cuts[0]]

    @property
    def local_linear(self) -> Numbers:
        """The local body's velocity."""
        return self.v[self.local_cuts[1]]

    @property
    def local_angular(self) -> Numbers:
        """The local body's angular velocity."""
        return self.v[self.local_cuts[2]]

    @property
    def remote_position(self) -> Numbers:
        """The remote's position in the message."""
        return self.sent_q[self.remote_cuts[0]]

    @property
    def remote_linear(self) -> Numbers:
        """The remote's velocity in the message."""
        return self.sent_v[self.remote_cuts[1]]

    @property
    def remote_angular(self) -> Numbers:
        """The remote's angular velocity in the message."""
        return self.sent_v[self.remote_cuts[2]]

    @property
    def common_position(self) -> Numbers:
        """The position that both had at `since_s`."""
        return self.common_q[self.remote_cuts[0]]

    @property
    def common_linear(self) -> Numbers:
        """The velocity that both had at `since_s`."""
        return self.common_v[self.remote_cuts[1]]

    @property
    def common_angular(self) -> Numbers:
        """The angular velocity that both had at `since_s`."""
        return self.common_v[self.remote_cuts[2]]


@dataclass(frozen=True)
class Setup:
    """What an estimator may know before the first update.

    Attributes:
        scene: The scene.
        body: The local body as it starts.
        pushes: The commands over physics steps, (n, 12), see `scene.push_columns`; only those of the past may be used.
    """

    scene: SceneConfig
    body: BodyConfig
    pushes: np.ndarray = field(default_factory=lambda: np.empty((0, 12)))


class AbstractEstimator(ABC):
    """A rule from what was seen to new values of the local body's parameters.

    An estimator has no state of its own: `start` makes a memory, `update` returns the next one, or the same object
    where nothing has changed. Both are pure, so that one estimator may serve many runs at once, and a run may be
    repeated. A memory is never written to: all of them are kept until the run is over.
    """

    names: ClassVar[tuple[str, ...]] = ("mass_kg",)  # of `runner.teleop.parameters`
    details: ClassVar[tuple[str, ...]] = ()  # further numbers that the frames keep

    @property
    def compared(self) -> Compared:
        """Which rates it compares."""
        return Compared.both

    @abstractmethod
    def start(self, setup: Setup) -> Any:
        """Return the memory before the first update."""

    @abstractmethod
    def update(self, memory: Any, seen: Seen) -> tuple[Any, Outcome]:
        """Return the memory after an update, and what the update did."""

    @abstractmethod
    def values(self, memory: Any) -> tuple[float, ...]:
        """Return the current values of the parameters in `names`."""

    def detail(self, memory: Any) -> tuple[float, ...]:
        """Return the current values of the numbers in `details`."""
        return ()


@dataclass(frozen=True)
class MassRule(AbstractEstimator):
    """A rule whose memory is the mass alone. Results outside [`lowest_kg`, `highest_kg`] are refused, not clipped."""

    lowest_kg: float = 1e-3
    highest_kg: float = 1e4

    def __post_init__(self) -> None:
        check_range("lowest_kg", self.lowest_kg, 0.0, 1e6, unit="kg", lower_open=True)
        check_range("highest_kg", self.highest_kg, self.lowest_kg, 1e6, unit="kg", lower_open=True)

    def start(self, setup: Setup) -> float:
        return setup.body.mass_kg

    def values(self, memory: float) -> tuple[float, ...]:
        return (memory,)

    def _accept(self, mass_kg: float, new_kg: float) -> tuple[float, Outcome]:
        if new_kg == mass_kg:
            return mass_kg, Outcome.updated
        if self.lowest_kg <= new_kg <= self.highest_kg:
            return new_kg, Outcome.updated
        return mass_kg, Outcome.implausible


@registered("estimator")
@dataclass(frozen=True)
class Linear(MassRule):
    """Eq. 2: scale the mass by the ratio of the speeds; hold while either is below `slowest_m_s`."""

    slowest_m_s: float = 1e-3

    @property
    def compared(self) -> Compared:
        return Compared.linear

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range("slowest_m_s", self.slowest_m_s, 0.0, 100.0, unit="m/s", lower_open=True)

    def update(self, memory: float, seen: Seen) -> tuple[float, Outcome]:
        ratio = compare(seen.local_linear, seen.remote_linear, self.slowest_m_s)
        return (memory, _HELD[ratio]) if ratio <= 0 else self._accept(memory, memory * ratio)


@registered("estimator")
@dataclass(frozen=True)
class Rotational(MassRule):
    """Eq. 5: scale the mass by the ratio of the turning rates; hold while either is below `slowest_rad_s`."""

    slowest_rad_s: float = 2e-3

    @property
    def compared(self) -> Compared:
        return Compared.angular

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range("slowest_rad_s", self.slowest_rad_s, 0.0, 100.0, unit="rad/s", lower_open=True)

    def update(self, memory: float, seen: Seen) -> tuple[float, Outcome]:
        ratio = compare(seen.local_angular, seen.remote_angular, self.slowest_rad_s)
        return self._accept(memory, memory * ratio) if ratio > 0 else (memory, _HELD[ratio])


@registered("estimator")
@dataclass(frozen=True)
class LinearGuarded(MassRule):
    """Eq. 2 with the guard: no overshoot at the start of a push, no growth while pushed against the motion."""

    slowest_m_s: float = 1e-3

    @property
    def compared(self) -> Compared:
        return Compared.linear

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range("slowest_m_s", self.slowest_m_s, 0.0, 100.0, unit="m/s", lower_open=True)

    def update(self, memory: float, seen: Seen) -> tuple[float, Outcome]:
        local, remote = seen.local_linear, seen.remote_linear
        ratio = compare(local, remote, self.slowest_m_s)
        if ratio <= 0:
            return memory, _HELD[ratio]
        along = sum(p * v for p, v in zip(seen.impulse_n_s, remote, strict=False)) / memory
        speed2 = sum(v * v for v in remote)
        # rho = a . v / |v|^2, with a = v_local - impulse / m the velocity that the push did not make
        rho = (sum(u * v for u, v in zip(local, remote, strict=True)) - along) / speed2
        if rho > 1 or along <= 0:
            return memory, Outcome.not_driven
        return self._accept(memory, memory + memory * (ratio - 1) / (1 - min(rho, 0.0)))


# `compare` says in its sign why there is no ratio
_AT_REST, _OPPOSED = 0.0, -1.0
_HELD = {_AT_REST: Outcome.at_rest, _OPPOSED: Outcome.opposed}


def compare(local: Sequence[float], remote: Sequence[float], slowest: float) -> float:
    """Return |local| / |remote|; 0 where one is slower than `slowest`, -1 where they point in opposite directions."""
    u, v = math.hypot(*local), math.hypot(*remote)
    if u < slowest or v < slowest:
        return _AT_REST
    return u / v if sum(map(mul, local, remote)) > 0 else _OPPOSED
