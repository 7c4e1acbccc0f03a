"""Motions of trees of hinges and slides: the loop over motions and steps.

A step is MuJoCo's with `implicitfast`, and with what `runner.systems.mechanism.midpoint` makes of it: what is quadratic
in the velocities is taken in the middle of the step, and friction of a joint that turns round is the mean over it.
Without the engine's other stages a step takes a fifth of the time. `tests/test_joint_tree.py` holds both together.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from runner.numerics.arrays import FloatArray
from runner.physics import borrowed as borrowing
from runner.physics import joint_law
from runner.physics.borrowed import borrowed
from runner.physics.joint_law.law import added, limit_at, turning
from runner.physics.joint_law.record import COLUMN, MAGIC, SIZE
from runner.physics.joint_tree.constraints import (
    AT_JOINT,
    AT_TENDON,
    constrained,
    factorised,
    friction_rows,
    limit_rows,
    solved,
)
from runner.physics.joint_tree.dynamics import inertia_matrix, inertial_forces, place
from runner.physics.joint_tree.numbers import ACTUATOR, JOINT, TENDON, TENDON_SIZE, Numbers, Shape, Tree
from runner.physics.threads import shared
from runner.storage.numba_cache import fingerprint

SOURCES = fingerprint(
    borrowing.__file__, *Path(joint_law.__file__).parent.glob("*.py"), *Path(__file__).parent.glob("*.py")
)
STIFFNESS, SPRING, DAMPING, FRICTION = (JOINT[n] for n in ("stiffness", "spring", "damping", "friction"))
ARMATURE, ACT_LIMITED, ACT_RANGE, LAW = (JOINT[n] for n in ("armature", "act_limited", "act_range", "law"))
LOAD_SHARE, DRIVE_AFTER = COLUMN["load_share"], COLUMN["drive_after"]
TENDON_STIFFNESS, TENDON_DAMPING, TENDON_SPRING = (TENDON[n] for n in ("stiffness", "damping", "spring"))
AFFINE_GAIN, GAIN, AFFINE_BIAS, BIAS = (ACTUATOR[n] for n in ("affine_gain", "gain", "affine_bias", "bias"))
CTRL_LIMITED, CTRL_RANGE = ACTUATOR["ctrl_limited"], ACTUATOR["ctrl_range"]
FORCE_LIMITED, FORCE_RANGE = ACTUATOR["force_limited"], ACTUATOR["force_range"]
GEAR, TAKEN = ACTUATOR["gear"], ACTUATOR["taken"]
HUGE = 1e10  # as MuJoCo's mjMAXVAL: a motion has diverged


def rollout(trees: Sequence[Tree], start: FloatArray, control: FloatArray, threads: int = 1) -> FloatArray:
    """Simulate many motions, each of a tree of its own.

    Args:
        trees: Of one shape, (R,).
        start: Time, positions and velocities at the start of each, (R, 1 + 2 V).
        control: What is commanded and which forces act on the joints in each step, (R, n, U + V).
        threads: How many share the work.

    Returns:
        The same as `start` after each step, (R, n, 1 + 2 V); NaN once a motion has diverged.
    """
    unique = {id(tree): tree for tree in trees}
    number = {key: i for i, key in enumerate(unique)}
    which, shape = np.array([number[id(tree)] for tree in trees]), trees[0].shape
    numbers = Numbers(*(np.stack(tables) for tables in zip(*(t.numbers for t in unique.values()), strict=True)))
    simulate, out = _compiled(), np.empty((len(start), control.shape[1], start.shape[1]))
    start, control = np.ascontiguousarray(start), np.ascontiguousarray(control)

    def part(some: slice) -> None:
        simulate(shape, numbers, which[some], start[some], control[some], _scratch(numbers), out[some])

    shared(part, len(start), threads)
    return out


class Scratch(NamedTuple):
    """What a step works in, for V joints, B bodies, U actuators and at most R rows of constraints."""

    vectors: FloatArray  # (14, V)
    squares: FloatArray  # (3, V, V)
    axes: FloatArray  # (V, 6)
    room: FloatArray  # (2 V + 2, V)
    frames: FloatArray  # (B, 9)
    origins: FloatArray  # (B, 3)
    moments: FloatArray  # (2, B, 10)
    sixes: FloatArray  # (3, B, 6)
    momentum: FloatArray  # (6,)
    forces: FloatArray  # (U,)
    lines: FloatArray  # (R, V)
    rows: FloatArray  # (3, R)
    row_of: NDArray[np.int64]  # (V,)


def _scratch(numbers: Numbers) -> Scratch:
    v, b, u = numbers.joints.shape[1], numbers.bodies.shape[1], numbers.actuators.shape[1]
    rows = 3 * v + 2 * numbers.tendons.shape[1]
    shapes = [(14, v), (3, v, v), (v, 6), (2 * v + 2, v), (b, 9), (b, 3), (2, b, 10), (3, b, 6), (6,), (u,), (rows, v)]
    return Scratch(*map(np.zeros, shapes), np.zeros((3, rows)), np.zeros(v, np.int64))


@njit(error_model="numpy", inline="always")
def _driven(driven, actuators, joints, control, q, v, forces, on_joints, slopes):
    """Write the force of each actuator, what they exert on the joints, and how that changes with the velocity."""
    for j in range(len(joints)):
        on_joints[j], slopes[j] = 0.0, 0.0
    for k in range(len(actuators)):
        table, j, command = actuators[k], driven[k], control[k]
        if table[CTRL_LIMITED] != 0.0:
            command = min(max(command, table[CTRL_RANGE]), table[CTRL_RANGE + 1])
        gear = table[GEAR]
        long, rate = gear * q[j], gear * v[j]
        gain, bias, slope = table[GAIN], 0.0, 0.0
        if table[AFFINE_GAIN] != 0.0:
            gain += table[GAIN + 1] * long + table[GAIN + 2] * rate
            slope += table[GAIN + 2] * command
        if table[AFFINE_BIAS] != 0.0:
            bias = table[BIAS] + table[BIAS + 1] * long + table[BIAS + 2] * rate
            slope += table[BIAS + 2]
        force = gain * command + bias
        if table[FORCE_LIMITED] != 0.0:
            low, high = table[FORCE_RANGE], table[FORCE_RANGE + 1]
            if force <= low or force >= high:
                slope = 0.0
            force = min(max(force, low), high)
        forces[k] = force
        on_joints[j] += gear * force
        slopes[j] += gear * gear * slope
    for j in range(len(joints)):
        if joints[j, ACT_LIMITED] != 0.0:
            on_joints[j] = min(max(on_joints[j], joints[j, ACT_RANGE]), joints[j, ACT_RANGE + 1])


@cache
def _compiled():
    """Compile the loop; the sources stand in its closure, so that numba's cache follows them."""
    sources = SOURCES

    @njit(error_model="numpy", cache=True, nogil=True)
    def simulate(shape, numbers, which, start, control, of, out):
        assert sources
        # nothing of this is counted in the loop: see `borrowed`
        shape = Shape(
            borrowed(shape.parents), borrowed(shape.first), borrowed(shape.count), borrowed(shape.hinge),
            borrowed(shape.above), borrowed(shape.driven), borrowed(shape.carriers),
        )  # fmt: skip
        start, control, out = borrowed(start), borrowed(control), borrowed(out)
        heads, every_body, every_joint = borrowed(numbers.head), borrowed(numbers.bodies), borrowed(numbers.joints)
        every_actuator, every_tendon = borrowed(numbers.actuators), borrowed(numbers.tendons)
        vectors, squares, axes, room = borrowed(of.vectors), borrowed(of.squares), borrowed(of.axes), borrowed(of.room)
        frames, origins, moments = borrowed(of.frames), borrowed(of.origins), borrowed(of.moments)
        sixes, lines, of_rows = borrowed(of.sixes), borrowed(of.lines), borrowed(of.rows)
        momentum, forces, row_of = borrowed(of.momentum), borrowed(of.forces), borrowed(of.row_of)
        size, drives, spans = every_joint.shape[1], every_actuator.shape[1], every_tendon.shape[1]
        q, v, a, smooth, held, middle, exerted = (
            vectors[0], vectors[1], vectors[2], vectors[3], vectors[4], vectors[5], vectors[6],
        )  # fmt: skip
        slopes, inertial, springs, free = vectors[7], vectors[8], vectors[9], vectors[10]
        armature, passive, single = vectors[11], vectors[12], vectors[13]
        matrix, factor, implicit = squares[0], squares[1], squares[2]
        inertias, composite = moments[0], moments[1]
        moving, changing, acting = sixes[0], sixes[1], sixes[2]
        weights, references, bounds = of_rows[0], of_rows[1], of_rows[2]
        frames[0, 0] = frames[0, 4] = frames[0, 8] = 1.0
        for r in range(len(which)):
            m = which[r]
            head, bodies, joints = heads[m], every_body[m], every_joint[m]
            actuators, tendons = every_actuator[m], every_tendon[m]
            step, gravity, time = head[0], head[1:4], start[r, 0]
            loaded = False
            for j in range(size):
                q[j], v[j], a[j], held[j] = start[r, 1 + j], start[r, 1 + size + j], 0.0, 0.0
                armature[j] = joints[j, ARMATURE]
                loaded = loaded or (joints[j, LAW] == MAGIC and joints[j, LAW + LOAD_SHARE] != 0.0)
            for k in range(drives):
                forces[k] = 0.0
            for n in range(control.shape[1]):
                given = control[r, n]
                place(shape, bodies, joints, q, frames, origins, axes, inertias)
                inertia_matrix(shape, armature, axes, inertias, composite, momentum, matrix)
                known = False
                for j in range(size):
                    known = known or a[j] != 0.0
                rows = friction_rows(joints, v, step, lines, weights, references, bounds, row_of)
                for j in range(size):
                    for k in range(size):
                        single[k] = 0.0
                    single[j] = 1.0
                    rows = limit_rows(
                        joints[j], AT_JOINT, single, q[j], v[j], step, rows, lines, weights, references, bounds
                    )
                    springs[j] = -joints[j, STIFFNESS] * (q[j] - joints[j, SPRING])
                    passive[j] = -joints[j, DAMPING] * v[j]
                for t in range(spans):
                    line, long, rate = tendons[t, TENDON_SIZE:], 0.0, 0.0
                    for j in range(size):
                        long += line[j] * q[j]
                        rate += line[j] * v[j]
                    rows = limit_rows(
                        tendons[t], AT_TENDON, line, long, rate, step, rows, lines, weights, references, bounds
                    )
                    rest = min(max(long, tendons[t, TENDON_SPRING]), tendons[t, TENDON_SPRING + 1])
                    for j in range(size):
                        springs[j] -= line[j] * tendons[t, TENDON_STIFFNESS] * (long - rest)
                        passive[j] -= line[j] * tendons[t, TENDON_DAMPING] * rate
                if loaded:
                    _driven(shape.driven, actuators, joints, given, q, v, forces, exerted, slopes)
                    inertial_forces(shape, gravity, bodies, axes, inertias, v, moving, changing, acting, inertial)
                for j in range(size):
                    dry = joints[j, FRICTION]
                    if joints[j, LAW] == MAGIC:
                        record = joints[j, LAW : LAW + SIZE]
                        speed = v[j] + 0.5 * step * a[j]
                        limit = limit_at(record, dry, speed)
                        if record[LOAD_SHARE] != 0.0:
                            against = springs[j] + given[drives + j] - inertial[j]
                            limit += record[LOAD_SHARE] * 0.5 * abs(exerted[j + int(record[DRIVE_AFTER])] - against)
                        if row_of[j] >= 0:
                            bounds[row_of[j]] = limit
                        passive[j] += added(record, dry, joints[j, DAMPING], q[j], speed, time, step)
                    if known and row_of[j] >= 0:
                        passive[j] += turning(dry, bounds[row_of[j]], held[j], v[j], a[j], step)
                if known:
                    for k in range(drives):
                        if actuators[k, TAKEN] != 0.0:
                            low, high = actuators[k, FORCE_RANGE], actuators[k, FORCE_RANGE + 1]
                            if forces[k] <= low or forces[k] >= high:
                                passive[shape.driven[k]] -= actuators[k, TAKEN] * a[shape.driven[k]]
                for j in range(size):
                    middle[j] = v[j] + (0.5 * step * a[j] if known else 0.0)
                inertial_forces(shape, gravity, bodies, axes, inertias, middle, moving, changing, acting, inertial)
                _driven(shape.driven, actuators, joints, given, q, v, forces, exerted, slopes)
                for j in range(size):
                    smooth[j] = passive[j] + springs[j] - inertial[j] + given[drives + j] + exerted[j]
                    free[j] = smooth[j]
                if not factorised(matrix, factor):
                    smooth[0] = np.inf
                solved(factor, free)
                for j in range(size):
                    held[j] = 0.0
                    if rows == 0 or not known:
                        a[j] = free[j]
                if rows > 0:
                    constrained(matrix, free, rows, lines, weights, references, bounds, a, held, room)
                # forces that damp are taken at the end of the step
                for i in range(size):
                    for j in range(size):
                        implicit[i, j] = matrix[i, j]
                    implicit[i, i] += step * (joints[i, DAMPING] - slopes[i])
                    free[i] = smooth[i] + held[i]
                for t in range(spans):
                    if tendons[t, TENDON_DAMPING] != 0.0:
                        line = tendons[t, TENDON_SIZE:]
                        for i in range(size):
                            # as MuJoCo: between joints that do not carry each other this part is left out
                            j = i
                            while j >= 0:
                                part = step * tendons[t, TENDON_DAMPING] * line[i] * line[j]
                                implicit[i, j] += part
                                implicit[j, i] += part if j < i else 0.0
                                j = shape.above[j]
                if not factorised(implicit, factor):
                    free[0] = np.inf
                solved(factor, free)
                sound = True
                for j in range(size):
                    v[j] += step * free[j]
                    q[j] += step * v[j]
                    sound = sound and abs(v[j]) < HUGE and abs(q[j]) < HUGE and abs(a[j]) < HUGE
                time += step
                if not sound:
                    out[r, n:] = np.nan
                    break
                out[r, n, 0] = time
                for j in range(size):
                    out[r, n, 1 + j], out[r, n, 1 + size + j] = q[j], v[j]

    return simulate
