"""What of a box was measured, and a rough account of its motion."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from runner.effects.base import in_stages
from runner.effects.planar_box import Motion, PlanarEffect
from runner.effects.planar_box.base import overdone
from runner.effects.planar_box.delay import Delay
from runner.physics.dry_friction import STATE, STATE_AND_PIN
from runner.recording import Recording
from runner.recording.kinematics import without_gaps

START_CORRECTIONS = 2  # each leaves a few percent of the one before: what a hard push changes of friction in a step


def measured_columns(recording: Recording) -> np.ndarray:
    """Return which of x, y, yaw, vx, vy, wz, and of a pin's fx, fy, were measured at all, (C,) ascending indices."""
    by_pin = recording.nominal.pin is not None
    columns = ([e.pose, e.twist, *([e.force_n[:, :2]] if by_pin else [])] for e in recording.episodes)
    return np.flatnonzero(np.any([np.isfinite(np.hstack(c)).any(axis=0) for c in columns], axis=0))


def state_columns(recording: Recording) -> np.ndarray:
    """Return which of x, y, yaw, vx, vy, wz were measured at all, (K,) indices; they come first of what was."""
    columns = measured_columns(recording)
    return columns[columns < STATE]


def simulated_columns(measured: np.ndarray) -> int:
    """Return how many numbers have to be simulated to show those of these indices, (C,)."""
    return STATE_AND_PIN if (measured >= STATE).any() else STATE


def motion(recording: Recording) -> tuple[np.ndarray, ...]:
    """Return pose and twist of each episode without gaps, (T, 6): lines between samples, slopes for velocities."""
    return tuple(np.hstack(without_gaps(e.t_s, e.pose, e.twist)) for e in recording.episodes)


def read_at_steps(start: np.ndarray, after: np.ndarray, step_s: float, effects: Sequence[PlanarEffect]) -> Motion:
    """Return what sensors with these effects show of simulated motions, at the start and after every step.

    At steps, as commands are delayed by whole ones: what that overdoes is made up for where the motion is read.

    Args:
        start: Of the engine, whose poses lead by half a step: x, y, yaw, vx, vy, wz, (R, 6).
        after: After each step, (R, n, 6) or more columns.
        step_s: Length of a step.
        effects: Of which some may act on what is measured.
    """
    states = np.concatenate([start[:, None], after[..., :STATE]], axis=1)
    states[:, :, :3] -= 0.5 * step_s * states[:, :, 3:]
    seen = Motion(np.arange(states.shape[1]) * step_s, states[..., :3], states[..., 3:])
    for effect in in_stages(effects):
        seen = effect.edit_measurement(seen)
    return seen


def read_ahead(effects: Sequence[PlanarEffect], step_s: float) -> float:
    """Return by which part of a step motions with these effects are read ahead, see `read_at_steps`."""
    return sum((overdone(e.delay_s, step_s) for e in effects if isinstance(e, Delay)), 0.0)


def begun_ahead(
    state: np.ndarray,
    controls: np.ndarray,
    share: np.ndarray,
    step_s: float,
    after: Callable[[np.ndarray, np.ndarray], np.ndarray],
) -> np.ndarray:
    """Return starts from which the given ones are what is read ahead at the first sample, (R, 6).

    Read as they are, starts of what moves would jump by a step's way wherever a delay passes a whole step.

    Args:
        state: Of the engine, time, pose and twist, (R, 7) or more columns; poses lead by half a step.
        controls: Commands, (D, n, ...).
        share: By which part of a step each is read ahead, (R, 1).
        step_s: Length of a step.
        after: Returns the state after each step, (R, n, 6) or more columns, from states and commands.
    """
    start = state[:, 1:7].copy()
    if not share.any() or not start[:, 3:].any():
        return start
    pose, twist, begun = start[:, :3], start[:, 3:], state.copy()
    for _ in range(START_CORRECTIONS):
        change = after(begun, controls[:, :1])[:, 0, 3:6] - begun[:, 4:7]
        back = share * step_s * (twist - 0.5 * share * change) + 0.5 * step_s * share * change
        begun[:, 1:7] = np.hstack([pose - back, twist - share * change])
    return begun[:, 1:7]
