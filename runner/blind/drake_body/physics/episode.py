"""A toss, stepped by Drake from sample to sample, and what the tracker shows of it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from runner.blind.drake_body.physics.plant import BodyOnTable
from runner.blind.drake_body.physics.poses import path_of, turns_of
from runner.blind.drake_body.physics.surroundings import Surroundings
from runner.blind.drake_body.physics.world import World
from runner.errors import RunnerError

STEP_S = 5e-4  # the longest


class DrakeError(RunnerError):
    """The engine could not go on."""


@dataclass(frozen=True)
class Toss:
    """How an episode begins, and how long it is.

    Args:
        place: Of the geometric centre, m, (3,).
        quaternion: w, x, y, z, body to world, (4,).
        spin: rad/s, world axes, (3,).
        velocity: Of the geometric centre, m/s, (3,).
        rate_hz: Samples per second of the recorded clock.
        samples: How many.
    """

    place: np.ndarray
    quaternion: np.ndarray
    spin: np.ndarray
    velocity: np.ndarray
    rate_hz: float
    samples: int


def simulate_all(world: World, tosses: Sequence[Toss], *, step_s: float = STEP_S) -> list[np.ndarray]:
    """Return what the tracker shows of each toss, without noise: paths of poses, (T, 7) each.

    Args:
        world: One world.
        tosses: All of one rate.
        step_s: Longest step; the time between samples is a whole number of steps.

    Raises:
        ConfigError: If Drake is not installed.
        DrakeError: If the engine gives up.
    """
    between_s = 1.0 / (tosses[0].rate_hz * world.clock)
    substeps = math.ceil(between_s / step_s - 1e-6)
    body, surroundings = BodyOnTable(world, between_s / substeps), Surroundings(world)
    try:
        return [_shown(world, _run(toss, body, surroundings, substeps, between_s), toss) for toss in tosses]
    except RuntimeError as error:  # what the engine throws
        raise DrakeError(f"physics: Drake stopped: {str(error).splitlines()[0]}") from None


def _run(toss: Toss, body: BodyOnTable, surroundings: Surroundings, substeps: int, between_s: float) -> np.ndarray:
    """Step from sample to sample.

    Drake's discrete step takes the velocity first and the pose with the new one. So a pose of its is read as that of
    half a step later, as in the leapfrog method, which is of second order where this would be of first.
    """
    half_s = 0.5 * between_s / substeps
    (turn,) = turns_of(np.concatenate([toss.place, toss.quaternion])[None])
    ahead = Rotation.from_rotvec(half_s * toss.spin) * turn
    body.place(toss.place + half_s * toss.velocity, ahead.as_quat()[[3, 0, 1, 2]], toss.spin, toss.velocity)
    places, turns = [toss.place], [turn]
    for _ in range(toss.samples - 1):
        if surroundings.empty:
            body.go(substeps)
        else:
            for _ in range(substeps):
                body.push(surroundings.wrench(*body.state()))
                body.go(1)
        place, matrix, spin, velocity = body.state()
        places.append(place - half_s * velocity)
        turns.append(Rotation.from_rotvec(-half_s * spin) * Rotation.from_matrix(matrix))
    path = path_of(np.array(places), Rotation.concatenate(turns))
    if not np.all(np.isfinite(path)):
        raise DrakeError("physics: a body has left all bounds.")
    return path


def _shown(world: World, path: np.ndarray, toss: Toss) -> np.ndarray:
    """Return what the tracker shows of a path."""
    s = world.strange
    places, turns = path[:, :3] + turns_of(path).apply(np.array(s.marker)), turns_of(path)
    if s.yaw_drift_rad_s != 0.0:
        angles = s.yaw_drift_rad_s * np.arange(len(path)) / toss.rate_hz
        turns = Rotation.from_rotvec(np.outer(angles, [0.0, 0.0, 1.0])) * turns
    # a vertical that is tilted towards x is turned about -y
    frame = Rotation.from_rotvec([world.tilt[1], -world.tilt[0], 0.0])
    return path_of(frame.apply(places) + np.array([0.0, 0.0, world.raised_m]), frame * turns)
