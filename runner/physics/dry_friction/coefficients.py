"""The friction coefficient of each base point: by place, by speed, and by the direction of the slip."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from runner.physics.dry_friction.record import COLUMN

AT_REST = 1e-5  # m/s, a slip that has no direction of its own
# Squares of slips in widths of a fall: below the first nothing has fallen, over less than the second it is as good as
# even. Where a body rests, which is much of a recording, all points are there.
AS_REST, AS_ONE = 1e-18, 1e-6

MU, ALONG, ACROSS, NORMALITY = COLUMN["mu"], COLUMN["along"], COLUMN["across"], COLUMN["normality"]
STRIBECK, STRIBECK_SPEED = COLUMN["stribeck"], COLUMN["stribeck_speed"]
STRIBECK_EXPONENT, STRIBECK_REFERENCE = COLUMN["stribeck_exponent"], COLUMN["stribeck_reference"]
STICTION, STICTION_SPEED = COLUMN["stiction"], COLUMN["stiction_speed"]
PATCH, PATCH_X, PATCH_Y = COLUMN["patch"], COLUMN["patch_x"], COLUMN["patch_y"]
PATCH_RADIUS = COLUMN["patch_radius"]

# of Gauss-Legendre on [-1, 1], 8 points: the mean of a fall with another exponent than 2 has no closed form
NODES, WEIGHTS = np.polynomial.legendre.leggauss(8)


@njit(error_model="numpy")
def depends_on_speed(record):
    """Tell whether the coefficient changes with the speed of the slip."""
    return record[STRIBECK] != 0.0 or record[STICTION] != 0.0


@njit(error_model="numpy")
def _bump(u2, width, exponent):
    """Return exp(-(u / width)^exponent) at a slip whose square is u2."""
    z2 = u2 / (width * width)
    if z2 < AS_REST:
        return 1.0
    return math.exp(-z2 if exponent == 2.0 else -(z2 ** (0.5 * exponent)))


@njit(error_model="numpy")
def largest_change(record, slip):
    """Return by which share of itself the coefficient may change where the slip changes by so much, m/s.

    That is the slip of the body's mass as a whole: of what turns about itself corners slip up to 1.7 times as fast.

    Roughly: 1 - exp(-z^e) is at most z^e, and where e > 1 the curve is hardly steeper than 1 / width.
    """
    change = 0.0
    if record[STRIBECK] != 0.0:
        exponent = min(record[STRIBECK_EXPONENT], 1.0)
        change += abs(record[STRIBECK]) * min((slip / record[STRIBECK_SPEED]) ** exponent, 1.0)
    if record[STICTION] != 0.0:
        change += abs(record[STICTION]) * min(slip / record[STICTION_SPEED], 1.0)
    return change


@njit(error_model="numpy")
def coefficients(record, n, rx, ry, v, place, mu):
    """Fill `mu` with each point's friction coefficient at velocity v."""
    for i in range(n):
        mu[i] = record[MU]
    stribeck, stiction, patch = record[STRIBECK], record[STICTION], record[PATCH]
    if patch != 0.0:
        px, py, angle = place
        c, s = math.cos(angle), math.sin(angle)
        radius = record[PATCH_RADIUS]
        for i in range(n):
            dx = px + c * rx[i] - s * ry[i] - record[PATCH_X]
            dy = py + s * rx[i] + c * ry[i] - record[PATCH_Y]
            z = (math.sqrt(dx * dx + dy * dy) - radius) / (0.08 * radius)
            if z < 30.0:
                mu[i] *= 1.0 + patch / (1.0 + math.exp(z))
    if not depends_on_speed(record):
        return
    level = 1.0 - stribeck * record[STRIBECK_REFERENCE]
    speed, exponent, still = record[STRIBECK_SPEED], record[STRIBECK_EXPONENT], record[STICTION_SPEED]
    for i in range(n):
        ux = v[0] - v[2] * ry[i]
        uy = v[1] + v[2] * rx[i]
        u2 = ux * ux + uy * uy
        share = level
        if stribeck != 0.0:
            share += stribeck * _bump(u2, speed, exponent)
        if stiction != 0.0:
            share += stiction * _bump(u2, still, 2.0)
        mu[i] *= share


@njit(error_model="numpy")
def bend_flow(record, n, rx, ry, v, ahead, mu, sign):
    """Multiply `mu` (`sign` 1, or divide it: -1) by what makes the flow one of less normality than the potential's.

    f = -N mu (a^(1+g) p, b^(1+g) q) / sqrt((a^g p)^2 + (b^g q)^2), a and b along and across, g the normality, is the
    friction of the potential in sqrt(a^(1+g) p^2 + b^(1+g) q^2) but for a factor by the direction of the slip (p, q).
    A point at rest would slip where `ahead` points.
    """
    along, across, normality = record[ALONG], record[ACROSS], record[NORMALITY]
    a, b = along ** (2.0 * normality), across ** (2.0 * normality)
    c, d = along ** (1.0 + normality), across ** (1.0 + normality)
    for i in range(n):
        p, q = v[0] - v[2] * ry[i], v[1] + v[2] * rx[i]
        if p * p + q * q < AT_REST * AT_REST:
            p, q = ahead[0] - ahead[2] * ry[i], ahead[1] + ahead[2] * rx[i]
        largest = max(abs(p), abs(q))
        if largest > 0.0:
            # a force that has decayed may be so small that its square is none
            p, q = p / largest, q / largest
            factor = math.sqrt((c * p * p + d * q * q) / (a * p * p + b * q * q))
            mu[i] *= factor if sign > 0 else 1.0 / factor


@njit(error_model="numpy")
def _mean_bump(ux, uy, dx, dy, width):
    """Average exp(-(u / width)^2) on the straight way of the slip from u to u + d."""
    d2 = dx * dx + dy * dy
    if d2 < 1e-4 * width * width:
        return math.exp(-((ux + 0.5 * dx) ** 2 + (uy + 0.5 * dy) ** 2) / (width * width))
    d = math.sqrt(d2)
    before = (ux * dx + uy * dy) / d
    aside_2 = ux * ux + uy * uy - before * before
    if aside_2 > 40.0 * width * width:
        return 0.0
    passed = math.erf((before + d) / width) - math.erf(before / width)
    return math.exp(-aside_2 / (width * width)) * 0.5 * math.sqrt(math.pi) * width / d * passed


@njit(error_model="numpy")
def _mean_bump_of(ux, uy, dx, dy, width, exponent):
    """Average exp(-(u / width)^exponent) on the straight way of the slip from u to u + d."""
    if exponent == 2.0:
        return _mean_bump(ux, uy, dx, dy, width)
    if dx * dx + dy * dy < AS_ONE * width * width:
        x, y = ux + 0.5 * dx, uy + 0.5 * dy
        middle = x * x + y * y
        # near zero a curve of small exponent is too bent for its middle
        if middle > dx * dx + dy * dy or dx * dx + dy * dy < AS_REST * width * width:
            return _bump(middle, width, exponent)
    total = 0.0
    for k in range(len(NODES)):
        part = 0.5 * (1.0 + NODES[k])
        x, y = ux + part * dx, uy + part * dy
        total += 0.5 * WEIGHTS[k] * _bump(x * x + y * y, width, exponent)
    return total


@njit(error_model="numpy")
def average_speed_effects(record, n, rx, ry, v, x, mu):
    """Turn friction coefficients that hold at velocity v into their mean on the way from v to x."""
    stribeck, stiction = record[STRIBECK], record[STICTION]
    level = 1.0 - stribeck * record[STRIBECK_REFERENCE]
    slow, exponent, still = record[STRIBECK_SPEED], record[STRIBECK_EXPONENT], record[STICTION_SPEED]
    for i in range(n):
        ux, uy = v[0] - v[2] * ry[i], v[1] + v[2] * rx[i]
        u2 = ux * ux + uy * uy
        before = mean = level
        dx, dy = x[0] - x[2] * ry[i] - ux, x[1] + x[2] * rx[i] - uy
        if stribeck != 0.0:
            before += stribeck * _bump(u2, slow, exponent)
            mean += stribeck * _mean_bump_of(ux, uy, dx, dy, slow, exponent)
        if stiction != 0.0:
            before += stiction * _bump(u2, still, 2.0)
            mean += stiction * _mean_bump(ux, uy, dx, dy, still)
        mu[i] *= mean / before
