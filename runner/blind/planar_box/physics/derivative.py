"""The derivative of the right-hand side by the state, for the stiff integrator."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from runner.blind.planar_box.physics import layout as at
from runner.blind.planar_box.physics.friction import solve3
from runner.blind.planar_box.physics.motion import balance


@njit(error_model="numpy")
def _friction_by_velocity(p, n, mu, a, b, d, v0, v1, v2):
    """Return the derivative of friction by velocity under a given load, over the weight, body axes, shape (3, 3)."""
    eps2 = p[at.EPS] * p[at.EPS]
    d11, d12, d22, q11, q12, q22 = p[at.D11], p[at.D12], p[at.D22], p[at.Q11], p[at.Q12], p[at.Q22]
    h00 = h01 = h02 = h10 = h11 = h12 = h20 = h21 = h22 = 0.0
    for i in range(n):
        x = p[at.POINTS_AT + i]
        z = p[at.POINTS_AT + n + i]
        load = p[at.POINTS_AT + 2 * n + i] * (a + b * x + d * z)
        if load <= 0.0:
            continue
        k = load * mu[i]
        ux = v0 - v2 * z
        uy = v1 + v2 * x
        qx = q11 * ux + q12 * uy
        qy = q12 * ux + q22 * uy
        i2 = 1.0 / (ux * qx + uy * qy + eps2)
        k *= math.sqrt(i2)
        dx = d11 * ux + d12 * uy
        dz = d12 * ux + d22 * uy
        j00 = k * (d11 - dx * qx * i2)
        j01 = k * (d12 - dx * qy * i2)
        j10 = k * (d12 - dz * qx * i2)
        j11 = k * (d22 - dz * qy * i2)
        if p[at.STRIBECK] != 0.0 or p[at.STICTION] != 0.0:
            u2 = ux * ux + uy * uy + eps2
            e1 = p[at.STRIBECK] * math.exp(-u2 / p[at.STRIBECK_V] ** 2)
            e2 = p[at.STICTION] * math.exp(-u2 / p[at.STICTION_V] ** 2)
            g = -2.0 * k * (e1 / p[at.STRIBECK_V] ** 2 + e2 / p[at.STICTION_V] ** 2) / (1.0 + e1 + e2)
            j00 += g * dx * ux
            j01 += g * dx * uy
            j10 += g * dz * ux
            j11 += g * dz * uy
        j02 = x * j01 - z * j00
        j12 = x * j11 - z * j10
        h00 += j00
        h01 += j01
        h02 += j02
        h10 += j10
        h11 += j11
        h12 += j12
        h20 += x * j10 - z * j00
        h21 += x * j11 - z * j01
        h22 += x * j12 - z * j02
    return np.array([[h00, h01, h02], [h10, h11, h12], [h20, h21, h22]])


@njit(error_model="numpy")
def jacobian(y, t, p):
    """Derivative of the rate by the state, shape (6, 6): friction by velocity, the stiff part, and the kinematics."""
    n = int(p[at.POINTS])
    mu = np.empty(n)
    out = np.empty(15)
    a, b, d, weight, _, _, _ = balance(p, y, t, mu, out)
    c = math.cos(y[2])
    s = math.sin(y[2])
    v0 = c * y[3] + s * y[4]
    v1 = c * y[4] - s * y[3]
    v2 = y[5]
    hh = _friction_by_velocity(p, n, mu, a, b, d, v0, v1, v2)
    # the load shifts with the friction: (a, b, d) follow by the same 3 x 3 system
    h = p[at.HEIGHT]
    jac = np.zeros((6, 6))
    full = np.empty((3, 3))
    for j in range(3):
        da, db, dd = solve3(
            out[0], out[1], out[2],
            out[1] - h * out[6], out[3] - h * out[7], out[4] - h * out[8],
            out[2] - h * out[9], out[4] - h * out[10], out[5] - h * out[11],
            0.0, h * hh[0, j], h * hh[1, j],
        )  # fmt: skip
        for i in range(3):
            r = 6 + 3 * i
            full[i, j] = -weight * (hh[i, j] + out[r] * da + out[r + 1] * db + out[r + 2] * dd)
    full[0, 0] -= p[at.DRAG] + p[at.FILM]
    full[1, 1] -= p[at.DRAG] + p[at.FILM]
    full[2, 2] -= p[at.SPIN] + p[at.FILM] * p[at.FILM_XX]
    share = 1.0 - p[at.LEAK] * t if p[at.LEAK] != 0.0 else 1.0
    for j in range(3):
        f0, f1, torque = full[0, j], full[1, j], full[2, j]
        alpha = (torque - (p[at.COMX] * f1 - p[at.COMY] * f0)) / (p[at.INERTIA] * share)
        a0 = f0 / (p[at.MASS] * share) + alpha * p[at.COMY]
        a1 = f1 / (p[at.MASS] * share) - alpha * p[at.COMX]
        full[0, j] = c * a0 - s * a1
        full[1, j] = s * a0 + c * a1
        full[2, j] = alpha
    # columns from body to world velocity
    for i in range(3):
        jac[i, 3 + i] = 1.0
        jac[3 + i, 3] = full[i, 0] * c - full[i, 1] * s
        jac[3 + i, 4] = full[i, 0] * s + full[i, 1] * c
        jac[3 + i, 5] = full[i, 2]
    return jac
