"""One step of a planar body under dry friction: velocity, friction and load, implicitly.

All stands in the axes of friction, which are turned against the body. Vectors of three are (x, y, yaw), symmetric
matrices are row-major upper.

The functions of a step are inlined into one (`forceinline`, here and in `planar`, `points`, `settle` and `load`):
handing over some ten arrays from call to call would take a quarter of the step's time.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from numba import njit

from runner.physics.dry_friction.coefficients import depends_on_speed, largest_change
from runner.physics.dry_friction.kernel import derivatives, gradient_by_load
from runner.physics.dry_friction.load import lifted_points, lifted_share, moments, onto_base, share_load
from runner.physics.dry_friction.matrix3 import Symmetric, Triple, along, dot, plus, solve, solve_any, times
from runner.physics.dry_friction.pin import Touch, pin_over
from runner.physics.dry_friction.points import anisotropy, lay_out, set_coefficients
from runner.physics.dry_friction.record import COLUMN
from runner.physics.dry_friction.settle import AIR_DRAG, balance_of_momentum, settle

# A step is parted where the motion turns by such an angle (rad), or no more than such a share of it is left, from
# such a speed (m/s) on; its shortest part.
TURNED, STOPPED, STANDING, SHORTEST_PART = 0.1, 0.05, 1e-3, 0.02
# The same where friction depends on speed, which changes by such a share, and the coefficient perhaps by such a one:
# what changes less within a step is, at its middle, as good as constant.
CHANGED, CHANGED_FRICTION = 0.1, 0.01

HALF_X, HALF_Y = COLUMN["half_x"], COLUMN["half_y"]


class PlanarBody(NamedTuple):
    """What a step takes of a body, besides its velocity and its record."""

    force: Triple  # generalised, without friction, drag and centrifugal force
    mass: Symmetric
    damping: Symmetric  # of the joints
    first_moment: tuple[float, float]  # mass times the centre of mass
    weight: float  # what the base carries
    com_height: float  # of the centre of mass above the base
    com_z: float  # of the centre of mass above the body frame
    free_centre: tuple[float, float]  # of the load without friction and drag
    place: Triple  # world position of the body frame, and the angle of the axes in the world
    turn: tuple[float, float]  # cos, sin of the angle of the axes in the body
    touch: Touch  # of a pin


@njit(error_model="numpy", forceinline=True)
def _force_at_start(record, v, body, films):
    """Return all of the force but friction at the start of the step, for a first look ahead."""
    air = record[AIR_DRAG] * math.sqrt(v[0] * v[0] + v[1] * v[1])
    d0, d1, d2 = times(plus(body.damping, 1.0, films), v)
    return (
        body.force[0] - d0 - air * v[0] + v[2] * v[2] * body.first_moment[0],
        body.force[1] - d1 - air * v[1] + v[2] * v[2] * body.first_moment[1],
        body.force[2] - d2,
    )


@njit(error_model="numpy", forceinline=True)
def _friction_at_start(n, v, body, points, axes):
    """Share the load as friction at the start of the step has it.

    Returns:
        Centre of the load that the moments ask for (2), the nearest to it on the base (2) and how that follows (3),
        friction (3), and how stiff friction is across the slip.
    """
    whole, sums, share, height, free = points.whole, points.sums, points.share, body.com_height, body.free_centre
    gradient_by_load(v, n, points.x, points.y, points.weight, points.mu, points.weight, axes.along, axes.across, sums)
    stiff = sums[9]
    # friction is linear in a, b, c, so they follow from one system
    a, b, c = solve_any(
        whole[0], whole[1], whole[2],
        whole[1] - height * sums[0], whole[3] - height * sums[3], whole[4] - height * sums[6],
        whole[2] - height * sums[1], whole[4] - height * sums[4], whole[5] - height * sums[7],
        1.0, free[0], free[1],
    )  # fmt: skip
    y = (a * whole[1] + b * whole[3] + c * whole[4], a * whole[2] + b * whole[4] + c * whole[5])
    centre, follow = onto_base(y, body.turn, n, points)
    share_load(n, points.x, points.y, points.weight, centre, body.weight, whole, points.load, share)
    if share[3] == whole[0] and follow[0] == 1.0 and follow[2] == 1.0:
        rub = (
            body.weight * (a * sums[0] + b * sums[3] + c * sums[6]),
            body.weight * (a * sums[1] + b * sums[4] + c * sums[7]),
            body.weight * (a * sums[2] + b * sums[5] + c * sums[8]),
        )
    else:
        for i in range(n):
            points.limit[i] = points.mu[i] * points.load[i]
        derivatives(v, n, points.x, points.y, points.limit, axes.along, axes.across, sums)
        rub = (sums[0], sums[1], sums[2])
    return y, centre, follow, rub, stiff


@njit(error_model="numpy", forceinline=True)
def _theta(h, v, mass, force, by_force, rub, by_rub, stiff):
    """Return theta by how much of the momentum a step may take, and by how stiff friction is across the slip."""
    momentum = math.sqrt(dot(v, times(mass, v)))
    impulse = h * (math.sqrt(abs(dot(by_force, force))) + math.sqrt(abs(dot(by_rub, rub))))
    change = max(impulse, stiff * momentum)
    return 1.0 if change >= momentum else 0.5 + 0.5 * (change / momentum) ** 2


@njit(error_model="numpy", forceinline=True)
def _lifted(record, n, points, turn, follow, y):
    """Return the share of the base that is lifted under the load that the moments ask for, its centre at y."""
    if points.base[3] > 0.0:
        return lifted_points(n, points.x, points.y, points.weight, points.share)
    whole, share, half = points.whole, points.share, (record[HALF_X], record[HALF_Y])
    lifted = lifted_share(share, turn, half, points.reach)
    if follow[0] < 1.0 or follow[2] < 1.0:
        # as if it could bear all that the moments ask for: four corners are held down until they tip
        a, b_x, b_y = solve(whole[0], whole[1], whole[2], whole[3], whole[4], whole[5], 1.0, y[0], y[1])
        share[0], share[1], share[2] = a, b_x, b_y
        lifted = max(lifted, lifted_share(share, turn, half, points.reach))
    return lifted


@njit(error_model="numpy", forceinline=True)
def implicit_step(record, n, h, v, body, gap, room):
    """Return the velocity at the end of a step, the friction, where the load is, how much is lifted, and a pin's force.

    Velocity, load and friction are solved together: the load is affine in its centre, and its centre in the friction.

    Friction is that of the velocity at a fraction `theta` of the step: 1/2 (midpoint rule, of second order) while
    the body slides, 1 (backward Euler, which can stop) where it may come to rest within the step. There a coefficient
    that changes with the slip is first that of the start of the step, so that a body at rest yields where static
    friction does, and then the mean on the way: a body that breaks away is held by static friction for no more than
    the part of the step that it is slow.

    Args:
        record: The body's `user` data: its record and `n` base points.
        n: See `record`.
        h: Step.
        v: Velocity (x, y, yaw) at the start of the step.
        body: The body.
        gap: Between it and a pin at the start of the step, m.
        room: Memory for the points, `room_for` them.

    Returns:
        Velocity (3), friction (3), centre of the load that the moments ask for (2, body axes), lifted share, force of
        the pin (3).
    """
    mass = body.mass
    bears = n > 0 and body.weight > 0.0
    pin = pin_over(record, body.touch, gap, h, v)
    points, total = lay_out(record, n, body.turn, room)
    axes = anisotropy(record, v, body)
    speed_counts = depends_on_speed(record) or axes.bends
    set_coefficients(record, n, points, axes, v, body.place)

    # a first look ahead, from the start of the step
    e = _force_at_start(record, v, body, points.films)
    y = centre = body.free_centre
    follow = (1.0, 0.0, 1.0)
    rub = (0.0, 0.0, 0.0)
    stiff = 0.0
    if bears:
        for i in range(n):
            points.weight[i] /= total
        moments(n, points.x, points.y, points.weight, 1.0, 0.0, 0.0, points.whole)
        y, centre, follow, rub, stiff = _friction_at_start(n, v, body, points, axes)
        stiff = 0.5 * h * body.weight * stiff / mass[0]

    ae = solve(*mass, *e)
    ar = solve(*mass, *rub)
    # the midpoint rule would let a body bounce on a stiff contact for ever
    theta = 1.0 if pin.near else _theta(h, v, mass, e, ae, rub, ar, stiff) if bears else 0.5
    acceleration = (ae[0] - ar[0], ae[1] - ar[1], ae[2] - ar[2])
    p = along(v, (1.0 - theta) * h, acceleration)
    if speed_counts:
        set_coefficients(record, n, points, axes, p, body.place)

    h *= theta
    balance = balance_of_momentum(record, h, v, p, body, points.films, bears)
    lifted = 1.0
    taken = (0.0, 0.0, 0.0)
    if bears:
        x, to_rest = along(v, h, acceleration), theta == 1.0
        x, y, follow, taken = settle(
            record, n, h, v, x, y, centre, follow, to_rest, speed_counts and to_rest, body, balance, points, axes, pin
        )
        lifted = _lifted(record, n, points, body.turn, follow, y)
    else:
        x = solve(*balance.q, *balance.b)
    # from the balance of momentum: exact also where the regularised friction is stiff
    i0, i1, i2 = times(balance.dry, x)
    b = balance.b
    rub = ((i0 - b[0] + taken[0]) / h, (i1 - b[1] + taken[1]) / h, (i2 - b[2] + taken[2]) / h)
    end = v[0] + (x[0] - v[0]) / theta, v[1] + (x[1] - v[1]) / theta, v[2] + (x[2] - v[2]) / theta
    cr, sr = body.turn
    held = (-taken[0] / h, -taken[1] / h, -taken[2] / h)
    return end, rub, (cr * y[0] - sr * y[1], sr * y[0] + cr * y[1]), lifted, held


@njit(error_model="numpy", forceinline=True)
def step_in_parts(record, n, h, v, body, room):
    """Advance by a step, in parts where the motion turns round within it; see `implicit_step`, which this returns as.

    A body that stops under a push that is stronger than friction goes back at once, and friction turns with the slip.
    One implicit step would hold it until the end of the step, by friction of the direction that it has there.
    """
    m = body.mass
    part, passed = h, 0.0
    rub0 = rub1 = rub2 = held0 = held1 = 0.0
    gap = body.touch.gap
    least = STANDING * STANDING * m[0]
    by_speed = depends_on_speed(record)
    while True:
        end, rub, cop, lifted, held = implicit_step(record, n, part, v, body, gap, room)
        momentum = times(m, v)
        motion, goes_on, after = dot(v, momentum), dot(end, momentum), dot(end, times(m, end))
        turned = goes_on < STOPPED * motion or goes_on * goes_on < (1.0 - TURNED * TURNED) * motion * after
        if by_speed:
            change = motion - 2.0 * goes_on + after
            slip = math.sqrt(max(change, 0.0) / m[0])
            slower = change > CHANGED * CHANGED * motion and largest_change(record, slip) > CHANGED_FRICTION
            turned = turned or slower
        if turned and motion > least and n > 0 and part > SHORTEST_PART * h:
            part *= 0.5
            continue
        rub0, rub1, rub2 = rub0 + part * rub[0], rub1 + part * rub[1], rub2 + part * rub[2]
        held0, held1 = held0 + part * held[0], held1 + part * held[1]
        gap += part * (body.touch.speed - dot(body.touch.normal, end))
        v, passed = end, passed + part
        if h - passed < 1e-9 * h:
            break
        part = min(2.0 * part, h - passed)
    return end, (rub0 / h, rub1 / h, rub2 / h), cop, lifted, (held0 / h, held1 / h)
