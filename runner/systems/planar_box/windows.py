"""Windows of a recording, simulated from measured states: many at once, in one rollout."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import cast

import mujoco
import numpy as np
from mujoco import rollout

from runner.effects.base import AbstractEffect, in_stages
from runner.effects.planar_box import ActuatorDelay, Motion, ObservationDelay, PlanarEffect
from runner.effects.planar_box.delay import Delay
from runner.physics import dry_friction
from runner.recording.model_form_mjcf import quiet
from runner.systems.planar_box.commands import Commands
from runner.systems.planar_box.motion import (
    begun_ahead,
    measured_columns,
    motion,
    read_ahead,
    read_at_steps,
    simulated_columns,
)
from runner.systems.planar_box.pin_force import means, steps_of_engine
from runner.systems.windows import Windows

Effects = tuple[PlanarEffect, ...]
FULL = mujoco.mjtState.mjSTATE_FULLPHYSICS.value
USERDATA = mujoco.mjtState.mjSTATE_USERDATA.value
BYTES_AT_ONCE = 60e6  # of commands and states in one rollout


def planar(effects: Sequence[AbstractEffect]) -> Effects:
    """Return effects of a box as such; this system's vocabulary has no others."""
    return cast(Effects, tuple(effects))


def shown_alike(effects: Effects) -> Effects:
    """Return effects that show the same in windows: a measurement that is late is a command that is late."""
    return tuple(ActuatorDelay(e.delay_s) if isinstance(e, ObservationDelay) else e for e in effects)


@dataclass
class WindowSimulator:
    """Simulates windows of a recording from given measured states, many in one rollout.

    A delayed measurement can't be told from a delayed command by a clock that started with the window, and is put in
    as such (`shown_alike`): so a window needs no motion from before it. Other effects on the measurement act at each
    instant, and the start state is the one that they would show as the given.
    """

    commands: Commands
    model: mujoco.MjModel
    effects: Effects
    simulated_s: float = field(init=False, default=0.0)
    _yaw: list[np.ndarray] = field(init=False)
    _columns_seen: np.ndarray = field(init=False)
    _simulated: int = field(init=False)

    def __post_init__(self) -> None:
        threads = len(os.sched_getaffinity(0))
        self._data = [mujoco.MjData(self.model) for _ in range(threads)]
        self._pool = rollout.Rollout(nthread=threads if threads > 1 else 0)
        recording, n = self.commands.recording, self.commands.steps_per_sample
        self._columns_seen = measured_columns(recording)
        self._simulated = simulated_columns(self._columns_seen)
        self._yaw = [np.repeat(0.5 * (states[1:, 2] + states[:-1, 2]), n) for states in motion(recording)]

    def predict(self, windows: Windows, starts: np.ndarray, wrench: np.ndarray | None = None) -> np.ndarray:
        """Return what would be measured in windows.

        Args:
            windows: W of them.
            starts: Measured states at their first samples, K for each: (W, K, 6): x, y, yaw, vx, vy, wz.
            wrench: Added to the command, for each: force through the geometric centre, N, world axes, and moment
                about the vertical, N m: (K, 3) or (W, K, 3).

        Returns:
            What is measured at the samples, the first of them the start, (W, K, samples, C).
        """
        out = np.empty((*starts.shape[:2], windows.samples, len(self._columns_seen)))
        wrench = None if wrench is None else np.broadcast_to(wrench, (*starts.shape[:2], 3))
        steps = (windows.samples - 1) * self.commands.steps_per_sample
        width = dry_friction.USERDATA_SIZE + mujoco.mj_stateSize(self.model, FULL)
        at_once = max(1, int(BYTES_AT_ONCE / (8.0 * starts.shape[1] * steps * width)))
        for part, some in windows.chunks(at_once):
            out[part] = self._predict(some, starts[part], None if wrench is None else wrench[part])
        return out

    def _predict(self, windows: Windows, starts: np.ndarray, wrench: np.ndarray | None) -> np.ndarray:
        per_sample, step_s = self.commands.steps_per_sample, self.commands.step_s
        count, columns = starts.shape[:2]
        steps = (windows.samples - 1) * per_sample
        begin = windows.first * per_sample
        true = unseen(self.effects, starts, step_s)
        control = np.zeros((count, columns, steps, dry_friction.USERDATA_SIZE))
        for w in range(count):
            span = slice(begin[w], begin[w] + steps)
            control[w] = self.commands.control(self.effects, int(windows.episode[w]))[span]
            if wrench is not None:
                _add_wrench(control[w], wrench[w], self._yaw[windows.episode[w]][span])
        state = np.zeros((count, columns, mujoco.mj_stateSize(self.model, FULL)))
        state[:, :, 0] = (begin * step_s)[:, None]
        state[:, :, 1:7] = true
        # poses lead by half a step, as in the simulator
        state[:, :, 1:4] += 0.5 * step_s * true[..., 3:]
        state, control = state.reshape(count * columns, -1), control.reshape(count * columns, steps, -1)
        shares = np.full((len(state), 1), read_ahead(self.effects, step_s))
        state[:, 1:7] = begun_ahead(state, control, shares, step_s, self._after)
        rows = self._after(state, control)
        seen = read_at_steps(state[:, 1:7], rows, step_s, self.effects)
        shown = [seen.pose[:, ::per_sample], seen.twist[:, ::per_sample]]
        if self._simulated > dry_friction.STATE:
            shown.append(means(rows[..., 6:], per_sample, step_s))
        every = np.concatenate(shown, axis=-1)[..., self._columns_seen]
        return every.reshape(count, columns, windows.samples, len(self._columns_seen))

    def _after(self, state: np.ndarray, control: np.ndarray) -> np.ndarray:
        """Return the state after each step of some runs, (R, n, 6) or more columns, from states and commands."""
        self.simulated_s += control.shape[0] * control.shape[1] * self.commands.step_s
        if dry_friction.is_all_that_acts(self.model):
            of = np.zeros(len(state), int), np.arange(len(state))
            return dry_friction.rollout(
                [self.model], control, state[:, :7], of, len(self._data), columns=self._simulated
            )
        if self._simulated > dry_friction.STATE:
            return steps_of_engine([self.model] * len(state), self._data[0], state, control)
        with quiet():
            rows, _ = self._pool.rollout(
                [self.model] * len(state),
                self._data,
                state,
                control,
                control_spec=USERDATA,
                chunk_size=max(1, min(16, len(state) // (4 * len(self._data)))),
            )
        return rows[:, :, 1:7]


def _add_wrench(control: np.ndarray, wrench: np.ndarray, yaw: np.ndarray) -> None:
    """Add forces and moments (K, 3) to commands (K, n, ...); a moment is a couple on a turning arm."""
    control[:, :, :2] += wrench[:, None, :2]
    # the push moment about z is -sin S_xx + cos S_xy (see `runner.physics.dry_friction`)
    control[:, :, 3] -= wrench[:, 2:] * np.sin(yaw)
    control[:, :, 4] += wrench[:, 2:] * np.cos(yaw)


def unseen(effects: Sequence[PlanarEffect], shown: np.ndarray, step_s: float) -> np.ndarray:
    """Return the true states (..., 6) that sensors with these effects show as the given ones.

    Solved by repeated correction. What reads a motion ahead of its steps is left to those who make them, see
    `begun_ahead`.
    """
    state = shown.copy()
    effects = [
        e for e in effects if type(e).edit_measurement not in (PlanarEffect.edit_measurement, Delay.edit_measurement)
    ]
    if not effects:
        return state
    for _ in range(30):
        pose = np.stack([state[..., :3], state[..., :3] + step_s * state[..., 3:]], axis=-2)
        motion = Motion(np.array([0.0, step_s]), pose, np.stack([state[..., 3:]] * 2, axis=-2))
        for effect in in_stages(effects):
            motion = effect.edit_measurement(motion)
        error = shown - np.concatenate([motion.pose[..., 0, :], motion.twist[..., 0, :]], axis=-1)
        state += error
        if np.abs(error).max(initial=0.0) < 1e-12:
            break
    return state
