"""A round pin that moves as it is told and touches a body: where, and its part in the balance of momentum.

The normal force on the body is N = max(0, d (n.u + s)), n.u the speed of the touched point towards the pin, d the
damper and the spring over the step together, s such that a gap closes just as far as there is one. A pin that is found
inside the body pushes it out no faster than `RECOVERY`: places that were measured may overlap, and a spring would fling
the body away. Friction across is dry: at most mu N, against the slip. Vectors of three are generalised (x, y, yaw).
"""

from __future__ import annotations

import math
from typing import NamedTuple

from numba import njit

from runner.physics.dry_friction.kernel import SLIP_EPS
from runner.physics.dry_friction.matrix3 import Triple, dot
from runner.physics.dry_friction.record import CIRCLE, COLUMN, POINT_STRIDE, SIDES, STRIDE

PIN_RADIUS, PIN_FRICTION = COLUMN["pin_radius"], COLUMN["pin_friction"]
PIN_STIFFNESS, PIN_DAMPING = COLUMN["pin_stiffness"], COLUMN["pin_damping"]
POINTS, CORNERS = COLUMN["points"], COLUMN["corners"]

RECOVERY = 0.01  # m/s; errors of a millimetre are gone after a tenth of a second, and hardly seen in the velocity
AHEAD = 2.0  # a pin counts as near that the two could reach within so many steps at their speeds
TOUCHING = 1e-6  # m


class Touch(NamedTuple):
    """Where a pin is to a body at the start of a step."""

    gap: float  # m; below zero: it overlaps
    normal: Triple  # from the body to the pin, as a generalised direction of the touched point
    across: Triple  # to the left of it
    speed: float  # of the pin along the normal, m/s
    slide: float  # of the pin across


class Pin(NamedTuple):
    """A contact over a step of a given length."""

    near: bool
    normal: Triple
    across: Triple
    damper: float  # N s/m
    closing: float  # m/s, `s` of the module's docstring
    slide: float
    mu: float


@njit(error_model="numpy")
def _along_sides(record, first, sides, x, y, nearest, inside):
    """Return the nearest place on the sides from one to before another, or what it was, as squared distance and place.

    And whether (x, y) is inside, as far as these sides tell: as often as a ray crosses one, that changes.
    """
    nearest_2, near_x, near_y = nearest
    begin, end, before = sides
    j = first + 2 * before
    ax, ay = record[j], record[j + 1]
    for k in range(begin, end):
        bx, by = record[first + 2 * k], record[first + 2 * k + 1]
        dx, dy = bx - ax, by - ay
        part = ((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy)
        part = min(max(part, 0.0), 1.0)
        qx, qy = ax + part * dx, ay + part * dy
        far_2 = (x - qx) * (x - qx) + (y - qy) * (y - qy)
        if far_2 < nearest_2:
            nearest_2, near_x, near_y = far_2, qx, qy
        if (ay > y) != (by > y) and x < dx * (y - ay) / dy + ax:
            inside = not inside
        ax, ay = bx, by
    return (nearest_2, near_x, near_y), inside


@njit(error_model="numpy")
def nearest_on_outline(record, first, count, x, y):
    """Return the signed distance of a place in body axes from the outline, above zero outside, and the nearest point.

    The corners, `count` of them, begin at `first` in the body's `user` data; behind them are the circles around
    `SIDES` sides at a time. Sides are passed over whose circle is farther away than what was found, and which a ray
    to the right cannot cross.
    """
    circles, groups = first + 2 * count, (count + SIDES - 1) // SIDES
    nearest_group, least_2 = 0, math.inf
    for g in range(groups):
        cx, cy = record[circles + CIRCLE * g], record[circles + CIRCLE * g + 1]
        far_2 = (x - cx) * (x - cx) + (y - cy) * (y - cy)
        if far_2 < least_2:
            nearest_group, least_2 = g, far_2
    nearest, inside, far = (math.inf, 0.0, 0.0), False, math.inf
    for i in range(groups):
        # the nearest group first, in the place of the first
        g = nearest_group if i == 0 else 0 if i == nearest_group else i
        cx, cy = record[circles + CIRCLE * g], record[circles + CIRCLE * g + 1]
        radius = record[circles + CIRCLE * g + 2]
        reach = far + radius
        farther = (x - cx) * (x - cx) + (y - cy) * (y - cy) > reach * reach
        if farther and (abs(y - cy) > radius or x > cx + radius):
            continue
        sides = SIDES * g, min(SIDES * (g + 1), count), (SIDES * g if g > 0 else count) - 1
        nearest, inside = _along_sides(record, first, sides, x, y, nearest, inside)
        far = math.sqrt(nearest[0])
    return (-far if inside else far), nearest[1], nearest[2]


@njit(error_model="numpy")
def no_touch():
    """Return what stands for a pin that is not there."""
    nothing = (0.0, 0.0, 0.0)
    return Touch(math.inf, nothing, nothing, 0.0, 0.0)


@njit(error_model="numpy")
def touch_of(record, place, px, py, vx, vy):
    """Return where a pin at (px, py) that moves at (vx, vy), world axes, is to a body.

    Args:
        record: The body's `user` data.
        place: World position of the body frame and its angle, and that of the axes in which the answer is, in the body.
        px: Centre of the pin.
        py: Centre of the pin.
        vx: Its velocity.
        vy: Its velocity.
    """
    x, y, yaw, turn = place
    c, s = math.cos(yaw), math.sin(yaw)
    bx, by = c * (px - x) + s * (py - y), c * (py - y) - s * (px - x)
    first = STRIDE + POINT_STRIDE * int(record[POINTS])
    far, qx, qy = nearest_on_outline(record, first, int(record[CORNERS]), bx, by)
    if far == 0.0:
        return no_touch()  # no side to push to
    nx, ny = (bx - qx) / far, (by - qy) / far
    # into the axes of friction
    ct, st = math.cos(turn), math.sin(turn)
    qx, qy = ct * qx + st * qy, ct * qy - st * qx
    nx, ny = ct * nx + st * ny, ct * ny - st * nx
    ca, sa = math.cos(yaw + turn), math.sin(yaw + turn)
    ux, uy = ca * vx + sa * vy, ca * vy - sa * vx
    normal = (nx, ny, qx * ny - qy * nx)
    across = (-ny, nx, qx * nx + qy * ny)
    return Touch(far - record[PIN_RADIUS], normal, across, ux * nx + uy * ny, uy * nx - ux * ny)


@njit(error_model="numpy")
def pin_over(record, touch, gap, h, v):
    """Return the contact over a step h that begins at velocity v with this gap."""
    approach = abs(dot(touch.normal, v)) + abs(touch.speed)
    near = gap < TOUCHING + AHEAD * h * approach
    damper = h * record[PIN_STIFFNESS] + record[PIN_DAMPING]
    closing = 0.0
    if near:
        closing = min(-record[PIN_STIFFNESS] * gap / damper, RECOVERY) - touch.speed
    return Pin(near, touch.normal, touch.across, damper, closing, touch.slide, record[PIN_FRICTION])


@njit(error_model="numpy")
def normal_force(pin, x):
    """Return what the pin pushes with at velocity x, N."""
    return max(pin.damper * (dot(pin.normal, x) + pin.closing), 0.0)


@njit(error_model="numpy")
def slip_share(pin, x):
    """Return how much of its limit the friction of the pin uses at velocity x, by sign, and its stiffness, s/m."""
    slip = dot(pin.across, x) - pin.slide
    size = math.sqrt(slip * slip + SLIP_EPS * SLIP_EPS)
    share = slip / size
    return share, (1.0 - share * share) / size


@njit(error_model="numpy")
def resistance(pin, x, h, grip):
    """Return the impulse (3) that the pin takes over h at velocity x, and how it follows x (6, row-major upper).

    The friction is that of a normal force `grip`. They are gradient and Hessian of a convex potential.
    """
    n, a = pin.normal, pin.across
    force = normal_force(pin, x)
    share, stiff = slip_share(pin, x)
    along, across = h * force, h * pin.mu * grip * share
    k, m = (h * pin.damper if force > 0.0 else 0.0), h * pin.mu * grip * stiff
    impulse = (along * n[0] + across * a[0], along * n[1] + across * a[1], along * n[2] + across * a[2])
    follow = (
        k * n[0] * n[0] + m * a[0] * a[0],
        k * n[0] * n[1] + m * a[0] * a[1],
        k * n[0] * n[2] + m * a[0] * a[2],
        k * n[1] * n[1] + m * a[1] * a[1],
        k * n[1] * n[2] + m * a[1] * a[2],
        k * n[2] * n[2] + m * a[2] * a[2],
    )
    return impulse, follow
