"""A case before anything is planted: a mechanism with names, as its owner believes it, and what is done to it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from runner.blind.mechanism.physics import PlannedEpisode, World


@dataclass(frozen=True)
class Names:
    """What joints, bodies and actuators are called, in order."""

    joints: tuple[str, ...]
    bodies: tuple[str, ...]
    actuators: tuple[str, ...]


SYSTEMS = {
    "pendulum": Names(("hinge",), ("lever",), ("drive",)),
    "arm2": Names(("shoulder", "elbow"), ("upper", "forearm"), ("shoulder_drive", "elbow_drive")),
    "slider_servo": Names(("slide",), ("carriage",), ("drive",)),
}


@dataclass(frozen=True)
class Unplanted:
    """See the module's docstring.

    Args:
        names: Of its parts.
        world: As the owner believes it to be.
        episodes: What is done to it.
        paths: Position and velocity of each joint without any effect, one (T, 2 count) for each episode.
        measured: Whether each of these columns is measured.
    """

    names: Names
    world: World
    episodes: Sequence[PlannedEpisode]
    paths: Sequence[np.ndarray]
    measured: tuple[bool, ...]

    @property
    def count(self) -> int:
        """How many joints."""
        return len(self.world.joints)

    def channel(self, i: int, *, of_velocity: bool) -> str:
        """Return the column of a joint's position or velocity."""
        return f"{'dq' if of_velocity else 'q'}_{self.names.joints[i]}"

    @property
    def channels(self) -> list[str]:
        """Names of the measured columns."""
        both = [self.channel(i, of_velocity=v) for i in range(self.count) for v in (False, True)]
        return [name for name, kept in zip(both, self.measured, strict=True) if kept]

    def column(self, i: int, *, of_velocity: bool) -> np.ndarray:
        """Return a joint's positions or velocities in all episodes."""
        return np.concatenate([path[:, 2 * i + of_velocity] for path in self.paths])

    def reach(self, i: int) -> float:
        """Return half the range of a joint, rad or m."""
        low, high = np.quantile(self.column(i, of_velocity=False), [0.01, 0.99])
        return float(max(0.5 * (high - low), 1e-4))

    def speed(self, i: int) -> float:
        """Return the root mean square speed of a joint, rad/s or m/s."""
        return float(max(np.sqrt(np.mean(self.column(i, of_velocity=True) ** 2)), 1e-4))

    def inertia(self, i: int) -> float:
        """Return the inertia that a joint moves with all others hanging, kg m2 or kg."""
        world = self.world
        if world.slides:
            return world.links[0].mass_kg + world.joints[0].armature
        total = world.joints[i].armature
        for k in range(i, self.count):
            link = world.links[k]
            arm = math.hypot(*link.com_m) + (world.length_m if k > i else 0.0)
            total += link.inertia_kg_m2 + link.mass_kg * arm**2
        return total

    def force(self, i: int) -> float:
        """Return about what force moves a joint, N m or N."""
        rates = [np.gradient(p[:, 2 * i + 1], e.t_s) for p, e in zip(self.paths, self.episodes, strict=True)]
        return self.inertia(i) * float(np.sqrt(np.mean(np.concatenate(rates) ** 2))) + self.world.joints[i].dry

    def peak(self, i: int) -> float:
        """Return the largest force that an actuator is asked for, N m or N."""
        actuator = self.world.actuators[i]
        asked = [
            actuator.kp * (e.commands[:, i] - p[:, 2 * i]) - actuator.kv * p[:, 2 * i + 1]
            if actuator.servo
            else e.commands[:, i]
            for p, e in zip(self.paths, self.episodes, strict=True)
        ]
        return min(float(np.abs(np.concatenate(asked)).max()), actuator.limit)

    def largest_command(self, i: int) -> float:
        """Return the largest command of an actuator, in its unit."""
        return float(max(np.abs(e.commands[:, i]).max() for e in self.episodes))

    @property
    def shortest_s(self) -> float:
        """Length of the shortest episode."""
        return min(e.duration_s for e in self.episodes)
