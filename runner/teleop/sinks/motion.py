"""The columns of a recording for the Rerun viewer: motion, forces, estimates over time."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa
import rerun as rr

from runner.physics.scene import rotate
from runner.teleop.experiment import REMOTE
from runner.teleop.frames import Frames, RunResult
from runner.teleop.sinks.look import TRAIL, local_colour, parameters_of

ARROW_M_PER_N = 0.05


def thinned(frames: Frames, every: int) -> Frames:
    return frames if every == 1 else Frames({name: column[::every] for name, column in frames.columns.items()})


def _index(frames: Frames) -> list[rr.TimeColumn]:
    time_ns = np.round(1e9 * frames.column("time_s")).astype("timedelta64[ns]")
    return [rr.TimeColumn("sim_time", duration=time_ns), rr.TimeColumn("frame", sequence=frames.column("frame"))]


def send_motion(recording: rr.RecordingStream, result: RunResult, frames: Frames) -> None:
    index, names = _index(frames), (REMOTE, *result.estimators)
    pose = {name: _pose(frames, name, result.half_size_m[2]) for name in names}
    for name, (position, quaternion) in pose.items():
        columns = rr.Transform3D.columns(translation=position, quaternion=quaternion)
        recording.send_columns(f"world/{name}", index, columns)
    _send_scalars(
        recording, "velocity/linear", index, [frames.column(f"{n}_{a}_m_s") for n in names for a in ("vx", "vy")]
    )
    _send_scalars(recording, "velocity/turning", index, [frames.column(f"{n}_wz_rad_s") for n in names])
    force = np.column_stack([frames.column(f"force_{axis}_n") for axis in "xyz"])
    _send_scalars(recording, "force", index, [force[:, 0], force[:, 1]])
    # the arrow's tip is at the point of application, lifted on top of the cube so that it is seen
    position, quaternion = pose[REMOTE]
    point = np.column_stack([frames.column(f"point_{axis}_m") for axis in "xyz"])
    tip = position + rotate(quaternion[:, [3, 0, 1, 2]], point)
    tip[:, 2] = position[:, 2] + 1.1 * result.half_size_m[2]
    vector = ARROW_M_PER_N * force
    recording.send_columns("world/force", index, rr.Arrows3D.columns(origins=tip - vector, vectors=vector))


def send_trail(recording: rr.RecordingStream, result: RunResult) -> None:
    """Send the way of the remote's top, as one short line per tick of at least 1 / 15 s."""
    period_s = result.updates.column("time_s")[0]
    frames = thinned(result.updates, max(1, round(1 / 15 / period_s)))
    top, _ = _pose(frames, REMOTE, result.half_size_m[2])
    top = np.column_stack([top[:, :2], top[:, 2] + 1.03 * result.half_size_m[2]]).astype(np.float32)
    ends = np.stack([np.vstack([top[:1], top[:-1]]), top], axis=1)
    # as Arrow: the conversion of lists takes longer than all else
    kind: Any = rr.components.LineStrip3DBatch._ARROW_DATATYPE
    points = pa.FixedSizeListArray.from_arrays(pa.array(ends.ravel()), type=kind.value_type)
    strips = pa.ListArray.from_arrays(pa.array(np.arange(0, 2 * len(top) + 1, 2, dtype=np.int32)), points, type=kind)
    recording.send_columns(TRAIL, _index(frames), rr.LineStrips3D.columns(strips=strips))


def send_estimates(recording: rr.RecordingStream, result: RunResult) -> None:
    updates = result.updates
    index = _index(updates)
    for parameter in parameters_of(result):
        owners = [name for name in result.estimators if parameter in result.parameters[name]]
        truth = result.parameters[owners[0]][parameter]
        values = [updates.column(f"{name}_{parameter}") for name in owners]
        _send_scalars(recording, f"estimate/{parameter}", index, [np.full(len(updates), truth.true), *values])
        # the viewer has no logarithmic axis; an exact estimate is drawn at the resolution of the numbers
        errors = [np.log10(np.maximum(np.abs(truth.error(v)), 1e-16)) for v in values]
        _send_scalars(recording, f"error/{parameter}", index, errors)


ROUND = np.linspace(0.0, 2 * np.pi, 33)
HOLDS_95 = 2.4477  # standard deviations of two numbers together


def send_com(recording: rr.RecordingStream, result: RunResult) -> None:
    """Draw the CoM on top of the cubes: the true one, every estimate, and its 95 % ellipse where there is one."""
    updates, top = result.updates, 1.02 * result.half_size_m[2]
    index = _index(updates)
    for i, name in enumerate(result.estimators):
        known = result.parameters[name]
        if not {"com_x_m", "com_y_m"} <= known.keys():
            continue
        true = (known["com_x_m"].true, known["com_y_m"].true, top)
        recording.log(f"world/{REMOTE}/com", rr.Points3D([true], colors=(255, 255, 255), radii=0.015), static=True)
        told = np.column_stack([updates.column(f"{name}_com_{a}_m") for a in "xy"])
        place = np.column_stack([told, np.full(len(told), top)])
        entity, colour = f"world/{name}/com", local_colour(i)
        recording.log(entity, rr.Points3D.from_fields(colors=colour, radii=0.012), static=True)
        recording.send_columns(entity, index, rr.Points3D.columns(positions=place).partition(np.ones(len(place), int)))
        if f"{name}_com_xy_covariance_m2" not in updates.columns:
            continue
        sx, sy = (updates.column(f"{name}_com_{a}_sd_m") for a in "xy")
        xy = updates.column(f"{name}_com_xy_covariance_m2")
        # Cholesky's root of the covariance takes a circle to the ellipse
        across = xy / np.maximum(sx, 1e-300)
        rest = np.sqrt(np.maximum(sy**2 - across**2, 0.0))
        c, s = HOLDS_95 * np.cos(ROUND), HOLDS_95 * np.sin(ROUND)
        rim = np.stack([told[:, :1] + np.outer(sx, c), told[:, 1:] + np.outer(across, c) + np.outer(rest, s)], axis=-1)
        rim = np.concatenate([rim, np.full((*rim.shape[:2], 1), top)], axis=-1)
        recording.log(f"{entity}/ellipse", rr.LineStrips3D.from_fields(colors=colour, radii=0.004), static=True)
        strips = rr.LineStrips3D.columns(strips=list(rim)).partition(np.ones(len(rim), int))
        recording.send_columns(f"{entity}/ellipse", index, strips)


def _send_scalars(
    recording: rr.RecordingStream, entity: str, index: list[rr.TimeColumn], columns: list[np.ndarray]
) -> None:
    values = np.column_stack(columns)
    scalars = rr.Scalars.columns(scalars=values.ravel())
    recording.send_columns(entity, index, scalars.partition(np.full(len(values), len(columns))))


def _pose(frames: Frames, name: str, rest_height_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Return position (n, 3) and quaternion (n, 4), w last, of a cube."""
    n = len(frames)
    z = frames.columns.get(f"{name}_z_m", np.full(n, rest_height_m))
    position = np.column_stack([frames.column(f"{name}_x_m"), frames.column(f"{name}_y_m"), z])
    if f"{name}_qw" in frames.columns:
        return position, np.column_stack([frames.column(f"{name}_q{c}") for c in "xyzw"])
    half_yaw = frames.column(f"{name}_yaw_rad") / 2
    return position, np.column_stack([np.zeros((n, 2)), np.sin(half_yaw), np.cos(half_yaw)])
