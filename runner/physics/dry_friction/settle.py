"""Velocity and load at the end of an implicit step, solved together.

The load is affine in its centre, and its centre in the friction. For a given load the velocity is the minimum of a
convex function. All stands in the axes of friction.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from numba import njit

from runner.physics.dry_friction.coefficients import MU, average_speed_effects, bend_flow
from runner.physics.dry_friction.kernel import derivatives, gradient_by_load, potential
from runner.physics.dry_friction.load import onto_base, share_load
from runner.physics.dry_friction.matrix3 import Symmetric, Triple, along, dot, plus, solve, solve_any, times
from runner.physics.dry_friction.pin import normal_force, resistance, slip_share
from runner.physics.dry_friction.record import COLUMN

AIR_DRAG, PIN_HEIGHT = COLUMN["air_drag"], COLUMN["pin_height"]


class Balance(NamedTuple):
    """Balance of momentum: q x + impulse of friction = b; and what centre of the load the moments ask for at x."""

    q: Symmetric
    dry: Symmetric  # q without the film
    b: Triple
    free: tuple[float, float]  # centre of the load without friction
    lever: float  # shift of the centre per impulse of friction
    centre_x: Triple  # how the centre follows x
    centre_y: Triple
    by_pin: float  # shift of the centre per impulse that a pin takes


@njit(error_model="numpy", forceinline=True)
def balance_of_momentum(record, h, v, p, body, films, bears):
    """Set up the balance of momentum over h, with drag, which is linear around p, in the matrix."""
    air = record[AIR_DRAG] * math.sqrt(p[0] * p[0] + p[1] * p[1])
    own, force, free = body.damping, body.force, body.free_centre
    e = (force[0] + p[2] * p[2] * body.first_moment[0], force[1] + p[2] * p[2] * body.first_moment[1], force[2])
    if air > 0.0:
        speed_2 = p[0] * p[0] + p[1] * p[1]
        xx, xy, yy = p[0] * p[0] / speed_2, p[0] * p[1] / speed_2, p[1] * p[1] / speed_2
        own = plus(own, air, (1.0 + xx, xy, 0.0, 1.0 + yy, 0.0, 0.0))
        e = (e[0] + air * p[0], e[1] + air * p[1], e[2])
        if bears:
            shift = body.com_z * air
            free = (free[0] - shift * p[0] / body.weight, free[1] - shift * p[1] / body.weight)
    dry = plus(body.mass, h, own)
    b = along(times(body.mass, v), h, e)
    # friction shifts the load by this much per impulse, drag by this much per force
    lever = body.com_height / (body.weight * h) if bears else 0.0
    lift = body.com_z / body.weight if bears else 0.0
    l0, l1, l2 = lift * own[0] - lever * dry[0], lift * own[1] - lever * dry[1], lift * own[2] - lever * dry[2]
    n1, n2 = lift * own[3] - lever * dry[3], lift * own[4] - lever * dry[4]
    by_pin = (lift - record[PIN_HEIGHT] / body.weight) / h - lever if bears else 0.0
    return Balance(plus(dry, h, films), dry, b, free, lever, (l0, l1, l2), (l1, n1, n2), by_pin)


@njit(error_model="numpy", forceinline=True)
def _residual(q, x, b, out):
    q0, q1, q2 = times(q, x)
    return q0 - b[0] + out[0], q1 - b[1] + out[1], q2 - b[2] + out[2]


@njit(error_model="numpy", forceinline=True)
def _start_or_rest(n, v, balance, points, axes):
    """Return the velocity at the start of the step or rest, whichever has the lower cost."""
    cost = 0.5 * dot(v, times(balance.q, v)) - dot(balance.b, v)
    cost += potential(v, n, points.x, points.y, points.limit, axes.along, axes.across)
    if cost >= potential((0.0, 0.0, 0.0), n, points.x, points.y, points.limit, axes.along, axes.across):
        return (0.0, 0.0, 0.0)
    return v


@njit(error_model="numpy", forceinline=True)
def _derive(n, x, h, points, axes, pin, grip):
    """Leave the derivatives of all friction, and of what a pin takes, in `sums`."""
    sums = points.sums
    derivatives(x, n, points.x, points.y, points.limit, axes.along, axes.across, sums)
    if pin.near:
        impulse, follow = resistance(pin, x, h, grip)
        sums[0] += impulse[0]
        sums[1] += impulse[1]
        sums[2] += impulse[2]
        for i in range(6):
            sums[3 + i] += follow[i]


@njit(error_model="numpy", forceinline=True)
def _minimise(n, x, h, balance, points, axes, pin, grip, size, tolerance):
    """Return the velocity that a given load leads to, and the residual there; its derivatives are left in `sums`.

    It is the minimum of a convex function, found by Newton with a line search.
    """
    q, b, sums = balance.q, balance.b, points.sums
    _derive(n, x, h, points, axes, pin, grip)
    g = _residual(q, x, b, sums)
    for _ in range(40):
        if abs(g[0]) + abs(g[1]) + abs(g[2]) / size < tolerance:
            break
        d = solve(
            q[0] + sums[3], q[1] + sums[4], q[2] + sums[5], q[3] + sums[6], q[4] + sums[7], q[5] + sums[8], *g
        )  # fmt: skip
        slope = dot(g, d)
        step = 1.0
        start = x
        # convex: shorten by the secant rule until the slope along the step is small
        for _ls in range(30):
            x = along(start, -step, d)
            _derive(n, x, h, points, axes, pin, grip)
            g = _residual(q, x, b, sums)
            past = -dot(g, d)
            if past <= 0.5 * slope:
                break
            step *= max(slope / (slope + past), 0.1)
    return x, g


@njit(error_model="numpy", forceinline=True)
def _step_with_load(n, h, x, g, miss, follow, body, balance, points, axes, pin, grip):
    """Return the Newton step in velocity where the load follows it; `sums` holds the derivatives at x.

    The friction of a pin follows its normal force, from `grip` on.
    """
    q, sums, share, weight = balance.q, points.sums, points.share, body.weight
    l0, l1, l2 = balance.centre_x
    n0, n1, n2 = balance.centre_y
    e0, e1 = miss
    q00, q01, q02 = q[0] + sums[3], q[1] + sums[4], q[2] + sums[5]
    q11, q12, q22 = q[3] + sums[6], q[4] + sums[7], q[5] + sums[8]
    gradient_by_load(x, n, points.x, points.y, points.weight, points.mu, points.load, axes.along, axes.across, sums)
    # d(a, b, c) by the centre, where it may move; times h * weight for the impulse
    sx = solve(share[3], share[4], share[5], share[6], share[7], share[8], 0.0, h * weight, 0.0)
    sy = solve(share[3], share[4], share[5], share[6], share[7], share[8], 0.0, 0.0, h * weight)
    u0, u1, u2 = along((follow[0] * sx[0], follow[0] * sx[1], follow[0] * sx[2]), follow[1], sy)
    w0, w1, w2 = along((follow[1] * sx[0], follow[1] * sx[1], follow[1] * sx[2]), follow[2], sy)
    c00, c01 = sums[0] * u0 + sums[3] * u1 + sums[6] * u2, sums[0] * w0 + sums[3] * w1 + sums[6] * w2
    c10, c11 = sums[1] * u0 + sums[4] * u1 + sums[7] * u2, sums[1] * w0 + sums[4] * w1 + sums[7] * w2
    c20, c21 = sums[2] * u0 + sums[5] * u1 + sums[8] * u2, sums[2] * w0 + sums[5] * w1 + sums[8] * w2
    p0 = p1 = p2 = r0 = r1 = r2 = 0.0
    if pin.near:
        _, (h00, h01, h02, h11, h12, _) = resistance(pin, x, h, grip)
        by = balance.by_pin
        l0, l1, l2 = l0 + by * h00, l1 + by * h01, l2 + by * h02
        n0, n1, n2 = n0 + by * h01, n1 + by * h11, n2 + by * h12
        force, per = normal_force(pin, x), h * pin.mu * slip_share(pin, x)[0]
        g = along(g, per * (force - grip), pin.across)
        p0, p1, p2 = per * pin.across[0], per * pin.across[1], per * pin.across[2]
        if force > 0.0:
            r0, r1, r2 = pin.damper * pin.normal[0], pin.damper * pin.normal[1], pin.damper * pin.normal[2]
    return solve_any(
        q00 + c00 * l0 + c01 * n0 + p0 * r0, q01 + c00 * l1 + c01 * n1 + p0 * r1, q02 + c00 * l2 + c01 * n2 + p0 * r2,
        q01 + c10 * l0 + c11 * n0 + p1 * r0, q11 + c10 * l1 + c11 * n1 + p1 * r1, q12 + c10 * l2 + c11 * n2 + p1 * r2,
        q02 + c20 * l0 + c21 * n0 + p2 * r0, q12 + c20 * l1 + c21 * n1 + p2 * r1, q22 + c20 * l2 + c21 * n2 + p2 * r2,
        -g[0] - c00 * e0 - c01 * e1, -g[1] - c10 * e0 - c11 * e1, -g[2] - c20 * e0 - c21 * e1,
    )  # fmt: skip


@njit(error_model="numpy", forceinline=True)
def settle(record, n, h, v, x, y, centre, follow, to_rest, to_average, body, balance, points, axes, pin):
    """Solve for velocity and load together.

    For a given load, and a given limit of a pin's friction, the velocity is a minimum (`_minimise`). In between, one
    Newton step goes in velocity, centre and limit.

    Args:
        record: Of the body.
        n: Number of base points.
        h: How long friction acts.
        v: Velocity at the start of the step.
        x: Velocity to begin with.
        y: Centre of the load to begin with, as the moments ask for it.
        centre: The nearest to y on the base; `points.load` belongs to it.
        follow: How `centre` follows y.
        to_rest: Whether the body may come to rest within the step.
        to_average: Whether the coefficients change on the way and are to be averaged over it.
        body: The body.
        balance: Of momentum over h.
        points: Base points.
        axes: The anisotropy.
        pin: That may touch it.

    Returns:
        Velocity (3), centre of the load that the moments ask for (2), how the one on the base follows it (3), and the
        impulse that the pin takes (3).
    """
    lever, free = balance.lever, balance.free
    l0, l1, l2 = balance.centre_x
    n0, n1, n2 = balance.centre_y
    b = balance.b
    size = math.sqrt(points.whole[3] + points.whole[5])
    slip_impulse = h * record[MU] * body.weight
    grip = normal_force(pin, v) if pin.near else 0.0
    taken = (0.0, 0.0, 0.0)
    rounding = 1e-14 * (abs(b[0]) + abs(b[1]) + abs(b[2]) / size) + 1e-300
    for outer in range(40):
        if outer > 0:
            centre, follow = onto_base(y, body.turn, n, points)
            share_load(
                n, points.x, points.y, points.weight, centre, body.weight, points.whole, points.load, points.share
            )
        for i in range(n):
            points.limit[i] = h * points.mu[i] * points.load[i]
        if outer == 0 and to_rest:
            x = _start_or_rest(n, v, balance, points, axes)
        tolerance = (1e-3 if outer == 0 else 1e-6 if outer == 1 else 1e-9) * slip_impulse + rounding
        x, g = _minimise(n, x, h, balance, points, axes, pin, grip, size, tolerance)
        # where the centre of the load must be under this friction
        e0 = free[0] + lever * b[0] + l0 * x[0] + l1 * x[1] + l2 * x[2] - y[0]
        e1 = free[1] + lever * b[1] + n0 * x[0] + n1 * x[1] + n2 * x[2] - y[1]
        missing = 0.0
        if pin.near:
            missing = normal_force(pin, x) - grip
            taken, _ = resistance(pin, x, h, grip)
            e0 += balance.by_pin * taken[0]
            e1 += balance.by_pin * taken[1]
        wanted, _follow = onto_base((y[0] + e0, y[1] + e1), body.turn, n, points)
        settled = h * abs(missing) <= 1e-6 * slip_impulse
        if outer > 0 and settled and abs(wanted[0] - centre[0]) + abs(wanted[1] - centre[1]) < 1e-8:
            y = (y[0] + e0, y[1] + e1)
            if not to_average:
                break
            to_average = False
            average_speed_effects(record, n, points.x, points.y, v, x, points.mu)
            if axes.bends:
                bend_flow(record, n, points.x, points.y, v, axes.ahead, points.mu, -1)
                bend_flow(record, n, points.x, points.y, x, axes.ahead, points.mu, 1)
            continue
        if outer >= 8 and outer % 8 > 1:
            # Newton can go round in a circle where parts of the base lift and settle: step towards the wanted centre
            y = (centre[0] + 0.5 * (wanted[0] - centre[0]), centre[1] + 0.5 * (wanted[1] - centre[1]))
            grip += 0.5 * missing
            continue
        d0, d1, d2 = _step_with_load(n, h, x, g, (e0, e1), follow, body, balance, points, axes, pin, grip)
        x = x[0] + d0, x[1] + d1, x[2] + d2
        if pin.near:
            grip = normal_force(pin, x)
        y = y[0] + e0 + l0 * d0 + l1 * d1 + l2 * d2, y[1] + e1 + n0 * d0 + n1 * d1 + n2 * d2
    return x, y, follow, taken
