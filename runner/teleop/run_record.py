"""The raw numbers of a run: what is known of it before it starts, and what its updates leave behind."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from runner.physics import dry_friction
from runner.physics.scene import BodyHandle
from runner.teleop.estimators import Setup
from runner.teleop.experiment import Commands, Experiment
from runner.teleop.link import newest, schedule, update_steps


def _ticks(
    message: np.ndarray, experiment: Experiment, given: Commands, ends: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return for each tick the tick before at which a message was taken in, and the impulse commanded since then.

    Returns:
        The tick before, -1: the start, (m,); the impulse, (m, 3), N s.
    """
    h = experiment.scene.timestep_s
    taken = np.maximum.accumulate(np.where(message >= 0, np.arange(len(ends)), -1))
    since = np.concatenate([[-1], taken[:-1]]) if len(ends) else taken
    total = np.vstack([np.cumsum(given.force_n, axis=0)[ends - 1] * h, np.zeros(3)])  # row -1: the start
    return since, total[:-1] - total[since]


class RunRecord:
    """What is known of a run before it, and what its updates leave behind.

    Attributes:
        ends: After how many steps each tick comes, (m,).
        taken: The messages that are taken in at each tick, by the ticks at which they were sent, in that order.
        message: The newest of them, -1: none, (m,).
        noise: On what each message says of the remote, (m, 2 nv of it); None: none.
        fresh: Whether whatever arrives does so at once, and true.
        known: For each tick: its number, the message, whether it was sent at this very tick, the time, the time at
            which it was sent, the time since when, and the impulse since then.
        count: Ticks so far.
        qpos, qvel: Of all cubes at each tick, before the locals take over the remote's state, (m, nq), (m, nv).
        memories: Per estimator, its memory after each tick.
        outcomes: Per estimator, what it did at each tick.
        shown: Per estimator, the values that its shown cube had after each tick; empty where those of the estimate.
    """

    def __init__(self, experiment: Experiment, handles: Sequence[BodyHandle], given: Commands) -> None:
        self.experiment, self.handles, self.commands = experiment, handles, given
        # the pushes of the locals: the nominal ones
        self.setup = Setup(
            experiment.scene, experiment.local, given.pushes[:-1, dry_friction.PUSH_SIZE : 2 * dry_friction.PUSH_SIZE]
        )
        self.nq, self.nv = sum(h.nq for h in handles), sum(h.nv for h in handles)
        h = experiment.scene.timestep_s
        self.ends = update_steps(experiment.link, h, experiment.steps)
        times = np.append(self.ends * h, 0.0)  # the last: the start
        self.taken = schedule(experiment.link, times[:-1], np.random.default_rng([experiment.seed, 1]))
        self.message = newest(self.taken)
        since, impulse = _ticks(self.message, experiment, given, self.ends)
        number = np.arange(len(self.ends))
        self.noise = self._draw_noise()
        at_once = (self.message == number) & (self.noise is None)
        columns = (number, self.message, at_once, times[:-1], times[self.message], times[since], impulse)
        self.fresh = self.noise is None and bool(((self.message < 0) | (self.message == number)).all())
        self.known = list(zip(*(c.tolist() for c in columns), strict=True))
        self.count = 0
        self.qpos, self.qvel = np.empty((len(number), self.nq)), np.empty((len(number), self.nv))
        self.memories: list[list[Any]] = [[] for _ in experiment.estimator]
        self.outcomes: list[list[int]] = [[] for _ in experiment.estimator]
        self.shown: list[list[Any]] = [[] for _ in experiment.estimator]

    def _draw_noise(self) -> np.ndarray | None:
        link, remote = self.experiment.link, self.handles[0]
        angular = 3 if remote.joints == dry_friction.FREE else 1
        rng = np.random.default_rng([self.experiment.seed, 2])
        return link.noise.draws(len(self.ends), remote.nv - angular, angular, rng) if link.noise else None

    def received(self, message: int) -> tuple[np.ndarray, np.ndarray]:
        """Return what a message says, in place of all positions (nq,) and velocities (nv,): the remote's with noise."""
        q, v, remote = self.qpos[message].copy(), self.qvel[message].copy(), self.handles[0]
        if self.noise is not None:
            along, of_velocity = np.split(self.noise[message], 2)
            remote.move(q[remote.qpos_adr : remote.qpos_adr + remote.nq], along)
            v[remote.dof_adr : remote.dof_adr + remote.nv] += of_velocity
        return q, v
