"""What readings of a motion in space can tell at best of its body: the Cramer-Rao bound.

By central differences of whole trajectories, with the motion at the beginning, the ten numbers and every single wrench
as unknowns. It shares the step of the motion with the estimator, but neither its derivatives nor its recursion.
"""

from __future__ import annotations

import numpy as np
import scipy

from runner.estimation.space.dynamics import MOTION, WRENCH, Motion, accelerations, body_of, times
from runner.estimation.space.inertial import SIZE
from runner.estimation.space.made import MadeMotion, followed
from runner.estimation.space.readings import READ, SensorConfig
from runner.teleop.link import NoiseConfig

_STEP = 1e-5  # of the motion at the beginning and of the ten numbers
_WRENCH_STEP = 1e-2  # in standard deviations of its measurement
_NOTHING = 1e-6  # information on free numbers of order one below which they are not seen at all


def information(
    made: MadeMotion, x: np.ndarray, half_size_m: np.ndarray, sensors: SensorConfig, noise: NoiseConfig,
    gravity: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Return Fisher's information on the ten free numbers, (10, 10), motion and wrenches unknown.

    Args:
        made: The true motion.
        x: The true numbers, (10,).
        half_size_m: (3,).
        sensors: How a wrench and accelerations are measured.
        noise: How poses and velocities are measured.
        gravity: (3,).
    """
    m = len(made.acceleration)
    wrenches = 0 if made.wrench is None else m
    size = np.concatenate([np.full(SIZE + MOTION, _STEP), np.full(WRENCH * wrenches, _WRENCH_STEP)])
    count = len(size)
    steps = np.concatenate([np.diag(size), np.diag(-size)])
    body = body_of(x + steps[:, :SIZE], half_size_m)
    start = Motion(*(np.broadcast_to(part[0], (len(steps), *part.shape[1:])) for part in made.motion))
    held = np.zeros((m, len(steps), WRENCH))
    if made.wrench is not None:
        at_grip = steps[:, SIZE + MOTION :].reshape(len(steps), m, WRENCH).swapaxes(0, 1)
        held = made.wrench[:, None] + times(sensors.wrench_root, at_grip)
    motion = followed(body, start.moved(steps[:, SIZE : SIZE + MOTION]), held, made.step_s, gravity)
    sd = sensors.sd(noise)
    by = np.empty((m, READ, count))
    for k in range(m):
        now = motion.of(k)
        faster = accelerations(body, now.rate, held[k])
        apart = np.concatenate(
            [now.of(slice(count)).less(now.of(slice(count, None))), faster[:count] - faster[count:]], 1
        )
        by[k] = (apart / (2 * size[:, None]) / sd).T
    rows = by.reshape(m * READ, count)
    normal = rows.T @ rows
    # each wrench is measured once, in units of its standard deviation
    normal[range(SIZE + MOTION, count), range(SIZE + MOTION, count)] += 1.0
    across = normal[SIZE:, :SIZE]
    return normal[:SIZE, :SIZE] - across.T @ scipy.linalg.solve(normal[SIZE:, SIZE:], across, assume_a="pos")


def least_covariance(info: np.ndarray, by: np.ndarray) -> np.ndarray:
    """Return the least covariance of unbiased estimates of k values, (k, k), whose derivatives are `by`, (k, 10).

    Infinite on the diagonal where a value hangs on what the readings do not tell, and nothing is said beside it.
    """
    values, vectors = np.linalg.eigh(info)
    told = values > _NOTHING
    along = by @ vectors
    out = along[:, told] / values[told] @ along[:, told].T
    lost = (np.abs(along[:, ~told]) > 1e-4 * np.linalg.norm(by, axis=1, keepdims=True)).any(axis=1)
    out[lost] = out[:, lost] = np.nan
    out[lost, lost] = np.inf
    return out
