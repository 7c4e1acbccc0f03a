"""The frames of a run, made from its raw numbers when it is over."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from runner.physics import dry_friction
from runner.physics.scene import BodyHandle
from runner.teleop.experiment import REMOTE
from runner.teleop.frames import Frames, RunResult, Status, Truth
from runner.teleop.run_record import RunRecord

CONTACT = (
    ("friction_x_n", dry_friction.OUT_FORCE),
    ("friction_y_n", dry_friction.OUT_FORCE + 1),
    ("friction_torque_nm", dry_friction.OUT_TORQUE),
    ("pressure_x_m", dry_friction.OUT_COP),
    ("pressure_y_m", dry_friction.OUT_COP + 1),
    ("lifted_share", dry_friction.OUT_LIFTED),
    ("slip_m_s", dry_friction.OUT_SLIP),
    ("friction_w", dry_friction.OUT_POWER),
    ("load_n", dry_friction.OUT_LOAD),
)
POSITION = {
    dry_friction.PLANAR: ("x_m", "y_m", "yaw_rad"),
    dry_friction.UPRIGHT: ("x_m", "y_m", "z_m", "yaw_rad"),
    dry_friction.FREE: ("x_m", "y_m", "z_m", "qw", "qx", "qy", "qz"),
}
VELOCITY = {
    dry_friction.PLANAR: ("vx_m_s", "vy_m_s", "wz_rad_s"),
    dry_friction.UPRIGHT: ("vx_m_s", "vy_m_s", "vz_m_s", "wz_rad_s"),
    dry_friction.FREE: ("vx_m_s", "vy_m_s", "vz_m_s", "wx_rad_s", "wy_rad_s", "wz_rad_s"),
}


def result_of(
    record: RunRecord, truth: Mapping[str, Truth], frames: np.ndarray, wall_s: float, reason: str
) -> RunResult:
    experiment, names = record.experiment, (REMOTE, *record.experiment.estimator)
    estimates = _estimates(record, truth)
    return RunResult(
        make_steps=lambda: Frames(_step_columns(record, names, frames, estimates)),
        make_updates=lambda: Frames(_update_columns(record, names, frames, estimates)),
        step_count=len(frames),
        update_count=record.count,
        estimators=tuple(experiment.estimator),
        parameters={name: {p: truth[p] for p in rule.names} for name, rule in experiment.estimator.items()},
        half_size_m=experiment.remote.half_size_m,
        timestep_s=experiment.scene.timestep_s,
        wall_s=wall_s,
        status=Status.diverged if reason else Status.done,
        reason=reason,
    )


def _read_only(columns: Iterable[tuple[str, np.ndarray]]) -> dict[str, np.ndarray]:
    out = {}
    for name, column in columns:
        column = np.ascontiguousarray(column)
        column.setflags(write=False)
        out[name] = column
    return out


def _state_columns(name: str, handle: BodyHandle, qpos: np.ndarray, qvel: np.ndarray) -> dict[str, np.ndarray]:
    """Columns of one body's state, from all positions (nq, n) and velocities (nv, n)."""
    q, v = qpos[handle.qpos_adr :], qvel[handle.dof_adr :]
    out = {f"{name}_{c}": q[i] for i, c in enumerate(POSITION[handle.joints])}
    if handle.joints == dry_friction.UPRIGHT:
        out[f"{name}_z_m"] = out[f"{name}_z_m"] + handle.rest_height_m
    out |= {f"{name}_{c}": v[i] for i, c in enumerate(VELOCITY[handle.joints])}
    if handle.joints == dry_friction.FREE:
        twist = handle.twist(qpos.T, qvel.T).T
        out |= {f"{name}_{c}": twist[i] for i, c in enumerate(VELOCITY[dry_friction.FREE])}
    return out


Estimates = list[tuple[str, float, np.ndarray]]  # name, value at the start, values after each update


def _estimates(record: RunRecord, truth: Mapping[str, Truth]) -> Estimates:
    """Return estimates and their relative errors."""
    out = []
    for (name, rule), memories in zip(record.experiment.estimator.items(), record.memories, strict=True):
        table = np.array([rule.values(m) for m in memories]).reshape(len(memories), len(rule.names))
        for p, parameter in enumerate(rule.names):
            known = truth[parameter]
            out.append((f"{name}_{parameter}", known.start, table[:, p]))
            stem = parameter.rsplit("_", 1)[0]
            out.append((f"{name}_{stem}_error", known.error(known.start), known.error(table[:, p])))
    return out


def _details(record: RunRecord) -> dict[str, np.ndarray]:
    """Return what estimators say besides their estimates, (m,) each."""
    out = {}
    for (name, rule), memories in zip(record.experiment.estimator.items(), record.memories, strict=True):
        if rule.details:
            table = np.array([rule.detail(m) for m in memories]).reshape(len(memories), len(rule.details))
            out |= {f"{name}_{detail}": table[:, i] for i, detail in enumerate(rule.details)}
    return out


def _step_columns(
    record: RunRecord, names: Sequence[str], frames: np.ndarray, estimates: Estimates
) -> dict[str, np.ndarray]:
    n = len(frames)
    updates = np.zeros(n + 1, dtype=np.int64)
    updates[record.ends[record.ends <= n]] = 1
    updates = np.cumsum(updates)[:n]  # so many before this frame
    out: dict[str, np.ndarray] = {
        "time_s": np.arange(n) * record.experiment.scene.timestep_s,
        "frame": np.arange(n),
        "update": updates,
    }
    raw = np.ascontiguousarray(frames.T)  # (width, n): columns in one piece
    out |= _command_columns(record, slice(n))
    for name, handle in zip(names, record.handles, strict=True):
        out |= _state_columns(name, handle, raw[: record.nq], raw[record.nq :])
    out |= _contact_columns(record, names, raw)
    held = np.minimum(updates, record.count)
    out |= {name: np.concatenate([[start], column])[held] for name, start, column in estimates}
    return _read_only(out.items())


def _command_columns(record: RunRecord, rows: slice | np.ndarray) -> dict[str, np.ndarray]:
    force, point = record.commands.force_n[rows], record.commands.point_m[rows]
    out = {f"force_{axis}_n": force[:, j] for j, axis in enumerate("xyz")}
    return out | {f"point_{axis}_m": point[:, j] for j, axis in enumerate("xyz")}


def _contact_columns(record: RunRecord, names: Sequence[str], raw: np.ndarray) -> dict[str, np.ndarray]:
    """What dry friction said of each body, from raw frames (width, n); nothing where it does not carry the bodies."""
    out = {}
    for b, (name, handle) in enumerate(zip(names, record.handles, strict=True)):
        if handle.joints == dry_friction.PLANAR:
            base = record.nq + record.nv + b * dry_friction.OUT_SIZE
            out |= {f"{name}_{column}": raw[base + offset] for column, offset in CONTACT}
    return out


def _update_columns(
    record: RunRecord, names: Sequence[str], frames: np.ndarray, estimates: Estimates
) -> dict[str, np.ndarray]:
    m = record.count
    qpos, qvel = np.ascontiguousarray(record.qpos[:m].T), np.ascontiguousarray(record.qvel[:m].T)
    times, message = record.ends[:m] * record.experiment.scene.timestep_s, record.message[:m]
    last = record.ends[:m] - 1  # the step that ends with the update
    out = {
        "time_s": times,
        "update": np.arange(1, m + 1),
        "frame": record.ends[:m],
        "sent_s": np.where(message >= 0, times[message], np.nan) if m else times,
    }
    out |= _command_columns(record, last)
    for name, handle in zip(names, record.handles, strict=True):
        out |= _state_columns(name, handle, qpos, qvel)
    out |= _contact_columns(record, names, np.ascontiguousarray(frames[last].T))
    for name, outcomes in zip(names[1:], record.outcomes, strict=True):
        out |= _behind(name, out)
        out[f"{name}_outcome"] = np.array(outcomes, dtype=np.int8)
    for (name, rule), shown in zip(record.experiment.estimator.items(), record.shown, strict=True):
        columns = np.array(shown).reshape(len(shown), len(rule.names))
        out |= {f"{name}_shown_{p}": columns[:, i] for i, p in enumerate(rule.names) if shown}
    out |= {name: column for name, _, column in estimates}
    out |= _details(record)
    return _read_only(out.items())


def _behind(name: str, columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """How far the local cube was from the remote, just before it took over what it received."""

    def size(names: Iterable[str]) -> np.ndarray:
        parts = [columns[f"{name}_{c}"] - columns[f"{REMOTE}_{c}"] for c in names if f"{name}_{c}" in columns]
        return np.sqrt(sum(p * p for p in parts))

    return {
        f"{name}_position_error_m": size(("x_m", "y_m", "z_m")),
        f"{name}_velocity_error_m_s": size(("vx_m_s", "vy_m_s", "vz_m_s")),
        f"{name}_rate_error_rad_s": size(("wx_rad_s", "wy_rad_s", "wz_rad_s")),
    }
