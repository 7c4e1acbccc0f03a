"""What estimators are given: the commands, and the remote's states as its sensors see them, with seeded noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from runner.estimation.copies import from_values
from runner.physics import dry_friction
from runner.teleop.estimators import Linear
from runner.teleop.experiment import REMOTE, Experiment, commands, compile_experiment
from runner.teleop.follow import Immediate
from runner.teleop.link import LinkConfig, NoiseConfig
from runner.teleop.loop import run_compiled
from runner.teleop.parameters import PARAMETERS

# what an estimate expects of sensors that are said to be exact: m, rad, m/s, rad/s
LEAST_SD = np.array([1e-5, 1e-5, 1e-5, 1e-4, 1e-4, 1e-4])
_COLUMNS = ("x_m", "y_m", "yaw_rad", "vx_m_s", "vy_m_s", "wz_rad_s")


def measured_sd(noise: NoiseConfig) -> np.ndarray:
    """Return the standard deviations of a measured planar state, (6,): x, y, yaw and their rates."""
    sd = [*2 * [noise.position_m], noise.angle_rad, *2 * [noise.velocity_m_s], noise.rate_rad_s]
    return np.maximum(sd, LEAST_SD)


def times(noise: NoiseConfig, factor: float) -> NoiseConfig:
    """Return noise of another size."""
    values = noise.position_m, noise.angle_rad, noise.velocity_m_s, noise.rate_rad_s
    return NoiseConfig(*(factor * v for v in values))


@dataclass(frozen=True)
class RemoteMotion:
    """How the remote moved.

    Attributes:
        timestep_s: Of the physics.
        pushes: Commands over physics steps, (n, 12).
        ends: After how many steps each measurement comes, (m,).
        states: The remote's at these times, (m, 6).
        true_x: Its parameters, (5,).
    """

    timestep_s: float
    pushes: np.ndarray
    ends: np.ndarray
    states: np.ndarray
    true_x: np.ndarray

    @property
    def unknowns(self) -> np.ndarray:
        """The state at the start, which is rest at the origin, and the parameters, (11,)."""
        return np.concatenate([np.zeros(6), self.true_x])

    @property
    def times_s(self) -> np.ndarray:
        """Of the measurements, (m,)."""
        return self.ends * self.timestep_s

    def windows(self) -> list[np.ndarray]:
        """Return the commands between one measurement and the next, (steps, 12) each."""
        return [self.pushes[a:b] for a, b in pairwise([0, *self.ends.tolist()])]

    def measured(self, noise: NoiseConfig, seeds: Sequence[int]) -> np.ndarray:
        """Return what the sensors say, with the noise of each seed, (len(seeds), m, 6)."""
        draws = [noise.draws(len(self.ends), 2, 1, np.random.default_rng([seed, 2])) for seed in seeds]
        return self.states + np.array(draws).reshape(len(seeds), *self.states.shape)


def motion_of(experiment: Experiment) -> RemoteMotion:
    """Run the remote of an experiment; what link and estimators do has no part in it."""
    link = LinkConfig(rate_hz=experiment.link.rate_hz)
    alone = replace(experiment, link=link, estimator={"linear": Linear()}, follow=Immediate())
    compiled = compile_experiment(alone)
    frames = run_compiled(alone, compiled).updates
    values = np.array([compiled.truth[name].true for name in PARAMETERS])
    return RemoteMotion(
        timestep_s=experiment.scene.timestep_s,
        pushes=commands(alone).pushes[:-1, dry_friction.PUSH_SIZE : 2 * dry_friction.PUSH_SIZE],
        ends=frames.column("frame"),
        states=np.column_stack([frames.column(f"{REMOTE}_{name}") for name in _COLUMNS]),
        true_x=from_values(values, experiment.remote.half_size_m),
    )
