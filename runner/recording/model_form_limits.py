"""Joints that were measured beyond their range: there the simulator has a stop, and the machine has none, or elsewhere.

MuJoCo's stops are soft: a joint that runs into one, or is pressed against it, is beyond its range for a while. How far
is told by the model itself, so that only more than that is told.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from runner.numerics.differences import rounding_noise, white_noise
from runner.recording.model_form_commands import measured_joints
from runner.recording.model_form_mapping import ChannelSource, ModelMapping
from runner.recording.model_form_mjcf import quiet
from runner.recording.table import Table
from runner.settings import SETTINGS

LASTS_S = 1.0  # so long a stop is replayed at most: by then it has given way as far as it does
MOST_STEPS = 20_000  # some tenths of a second of computing: reading a case must not wait for a stop
DIVERGED = (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)
SHOWN = {"rad": ("deg", 180 / np.pi), "m": ("m", 1.0)}


@dataclass(frozen=True)
class _Beyond:
    """How a joint was measured beyond one end of its range.

    Args:
        rows: Of the table, beyond that end, each beside another such row.
        deepest: The row that is furthest beyond.
        depth: How far that is, rad or m.
        enters: The last row before that which is not, or the first of its episode.
        leaves: The last row until which it is.
        step_s: Time from `enters` to the next row.
        speed: At which the joint goes that way at most, of the two steps into it, rad/s or m/s.
    """

    rows: NDArray[np.int64]
    deepest: int
    depth: float
    enters: int
    leaves: int
    step_s: float
    speed: float


def note_limits(table: Table, spans: Sequence[slice], mapping: ModelMapping, model: mujoco.MjModel) -> list[str]:
    """Return a note on each joint that was measured further beyond its range than its stop and noise allow.

    Args:
        table: What was recorded.
        spans: Rows of each episode.
        mapping: What its columns measure.
        model: As its owner believes.
    """
    if measured_joints(mapping, model) is None:
        return []  # what the stop gives way to is not known
    if model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_LIMIT:
        return []
    notes = []
    for source in mapping.sources:
        if source.kind != "joint" or source.quantity != "position" or not model.joint(source.target).limited[0]:
            continue
        clear = SETTINGS.forces.certain_errors * _noise(table, spans, source, mapping.noise)
        ends = zip((-1.0, 1.0), model.joint(source.target).range, strict=True)
        sides = [(side, _beyond(table, spans, source.name, side, float(end))) for side, end in ends]
        told = [
            found
            for side, found in sides
            if found is not None
            and found.depth > clear
            and found.depth - clear > _given(table, found, side, mapping, model, source.target)
        ]
        if told:
            notes.append(_note(table, spans, source, max(told, key=lambda f: f.depth), model))
    return notes


def _beyond(table: Table, spans: Sequence[slice], name: str, side: float, end: float) -> _Beyond | None:
    """Return where a column is beyond an end of a range for more than a lone sample; None: nowhere."""
    depth, rows = side * (table[name] - end), []
    for span in spans:
        out = np.nan_to_num(depth[span], nan=-np.inf) > 0
        lasting = out & (np.append(out[1:], False) | np.insert(out[:-1], 0, False))
        rows.append(span.start + np.flatnonzero(lasting))
    every = np.concatenate(rows)
    if not len(every):
        return None
    deepest = int(every[np.argmax(depth[every])])
    span = next(s for s in spans if s.start <= deepest < s.stop)
    inside = np.flatnonzero(depth[span] <= 0) + span.start
    enters = int(max(inside[inside < deepest], default=span.start))
    leaves = int(min(inside[inside > deepest], default=span.stop) - 1)
    near = slice(max(enters - 1, span.start), enters + 2)
    rates = np.diff(depth[near]) / np.diff(table["t"][near])
    step_s = float(table["t"][enters + 1] - table["t"][enters])
    speed = float(np.nanmax(rates, initial=0.0))
    return _Beyond(every, deepest, float(depth[deepest]), enters, leaves, step_s, speed)


def _noise(table: Table, spans: Sequence[slice], source: ChannelSource, stated: Mapping[str, float]) -> float:
    """Return the noise of a channel as it is stated, else as its differences tell it, that of a counter included."""
    if source.name in stated:
        return stated[source.name]
    values = [table[source.name][span] for span in spans]
    white = white_noise(zip([table["t"][span] for span in spans], values, strict=True))
    return max(float(np.nan_to_num(white)), rounding_noise(values))


def _given(
    table: Table, found: _Beyond, side: float, mapping: ModelMapping, model: mujoco.MjModel, joint: str
) -> float:
    """Return how far the model goes beyond the range: as fast as measured at its end, and driven as commanded.

    Infinite where it diverges, or would take too long: that says nothing of a stop.
    """
    data = mujoco.MjData(model)
    for source in mapping.sources:
        if source.kind == "joint" and source.quantity == "position":
            values = table[source.name][[found.enters, found.enters + 1]]
            if np.isfinite(values).all():
                data.joint(source.target).qpos[0] = values[0]
                data.joint(source.target).qvel[0] = np.diff(values)[0] / found.step_s
    end = float(model.joint(joint).range[int(side > 0)])
    data.joint(joint).qpos[0] = side * min(side * data.joint(joint).qpos[0], side * end)
    data.joint(joint).qvel[0] = side * found.speed
    step_s, times_s = float(model.opt.timestep), table["t"][found.enters : found.leaves + 1]
    ends = np.rint(np.minimum(times_s - times_s[0], LASTS_S) / step_s).astype(int)
    if ends[-1] > MOST_STEPS:
        return np.inf
    deepest = 0.0
    with quiet():
        for row, steps in enumerate(np.diff(ends).tolist(), found.enters):
            for name, command in mapping.commands.items():
                data.actuator(command.actuator).ctrl[0] = table[name][row]
            for _ in range(steps):
                mujoco.mj_step(model, data)
                if any(data.warning[w].number for w in DIVERGED):
                    return np.inf
                deepest = max(deepest, side * (float(data.joint(joint).qpos[0]) - end))
    return deepest


def _note(table: Table, spans: Sequence[slice], source: ChannelSource, found: _Beyond, model: mujoco.MjModel) -> str:
    unit, scale = SHOWN[source.unit]
    most = f"{scale * float(table[source.name][found.deepest]):.4g} {unit}"
    low, high = (f"{scale * float(v):.4g}" for v in model.joint(source.target).range)
    of = [s for s in spans if ((found.rows >= s.start) & (found.rows < s.stop)).any()]
    measured = sum(int(np.isfinite(table[source.name][s]).sum()) for s in of)
    where = f"episode {int(table['episode'][of[0].start])}" if len(of) == 1 else f"{len(of)} episodes"
    return (
        f"joint '{source.target}' was measured at {most}, beyond its range of {low} to {high} {unit} in the MJCF "
        f"({100 * len(found.rows) / measured:.2g} % of its samples in {where}): the simulator's stop acts where the "
        "machine had none, or one elsewhere; widen `range` if that is so"
    )
