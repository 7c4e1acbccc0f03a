"""The right-hand side: balance of forces and load, and the rate of the state."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from runner.blind.planar_box.physics import layout as at
from runner.blind.planar_box.physics.forces import add_surrounding, pushed
from runner.blind.planar_box.physics.friction import coefficients, solve3, sums


@njit(error_model="numpy")
def _settle_load(p, bx, by, w, mu, v0, v1, v2, m0, m1, out):
    """Return a, b, d of the load whose moments are m0, m1 and those of friction; NaN: none balances, the box tips.

    `out` is left with the sums over the points that bear.
    """
    h, eps2 = p[at.HEIGHT], p[at.EPS] * p[at.EPS]
    d11, d12, d22, q11, q12, q22 = p[at.D11], p[at.D12], p[at.D22], p[at.Q11], p[at.Q12], p[at.Q22]
    a, b, d = 1.0, 0.0, 0.0
    settled = False
    for k in range(12):
        sums(bx, by, w, mu, v0, v1, v2, d11, d12, d22, q11, q12, q22, eps2, a, b, d, out)
        na, nb, nd = solve3(
            out[0], out[1], out[2],
            out[1] - h * out[6], out[3] - h * out[7], out[4] - h * out[8],
            out[2] - h * out[9], out[4] - h * out[10], out[5] - h * out[11],
            1.0, m0, m1,
        )  # fmt: skip
        if not (math.isfinite(na) and math.isfinite(nb) and math.isfinite(nd)):
            break
        bears = k == 0 and na - abs(nb) * p[at.HX] - abs(nd) * p[at.HY] >= 0.0  # everywhere
        settled = bears or abs(na - a) + abs(nb - b) * p[at.HX] + abs(nd - d) * p[at.HY] < 1e-10 * (1.0 + abs(na))
        a, b, d = na, nb, nd
        if settled:
            break
    if not settled:
        a = math.nan
    return a, b, d


@njit(error_model="numpy")
def balance(p, y, t, mu, out):
    """Fill `mu` and the sums `out`, and return what the two callers share.

    Returns:
        a, b, d of the load; the weight W; force without friction (x, y in body axes) and torque about the geometric
        centre.
    """
    n = int(p[at.POINTS])
    bx = p[at.POINTS_AT : at.POINTS_AT + n]
    by = p[at.POINTS_AT + n : at.POINTS_AT + 2 * n]
    w = p[at.POINTS_AT + 2 * n : at.POINTS_AT + 3 * n]
    c = math.cos(y[2])
    s = math.sin(y[2])
    v0 = c * y[3] + s * y[4]
    v1 = c * y[4] - s * y[3]
    v2 = y[5]
    share = 1.0 - p[at.LEAK] * t if p[at.LEAK] != 0.0 else 1.0
    weight = p[at.WEIGHT_G] * share

    fx, fy, torque, zx, zy = pushed(p, t, c, s)
    fx, fy = add_surrounding(p, y, t, fx, fy)
    torque -= p[at.SPIN] * v2
    if p[at.COGGING] != 0.0:
        torque += p[at.COGGING] * math.sin(p[at.TEETH] * y[2] + p[at.COGGING_P])

    # gravity along the floor acts at the centre of mass
    gx = p[at.MASS] * share * p[at.GX]
    gy = p[at.MASS] * share * p[at.GY]
    cx = c * p[at.COMX] - s * p[at.COMY]
    cy = s * p[at.COMX] + c * p[at.COMY]
    torque += cx * gy - cy * gx
    fx += gx
    fy += gy
    f0 = c * fx + s * fy
    f1 = c * fy - s * fx
    film0 = -p[at.FILM] * v0
    film1 = -p[at.FILM] * v1
    torque -= p[at.FILM] * p[at.FILM_XX] * v2
    h = p[at.HEIGHT]
    # moments of the push about the height of the centre of mass, over the weight; and of the film
    m0 = p[at.COMX] + ((c * zx + s * zy) - h * film0) / weight
    m1 = p[at.COMY] + ((c * zy - s * zx) - h * film1) / weight

    level = p[at.FRICTION]
    if p[at.WEAR] != 0.0:
        level *= 1.0 + p[at.WEAR] * (p[at.ELAPSED] + t)
    if p[at.BY_POINT] > 0.0:
        coefficients(p, n, bx, by, y[0], y[1], c, s, v0, v1, v2, level, mu)
    else:
        mu[:] = level
    a, b, d = _settle_load(p, bx, by, w, mu, v0, v1, v2, m0, m1, out)
    return a, b, d, weight, f0 + film0, f1 + film1, torque


@njit(error_model="numpy")
def rate(y, t, p):
    """Time derivative of the state, shape (6,)."""
    n = int(p[at.POINTS])
    mu = np.empty(n)
    out = np.empty(15)
    a, b, d, weight, f0, f1, torque = balance(p, y, t, mu, out)
    f0 -= weight * (a * out[6] + b * out[7] + d * out[8])
    f1 -= weight * (a * out[9] + b * out[10] + d * out[11])
    torque -= weight * (a * out[12] + b * out[13] + d * out[14])
    share = 1.0 - p[at.LEAK] * t if p[at.LEAK] != 0.0 else 1.0
    mass = p[at.MASS] * share
    alpha = (torque - (p[at.COMX] * f1 - p[at.COMY] * f0)) / (p[at.INERTIA] * share)
    w2 = y[5] * y[5]
    a0 = f0 / mass + alpha * p[at.COMY] + w2 * p[at.COMX]
    a1 = f1 / mass - alpha * p[at.COMX] + w2 * p[at.COMY]
    c = math.cos(y[2])
    s = math.sin(y[2])
    dy = np.empty(6)
    dy[0] = y[3]
    dy[1] = y[4]
    dy[2] = y[5]
    dy[3] = c * a0 - s * a1
    dy[4] = s * a0 + c * a1
    dy[5] = alpha
    return dy
