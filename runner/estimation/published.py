"""The published estimators on the same measurements as ours, many seeds side by side."""

from __future__ import annotations

import numpy as np

from runner.estimation.copies import COM_X, COM_Y, FRICTION, INERTIA, MASS, Copies, to_vector
from runner.estimation.data import RemoteMotion
from runner.teleop.estimators import AbstractEstimator, Seen, Setup
from runner.teleop.experiment import Experiment

_REMOTE = (slice(0, 3), slice(0, 2), slice(2, 3))
_LOCAL = (slice(3, 6), slice(3, 5), slice(5, 6))


def published(
    rule: AbstractEstimator, copies: Copies, experiment: Experiment, motion: RemoteMotion, measured: np.ndarray
) -> np.ndarray:
    """Return the mass after each update, kg, (N, m), by a rule that finds the mass alone.

    At each update the local cubes start from what was measured at the one before. They know the friction, and take the
    cube for uniform, as the paper does.

    Args:
        rule: The rule; its memory is its own affair.
        copies: The model.
        experiment: Scene and start of the local cube.
        motion: Commands.
        measured: The remote's states, (N, m, 6).
    """
    n = len(measured)
    setup = Setup(experiment.scene, experiment.local, motion.pushes)
    memories = [rule.start(setup) for _ in range(n)]
    x = np.tile(to_vector(experiment.local), (n, 1))
    x[:, [COM_X, COM_Y]] = 0.0
    x[:, FRICTION] = motion.true_x[FRICTION]
    a, b, _ = experiment.remote.half_size_m
    out, common, before = np.empty(measured.shape[:2]), np.zeros((n, 6)), 0.0
    for k, pushes in enumerate(motion.windows()):
        mass = np.array([rule.values(memory)[0] for memory in memories])
        x[:, MASS], x[:, INERTIA] = np.log(mass), np.log(mass * (a * a + b * b) / 3)
        local, remote, now = copies.run(x, common, pushes), measured[:, k], float(motion.times_s[k])
        impulse = (pushes[:, :3].sum(axis=0) * motion.timestep_s).tolist()
        for i in range(n):
            q, v = [*remote[i, :3], *local[i, :3]], [*remote[i, 3:], *local[i, 3:]]
            common_q, common_v = [*common[i, :3]] * 2, [*common[i, 3:]] * 2
            seen = Seen(now, now, before, impulse, q, v, q, v, common_q, common_v, _LOCAL, _REMOTE)
            memories[i], _ = rule.update(memories[i], seen)
            out[i, k] = rule.values(memories[i])[0]
        common, before = remote, now
    return out
