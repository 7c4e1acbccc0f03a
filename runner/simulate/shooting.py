"""Windows of a recording, simulated from measured states: many at once, and their start states fitted to them.

All windows of one length run in one `mujoco.rollout`, with the columns of the derivatives by their start states.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import mujoco
import numpy as np
from mujoco import rollout

from runner.effects import AbstractEffect, ActuatorDelay, Motion, ObservationDelay
from runner.noise.model import Colour
from runner.physics import dry_friction
from runner.physics.scene import push_columns
from runner.systems.planar_box.simulator import FULL, USERDATA, Effects, Simulator

START_STEP = np.array([1e-3, 1e-3, 1e-3, 5e-3, 5e-3, 5e-3])  # for differences; m, rad, m/s, rad/s
PRIOR_SIGMAS = 10.0  # a fitted start state may lie some such distances from the measured one, and hardly more
WINDOWS_AT_ONCE = 400  # bounds the memory of one rollout

Predict = Callable[[np.ndarray], np.ndarray]


class Signals(Protocol):
    """Measured channels and their noise; `runner.noise.measured.Measured` is one."""

    @property
    def values(self) -> tuple[np.ndarray, ...]:
        """Per episode (T, C)."""
        ...

    @property
    def valid(self) -> tuple[np.ndarray, ...]:
        """Per episode (T, C): False for what does not count."""
        ...

    @property
    def sigma(self) -> np.ndarray:
        """Noise of each channel, (C,)."""
        ...

    @property
    def colour(self) -> Colour:
        """Colour of each channel's noise."""
        ...

    @property
    def stated(self) -> np.ndarray:
        """Whether the owner stated the noise of each channel, (C,)."""
        ...


@dataclass(frozen=True)
class Windows:
    """Windows of one length, in samples: `episode` and `first` sample of each, both (W,), and `samples` of each."""

    episode: np.ndarray
    first: np.ndarray
    samples: int

    def __len__(self) -> int:
        return len(self.episode)

    def of(self, arrays: Sequence[np.ndarray]) -> np.ndarray:
        """Return what arrays (T, ...), one per episode, hold in each window: (W, samples, ...)."""
        steps = np.arange(self.samples)
        return np.stack([arrays[e][f + steps] for e, f in zip(self.episode, self.first, strict=True)])

    def chunks(self) -> Iterator[tuple[slice, Windows]]:
        """Yield them in portions."""
        for begin in range(0, len(self), WINDOWS_AT_ONCE):
            part = slice(begin, begin + WINDOWS_AT_ONCE)
            yield part, Windows(self.episode[part], self.first[part], self.samples)


def windows_of(lengths: Sequence[int], samples: int, episodes: Sequence[int] | None = None) -> Windows:
    """Return windows end to end that share their border samples; what is left at the end of an episode is left out.

    Args:
        lengths: Samples of each episode.
        samples: Steps of a window; it then has one more sample than that.
        episodes: Which episodes; None: all.
    """
    chosen = range(len(lengths)) if episodes is None else episodes
    pairs = [(e, f) for e in chosen for f in range(0, lengths[e] - samples, samples)]
    index = np.array(pairs, dtype=int).reshape(-1, 2)
    return Windows(index[:, 0], index[:, 1], samples + 1)


@dataclass
class Restarts:
    """Simulates windows of a recording from given measured states, many in one rollout.

    A delayed measurement can't be told from a delayed command by a clock that started with the window, and is put in
    as such: so a window needs no motion from before it. Other effects on the measurement act at each instant, and
    the start state is the one that they would show as the given.
    """

    simulator: Simulator
    effects: Effects = ()
    _commands: list[np.ndarray] = field(init=False)
    _yaw: list[np.ndarray] = field(init=False)

    def __post_init__(self) -> None:
        simulator = self.simulator
        self.effects = tuple(ActuatorDelay(e.delay_s) if isinstance(e, ObservationDelay) else e for e in self.effects)
        self._model = simulator.model(self.effects)
        threads = len(os.sched_getaffinity(0))
        self._data = [mujoco.MjData(self._model) for _ in range(threads)]
        self._pool = rollout.Rollout(nthread=threads if threads > 1 else 0)
        self._commands, self._yaw = [], []
        n = simulator.steps_per_sample
        for episode in simulator.recording.episodes:
            columns = np.repeat(np.nan_to_num(push_columns(episode.force_n, episode.point_m)[:-1]), n, axis=0)
            for effect in self.effects:
                columns = effect.edit_command(columns, simulator.step_s)
            self._commands.append(columns)
            yaw = 0.5 * (episode.pose[1:, 2] + episode.pose[:-1, 2])
            self._yaw.append(np.repeat(yaw, n))

    def predict(self, windows: Windows, starts: np.ndarray, wrench: np.ndarray | None = None) -> np.ndarray:
        """Return what would be measured in windows.

        Args:
            windows: W of them.
            starts: Measured states at their first samples, K for each: (W, K, 6): x, y, yaw, vx, vy, wz.
            wrench: Added to the command, for each: force through the geometric centre, N, world axes, and moment
                about the vertical, N m: (K, 3) or (W, K, 3).

        Returns:
            Pose and twist at the samples, the first of them the start, (W, K, samples, 6).
        """
        out = np.empty((*starts.shape[:2], windows.samples, 6))
        wrench = None if wrench is None else np.broadcast_to(wrench, (*starts.shape[:2], 3))
        for part, some in windows.chunks():
            out[part] = self._predict(some, starts[part], None if wrench is None else wrench[part])
        return out

    def _predict(self, windows: Windows, starts: np.ndarray, wrench: np.ndarray | None) -> np.ndarray:
        per_sample, step_s = self.simulator.steps_per_sample, self.simulator.step_s
        count, columns = starts.shape[:2]
        steps = (windows.samples - 1) * per_sample
        begin = windows.first * per_sample
        true = unseen(self.effects, starts, per_sample * step_s)
        control = np.zeros((count, columns, steps, dry_friction.USERDATA_SIZE))
        for w in range(count):
            span = slice(begin[w], begin[w] + steps)
            control[w, :, :, : dry_friction.PUSH_SIZE] = self._commands[windows.episode[w]][span]
            if wrench is not None:
                _add_wrench(control[w], wrench[w], self._yaw[windows.episode[w]][span])
        state = np.zeros((count, columns, mujoco.mj_stateSize(self._model, FULL)))
        state[:, :, 0] = (begin * step_s)[:, None]
        state[:, :, 1:7] = true
        # poses lead by half a step, as in the simulator
        state[:, :, 1:4] += 0.5 * step_s * true[..., 3:]
        state = state.reshape(count * columns, -1)
        rows, _ = self._pool.rollout(
            [self._model] * len(state),
            self._data,
            state,
            control.reshape(len(state), steps, -1),
            control_spec=USERDATA,
            chunk_size=max(1, min(16, len(state) // (4 * len(self._data)))),
        )
        self.simulator.simulated_s += len(state) * steps * step_s
        motion = np.concatenate([state[:, None, 1:7], rows[:, per_sample - 1 :: per_sample, 1:7]], axis=1)
        motion[:, :, :3] -= 0.5 * step_s * motion[:, :, 3:]
        t_s = np.arange(windows.samples) * per_sample * step_s
        seen = Motion(t_s, motion[..., :3], motion[..., 3:])
        for effect in self.effects:
            seen = effect.edit_measurement(seen)
        return np.concatenate([seen.pose, seen.twist], axis=-1).reshape(count, columns, windows.samples, 6)


def _add_wrench(control: np.ndarray, wrench: np.ndarray, yaw: np.ndarray) -> None:
    """Add forces and moments (K, 3) to pushes (K, n, 22); the moment is a couple on an arm that turns with the body."""
    control[:, :, :2] += wrench[:, None, :2]
    # the push moment about z is -sin S_xx + cos S_xy (see `runner.physics.dry_friction`)
    control[:, :, 3] -= wrench[:, 2:] * np.sin(yaw)
    control[:, :, 4] += wrench[:, 2:] * np.cos(yaw)


def unseen(effects: Sequence[AbstractEffect], shown: np.ndarray, step_s: float) -> np.ndarray:
    """Return the true states (..., 6) that sensors with these effects show as the given ones.

    Solved by repeated correction; a delay assumes uniform motion before.
    """
    state = shown.copy()
    if not any(type(e).edit_measurement is not AbstractEffect.edit_measurement for e in effects):
        return state
    for _ in range(30):
        pose = np.stack([state[..., :3], state[..., :3] + step_s * state[..., 3:]], axis=-2)
        motion = Motion(np.array([0.0, step_s]), pose, np.stack([state[..., 3:]] * 2, axis=-2))
        for effect in effects:
            motion = effect.edit_measurement(motion)
        error = shown - np.concatenate([motion.pose[..., 0, :], motion.twist[..., 0, :]], axis=-1)
        state += error
        if np.abs(error).max(initial=0.0) < 1e-12:
            break
    return state


def whiten(residual: np.ndarray, valid: np.ndarray, signals: Signals) -> np.ndarray:
    """Return residuals (..., n, C) in units of the noise, its colour taken out; what doesn't count is 0."""
    return np.where(valid, signals.colour.whiten(np.where(valid, residual / signals.sigma, 0.0)), 0.0)


@dataclass(frozen=True)
class Fitted:
    """Windows with fitted start states.

    Args:
        starts: The start states, (W, 6).
        residual: Prediction less measurement, physical units, (W, n, 6).
        change: Derivatives of the prediction by the start states, both in units of the noise, (W, n, 6, 6).
        jacobian: The same whitened.
    """

    starts: np.ndarray
    residual: np.ndarray
    change: np.ndarray
    jacobian: np.ndarray

    def freedom(self, valid: np.ndarray) -> np.ndarray:
        """Return how many values of each channel are left after the fit, (W, 6): samples less what the fit follows.

        So many times the variance of the noise is what the sum of squared residuals of a perfect model comes to, be
        the noise white or coloured: diag(C - J (J^T C^-1 J)^-1 J^T) with C the noise's covariance.
        """
        w, n, c, p = self.jacobian.shape
        matrix = self.jacobian.reshape(w, n * c, p)
        # the weak prior holds what the window says nothing of
        normal = np.einsum("wip,wiq->wpq", matrix, matrix) + np.eye(p) / PRIOR_SIGMAS**2
        followed = np.einsum("wncp,wpq,wncq->wnc", self.change, np.linalg.inv(normal), self.change, optimize=True)
        return np.where(valid, 1.0 - followed, 0.0).sum(axis=1)


def fit_starts(
    predict: Predict,
    values: np.ndarray,
    valid: np.ndarray,
    signals: Signals,
    first: np.ndarray,
    *,
    iterations: int = 4,
    tolerance: float = 0.1,
) -> Fitted:
    """Fit the start state of each window by damped Gauss-Newton steps, all windows side by side.

    A window keeps a step only if it lowers its loss.

    Args:
        predict: From start states (W, K, 6) to predictions (W, K, n, 6).
        values: What was measured, (W, n, 6).
        valid: What of it counts, (W, n, 6).
        signals: The noise.
        first: Start states to begin with, (W, 6).
        iterations: At most so many steps.
        tolerance: Ends when no window expects to gain more than this in its sum of squares.
    """
    w = len(values)
    scale = signals.sigma
    offsets = np.vstack([np.zeros(6), np.diag(START_STEP)])
    starts, damping = first.copy(), np.full(w, 1e-3)
    changed = np.ones(w, bool)
    change = jacobian = np.zeros((w, *values.shape[1:], 6))
    residual = np.zeros_like(values)
    loss = np.zeros(w)

    def losses(residual: np.ndarray, starts: np.ndarray) -> np.ndarray:
        prior = ((starts - first) / scale / PRIOR_SIGMAS) ** 2
        return (whiten(residual, valid, signals) ** 2).sum(axis=(1, 2)) + prior.sum(axis=1)

    for iteration in range(iterations + 1):
        if changed.any():
            rows = predict(starts[:, None, :] + offsets)
            residual = rows[:, 0] - values
            moved = (rows[:, 1:] - rows[:, :1]) / START_STEP[:, None, None] * scale[:, None, None]
            jacobian = np.moveaxis(whiten(moved, valid[:, None], signals), 1, -1)
            change = np.moveaxis(moved / scale, 1, -1)
            loss = losses(residual, starts)
        if iteration == iterations:
            break
        matrix = jacobian.reshape(w, -1, 6)
        right = np.einsum("wip,wi->wp", matrix, whiten(residual, valid, signals).reshape(w, -1))
        right += (starts - first) / scale / PRIOR_SIGMAS**2
        normal = np.einsum("wip,wiq->wpq", matrix, matrix) + np.eye(6) / PRIOR_SIGMAS**2
        size = np.einsum("wpp->wp", normal)
        damped = normal + damping[:, None, None] * size[:, :, None] * np.eye(6)
        step = -np.linalg.solve(damped, right[:, :, None])[:, :, 0]
        promised = -2 * (right * step).sum(axis=1) - np.einsum("wp,wpq,wq->w", step, normal, step)
        if promised.max(initial=0.0) < tolerance:
            break
        trial = starts + step * scale
        gained = losses(predict(trial[:, None, :])[:, 0] - values, trial) < loss
        changed = gained
        starts = np.where(gained[:, None], trial, starts)
        damping = np.where(gained, damping / 10, damping * 30)
    return Fitted(starts, residual, change, jacobian)


def first_states(windows: Windows, signals: Signals) -> np.ndarray:
    """Return the measured state at the start of each window, (W, 6); a median around it where it doesn't count."""
    out = np.empty((len(windows), len(signals.sigma)))
    for w, (e, f) in enumerate(zip(windows.episode, windows.first, strict=True)):
        near = slice(max(0, f - 2), f + 3)
        around = np.where(signals.valid[e][near], signals.values[e][near], np.nan)
        fine = signals.valid[e][f]
        instead = np.zeros(len(fine)) if fine.all() else np.nan_to_num(_median(around))
        out[w] = np.where(fine, signals.values[e][f], instead)
    return out


def _median(values: np.ndarray) -> np.ndarray:
    """Return medians over rows without NaN, NaN where there is nothing."""
    columns = [column[np.isfinite(column)] for column in values.T]
    return np.array([np.median(column) if len(column) else np.nan for column in columns])
