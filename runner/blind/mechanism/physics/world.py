"""A mechanism and everything that may be the matter with it: numbers, all neutral unless something is planted."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any


@dataclass(frozen=True)
class Link:
    """A body on a joint.

    Args:
        mass_kg: Its mass.
        com_m: Centre of mass, x and z from the joint in the body's axes.
        inertia_kg_m2: About the centre of mass, about the joint's axis.
    """

    mass_kg: float
    com_m: tuple[float, float] = (0.0, 0.0)
    inertia_kg_m2: float = 0.0


@dataclass(frozen=True)
class Joint:
    """A hinge or slide: forces in N m or N, positions in rad or m.

    Args:
        dry, damping, armature: Dry friction at speed, viscous friction, inertia of the drive.
        offset: A constant force.
        excess, excess_speed: Dry friction is `dry (1 + excess exp(-(v / excess_speed)^2))`.
        dry_difference, viscous_difference: Of positive less negative motion, relative to their mean.
        load_share: Of half the difference of the torques on the gear's two sides, added to dry friction.
        stiffness, rest: A spring.
        ripple, ripple_rate, ripple_phase: `ripple sin(ripple_rate q + ripple_phase)`.
        push, push_from_s, push_until_s: A force for some time of each episode.
        play, give, drive_share: Width of the free play between drive and link, the inverse stiffness between them, and
            the share of dry and viscous friction that is the drive's; without play and give drive and link are one.
        spring_damping_ratio: Of link against drive, on the spring.
        quadratic: A force `-quadratic v |v|`.
        cubic, cubic_rest: A force `-cubic (q - cubic_rest)^3`.
        dahl, dahl_rate: Friction that builds up over a way of 1 / dahl_rate after a reversal (Dahl 1968).
        warm_up, warm_up_s: Both frictions are 1 + warm_up times as large when cold; how fast that fades.
        patch, patch_at, patch_width: Dry friction is `1 + patch exp(-((q - patch_at) / patch_width)^2)` times as large.
        stop_stiffness, stop_at, stop_side: A soft stop beyond a position, on the side of the sign.
        swings: Forces `a sin(2 pi f t + p)`, as (a, f, p) with t since the recording began.
    """

    dry: float = 0.0
    damping: float = 0.0
    armature: float = 0.0
    offset: float = 0.0
    excess: float = 0.0
    excess_speed: float = 1.0
    dry_difference: float = 0.0
    viscous_difference: float = 0.0
    load_share: float = 0.0
    stiffness: float = 0.0
    rest: float = 0.0
    ripple: float = 0.0
    ripple_rate: float = 0.0
    ripple_phase: float = 0.0
    push: float = 0.0
    push_from_s: float = 0.0
    push_until_s: float = 0.0
    play: float = 0.0
    give: float = 0.0
    drive_share: float = 0.6
    spring_damping_ratio: float = 0.05
    quadratic: float = 0.0
    cubic: float = 0.0
    cubic_rest: float = 0.0
    dahl: float = 0.0
    dahl_rate: float = 1.0
    warm_up: float = 0.0
    warm_up_s: float = 1.0
    patch: float = 0.0
    patch_at: float = 0.0
    patch_width: float = 1.0
    stop_stiffness: float = 0.0
    stop_at: float = 0.0
    stop_side: float = 1.0
    swings: tuple[tuple[float, float, float], ...] = ()


@dataclass(frozen=True)
class Actuator:
    """A motor, whose command is a force, or a position servo, whose command is a target: `kp (u - q) - kv v`.

    Args:
        servo: 1 for a servo, 0 for a motor.
        kp, kv: Of a servo.
        limit: Of its force, either way.
        gain: Of its force, up to the same limit.
        delay_s, lag_s: The command comes later; it follows with a first-order lag.
        dead_band: So much of a motor's command is lost.
        one_sided: Positive forces are 1 + one_sided times, negative 1 - one_sided times what they should be.
        fade, fade_s, fade_force: The gain falls by `fade` of itself for a mean square force of fade_force^2 that is
            kept up for long against fade_s, and comes back at rest.
        slip, slip_at: Beyond a force of `slip_at` a coupling slips and passes 1 - slip of that.
        crosstalk: Share of its force that acts on the other joint.
        quantum: Commands are rounded to multiples of it.
        slew_per_s: The command changes no faster; 0: at once.
        jitter_s: Each command comes late by its own time, at most so much.
        dropout: Share of the commands that are lost: the one before is held.
    """

    servo: float = 0.0
    kp: float = 0.0
    kv: float = 0.0
    limit: float = math.inf
    gain: float = 1.0
    delay_s: float = 0.0
    lag_s: float = 0.0
    dead_band: float = 0.0
    one_sided: float = 0.0
    fade: float = 0.0
    fade_s: float = 1.0
    fade_force: float = 1.0
    slip: float = 0.0
    slip_at: float = 0.0
    crosstalk: float = 0.0
    quantum: float = 0.0
    slew_per_s: float = 0.0
    jitter_s: float = 0.0
    dropout: float = 0.0


@dataclass(frozen=True)
class Sensor:
    """Of one channel: what it adds, by what it multiplies, how slowly it follows."""

    offset: float = 0.0
    scale: float = 1.0
    lag_s: float = 0.0


@dataclass(frozen=True)
class World:
    """A slide, a pendulum, or an arm of two links in a vertical plane, x ahead and z up; a positive turn is z to -x.

    Args:
        slides: The one joint is a slide along x.
        links, joints, actuators: One each per joint, one or two.
        sensors: Per joint that of its position and that of its velocity.
        length_m: From the first joint to the second, down along -z of the first link.
        gravity_m_s2: Its x and z.
        observation_delay_s: What is measured is so old.
        clock_ratio: Seconds that the recording's clock shows in a true second.
        seed: Of what is random from sample to sample.
    """

    slides: bool
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    actuators: tuple[Actuator, ...]
    sensors: tuple[tuple[Sensor, Sensor], ...]
    length_m: float = 0.0
    gravity_m_s2: tuple[float, float] = (0.0, -9.81)
    observation_delay_s: float = 0.0
    clock_ratio: float = 1.0
    seed: int = 0

    def with_link(self, i: int, **changes: Any) -> World:
        """Return the world with numbers of a link changed."""
        return replace(self, links=_changed(self.links, i, changes))

    def with_joint(self, i: int, **changes: Any) -> World:
        """Return the world with numbers of a joint changed."""
        return replace(self, joints=_changed(self.joints, i, changes))

    def with_actuator(self, i: int, **changes: Any) -> World:
        """Return the world with numbers of an actuator changed."""
        return replace(self, actuators=_changed(self.actuators, i, changes))

    def with_sensor(self, i: int, of_velocity: bool, **changes: Any) -> World:
        """Return the world with numbers of a joint's sensor changed."""
        pair = _changed(self.sensors[i], int(of_velocity), changes)
        return replace(self, sensors=tuple(pair if k == i else s for k, s in enumerate(self.sensors)))


def _changed(items: Sequence[Any], i: int, changes: dict[str, Any]) -> tuple[Any, ...]:
    return tuple(replace(item, **changes) if k == i else item for k, item in enumerate(items))
