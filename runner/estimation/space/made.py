"""Motions whose truth is known, to estimate from: a body that is shaken by a hand, and one that was tossed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from runner.estimation.space.dynamics import (
    MOTION,
    WRENCH,
    Body,
    Motion,
    accelerations,
    body_of,
    regressor,
    step,
    times,
)
from runner.estimation.space.inertial import standard_of
from runner.estimation.space.readings import READ, Reading, SensorConfig
from runner.teleop.link import NoiseConfig

_FINE = 4  # steps of the truth between two readings


@dataclass(frozen=True)
class MadeMotion:
    """A motion at m times: its parts, (m, ...), what makes it, and what an accelerometer would say of it.

    Attributes:
        step_s: Between two times.
        motion: Of the tracked point and the body.
        acceleration: Specific force and angular acceleration, (m, 6).
        wrench: At the tracked point, body axes, (m, 6); None: free.
    """

    step_s: float
    motion: Motion
    acceleration: np.ndarray
    wrench: np.ndarray | None

    def measured(self, sensors: SensorConfig, noise: NoiseConfig, seeds: Sequence[Sequence[int]]) -> list[Reading]:
        """Return the m readings, with a lane for the noise of each seed."""
        sd = sensors.sd(noise)
        m = len(self.acceleration)
        draws = np.array([np.random.default_rng(list(seed)).standard_normal((m, READ + WRENCH)) for seed in seeds])
        at_grip = np.linalg.inv(sensors.to_point)
        out = []
        for k in range(m):
            n = len(seeds)
            true = Motion(*(np.broadcast_to(part[k], (n, *part.shape[1:])) for part in self.motion))
            off = draws[:, k, :READ] * sd
            wrench = None
            if self.wrench is not None:
                wrench = times(at_grip, self.wrench[k]) + draws[:, k, READ:] * sensors.wrench_sd
            out.append(Reading(true.moved(off[:, :MOTION]), self.acceleration[k] + off[:, MOTION:], wrench))
        return out


def shaken(
    x: np.ndarray, half_size_m: np.ndarray, *, step_s: float, duration_s: float, gravity: np.ndarray, seed: int
) -> MadeMotion:
    """Return the motion of a body that a hand shakes and turns, each way at a frequency of its own.

    The hand's wrench is what a body would need that swings by 6 cm and 0.5 rad, at 1 to 3 Hz. It is made of the plan,
    not of the motion: what comes of it strays from the plan, and is the truth.

    Args:
        x: Its free numbers, (10,).
        half_size_m: (3,).
        step_s: Between two times.
        duration_s: In all.
        gravity: (3,), m/s2.
        seed: Of the phases.
    """
    rng = np.random.default_rng([seed, 7])
    times_s = np.arange(round(duration_s / step_s) + 1) * step_s
    speed = 2 * np.pi * np.array([1.1, 1.7, 2.3, 1.4, 2.0, 2.9])
    phase = rng.uniform(0, 2 * np.pi, WRENCH)
    size = np.array([0.06, 0.06, 0.06, 0.5, 0.5, 0.5])
    angle = speed * times_s[:, None] + phase
    planned = -size * speed**2 * np.sin(angle)  # accelerations
    swing = size[3:] * speed[3:] * np.cos(angle[:, 3:])  # rates
    plan = Motion(np.zeros(3), np.eye(3), np.zeros(3), np.zeros(3))
    standard, wrench = standard_of(x, half_size_m), []
    for k in range(len(times_s)):
        specific = plan.turn.T @ (planned[k, :3] - gravity)
        wrench.append(regressor(np.concatenate([specific, planned[k, 3:]]), swing[k]) @ standard)
        plan = plan.moved(np.concatenate([np.zeros(3), step_s * swing[k], np.zeros(6)]))
    velocity = size[:3] * speed[:3] * np.cos(phase[:3])
    start = Motion(np.zeros(3), np.eye(3), velocity, swing[0])
    return _made(x, half_size_m, start, np.array(wrench), step_s, gravity, free=False)


def tossed(
    x: np.ndarray,
    half_size_m: np.ndarray,
    *,
    step_s: float,
    duration_s: float,
    gravity: np.ndarray,
    spin_rad_s: float,
    seed: int,
) -> MadeMotion:
    """Return the flight of a body that is thrown up so that it comes back, spinning about an axis that a seed draws.

    Args: see `shaken`; `spin_rad_s` is how fast.
    """
    rng = np.random.default_rng([seed, 8])
    axis, turn = rng.standard_normal(3), rng.standard_normal(3)
    start = Motion(np.zeros(3), np.eye(3), -0.5 * duration_s * gravity, spin_rad_s * axis / np.linalg.norm(axis))
    start = start.moved(np.concatenate([np.zeros(3), turn, rng.normal(0.0, 0.3, 3), np.zeros(3)]))
    count = round(duration_s / step_s) + 1
    return _made(x, half_size_m, start, np.zeros((count, WRENCH)), step_s, gravity, free=True)


def _made(
    x: np.ndarray, half_size_m: np.ndarray, start: Motion, wrench: np.ndarray, step_s: float, gravity: np.ndarray,
    *, free: bool,
) -> MadeMotion:  # fmt: skip
    """Return the motion that wrenches (m, 6) make of a start."""
    body = body_of(x, half_size_m)
    motion = followed(body, start, wrench, step_s, gravity, fine=_FINE)
    return MadeMotion(step_s, motion, accelerations(body, motion.rate, wrench), None if free else wrench)


def followed(
    body: Body, start: Motion, wrench: np.ndarray, step_s: float, gravity: np.ndarray, *, fine: int = 1
) -> Motion:
    """Return how bodies (..., ) move from their starts under wrenches (m, ..., 6), at m times: parts (m, ..., ...)."""
    found = [start]
    for before, after in pairwise(wrench):
        motion = found[-1]
        for k in range(fine):
            both = tuple(before + (after - before) * share / fine for share in (k, k + 1))
            motion = step(body, motion, (both[0], both[1]), step_s / fine, gravity)
        found.append(motion)
    return Motion(*(np.stack(parts) for parts in zip(*found, strict=True)))
