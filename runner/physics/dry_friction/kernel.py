"""Sums over the base points: the potential of dry friction, its derivatives, and how it follows the load.

At velocity v = (x, y, yaw) a point at (x_i, y_i) slips by (v0 - v2 y_i, v1 + v2 x_i), all in the axes of friction. The
sums may be taken in any order (`fastmath`): they are what a step spends its time in.
"""

from __future__ import annotations

import math

from numba import njit

SLIP_EPS = 1e-7  # m/s, regularises the norm of the slip


@njit(error_model="numpy", fastmath={"nnan", "ninf", "contract", "reassoc", "arcp", "nsz"})
def potential(v, n, rx, ry, k, along, across):
    """Frictional potential at velocity v, for friction of at most k_i at point i."""
    x0, x1, x2 = v
    total = 0.0
    for i in range(n):
        p = along * (x0 - x2 * ry[i])
        q = across * (x1 + x2 * rx[i])
        total += k[i] * math.sqrt(p * p + q * q + SLIP_EPS * SLIP_EPS)
    return total


@njit(error_model="numpy", fastmath={"nnan", "ninf", "contract", "reassoc", "arcp", "nsz"})
def derivatives(v, n, rx, ry, k, along, across, out):
    """Gradient (3) and Hessian (6, row-major upper) of the frictional potential, into `out`."""
    x0, x1, x2 = v
    g0 = g1 = g2 = 0.0
    h00 = h01 = h02 = h11 = h12 = h22 = 0.0
    for i in range(n):
        x = rx[i]
        y = ry[i]
        p = along * (x0 - x2 * y)
        q = across * (x1 + x2 * x)
        s = 1.0 / math.sqrt(p * p + q * q + SLIP_EPS * SLIP_EPS)
        p *= s
        q *= s
        gx = k[i] * along * p
        gy = k[i] * across * q
        g0 += gx
        g1 += gy
        g2 += x * gy - y * gx
        s *= k[i]
        a = s * along * along * (1.0 - p * p)
        d = s * across * across * (1.0 - q * q)
        b = -s * along * across * p * q
        jx = b * x - a * y
        jy = d * x - b * y
        h00 += a
        h01 += b
        h11 += d
        h02 += jx
        h12 += jy
        h22 += x * jy - y * jx
    out[0] = g0
    out[1] = g1
    out[2] = g2
    out[3] = h00
    out[4] = h01
    out[5] = h02
    out[6] = h11
    out[7] = h12
    out[8] = h22


@njit(error_model="numpy", fastmath={"nnan", "ninf", "contract", "reassoc", "arcp", "nsz"})
def gradient_by_load(v, n, rx, ry, w, mu, load, along, across, out):
    """Gradient of the potential per a, b, c of the load, 3 x 3 by columns, and its stiffness, into `out`."""
    x0, x1, x2 = v
    stiff = 0.0
    a0 = a1 = a2 = b0 = b1 = b2 = c0 = c1 = c2 = 0.0
    for i in range(n):
        x = rx[i]
        y = ry[i]
        p = along * (x0 - x2 * y)
        q = across * (x1 + x2 * x)
        s = (mu[i] * w[i] if load[i] > 0.0 else 0.0) / math.sqrt(p * p + q * q + SLIP_EPS * SLIP_EPS)
        stiff += s
        gx = s * along * p
        gy = s * across * q
        gz = x * gy - y * gx
        a0 += gx
        a1 += gy
        a2 += gz
        b0 += x * gx
        b1 += x * gy
        b2 += x * gz
        c0 += y * gx
        c1 += y * gy
        c2 += y * gz
    out[0], out[1], out[2] = a0, a1, a2
    out[3], out[4], out[5] = b0, b1, b2
    out[6], out[7], out[8] = c0, c1, c2
    out[9] = stiff
