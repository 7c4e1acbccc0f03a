"""What the commands of a mechanism say of its motion, and the motion of them, in a line each.

The position of a servo follows its target. What any other actuator exerts is compared with what the motion needs by the
model: inertia, gravity and springs, less what goes with friction or another spring, as each joint may have those. The
motion may answer late, and the model may be wrong; what is told of is far from either.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from runner.numerics.arrays import FloatArray
from runner.numerics.differences import smooth_derivative
from runner.recording.data import WARNING
from runner.recording.kinematics import without_gaps
from runner.recording.model_form_mapping import ModelMapping, is_servo
from runner.recording.plausible_pairs import place
from runner.recording.table import Table
from runner.settings import SETTINGS

MOTION, FORCES, COMMANDS = SETTINGS.motion, SETTINGS.forces, SETTINGS.commands

TURNS = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))


@dataclass(frozen=True)
class _Answer:
    """What a command explains of what answers it.

    Args:
        gain: Of the answer to the command, least squares.
        explained: Share of the answer that the command explains beyond what is there without it.
        size: Share of the answer that the command would be, were the gain one.
    """

    gain: float
    explained: float
    size: float


def measured_joints(mapping: ModelMapping, model: mujoco.MjModel) -> dict[str, str] | None:
    """Return the channel of each joint's position; None: what was recorded does not tell what the model does next.

    It does where every joint is a hinge or a slide whose position is measured, no actuator has a state of its own, and
    no other force was recorded.
    """
    positions = {s.target: s.name for s in mapping.sources if s.kind == "joint" and s.quantity == "position"}
    joints = [model.joint(j) for j in range(model.njnt)]
    told = all(int(j.type[0]) in TURNS and j.name in positions for j in joints)
    return positions if told and not model.na and not mapping.forces else None


def note_commands(table: Table, spans: Sequence[slice], mapping: ModelMapping, model: mujoco.MjModel) -> list[str]:
    """Return notes on commands that the motion does not answer, answers the other way round, or by another size.

    Nothing is said where `measured_joints` has none.
    """
    positions = measured_joints(mapping, model)
    if positions is None or not mapping.commands:
        return []
    columns = [positions[model.joint(j).name] for j in range(model.njnt)]
    motions = list(_motions(table, spans, columns, list(mapping.commands)))
    if sum(len(m.q) for m in motions) < COMMANDS.min_points:
        return []
    notes = []
    exerted = [_exerted(model, mapping, m) for m in motions]
    needed = [_needed(model, m) for m in motions]
    for k, (name, command) in enumerate(mapping.commands.items()):
        actuator = model.actuator(command.actuator)
        if not np.ptp(table[name]):
            notes.append(f"the command '{name}' never changes")
        if int(actuator.trntype[0]) != int(mujoco.mjtTrn.mjTRN_JOINT):
            continue
        joint = int(actuator.trnid[0])
        column, gear = columns[joint], float(actuator.gear[0]) or 1.0
        if is_servo(model, actuator.id):
            gives, takes = [m.u[:, k] / gear for m in motions], [m.q[:, joint] for m in motions]
            rest = [np.zeros((len(m.q), 1)) for m in motions]
            what = f"the target '{name}' explains {{:.0%}} of how '{column}' moves"
        else:
            gives, takes = [e[:, joint] for e in exerted], [n[:, joint] for n in needed]
            rest = [_beside(m, joint) for m in motions]
            what = f"the command '{name}' explains {{:.0%}} of what the motion of '{column}' needs"
        answer = _answered(gives, takes, [r[:, :-1] for r in rest], motions)
        with_spring = _answered(gives, takes, rest, motions)
        notes += _beyond(table, name, gives, takes) or _told(name, column, what, answer, with_spring)
    return notes


def _told(name: str, column: str, what: str, answer: _Answer | None, with_spring: _Answer | None) -> list[str]:
    """Return what an answer says that can't be; a spring that the model does not have may hide it."""
    if answer is None or with_spring is None:
        return []
    if answer.explained > FORCES.explained_share:
        if answer.gain < 0:
            return [f"{WARNING}'{column}' moves against '{name}': one of them has the wrong sign"]
        if not 1 / COMMANDS.max_gain < answer.gain < COMMANDS.max_gain:
            return [
                f"{WARNING}the motion of '{column}' needs {answer.gain:.3g} times the command '{name}' by the model; "
                f"usual: {1 / COMMANDS.max_gain:g} to {COMMANDS.max_gain:g}"
            ]
    elif (
        answer.size > COMMANDS.telling_share
        and max(answer.explained, with_spring.explained) < COMMANDS.unexplained_share
    ):
        return [f"{WARNING}{what.format(answer.explained)}"]
    return []


@dataclass(frozen=True)
class _Motion:
    """A motion, smoothed: (T, nv) positions, velocities, accelerations, (T, K) commands, and the time of a step."""

    q: FloatArray
    dq: FloatArray
    ddq: FloatArray
    u: FloatArray
    step_s: float


def _motions(
    table: Table, spans: Sequence[slice], columns: Sequence[str], commands: Sequence[str]
) -> Iterator[_Motion]:
    """Yield the motion of each episode that is long enough, at even times, smoothed."""
    for span in spans:
        t, measured = table["t"][span], table.stack(columns)[span]
        count, step_s = len(t), float(t[-1] - t[0]) / (len(t) - 1)
        window = max(COMMANDS.min_window_samples, 2 * round(COMMANDS.smooth_s / step_s / 2) + 1)
        if count < 2 * window or not np.isfinite(measured).any(axis=0).all():
            continue
        even = t[0] + step_s * np.arange(count)
        whole, _ = without_gaps(t, measured, np.zeros_like(measured))
        q = np.stack([np.interp(even, t, w) for w in whole.T], axis=1)
        held = table.stack(commands)[span][np.clip(np.searchsorted(t, even, side="right") - 1, 0, None)]
        few = slice(window // 2, count - window // 2, max(1, window // 4))
        q, dq, ddq = (smooth_derivative(q, window, 3, order, step_s)[few] for order in (0, 1, 2))
        yield _Motion(q, dq, ddq, smooth_derivative(held, window, 0)[few], step_s * max(1, window // 4))


def _needed(model: mujoco.MjModel, motion: _Motion) -> FloatArray:
    """Return the forces that a motion needs by the model, without friction, limits and contacts, (T, nv)."""
    data = mujoco.MjData(model)
    flags = model.opt.disableflags
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT) | int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)
    out = np.empty_like(motion.q)
    try:
        for k in range(len(out)):
            data.qpos[:], data.qvel[:], data.qacc[:] = motion.q[k], motion.dq[k], motion.ddq[k]
            mujoco.mj_inverse(model, data)
            out[k] = data.qfrc_inverse
    finally:
        model.opt.disableflags = flags
    return out


def _exerted(model: mujoco.MjModel, mapping: ModelMapping, motion: _Motion) -> FloatArray:
    """Return the forces that the actuators exert by the model under their commands, (T, nv)."""
    data, out = mujoco.MjData(model), np.empty_like(motion.q)
    actuators = [model.actuator(c.actuator).id for c in mapping.commands.values()]
    for k in range(len(out)):
        data.qpos[:], data.qvel[:], data.ctrl[actuators] = motion.q[k], motion.dq[k], motion.u[k]
        mujoco.mj_forward(model, data)
        out[k] = data.qfrc_actuator
    return out


def _beside(motion: _Motion, joint: int) -> FloatArray:
    """Return what forces that the model does not have may go with, (T, 3): friction, and last a spring."""
    position, speed = motion.q[:, joint], motion.dq[:, joint]
    usual = float(np.sqrt(np.mean(speed**2))) or 1.0
    sign = np.tanh(speed / (COMMANDS.friction_speed_share * usual))  # gradual where it turns round
    return np.column_stack([speed, sign, position])


def _answered(
    gives: Sequence[FloatArray], takes: Sequence[FloatArray], rest: Sequence[FloatArray], motions: Sequence[_Motion]
) -> _Answer | None:
    """Return how what is taken answers what is given, as late as explains most; None where there is too little."""
    best: _Answer | None = None
    step_s = float(np.median([m.step_s for m in motions]))
    for late in range(round(FORCES.latest_s / step_s) + 1):
        ends = [max(len(g) - late, 0) for g in gives]
        given = np.concatenate([g[:n] for g, n in zip(gives, ends, strict=True)])
        taken = np.concatenate([t[late : late + n] for t, n in zip(takes, ends, strict=True)])
        beside = np.concatenate([r[late : late + n] for r, n in zip(rest, ends, strict=True)])
        found = _fitted(given, taken, np.column_stack([beside, np.ones(len(beside))]))
        if found is not None and (best is None or found.explained > best.explained + COMMANDS.later_share):
            best = found
    return best


def _fitted(given: FloatArray, taken: FloatArray, beside: FloatArray) -> _Answer | None:
    """Return what is explained of `taken` by `given`, both less what goes with `beside`."""
    if len(taken) < COMMANDS.min_points or not np.ptp(given):
        return None
    coefficients = np.linalg.lstsq(beside, np.column_stack([given, taken]), rcond=None)[0]
    g, t = (np.column_stack([given, taken]) - beside @ coefficients).T
    gg, tt, gt = float(g @ g), float(t @ t), float(g @ t)
    if not gg or not tt:
        return None
    return _Answer(gain=gt / gg, explained=gt**2 / (gg * tt), size=gg / tt)


def _beyond(table: Table, name: str, gives: Sequence[FloatArray], takes: Sequence[FloatArray]) -> list[str]:
    """Return a note on a command of a moment that is far beyond all others and all that the motion answers."""
    sizes = np.abs(table[name] - np.median(table[name]))
    row, usual = int(np.argmax(sizes)), float(np.percentile(sizes, MOTION.usual_percent))
    given, taken = (max(float(np.abs(part).max()) for part in parts) for parts in (gives, takes))
    if sizes[row] <= COMMANDS.beyond_factor * usual or given <= taken:
        return []
    return [f"{WARNING}'{name}' is {table[name][row]:.4g} at {place(table, row)}, and the motion does not answer"]
