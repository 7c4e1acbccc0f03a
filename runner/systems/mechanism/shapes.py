"""What the force that is missing at a joint may go along with, in the words of whoever looks for its cause."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from runner.numerics.arrays import FloatArray
from runner.recording.model_form import MechanismRecording
from runner.systems.mechanism.coordinates import HINGE, SLIDE, Coordinates
from runner.systems.mechanism.settings import MECHANISM

DIRECTION = "the direction of its motion, as dry friction does"
SPEED = "its speed, as viscous friction does"
DRAG = "the square of its speed, as drag does"
PLACE = "where it is, as a spring, a cable, gravity or cogging does"
ACCELERATION = "its acceleration, as inertia does"
CONSTANT = "nothing: it is constant"
TIME = "the time since an episode began, as warming up does"
COMMAND = "the commands, as a gain or a limit does"


def force_shapes(
    recording: MechanismRecording, coordinates: Coordinates, names: Sequence[str], missing: pd.DataFrame
) -> dict[str, dict[str, FloatArray]]:
    """Return columns (W, k) by what they stand for, for the missing force of each hinge and slide joint.

    Args:
        recording: The case.
        coordinates: Of its joints.
        names: Of the missing force of each degree of freedom.
        missing: A row for each window: `episode`, `t_s`, and position and speed of each joint.
    """
    began, commands = _of_episodes(recording, missing)
    out = {}
    for joint in coordinates.joints:
        if joint.kind not in (HINGE, SLIDE):
            continue
        unit = "rad" if joint.kind == HINGE else "m"
        q, v = (missing[f"{joint.name}_{u}"].to_numpy(float) for u in (unit, f"{unit}_s"))
        size = float(np.sqrt(np.mean(v**2))) or 1.0
        centred = (q - q.mean()) / (float(np.ptp(q)) or 1.0)
        turns = [np.sin(q), np.cos(q) - np.cos(q).mean()] if joint.kind == HINGE else []
        shapes = {
            CONSTANT: [np.ones(len(q))],
            DIRECTION: [np.where(np.abs(v) > MECHANISM.signal.slow * size, np.sign(v), 0.0)],
            SPEED: [v],
            DRAG: [v * np.abs(v)],
            PLACE: [centred, centred**2 - np.mean(centred**2), *turns],
            ACCELERATION: [_slope(missing, v)],
            TIME: [began - began.mean()],
            COMMAND: list(commands.T),
        }
        out[names[joint.v.start]] = {words: np.column_stack(c) for words, c in shapes.items() if len(c)}
    return out


def _of_episodes(recording: MechanismRecording, missing: pd.DataFrame) -> tuple[FloatArray, FloatArray]:
    """Return the time since its episode began at the middle of each window, (W,), and the commands there, (W, K)."""
    began, commands = np.zeros(len(missing)), np.zeros((len(missing), len(recording.mapping.commands)))
    for episode in recording.episodes:
        rows = (missing["episode"] == f"episode {episode.index}").to_numpy()
        t_s = missing.loc[rows, "t_s"].to_numpy(float)
        began[rows] = t_s - episode.t_s[0]
        held = np.clip(np.searchsorted(episode.t_s, t_s, side="right") - 1, 0, len(episode) - 1)
        commands[rows] = episode.commands[held][:, : commands.shape[1]]
    return began, commands - commands.mean(axis=0)


def _slope(missing: pd.DataFrame, speed: FloatArray) -> FloatArray:
    """Return how a speed (W,) changes from window to window of an episode, (W,)."""
    out = np.zeros(len(speed))
    for _, rows in missing.reset_index(drop=True).groupby("episode").groups.items():
        at = np.asarray(rows)
        t_s = missing["t_s"].to_numpy(float)[at]
        if len(at) > 2 and (np.diff(t_s) > 0).all():
            out[at] = np.gradient(speed[at], t_s)
    return out
