"""Dry friction and limits: rows of soft constraints as MuJoCo has them, and the accelerations that they lead to.

A row lets a combination J a of the accelerations come near to `aref` by a force of its own: of dry friction as large as
its limit at most, of a joint's or tendon's limit in one direction only. The accelerations are those of least

    1/2 (a - smooth)' M (a - smooth) + sum of s(J a - aref)

with s quadratic, and linear where friction slides (MuJoCo's documentation, "Computation"). That is solved by Newton's
method with an exact search along each step, which ends after finitely many: the sum is quadratic in pieces.
"""

from __future__ import annotations

import math

from numba import njit

from runner.physics.joint_tree.numbers import JOINT, TENDON

FRICTION, INVERSE = JOINT["friction"], JOINT["inverse"]
FRICTION_SOLREF, FRICTION_SOLIMP = JOINT["friction_solref"], JOINT["friction_solimp"]
LEAST = 1e-15  # as MuJoCo's mjMINVAL
MOST_STEPS, MOST_SEARCHED = 60, 60
EXACT = 1e-13  # of the forces that are summed up
LEAST_IMPEDANCE, MOST_IMPEDANCE = 0.0001, 0.9999  # as MuJoCo's mjMINIMP and mjMAXIMP
AT_JOINT = (JOINT["limited"], JOINT["range"], JOINT["margin"], JOINT["solref"], JOINT["solimp"], JOINT["inverse"])
AT_TENDON = (
    TENDON["limited"],
    TENDON["range"],
    TENDON["margin"],
    TENDON["solref"],
    TENDON["solimp"],
    TENDON["inverse"],
)


@njit(error_model="numpy")
def _impedance(table, solimp, apart):
    """Return the impedance of a row that is so far from its margin."""
    low = min(max(table[solimp], LEAST_IMPEDANCE), MOST_IMPEDANCE)
    high = min(max(table[solimp + 1], LEAST_IMPEDANCE), MOST_IMPEDANCE)
    width = max(table[solimp + 2], 0.0)
    middle = min(max(table[solimp + 3], LEAST_IMPEDANCE), MOST_IMPEDANCE)
    power = max(table[solimp + 4], 1.0)
    if low == high or width <= LEAST:
        return 0.5 * (low + high), high
    x = abs(apart) / width
    if x >= 1.0:
        return high, high
    if power == 1.0:
        y = x
    elif x <= middle:
        y = x**power / middle ** (power - 1.0)
    else:
        y = 1.0 - (1.0 - x) ** power / (1.0 - middle) ** (power - 1.0)
    return low + y * (high - low), high


@njit(error_model="numpy")
def _row(table, solref, solimp, inverse, apart, rate, step, of_friction):
    """Return the weight of a row and its reference acceleration."""
    impedance, most = _impedance(table, solimp, apart)
    time, ratio = table[solref], table[solref + 1]
    if time > 0.0:
        time = max(time, 2.0 * step)
        stiffness = 1.0 / max(LEAST, most * most * time * time * ratio * ratio)
        damping = 2.0 / max(LEAST, most * time)
    else:
        stiffness, damping = -time / max(LEAST, most * most), -ratio / max(LEAST, most)
    if of_friction:
        stiffness = 0.0
    softness = max(LEAST, (1.0 - impedance) * inverse / impedance)
    return 1.0 / softness, -damping * rate - stiffness * impedance * apart


@njit(error_model="numpy", inline="always")
def friction_rows(joints, v, step, lines, weights, references, bounds, row_of):
    """Write a row for each joint that has dry friction, and return how many; the limit is that of the model.

    Args:
        joints: Their numbers, (V, .).
        v: Velocities, (V,).
        step: s.
        lines: Out: which joint a row is of, as a row of J, (R, V).
        weights, references, bounds: Out: of each row, (R,); the last how large its force may be, negative: one-sided.
        row_of: Out: the row of each joint, (V,); -1: it has none.
    """
    n = 0
    for j in range(len(joints)):
        row_of[j] = -1
        if joints[j, FRICTION] > 0.0:
            row_of[j] = n
            for k in range(len(joints)):
                lines[n, k] = 0.0
            lines[n, j] = 1.0
            inverse = joints[j, INVERSE]
            weights[n], references[n] = _row(
                joints[j], FRICTION_SOLREF, FRICTION_SOLIMP, inverse, 0.0, v[j], step, True
            )
            bounds[n] = joints[j, FRICTION]
            n += 1
    return n


@njit(error_model="numpy", inline="always")
def limit_rows(table, at, line, place, rate, step, n, lines, weights, references, bounds):
    """Write rows for the limits that a joint or tendon is at, and return how many rows there are then.

    Args:
        table: Its numbers.
        at: `AT_JOINT` or `AT_TENDON`.
        line: How it moves with the joints, (V,).
        place: Position or length; `rate`, its velocity.
        n: How many rows there are.
        step, lines, weights, references, bounds: As in `friction_rows`.
    """
    limited, within, margin, solref, solimp, inverse = at
    if table[limited] == 0.0:
        return n
    for side in range(2):
        sign = 1.0 if side == 0 else -1.0
        apart = sign * (place - table[within + side])
        if apart < table[margin]:
            for k in range(len(line)):
                lines[n, k] = sign * line[k]
            weights[n], references[n] = _row(
                table, solref, solimp, table[inverse], apart - table[margin], sign * rate, step, False
            )
            bounds[n] = -1.0
            n += 1
    return n


@njit(error_model="numpy")
def _force(weight, bound, x):
    """Return the force of a row that is off by x, and whether it would grow with it."""
    force = -weight * x
    if bound < 0.0:
        return (force, True) if x < 0.0 else (0.0, False)
    if force > bound:
        return bound, False
    if force < -bound:
        return -bound, False
    return force, True


@njit(error_model="numpy")
def _piece(force, grows):
    """Return in which piece of its sum a row is, as a number: 0, 1 or 2."""
    return 1 if grows else 2 if force > 0.0 else 0


@njit(error_model="numpy", inline="always")
def factorised(matrix, out):
    """Write the lower factor of a positive matrix (V, V); false: it is none."""
    n = len(matrix)
    for i in range(n):
        for j in range(i + 1):
            s = matrix[i, j]
            for k in range(j):
                s -= out[i, k] * out[j, k]
            if i > j:
                out[i, j] = s / out[j, j]
            elif s > 0.0:
                out[i, i] = math.sqrt(s)
            else:
                return False
    return True


@njit(error_model="numpy", inline="always")
def solved(factor, x):
    """Solve in place for x, (V,), with the factor of a positive matrix."""
    n = len(factor)
    for i in range(n):
        s = x[i]
        for k in range(i):
            s -= factor[i, k] * x[k]
        x[i] = s / factor[i, i]
    for i in range(n - 1, -1, -1):
        s = x[i]
        for k in range(i + 1, n):
            s -= factor[k, i] * x[k]
        x[i] = s / factor[i, i]


@njit(error_model="numpy", inline="always")
def constrained(matrix, smooth, n, lines, weights, references, bounds, a, out, room):
    """Write the accelerations and the forces of constraints on the joints, both (V,).

    Args:
        matrix: Inertia, (V, V).
        smooth: Accelerations without constraints, (V,).
        n: How many rows there are.
        lines, weights, references, bounds: Of the rows, see `friction_rows`.
        a: Out; where it begins.
        out: Out: the forces.
        room: Scratch, (2 V + 2, V).
    """
    size = len(smooth)
    hessian, factor = room[:size], room[size : 2 * size]
    gradient, step = room[2 * size], room[2 * size + 1]
    before, share = -1, 0.0
    for _ in range(MOST_STEPS):
        scale, pieces = 0.0, 0
        for i in range(size):
            s = 0.0
            for k in range(size):
                s += matrix[i, k] * (a[k] - smooth[k])
                hessian[i, k] = matrix[i, k]
            gradient[i], out[i] = s, 0.0
            scale = max(scale, abs(s))
        for r in range(n):
            x = -references[r]
            for k in range(size):
                x += lines[r, k] * a[k]
            force, grows = _force(weights[r], bounds[r], x)
            pieces = 3 * pieces + _piece(force, grows)
            for i in range(size):
                if lines[r, i] == 0.0:
                    continue
                out[i] += lines[r, i] * force
                if grows:
                    for k in range(size):
                        hessian[i, k] += weights[r] * lines[r, i] * lines[r, k]
        worst = 0.0
        for i in range(size):
            scale = max(scale, abs(out[i]))
            gradient[i] -= out[i]
            worst = max(worst, abs(gradient[i]))
        # a whole step within one piece has led to the least there is
        if worst <= EXACT * scale or (pieces == before and share == 1.0) or not factorised(hessian, factor):
            return
        before = pieces
        for i in range(size):
            step[i] = -gradient[i]
        solved(factor, step)
        share = _searched(matrix, n, lines, weights, references, bounds, a, gradient, step, out, pieces)
        if share == 0.0:
            return
        for i in range(size):
            a[i] += share * step[i]


@njit(error_model="numpy", inline="always")
def _searched(matrix, n, lines, weights, references, bounds, a, gradient, step, forces, pieces):
    """Return which share of a step leads to the least sum along it."""
    size = len(step)
    curvature, inertial = 0.0, 0.0
    for i in range(size):
        s = 0.0
        for k in range(size):
            s += matrix[i, k] * step[k]
        curvature += step[i] * s
        inertial += step[i] * (gradient[i] + forces[i])
    low, high, share = 0.0, math.inf, 1.0
    for k in range(MOST_SEARCHED):
        slope, bend = inertial + share * curvature, curvature
        size_of, there = abs(inertial) + share * curvature, 0
        for r in range(n):
            x, along = -references[r], 0.0
            for i in range(size):
                along += lines[r, i] * step[i]
                x += lines[r, i] * a[i]
            force, grows = _force(weights[r], bounds[r], x + share * along)
            there = 3 * there + _piece(force, grows)
            slope -= along * force
            size_of += abs(along * force)
            if grows:
                bend += weights[r] * along * along
        if abs(slope) <= EXACT * size_of or (k == 0 and there == pieces):
            return share
        if slope > 0.0:
            high = share
        else:
            low = share
        share -= slope / bend
        if not low < share < high:
            share = 0.5 * (low + high) if high < math.inf else 2.0 * low
        if high - low <= EXACT * high:
            return low if low > 0.0 else share
    return share
