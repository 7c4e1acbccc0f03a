"""Vectors of three and symmetric 3 x 3 matrices as tuples, for compiled functions. Matrices are row-major upper."""

from __future__ import annotations

from numba import njit

Triple = tuple[float, float, float]
Symmetric = tuple[float, float, float, float, float, float]


@njit(error_model="numpy")
def solve(h00, h01, h02, h11, h12, h22, g0, g1, g2):
    """Solve a symmetric system by its cofactors."""
    a = h11 * h22 - h12 * h12
    b = h02 * h12 - h01 * h22
    c = h01 * h12 - h02 * h11
    det = h00 * a + h01 * b + h02 * c
    d = h00 * h22 - h02 * h02
    e = h01 * h02 - h00 * h12
    f = h00 * h11 - h01 * h01
    return (a * g0 + b * g1 + c * g2) / det, (b * g0 + d * g1 + e * g2) / det, (c * g0 + e * g1 + f * g2) / det


@njit(error_model="numpy")
def solve_any(a00, a01, a02, a10, a11, a12, a20, a21, a22, g0, g1, g2):
    """Solve a system that need not be symmetric (row-major)."""
    c00 = a11 * a22 - a12 * a21
    c01 = a12 * a20 - a10 * a22
    c02 = a10 * a21 - a11 * a20
    det = a00 * c00 + a01 * c01 + a02 * c02
    x0 = c00 * g0 + (a02 * a21 - a01 * a22) * g1 + (a01 * a12 - a02 * a11) * g2
    x1 = c01 * g0 + (a00 * a22 - a02 * a20) * g1 + (a02 * a10 - a00 * a12) * g2
    x2 = c02 * g0 + (a01 * a20 - a00 * a21) * g1 + (a00 * a11 - a01 * a10) * g2
    return x0 / det, x1 / det, x2 / det


@njit(error_model="numpy")
def times(m, x):
    """Product of a symmetric matrix with a vector."""
    m00, m01, m02, m11, m12, m22 = m
    x0, x1, x2 = x
    return m00 * x0 + m01 * x1 + m02 * x2, m01 * x0 + m11 * x1 + m12 * x2, m02 * x0 + m12 * x1 + m22 * x2


@njit(error_model="numpy")
def dot(a, b):
    """Inner product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(error_model="numpy")
def along(x, step, p):
    """Vector x + step p."""
    return x[0] + step * p[0], x[1] + step * p[1], x[2] + step * p[2]


@njit(error_model="numpy")
def plus(m, h, d):
    """Sum m + h d of symmetric matrices."""
    return m[0] + h * d[0], m[1] + h * d[1], m[2] + h * d[2], m[3] + h * d[3], m[4] + h * d[4], m[5] + h * d[5]
