"""Steps in time: the implicit midpoint rule, cut at every reversal and at every meeting of drive and link.

Dry friction. A joint that moves is under the full friction against its motion. One that is at rest stays there if a
friction within its limits can hold it: the box-constrained complementarity problem of all that rest, together with the
contact of drive and link, is solved by projected Gauss-Seidel (Moreau 1988; Acary & Brogliato 2008, 9.5). Where a
velocity would change its sign within a step, the step is made up to there, the joint is put to rest, and what is left
of the step is made anew: so the order of the rule, two, is kept through reversals.

Play. Drive and link meet without rebound, stay together as long as they press on one another, and part freely.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from runner.blind.mechanism.physics import layout as at
from runner.blind.mechanism.physics.dynamics import drive_of, forces, mass_matrix

ROUNDS, ALIKE = 8, 1e-11  # of the midpoint's iteration, each of which gains a factor of hundreds; when it is done
REST = 1e-10  # rad/s or m/s: slower is at rest
PARTS = 16  # of a step at most
SWEEPS = 200
# rows of the scratch
EXERTED, FORCE, UP, DOWN, MIDDLE, MIDDLE_V, NEXT, COMMAND, BUILT, PRESS, LAST, SCRATCH = range(12)


@njit(error_model="numpy")
def invert(matrix, n, out):
    """Write the inverse of a symmetric matrix, n of 1 to 3, by its cofactors."""
    a, b, c = matrix[0, 0], matrix[0, 1], matrix[1, 1]
    if n == 1:
        out[0, 0] = 1.0 / a
    elif n == 2:
        whole = a * c - b * b
        out[0, 0], out[1, 1] = c / whole, a / whole
        out[0, 1] = out[1, 0] = -b / whole
    else:
        d, e, f = matrix[0, 2], matrix[1, 2], matrix[2, 2]
        out[0, 0], out[0, 1], out[0, 2] = c * f - e * e, d * e - b * f, b * e - c * d
        out[1, 1], out[1, 2], out[2, 2] = a * f - d * d, b * d - a * e, a * c - b * b
        whole = a * out[0, 0] + b * out[0, 1] + d * out[0, 2]
        for i in range(3):
            for j in range(i, 3):
                out[i, j] /= whole
                out[j, i] = out[i, j]


@njit(error_model="numpy")
def reached(actuator, u, sent, h):
    """Return the command that has reached an actuator a time after `sent` had."""
    if actuator[at.SLEW] > 0.0:
        return sent + min(max(u - sent, -actuator[at.SLEW] * h), actuator[at.SLEW] * h)
    if actuator[at.LAG] > 0.0:
        return u + (sent - u) * math.exp(-h / actuator[at.LAG])
    return u


@njit(error_model="numpy")
def _hold(inverse, n, v, w, h, work, driven, count, side):
    """Add to velocities `w` what friction at rest and the contact of drive and link do; return that one's impulse."""
    press, total = work[PRESS], 0.0
    press[:n] = 0.0
    for _ in range(SWEEPS):
        largest = 0.0
        for i in range(n):
            if v[i] == 0.0:
                wanted = press[i] - w[i] / inverse[i, i]
                change = min(max(wanted, -work[UP, i] * h), work[DOWN, i] * h) - press[i]
                press[i] += change
                for k in range(n):
                    w[k] += inverse[k, i] * change
                largest = max(largest, abs(change) * inverse[i, i])
        if side != 0.0:
            both = inverse[driven, driven] + inverse[count, count] - 2.0 * inverse[driven, count]
            change = max(total + side * (w[driven] - w[count]) / both, 0.0) - total
            total += change
            for k in range(n):
                w[k] += side * change * (inverse[k, count] - inverse[k, driven])
            largest = max(largest, abs(change) * both)
        if largest < 1e-15:
            break
    return total


@njit(error_model="numpy")
def attempt(world, q, v, u, state, side, t, elapsed, h, mass, inverse, work):
    """Write into work[NEXT] the velocities after `h` in which nothing reverses; return the impulse of the contact."""
    whole, joints, actuators, swings = world
    count, driven = joints.shape[0], drive_of(joints)
    n = count + (1 if driven >= 0 else 0)
    sent, built, heat = state[0], state[1], state[2]
    following = work[NEXT]
    following[:n] = v[:n]
    total = 0.0
    for j in range(count):
        work[COMMAND, j] = reached(actuators[j], u[j], sent[j], 0.5 * h)
    for _ in range(ROUNDS):
        for i in range(n):
            work[MIDDLE_V, i] = 0.5 * (v[i] + following[i])
            work[MIDDLE, i] = q[i] + 0.5 * h * work[MIDDLE_V, i]
        for j in range(count):
            speed = joints[j, at.DAHL_RATE] * work[MIDDLE_V, j]
            work[BUILT, j] = built[j] + 0.5 * h * (speed - abs(speed) * built[j])
        mass_matrix(whole, joints, work[MIDDLE], mass)
        invert(mass, n, inverse)
        forces(
            whole, joints, actuators, swings, work[MIDDLE], work[MIDDLE_V], work[COMMAND], work[BUILT], heat,
            t + 0.5 * h, elapsed, work[EXERTED], work[FORCE], work[UP], work[DOWN],
        )  # fmt: skip
        for i in range(n):
            if v[i] > 0.0:
                work[FORCE, i] -= work[UP, i]
            elif v[i] < 0.0:
                work[FORCE, i] += work[DOWN, i]
        for i in range(n):
            work[LAST, i] = following[i]
            following[i] = v[i]
            for k in range(n):
                following[i] += h * inverse[i, k] * work[FORCE, k]
        total = _hold(inverse, n, v, following, h, work, driven, count, side)
        change = 0.0
        for i in range(n):
            change = max(change, abs(following[i] - work[LAST, i]))
        if change < ALIKE:
            break
    return total


@njit(error_model="numpy")
def _meeting(joints, q, v, following, h, driven, count):
    """Return the share of a step after which drive and link meet, above 1 if they don't, and on which side."""
    apart = q[driven] - q[count]
    first, last = v[driven] - v[count], following[driven] - following[count]
    half = 0.5 * joints[driven, at.PLAY]
    end = apart + 0.5 * h * (first + last)
    if abs(end) <= half:
        return 2.0, 0.0
    side = 1.0 if end > 0.0 else -1.0
    way = max(half - side * apart, 0.0)
    a, b = 0.5 * h * side * (last - first), h * side * first
    # a x^2 + b x = way, the root in 0..1
    root = math.sqrt(max(b * b + 4.0 * a * way, 0.0))
    share = 2.0 * way / (b + root) if b + root > 0.0 else 1.0
    return min(max(share, 0.0), 1.0), side


@njit(error_model="numpy")
def _collide(joints, v, driven, count, side, inverse):
    """Make the velocities of drive and link equal, as an impact without rebound does."""
    both = inverse[driven, driven] + inverse[count, count] - 2.0 * inverse[driven, count]
    impulse = side * (v[driven] - v[count]) / both
    if impulse > 0.0:
        for k in range(count + 1):
            v[k] += side * impulse * (inverse[k, count] - inverse[k, driven])


@njit(error_model="numpy")
def _keep(world, q, v, u, state, lags, h, work):
    """Take over the step that was attempted: positions, commands, what has built up, heat, what the sensors show."""
    _, joints, actuators, _ = world
    count, n = joints.shape[0], joints.shape[0] + (1 if drive_of(joints) >= 0 else 0)
    for j in range(count):
        state[0, j] = reached(actuators[j], u[j], state[0, j], h)
        speed = joints[j, at.DAHL_RATE] * 0.5 * (v[j] + work[NEXT, j])
        state[1, j] += h * (speed - abs(speed) * work[BUILT, j])
        if actuators[j, at.FADE] != 0.0:
            load = (work[EXERTED, j] / actuators[j, at.FADE_FORCE]) ** 2
            state[2, j] = load + (state[2, j] - load) * math.exp(-h / actuators[j, at.FADE_S])
        for k in range(2):
            c = 2 * j + k
            begin = q[j] if k == 0 else v[j]
            end = q[j] + 0.5 * h * (v[j] + work[NEXT, j]) if k == 0 else work[NEXT, j]
            tau = lags[c]
            if tau > 0.0 and h > 0.0:
                rate = (end - begin) / h
                # exact for a value that is linear over the step
                state[3, c] = end - tau * rate + (state[3, c] - begin + tau * rate) * math.exp(-h / tau)
            else:
                state[3, c] = end
    for i in range(n):
        q[i] += 0.5 * h * (v[i] + work[NEXT, i])
        v[i] = work[NEXT, i] if abs(work[NEXT, i]) > REST else 0.0


@njit(error_model="numpy")
def advance(world, q, v, u, state, lags, side, t, elapsed, h, mass, inverse, work):
    """Take one step, in parts where something reverses, meets or parts; return the side on which drive and link press.

    Args:
        world: Tables of `layout`.
        q, v: Positions and velocities, (n,); changed.
        u: Commands that are sent, (count,).
        state: Rows: commands that have reached the actuators, what has built up, heat, what the sensors show. Changed.
        lags: Of the sensors, (2 count,), s.
        side: Of the flank on which drive and link press, 0 if on none.
        t, elapsed: Time since the episode began, and since the recording did until then, s.
        h: Length, s.
        mass, inverse, work: Scratch.
    """
    joints = world[1]
    count, driven = joints.shape[0], drive_of(joints)
    n = count + (1 if driven >= 0 else 0)
    plays = driven >= 0 and joints[driven, at.PLAY] > 0.0
    left = h
    for part in range(PARTS):
        impulse = attempt(world, q, v, u, state, side, t, elapsed, left, mass, inverse, work)
        share, row, met = 1.0, -1, 0.0
        for i in range(n):
            if v[i] != 0.0 and v[i] * work[NEXT, i] <= 0.0 and v[i] / (v[i] - work[NEXT, i]) < share:
                share, row = v[i] / (v[i] - work[NEXT, i]), i
        if plays and side == 0.0:
            until, found = _meeting(joints, q, v, work[NEXT], left, driven, count)
            if until < share:
                share, row, met = until, -1, found
        if part == PARTS - 1:
            share, row, met = 1.0, -1, 0.0
        now = share * left
        if share < 1.0:
            impulse = attempt(world, q, v, u, state, side, t, elapsed, now, mass, inverse, work)
            if row >= 0:
                work[NEXT, row] = 0.0
        _keep(world, q, v, u, state, lags, now, work)
        if met != 0.0:
            _collide(joints, v, driven, count, met, inverse)
            side = met
        elif side != 0.0 and impulse <= 0.0 and now > 0.0:
            side = 0.0
        if side != 0.0:
            q[count] = q[driven] - side * 0.5 * joints[driven, at.PLAY]
        left -= now
        t += now
        if left <= 1e-13:
            break
    return side


@njit(error_model="numpy")
def settle(world, q, v, u, state, mass, inverse, work):
    """Put the drive where it is when an episode begins: moving with the link, pressing on it; return on which side."""
    whole, joints, actuators, swings = world
    count, driven = joints.shape[0], drive_of(joints)
    if driven < 0:
        return 0.0
    q[count], v[count] = q[driven], v[driven]
    mass_matrix(whole, joints, q, mass)
    invert(mass, count + 1, inverse)
    forces(
        whole, joints, actuators, swings, q, v, u, state[1], state[2], 0.0, 0.0, work[EXERTED], work[FORCE],
        work[UP], work[DOWN],
    )  # fmt: skip
    apart = 0.0
    for k in range(count + 1):
        apart += (inverse[driven, k] - inverse[count, k]) * work[FORCE, k]
    side = 1.0 if apart > 0.0 else -1.0
    if joints[driven, at.GIVE] > 0.0:
        both = inverse[driven, driven] + inverse[count, count] - 2.0 * inverse[driven, count]
        q[count] -= apart * joints[driven, at.GIVE] / both
        return 0.0
    q[count] -= 0.5 * side * joints[driven, at.PLAY]
    return side


@njit(error_model="numpy")
def run(whole, joints, actuators, swings, lags, start, held, before, edges, commands, kept, elapsed, longest, out):
    """Simulate an episode; write positions and velocities as the sensors show them, (T, 2 count), at the kept edges.

    Args:
        whole, joints, actuators, swings, lags: The world, see `layout`.
        start: Positions, then velocities, (2 count,).
        held: Whether the mechanism was held before the start.
        before: Commands of before, (count,).
        edges: Times between which commands are constant, (E + 1,), s.
        commands: Between them, (E, count).
        kept: Row of `out` of each edge, -1 for none, (E + 1,).
        elapsed: Time in use before this episode, s.
        longest: Longest step, s.
        out: Written.
    """
    world = (whole, joints, actuators, swings)
    count = joints.shape[0]
    q, v = np.zeros(3), np.zeros(3)
    state, work = np.zeros((4, 4)), np.zeros((SCRATCH, 4))
    mass, inverse = np.zeros((3, 3)), np.zeros((3, 3))
    for j in range(count):
        q[j], v[j] = start[j], start[count + j]
        state[0, j], state[3, 2 * j], state[3, 2 * j + 1] = before[j], q[j], v[j]
    side = settle(world, q, v, commands[0], state, mass, inverse, work)
    if not held:
        # slow sensors have followed a steady change until then
        attempt(world, q, v, commands[0], state, side, edges[0], elapsed, longest, mass, inverse, work)
        for j in range(count):
            state[3, 2 * j] -= lags[2 * j] * v[j]
            state[3, 2 * j + 1] -= lags[2 * j + 1] * (work[NEXT, j] - v[j]) / longest
    for e in range(len(edges)):
        if kept[e] >= 0:
            for j in range(count):
                out[kept[e], 2 * j], out[kept[e], 2 * j + 1] = state[3, 2 * j], state[3, 2 * j + 1]
        if e == len(edges) - 1:
            break
        length = edges[e + 1] - edges[e]
        steps = max(1, math.ceil(length / longest - 1e-9))
        for k in range(steps):
            t = edges[e] + k * length / steps
            side = advance(world, q, v, commands[e], state, lags, side, t, elapsed, length / steps, mass, inverse, work)
        if not (math.isfinite(q[0]) and abs(v[0]) < 1e6):
            return False
    return True
