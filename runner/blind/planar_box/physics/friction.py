"""Friction and load at the base points."""

from __future__ import annotations

import math

from numba import njit

from runner.blind.planar_box.physics import layout as at
from runner.blind.planar_box.physics.layout import TEXTURE_CELLS

FAST = {"nnan", "ninf", "contract", "reassoc", "arcp", "nsz"}


@njit(error_model="numpy", fastmath=FAST)
def sums(bx, by, w, mu, v0, v1, v2, d11, d12, d22, q11, q12, q22, eps2, a, b, d, out):
    """Fill `out` with moments of the load shares (6), friction sums (6) and torque sums (3) over the bearing points."""
    s0 = sx = sy = sxx = sxy = syy = 0.0
    gx0 = gxx = gxy = gy0 = gyx = gyy = t0 = tx = ty = 0.0
    for i in range(bx.size):
        x = bx[i]
        y = by[i]
        wi = w[i] if a + b * x + d * y > 0.0 else 0.0
        ux = v0 - v2 * y
        uy = v1 + v2 * x
        k = mu[i] * wi / math.sqrt(q11 * ux * ux + 2.0 * q12 * ux * uy + q22 * uy * uy + eps2)
        px = k * (d11 * ux + d12 * uy)
        py = k * (d12 * ux + d22 * uy)
        t = x * py - y * px
        s0 += wi
        sx += wi * x
        sy += wi * y
        sxx += wi * x * x
        sxy += wi * x * y
        syy += wi * y * y
        gx0 += px
        gxx += px * x
        gxy += px * y
        gy0 += py
        gyx += py * x
        gyy += py * y
        t0 += t
        tx += t * x
        ty += t * y
    out[0], out[1], out[2], out[3], out[4], out[5] = s0, sx, sy, sxx, sxy, syy
    out[6], out[7], out[8], out[9], out[10], out[11] = gx0, gxx, gxy, gy0, gyx, gyy
    out[12], out[13], out[14] = t0, tx, ty


@njit(error_model="numpy")
def _floor_texture(p, n, wx, wy):
    """Interpolate the texture at a place of the floor, between the nodes of its periodic grid."""
    grid = at.POINTS_AT + 3 * n
    gx = wx / p[at.CELL]
    gy = wy / p[at.CELL]
    ix = math.floor(gx)
    iy = math.floor(gy)
    ax = gx - ix
    ay = gy - iy
    i0 = int(ix) % TEXTURE_CELLS
    j0 = int(iy) % TEXTURE_CELLS
    i1 = (i0 + 1) % TEXTURE_CELLS
    j1 = (j0 + 1) % TEXTURE_CELLS
    value = (1.0 - ax) * ((1.0 - ay) * p[grid + TEXTURE_CELLS * i0 + j0] + ay * p[grid + TEXTURE_CELLS * i0 + j1])
    value += ax * ((1.0 - ay) * p[grid + TEXTURE_CELLS * i1 + j0] + ay * p[grid + TEXTURE_CELLS * i1 + j1])
    return value


@njit(error_model="numpy")
def coefficients(p, n, bx, by, rx, ry, c, s, v0, v1, v2, level, mu):
    """Friction coefficient at each point: patch, texture and speed."""
    eps2 = p[at.EPS] * p[at.EPS]
    stribeck, stiction, patch, texture = p[at.STRIBECK], p[at.STICTION], p[at.PATCH], p[at.TEXTURE]
    i_stribeck, exponent = 1.0 / (p[at.STRIBECK_V] * p[at.STRIBECK_V]), p[at.STRIBECK_D]
    without = 1.0 - stribeck * p[at.STRIBECK_0]
    i_stiction = 1.0 / (p[at.STICTION_V] * p[at.STICTION_V])
    for i in range(n):
        m = level
        if stribeck != 0.0 or stiction != 0.0:
            ux = v0 - v2 * by[i]
            uy = v1 + v2 * bx[i]
            u2 = ux * ux + uy * uy + eps2
            z2 = u2 * i_stribeck
            fall = math.exp(-z2 if exponent == 2.0 else -(z2 ** (0.5 * exponent)))
            m *= without + stribeck * fall + stiction * math.exp(-u2 * i_stiction)
        if patch != 0.0 or texture != 0.0:
            wx = rx + c * bx[i] - s * by[i]
            wy = ry + s * bx[i] + c * by[i]
            if patch != 0.0:
                dx = wx - p[at.PATCH_X]
                dy = wy - p[at.PATCH_Y]
                r2 = dx * dx + dy * dy
                if p[at.PATCH_DISC] > 0.0:
                    z = (math.sqrt(r2) - p[at.PATCH_R]) / 0.02
                    if z < 40.0:
                        m *= 1.0 + patch / (1.0 + math.exp(z))
                else:
                    m *= 1.0 + patch * math.exp(-0.5 * r2 / (p[at.PATCH_R] * p[at.PATCH_R]))
            if texture != 0.0:
                m *= 1.0 + texture * _floor_texture(p, n, wx, wy)
        mu[i] = m


@njit(error_model="numpy")
def solve3(m00, m01, m02, m10, m11, m12, m20, m21, m22, r0, r1, r2):
    c00 = m11 * m22 - m12 * m21
    c01 = m12 * m20 - m10 * m22
    c02 = m10 * m21 - m11 * m20
    det = m00 * c00 + m01 * c01 + m02 * c02
    x0 = (c00 * r0 + (m02 * m21 - m01 * m22) * r1 + (m01 * m12 - m02 * m11) * r2) / det
    x1 = (c01 * r0 + (m00 * m22 - m02 * m20) * r1 + (m02 * m10 - m00 * m12) * r2) / det
    x2 = (c02 * r0 + (m01 * m20 - m00 * m21) * r1 + (m00 * m11 - m01 * m10) * r2) / det
    return x0, x1, x2
