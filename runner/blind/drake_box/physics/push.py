"""What of the commanded pushes reaches the box, step by step."""

from __future__ import annotations

import math

import numpy as np

from runner.blind.drake_box.physics.scene import Scene, Strange
from runner.blind.planar_box.physics import PlannedEpisode, carried_out


def pushed(scene: Scene, episode: PlannedEpisode, steps: int, step_s: float) -> np.ndarray:
    """Return the mean wrench of the push in each step, shape (steps, 8), columns as `carried_out` has them.

    What is sensed late is, but for its start, the same as what is done late; so both delays are of the push.
    """
    world, dt = scene.world, 1.0 / episode.rate_hz
    wrench = carried_out(world, disturbed(scene.strange, episode))
    late = np.random.default_rng([scene.late_seed, episode.number]).uniform(0.0, 1.0, len(wrench)) * scene.late
    edges = (np.arange(len(wrench)) + late) * dt + world.delay + world.observation_delay
    # from impulses at the edges to those at the steps: linear between
    impulse = np.vstack([np.zeros(8), np.cumsum(wrench[:-1] * np.diff(edges)[:, None], axis=0)])
    knots = np.append(edges, edges[-1] + 1e3)
    impulse = np.vstack([impulse, impulse[-1] + wrench[-1] * 1e3])
    at = np.arange(steps + 1) * step_s
    means = np.column_stack([np.diff(np.interp(at, knots, column)) for column in impulse.T]) / step_s
    if world.lag > 0.0:
        means = lagged(means, step_s / world.lag)
    means[abs(means) < 1e-9] = 0.0  # differences of impulses are not quite zero
    return means


def lagged(means: np.ndarray, ratio: float) -> np.ndarray:
    """Return the means over each step of a first-order lag's output; `ratio` is the step over the time constant."""
    decay = math.exp(-ratio)
    share = (1.0 - decay) / ratio
    state, out = np.zeros(means.shape[1]), np.empty_like(means)
    for k, target in enumerate(means):
        out[k] = target + (state - target) * share
        state = target + (state - target) * decay
    return out


def disturbed(strange: Strange, episode: PlannedEpisode) -> np.ndarray:
    """Return the commands less those that drop out, and no faster than the force may change, shape (n, 5)."""
    command = np.array(episode.command, float)
    if strange.slew_n_per_s is not None:
        most, force = strange.slew_n_per_s / episode.rate_hz, np.zeros(2)
        for k, wanted in enumerate(command[:, :2].copy()):
            change = wanted - force
            force = force + change * min(1.0, most / max(float(np.hypot(*change)), 1e-12))
            command[k, :2] = force
            if not np.any(wanted):
                command[k, 2:] = command[k - 1, 2:]  # what is left of a push acts where it did
    if strange.dropouts > 0.0:
        g = np.random.default_rng([strange.dropout_seed, episode.number])
        on_s = strange.dropout_s * (1.0 - strange.dropouts) / strange.dropouts
        at = g.exponential(on_s)
        while at < episode.duration_s:
            gone = g.exponential(strange.dropout_s)
            command[math.ceil(at * episode.rate_hz) : math.ceil((at + gone) * episode.rate_hz)] = 0.0
            at += gone + g.exponential(on_s)
    return command
