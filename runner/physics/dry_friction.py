"""The compiled law: pushes at body-fixed points and distributed dry friction, inside MuJoCo's step.

A numba function is MuJoCo's `mjcb_passive`. It runs in `mj_step`, `mujoco.rollout` and `mujoco.batch.Batch`
alike, without Python and without the interpreter lock. It holds no state: everything it needs stands in the
`user` data of each body (see `LawBody`) and in `mjData.userdata`, so that several models can live in one process
and be stepped by several threads. Bodies without such a record, and models without any, are left alone.

Push. `userdata[push_adr : push_adr + 12]` holds a force F (3, N, world axes) and the first moment S = p x F^T
(3 x 3, row-major, S[i, j] = p_i F_j, N m) of its point of application p (body axes, relative to the body frame).
Both are linear in the command, so a mean over a step, a delay or a lag of the command keeps its impulse and its
angular impulse. The moment about the body frame is sum_ij (R e_i) x e_j S_ij.

Friction. The base is a set of points with load w_k. Friction is dry (Coulomb), and it is solved implicitly: the
velocity z at a fraction theta of the step h minimises

    1/2 (z - z_free)^T M (z - z_free) + theta h sum_k mu_k N_k |u_k(z)|

with u_k the slip at point k (the theta method on the friction potential: Moreau 1988; Acary & Brogliato 2008), and
the velocity at the end is v + (z - v) / theta. While the body slides, theta is 1/2, which is of second order. Where it
may come to rest within the step, theta is 1 (backward Euler): stick is then a true minimum, and the only creep is that
of the regularising speed `SLIP_EPS`. Where the motion turns within a step, as when a push reverses it, the step is
taken in parts. MuJoCo adds h times the velocity at the end to the position, so positions lead by
h (v - v_start) / 2, which a reader may subtract; angles that lead by half a step are right for the midpoint rule.

Load. N_k = w_k (a + b x_k + c y_k), clipped at zero, with a, b, c from the balance of the vertical force and of
the moments about the horizontal axes: the pushes at their height, inertia at the height of the centre of mass,
friction at the floor. It is solved together with the friction. A body under the law can't tip: where the moments ask
for more than its base can give, the load rests on the edge, and the centre that was asked for is reported.
"""

from __future__ import annotations

import ctypes
import math
from dataclasses import dataclass, field, fields
from typing import Any

import mujoco
import numpy as np
from numba import carray, cfunc, njit, types
from numba.core import cgutils
from numba.extending import intrinsic

from runner.physics import passive

MAGIC = 271828.1828
PLANAR, UPRIGHT, FREE = 3, 4, 6
SLIP_EPS = 1e-7  # m/s, regularises the norm of the slip
AT_REST = 1e-5  # m/s, a slip that has no direction of its own
# A step is parted where the motion turns by such an angle (rad), or no more than such a share of it is left, from
# such a speed (m/s) on; its shortest part.
TURNED, STOPPED, STANDING, SHORTEST_PART = 0.1, 0.05, 1e-3, 0.02
CHANGED = 0.1  # the same where friction depends on speed and it changes by such a share
EDGE = 0.999  # the load's centre stays within this share of the outermost base points
PUSH_SIZE = 12
OUT_SIZE = 10
USERDATA_SIZE = PUSH_SIZE + OUT_SIZE  # per body

# Offsets inside the `userdata` block of a body, after the push: friction (world axes, N, film included), its moment
# about the body frame (N m), where the moments ask the load to be (body axes, m; beyond the base it would tip),
# share of the base that is lifted, speed at the end of the step (m/s), power of friction (W, mean over the step), load
# on the base (N), yaw rate (rad/s).
OUT_FORCE, OUT_TORQUE, OUT_COP, OUT_LIFTED, OUT_SLIP, OUT_POWER, OUT_LOAD, OUT_TURN = 0, 2, 3, 5, 6, 7, 8, 9


@dataclass
class LawBody:
    """What the law knows of one body: the first numbers of the body's `user` data, in this order.

    Lengths in m, speeds in m/s, angles in rad. A neutral value switches an effect off.
    """

    magic: float = MAGIC
    joints: float = PLANAR  # PLANAR: slide x, slide y, hinge z; UPRIGHT: with slide z after y; FREE: a free joint
    push_adr: float = 0  # start of the body's block in userdata
    points: float = 0  # base points; 0: pushes only
    base_z: float = 0.0  # height of the base in the body frame (negative)
    mu: float = 0.0
    # mu * along on the body axis at aniso_angle, mu * across at right angles to it: friction lies on that ellipse.
    # normality 1: slip is at right angles to it (associated); 0: every axis by itself, mu (along p, across q) / u
    along: float = 1.0
    across: float = 1.0
    aniso_angle: float = 0.0
    normality: float = 1.0
    # mu * (1 + stribeck * exp(-(u / stribeck_speed)^2))
    stribeck: float = 0.0
    stribeck_speed: float = 0.1
    # mu * (1 + stiction * exp(-(u / stiction_speed)^2))
    stiction: float = 0.0
    stiction_speed: float = 2e-3
    # mu * (1 + patch * s), s = 1 inside a disc of the floor, with a smooth edge
    patch: float = 0.0
    patch_x: float = 0.0
    patch_y: float = 0.0
    patch_radius: float = 0.5
    # a film under the base: force -film / points at each point, against its slip; N s/m in all
    film: float = 0.0
    # -air_drag |v| v at the body frame's origin; N s2/m2
    air_drag: float = 0.0
    # mass and inertia times (1 - mass_leak * t); 1/s
    mass_leak: float = 0.0
    # load carried by the base points besides the weight share: w_k (1 + pressure * shape_k)
    pressure: float = 0.0
    # half sizes of the base, to tell how much of it is lifted
    half_x: float = 0.0
    half_y: float = 0.0


FIELDS = tuple(f.name for f in fields(LawBody))
STRIDE = len(FIELDS)
COLUMN = {name: i for i, name in enumerate(FIELDS)}
POINT_STRIDE = 4  # x, y, weight, pressure shape

(
    _MAGIC, _JOINTS, _PUSH, _PNUM, _BASEZ, _MU, _ALONG, _ACROSS, _ANGLE, _NORMALITY, _STRIBECK, _STRIBECK_V, _STICTION,
    _STICTION_V, _PATCH, _PATCH_X, _PATCH_Y, _PATCH_R, _FILM, _AIR, _LEAK, _PRESSURE, _HALF_X, _HALF_Y,
) = range(STRIDE)  # fmt: skip


def base_points(half_x: float, half_y: float, n: int = 8) -> np.ndarray:
    """Return quadrature points of a rectangular base under even load, shape (n*n, 4).

    Columns: x, y (m, body frame), weight (sums to 1), and the shape of a rim-heavy pressure (mean 0, +1 at the
    rim's middle radius). Gauss-Legendre in both axes.
    """
    nodes, weights = np.polynomial.legendre.leggauss(n)
    x, y = (a.ravel() for a in np.meshgrid(nodes, nodes, indexing="ij"))
    w = np.outer(weights, weights).ravel() / 4.0
    return _with_shape(x * half_x, y * half_y, w, np.maximum(abs(x), abs(y)))


def corner_points(half_x: float, half_y: float) -> np.ndarray:
    """Return the four corners as base points, shape (4, 4), for an object that bears on its corners only."""
    x, y = np.array([1.0, 1, -1, -1]), np.array([1.0, -1, 1, -1])
    return _with_shape(x * half_x, y * half_y, np.full(4, 0.25), np.ones(4))


def _with_shape(x: np.ndarray, y: np.ndarray, w: np.ndarray, radius: np.ndarray) -> np.ndarray:
    # radius: 0 at the middle, 1 at the edge. 2 r^2 - 1 has mean 0 over the square, as r^2 averages 1/2.
    shape = 2.0 * radius**2 - 1.0
    shape = shape - np.sum(w * shape)
    return np.column_stack([x, y, w, shape])


def pack(body: LawBody, points: np.ndarray) -> np.ndarray:
    """Return the `user` data of a body under the law: its record, then its base points, (n, 4), n may be 0."""
    body.points = len(points)
    return np.concatenate([[float(getattr(body, name)) for name in FIELDS], np.asarray(points, float).ravel()])


@dataclass(frozen=True)
class LawView:
    """Read and write access to a body's record inside a compiled model, by field name."""

    model: mujoco.MjModel = field(repr=False)
    body_id: int

    def __getitem__(self, name: str) -> float:
        return float(self.model.body_user[self.body_id, COLUMN[name]])

    def __setitem__(self, name: str, value: float) -> None:
        self.model.body_user[self.body_id, COLUMN[name]] = value


def _cast(typing_context, address):
    def codegen(context, builder, signature, args):
        return builder.inttoptr(args[0], cgutils.voidptr_t)

    return types.voidptr(types.uint64), codegen


_as_pointer: Any = intrinsic(_cast)


@njit(cache=True, error_model="numpy")
def _load(base, offset, size):
    pointer = carray(_as_pointer(types.uint64(base + offset)), (1,), types.uint64)
    return carray(_as_pointer(pointer[0]), (size,), types.float64)


@njit(cache=True, error_model="numpy")
def _scalar(base, offset):
    return carray(_as_pointer(types.uint64(base + offset)), (1,), types.float64)[0]


@njit(cache=True, error_model="numpy")
def _solve3(h00, h01, h02, h11, h12, h22, g0, g1, g2):
    a = h11 * h22 - h12 * h12
    b = h02 * h12 - h01 * h22
    c = h01 * h12 - h02 * h11
    det = h00 * a + h01 * b + h02 * c
    d = h00 * h22 - h02 * h02
    e = h01 * h02 - h00 * h12
    f = h00 * h11 - h01 * h01
    return (a * g0 + b * g1 + c * g2) / det, (b * g0 + d * g1 + e * g2) / det, (c * g0 + e * g1 + f * g2) / det


@njit(cache=True, error_model="numpy")
def _solve3_any(a00, a01, a02, a10, a11, a12, a20, a21, a22, g0, g1, g2):
    c00 = a11 * a22 - a12 * a21
    c01 = a12 * a20 - a10 * a22
    c02 = a10 * a21 - a11 * a20
    det = a00 * c00 + a01 * c01 + a02 * c02
    x0 = c00 * g0 + (a02 * a21 - a01 * a22) * g1 + (a01 * a12 - a02 * a11) * g2
    x1 = c01 * g0 + (a00 * a22 - a02 * a20) * g1 + (a02 * a10 - a00 * a12) * g2
    x2 = c02 * g0 + (a01 * a20 - a00 * a21) * g1 + (a00 * a11 - a01 * a10) * g2
    return x0 / det, x1 / det, x2 / det


@njit(cache=True, error_model="numpy", fastmath={"nnan", "ninf", "contract", "reassoc", "arcp", "nsz"})
def _cost(v, n, rx, ry, k, along, across):
    """Frictional potential at velocity v."""
    x0, x1, x2 = v
    total = 0.0
    for i in range(n):
        p = along * (x0 - x2 * ry[i])
        q = across * (x1 + x2 * rx[i])
        total += k[i] * math.sqrt(p * p + q * q + SLIP_EPS * SLIP_EPS)
    return total


@njit(cache=True, error_model="numpy", fastmath={"nnan", "ninf", "contract", "reassoc", "arcp", "nsz"})
def _terms(v, n, rx, ry, k, along, across, out):
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


@njit(cache=True, error_model="numpy", fastmath={"nnan", "ninf", "contract", "reassoc", "arcp", "nsz"})
def _coupling(v, n, rx, ry, w, mu, load, along, across, out):
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


@njit(cache=True, error_model="numpy")
def _moments(n, rx, ry, w, a, b, c, out):
    """Zeroth to second moments of the weights where a + b x + c y > 0 (6), and of the load there (3)."""
    s0 = sx = sy = sxx = sxy = syy = 0.0
    for i in range(n):
        x, y = rx[i], ry[i]
        if a + b * x + c * y > 0.0:
            wx, wy = w[i] * x, w[i] * y
            s0 += w[i]
            sx += wx
            sy += wy
            sxx += wx * x
            sxy += wx * y
            syy += wy * y
    out[0], out[1], out[2], out[3], out[4], out[5] = s0, sx, sy, sxx, sxy, syy
    out[6] = a * s0 + b * sx + c * sy
    out[7] = a * sx + b * sxx + c * sxy
    out[8] = a * sy + b * sxy + c * syy


@njit(cache=True, error_model="numpy")
def _share_load(n, rx, ry, w, centre, weight, whole, load, share):
    """Fill `load` with N_k = weight * w_k max(a + b x_k + c y_k, 0) with this centre (cx, cy).

    `whole` holds the moments of all weights, `share` receives a, b, c and the moments of those that bear. Where part
    of the base is lifted, a, b, c minimise the convex 1/2 sum_k w_k max(p_k, 0)^2 - (a + b cx + c cy), by Newton.
    The centre must lie inside the base.
    """
    cx, cy = centre
    a, b, c = _solve3(whole[0], whole[1], whole[2], whole[3], whole[4], whole[5], 1.0, cx, cy)
    lowest = 1.0
    for i in range(n):
        p = a + b * rx[i] + c * ry[i]
        load[i] = weight * w[i] * p
        lowest = min(lowest, p)
    if lowest > 0.0:
        share[0], share[1], share[2] = a, b, c
        for i in range(6):
            share[3 + i] = whole[i]
        return
    s = share[3:12]
    _moments(n, rx, ry, w, a, b, c, s)
    size = whole[3] + whole[5]
    for _ in range(60):
        g0, g1, g2 = s[6] - 1.0, s[7] - cx, s[8] - cy
        if abs(g0) + (abs(g1) + abs(g2)) / math.sqrt(size) < 1e-13:
            break
        # the ridge matters only where no more than a line of points bears
        ridge = 1e-13
        d0, d1, d2 = _solve3(s[0] + ridge, s[1], s[2], s[3] + ridge * size, s[4], s[5] + ridge * size, g0, g1, g2)
        slope = g0 * d0 + g1 * d1 + g2 * d2
        step = 1.0
        for _ls in range(30):
            na, nb, nc = a - step * d0, b - step * d1, c - step * d2
            _moments(n, rx, ry, w, na, nb, nc, s)
            past = -((s[6] - 1.0) * d0 + (s[7] - cx) * d1 + (s[8] - cy) * d2)
            if past <= 0.5 * slope:
                break
            step *= max(slope / (slope + past), 0.1)
        a, b, c = na, nb, nc
    total = 0.0
    for i in range(n):
        load[i] = w[i] * max(a + b * rx[i] + c * ry[i], 0.0)
        total += load[i]
    for i in range(n):
        load[i] *= weight / total
    share[0], share[1], share[2] = a, b, c


@njit(cache=True, error_model="numpy")
def _lifted_share(share, turn, half, reach):
    """Share of the base |x| <= hx, |y| <= hy where the load is negative: above zero as soon as a corner lifts."""
    a, p, q = share[0], share[1], share[2]
    b = abs(turn[0] * p - turn[1] * q) * max(half[0], reach[0])
    c = abs(turn[1] * p + turn[0] * q) * max(half[1], reach[1])
    b, c = max(b, c), min(b, c)
    if a >= b + c:
        return 0.0
    if c < 1e-9 * b:
        return min(max(0.5 * (1.0 - a / b), 0.0), 1.0)
    area = max(b + c - a, 0.0) ** 2 - max(b - c - a, 0.0) ** 2 - max(c - b - a, 0.0) ** 2 + max(-b - c - a, 0.0) ** 2
    return area / (8.0 * b * c)


@njit(cache=True, error_model="numpy")
def _times(m, x):
    """Product of a symmetric matrix (row-major upper) with a vector."""
    m00, m01, m02, m11, m12, m22 = m
    x0, x1, x2 = x
    return m00 * x0 + m01 * x1 + m02 * x2, m01 * x0 + m11 * x1 + m12 * x2, m02 * x0 + m12 * x1 + m22 * x2


@njit(cache=True, error_model="numpy")
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(cache=True, error_model="numpy")
def _along(x, step, p):
    return x[0] + step * p[0], x[1] + step * p[1], x[2] + step * p[2]


@njit(cache=True, error_model="numpy")
def _plus(m, h, d):
    """Sum m + h d of symmetric matrices."""
    return m[0] + h * d[0], m[1] + h * d[1], m[2] + h * d[2], m[3] + h * d[3], m[4] + h * d[4], m[5] + h * d[5]


@njit(cache=True, error_model="numpy")
def _coefficients(num, r, n, rx, ry, v, place, mu):
    """Fill `mu` with each point's friction coefficient at velocity v; tell whether it depends on v."""
    for i in range(n):
        mu[i] = num[r + _MU]
    stribeck, stiction, patch = num[r + _STRIBECK], num[r + _STICTION], num[r + _PATCH]
    if patch != 0.0:
        px, py, angle = place
        c, s = math.cos(angle), math.sin(angle)
        radius = num[r + _PATCH_R]
        for i in range(n):
            dx = px + c * rx[i] - s * ry[i] - num[r + _PATCH_X]
            dy = py + s * rx[i] + c * ry[i] - num[r + _PATCH_Y]
            z = (math.sqrt(dx * dx + dy * dy) - radius) / (0.08 * radius)
            if z < 30.0:
                mu[i] *= 1.0 + patch / (1.0 + math.exp(z))
    if stribeck == 0.0 and stiction == 0.0:
        return False
    stribeck_2 = num[r + _STRIBECK_V] * num[r + _STRIBECK_V]
    stiction_2 = num[r + _STICTION_V] * num[r + _STICTION_V]
    for i in range(n):
        ux = v[0] - v[2] * ry[i]
        uy = v[1] + v[2] * rx[i]
        u2 = ux * ux + uy * uy
        mu[i] *= 1.0 + stribeck * math.exp(-u2 / stribeck_2) + stiction * math.exp(-u2 / stiction_2)
    return True


@njit(cache=True, error_model="numpy")
def _flow(num, r, n, rx, ry, v, ahead, mu, sign):
    """Multiply `mu` (`sign` 1, or divide it: -1) by what makes the flow one of less normality than the potential's.

    f = -N mu (a^(1+g) p, b^(1+g) q) / sqrt((a^g p)^2 + (b^g q)^2), a and b along and across, g the normality, is the
    friction of the potential in sqrt(a^(1+g) p^2 + b^(1+g) q^2) but for a factor by the direction of the slip (p, q).
    A point at rest would slip where `ahead` points.
    """
    along, across, normality = num[r + _ALONG], num[r + _ACROSS], num[r + _NORMALITY]
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


@njit(cache=True, error_model="numpy")
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


@njit(cache=True, error_model="numpy")
def _average_speed_effects(num, r, n, rx, ry, v, x, mu):
    """Turn friction coefficients that hold at velocity v into their mean on the way from v to x."""
    stribeck, stiction = num[r + _STRIBECK], num[r + _STICTION]
    slow, still = num[r + _STRIBECK_V], num[r + _STICTION_V]
    for i in range(n):
        ux, uy = v[0] - v[2] * ry[i], v[1] + v[2] * rx[i]
        u2 = ux * ux + uy * uy
        before = 1.0 + stribeck * math.exp(-u2 / (slow * slow)) + stiction * math.exp(-u2 / (still * still))
        dx, dy = x[0] - x[2] * ry[i] - ux, x[1] + x[2] * rx[i] - uy
        mean = 1.0
        if stribeck != 0.0:
            mean += stribeck * _mean_bump(ux, uy, dx, dy, slow)
        if stiction != 0.0:
            mean += stiction * _mean_bump(ux, uy, dx, dy, still)
        mu[i] *= mean / before


@njit(cache=True, error_model="numpy")
def _onto_base(y, turn, reach):
    """Return the place of the base that is nearest to y (2), and how it follows y (3, row-major upper)."""
    cr, sr = turn
    x, z = cr * y[0] - sr * y[1], sr * y[0] + cr * y[1]
    free_x = free_y = 1.0
    if abs(x) > EDGE * reach[0]:
        x, free_x = math.copysign(EDGE * reach[0], x), 0.0
    if abs(z) > EDGE * reach[1]:
        z, free_y = math.copysign(EDGE * reach[1], z), 0.0
    follow = (cr * cr * free_x + sr * sr * free_y, cr * sr * (free_y - free_x), sr * sr * free_x + cr * cr * free_y)
    return (cr * x + sr * z, cr * z - sr * x), follow


@njit(cache=True, error_model="numpy")
def _advance(num, r, n, h, v, force, m, damping, com, weight, heights, free, place, turn):
    """Return the velocity at the end of a step, the friction, where the load is, and how much of the base is lifted.

    All in the axes of the law, which are turned against the body. Velocity, load and friction are solved together:
    the load is affine in its centre, and its centre in the friction. For a given load the velocity is the minimum of
    a convex function, found by Newton with a line search. In between, one Newton step goes in velocity and centre.

    Friction is that of the velocity at a fraction `theta` of the step: 1/2 (midpoint rule, of second order) while
    the body slides, 1 (backward Euler, which can stop) where it may come to rest within the step. There a coefficient
    that changes with the slip is first that of the start of the step, so that a body at rest yields where static
    friction does, and then the mean on the way: a body that breaks away is held by static friction for no more than
    the part of the step that it is slow.

    Args:
        num: The model's `user` data; the body's record starts at `r`, `n` base points follow it.
        r: See `num`.
        n: See `num`.
        h: Step.
        v: Velocity (x, y, yaw) at the start of the step.
        force: Generalised force without friction, drag and centrifugal force (3).
        m: Mass matrix (row-major upper).
        damping: Joint damping (row-major upper).
        com: Mass times the centre of mass (2).
        weight: What the base carries.
        heights: Of the centre of mass above the base and above the body frame (2).
        free: Centre of the load without friction and drag (2).
        place: World position of the body frame (2) and the angle of the axes in the world.
        turn: cos, sin of the angle of the axes in the body.

    Returns:
        Velocity (3), friction (3), centre of the load that the moments ask for (2, body axes), lifted share.
    """
    record = r + STRIDE
    com_height, com_z = heights
    cr, sr = turn
    rx, ry, w, mu, load, k = np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    out, whole, share = np.empty(10), np.empty(9), np.empty(12)
    bears = n > 0 and weight > 0.0

    film, pressure = num[r + _FILM], num[r + _PRESSURE]
    f0 = f2 = f4 = f5 = 0.0
    reach_x = reach_y = total = 0.0
    for i in range(n):
        j = record + POINT_STRIDE * i
        bx, by = num[j], num[j + 1]
        rx[i] = cr * bx + sr * by
        ry[i] = cr * by - sr * bx
        w[i] = num[j + 2] * max(1.0 + pressure * num[j + 3], 0.0)
        total += w[i]
        if w[i] > 0.0:
            reach_x = max(reach_x, abs(bx))
            reach_y = max(reach_y, abs(by))
        if film > 0.0:
            z = film * num[j + 2]
            f0 += z
            f2 -= z * ry[i]
            f4 += z * rx[i]
            f5 += z * (rx[i] * rx[i] + ry[i] * ry[i])
    films = (f0, 0.0, f2, f0, f4, f5)
    reach = (reach_x, reach_y)
    along, across = num[r + _ALONG], num[r + _ACROSS]
    turns = along != across and num[r + _NORMALITY] != 1.0
    speed_counts = _coefficients(num, r, n, rx, ry, v, place, mu) or turns
    ahead = v
    if turns:
        along, across = along ** (0.5 + 0.5 * num[r + _NORMALITY]), across ** (0.5 + 0.5 * num[r + _NORMALITY])
        # a slip that friction answers with what opposes the force
        ahead = _solve3(*m, *force)
        ahead = ahead[0] / (along * along), ahead[1] / (across * across), ahead[2]
        _flow(num, r, n, rx, ry, v, ahead, mu, 1)

    # forces and friction at the start of the step, for a first look ahead
    air = num[r + _AIR] * math.sqrt(v[0] * v[0] + v[1] * v[1])
    d0, d1, d2 = _times(_plus(damping, 1.0, films), v)
    e = (
        force[0] - d0 - air * v[0] + v[2] * v[2] * com[0],
        force[1] - d1 - air * v[1] + v[2] * v[2] * com[1],
        force[2] - d2,
    )
    y = centre = free
    follow = (1.0, 0.0, 1.0)
    rub = (0.0, 0.0, 0.0)
    stiff = 0.0
    if bears:
        for i in range(n):
            w[i] /= total
        _moments(n, rx, ry, w, 1.0, 0.0, 0.0, whole)
        _coupling(v, n, rx, ry, w, mu, w, along, across, out)
        stiff = 0.5 * h * weight * out[9] / m[0]
        # friction is linear in a, b, c, so they follow from one system
        a, b, c = _solve3_any(
            whole[0], whole[1], whole[2],
            whole[1] - com_height * out[0], whole[3] - com_height * out[3], whole[4] - com_height * out[6],
            whole[2] - com_height * out[1], whole[4] - com_height * out[4], whole[5] - com_height * out[7],
            1.0, free[0], free[1],
        )  # fmt: skip
        y = (a * whole[1] + b * whole[3] + c * whole[4], a * whole[2] + b * whole[4] + c * whole[5])
        centre, follow = _onto_base(y, turn, reach)
        _share_load(n, rx, ry, w, centre, weight, whole, load, share)
        if share[3] == whole[0] and follow[0] == 1.0 and follow[2] == 1.0:
            rub = (
                weight * (a * out[0] + b * out[3] + c * out[6]),
                weight * (a * out[1] + b * out[4] + c * out[7]),
                weight * (a * out[2] + b * out[5] + c * out[8]),
            )
        else:
            for i in range(n):
                k[i] = mu[i] * load[i]
            _terms(v, n, rx, ry, k, along, across, out)
            rub = (out[0], out[1], out[2])

    # theta by how much of the momentum a step may take, and by how stiff friction is across the slip
    theta = 0.5
    ae = _solve3(*m, *e)
    ar = _solve3(*m, *rub)
    if bears:
        momentum = math.sqrt(_dot(v, _times(m, v)))
        impulse = h * (math.sqrt(abs(_dot(ae, e))) + math.sqrt(abs(_dot(ar, rub))))
        change = max(impulse, stiff * momentum)
        theta = 1.0 if change >= momentum else 0.5 + 0.5 * (change / momentum) ** 2
    acceleration = (ae[0] - ar[0], ae[1] - ar[1], ae[2] - ar[2])
    p = _along(v, (1.0 - theta) * h, acceleration)
    if speed_counts:
        _coefficients(num, r, n, rx, ry, p, place, mu)
        if turns:
            _flow(num, r, n, rx, ry, p, ahead, mu, 1)

    # drag, linear around p, belongs to the matrix
    h *= theta
    air = num[r + _AIR] * math.sqrt(p[0] * p[0] + p[1] * p[1])
    own = damping
    e = (force[0] + p[2] * p[2] * com[0], force[1] + p[2] * p[2] * com[1], force[2])
    if air > 0.0:
        speed_2 = p[0] * p[0] + p[1] * p[1]
        xx, xy, yy = p[0] * p[0] / speed_2, p[0] * p[1] / speed_2, p[1] * p[1] / speed_2
        own = _plus(damping, air, (1.0 + xx, xy, 0.0, 1.0 + yy, 0.0, 0.0))
        e = (e[0] + air * p[0], e[1] + air * p[1], e[2])
        if bears:
            free = (free[0] - com_z * air * p[0] / weight, free[1] - com_z * air * p[1] / weight)
    dry = _plus(m, h, own)
    q = _plus(dry, h, films)
    b = _along(_times(m, v), h, e)

    x = _along(v, h, acceleration)
    if not bears:
        x = _solve3(*q, *b)
    # friction shifts the load by this much per impulse, drag by this much per force
    lever = com_height / (weight * h) if bears else 0.0
    lift = com_z / weight if bears else 0.0
    l0, l1, l2 = lift * own[0] - lever * dry[0], lift * own[1] - lever * dry[1], lift * own[2] - lever * dry[2]
    n0, n1, n2 = l1, lift * own[3] - lever * dry[3], lift * own[4] - lever * dry[4]
    size = math.sqrt(whole[3] + whole[5]) if bears else 1.0
    slip_impulse = h * num[r + _MU] * weight
    rounding = 1e-14 * (abs(b[0]) + abs(b[1]) + abs(b[2]) / size) + 1e-300
    to_average = speed_counts and theta == 1.0
    for outer in range(40 if bears else 0):
        if outer > 0:
            centre, follow = _onto_base(y, turn, reach)
            _share_load(n, rx, ry, w, centre, weight, whole, load, share)
        for i in range(n):
            k[i] = h * mu[i] * load[i]
        if outer == 0 and theta == 1.0:
            # start from where it was or from rest, whichever is lower
            x = v
            cost = 0.5 * _dot(x, _times(q, x)) - _dot(b, x) + _cost(x, n, rx, ry, k, along, across)
            if cost >= _cost((0.0, 0.0, 0.0), n, rx, ry, k, along, across):
                x = (0.0, 0.0, 0.0)
        _terms(x, n, rx, ry, k, along, across, out)
        g = _residual(q, x, b, out)
        tolerance = (1e-3 if outer == 0 else 1e-6 if outer == 1 else 1e-9) * slip_impulse + rounding
        for _ in range(40):
            if abs(g[0]) + abs(g[1]) + abs(g[2]) / size < tolerance:
                break
            d = _solve3(
                q[0] + out[3], q[1] + out[4], q[2] + out[5], q[3] + out[6], q[4] + out[7], q[5] + out[8], *g
            )  # fmt: skip
            slope = _dot(g, d)
            step = 1.0
            start = x
            # convex: shorten by the secant rule until the slope along the step is small
            for _ls in range(30):
                x = _along(start, -step, d)
                _terms(x, n, rx, ry, k, along, across, out)
                g = _residual(q, x, b, out)
                past = -_dot(g, d)
                if past <= 0.5 * slope:
                    break
                step *= max(slope / (slope + past), 0.1)
        # where the centre of the load must be under this friction
        e0 = free[0] + lever * b[0] + l0 * x[0] + l1 * x[1] + l2 * x[2] - y[0]
        e1 = free[1] + lever * b[1] + n0 * x[0] + n1 * x[1] + n2 * x[2] - y[1]
        wanted, _follow = _onto_base((y[0] + e0, y[1] + e1), turn, reach)
        if outer > 0 and abs(wanted[0] - centre[0]) + abs(wanted[1] - centre[1]) < 1e-8:
            y = (y[0] + e0, y[1] + e1)
            if not to_average:
                break
            to_average = False
            _average_speed_effects(num, r, n, rx, ry, v, x, mu)
            if turns:
                _flow(num, r, n, rx, ry, v, ahead, mu, -1)
                _flow(num, r, n, rx, ry, x, ahead, mu, 1)
            continue
        if outer >= 8 and outer % 8 > 1:
            # Newton can go round in a circle where parts of the base lift and settle: step towards the wanted centre
            y = (centre[0] + 0.5 * (wanted[0] - centre[0]), centre[1] + 0.5 * (wanted[1] - centre[1]))
            continue
        q00, q01, q02 = q[0] + out[3], q[1] + out[4], q[2] + out[5]
        q11, q12, q22 = q[3] + out[6], q[4] + out[7], q[5] + out[8]
        _coupling(x, n, rx, ry, w, mu, load, along, across, out)
        # d(a, b, c) by the centre, where it may move; times h * weight for the impulse
        sx = _solve3(share[3], share[4], share[5], share[6], share[7], share[8], 0.0, h * weight, 0.0)
        sy = _solve3(share[3], share[4], share[5], share[6], share[7], share[8], 0.0, 0.0, h * weight)
        u0, u1, u2 = _along((follow[0] * sx[0], follow[0] * sx[1], follow[0] * sx[2]), follow[1], sy)
        w0, w1, w2 = _along((follow[1] * sx[0], follow[1] * sx[1], follow[1] * sx[2]), follow[2], sy)
        c00, c01 = out[0] * u0 + out[3] * u1 + out[6] * u2, out[0] * w0 + out[3] * w1 + out[6] * w2
        c10, c11 = out[1] * u0 + out[4] * u1 + out[7] * u2, out[1] * w0 + out[4] * w1 + out[7] * w2
        c20, c21 = out[2] * u0 + out[5] * u1 + out[8] * u2, out[2] * w0 + out[5] * w1 + out[8] * w2
        d0, d1, d2 = _solve3_any(
            q00 + c00 * l0 + c01 * n0, q01 + c00 * l1 + c01 * n1, q02 + c00 * l2 + c01 * n2,
            q01 + c10 * l0 + c11 * n0, q11 + c10 * l1 + c11 * n1, q12 + c10 * l2 + c11 * n2,
            q02 + c20 * l0 + c21 * n0, q12 + c20 * l1 + c21 * n1, q22 + c20 * l2 + c21 * n2,
            -g[0] - c00 * e0 - c01 * e1, -g[1] - c10 * e0 - c11 * e1, -g[2] - c20 * e0 - c21 * e1,
        )  # fmt: skip
        x = x[0] + d0, x[1] + d1, x[2] + d2
        y = y[0] + e0 + l0 * d0 + l1 * d1 + l2 * d2, y[1] + e1 + n0 * d0 + n1 * d1 + n2 * d2
    lifted = 1.0
    if bears:
        lifted = _lifted_share(share, turn, (num[r + _HALF_X], num[r + _HALF_Y]), reach)
        if follow[0] < 1.0 or follow[2] < 1.0:
            # as if it could bear all that the moments ask for: four corners are held down until they tip
            a, b_x, b_y = _solve3(whole[0], whole[1], whole[2], whole[3], whole[4], whole[5], 1.0, y[0], y[1])
            share[0], share[1], share[2] = a, b_x, b_y
            lifted = max(lifted, _lifted_share(share, turn, (num[r + _HALF_X], num[r + _HALF_Y]), reach))
    # from the balance of momentum: exact also where the regularised law is stiff
    i0, i1, i2 = _times(dry, x)
    rub = ((i0 - b[0]) / h, (i1 - b[1]) / h, (i2 - b[2]) / h)
    end = v[0] + (x[0] - v[0]) / theta, v[1] + (x[1] - v[1]) / theta, v[2] + (x[2] - v[2]) / theta
    return end, rub, (cr * y[0] - sr * y[1], sr * y[0] + cr * y[1]), lifted


@njit(cache=True, error_model="numpy")
def _residual(q, x, b, out):
    q0, q1, q2 = _times(q, x)
    return q0 - b[0] + out[0], q1 - b[1] + out[1], q2 - b[2] + out[2]


@njit(cache=True, error_model="numpy")
def _through(num, r, n, h, v, force, m, damping, com, weight, heights, free, place, turn):
    """Advance by a step, in parts where the motion turns round within it; see `_advance`, which this returns as.

    A body that stops under a push that is stronger than friction goes back at once, and friction turns with the slip.
    One implicit step would hold it until the end of the step, by friction of the direction that it has there.
    """
    part, passed = h, 0.0
    rub0 = rub1 = rub2 = 0.0
    least = STANDING * STANDING * m[0]
    by_speed = num[r + _STRIBECK] != 0.0 or num[r + _STICTION] != 0.0
    while True:
        end, rub, cop, lifted = _advance(num, r, n, part, v, force, m, damping, com, weight, heights, free, place, turn)
        momentum = _times(m, v)
        motion, goes_on, after = _dot(v, momentum), _dot(end, momentum), _dot(end, _times(m, end))
        turned = goes_on < STOPPED * motion or goes_on * goes_on < (1.0 - TURNED * TURNED) * motion * after
        if by_speed:
            turned = turned or motion - 2.0 * goes_on + after > CHANGED * CHANGED * motion
        if turned and motion > least and n > 0 and part > SHORTEST_PART * h:
            part *= 0.5
            continue
        rub0, rub1, rub2 = rub0 + part * rub[0], rub1 + part * rub[1], rub2 + part * rub[2]
        v, passed = end, passed + part
        if h - passed < 1e-9 * h:
            break
        part = min(2.0 * part, h - passed)
    return end, (rub0 / h, rub1 / h, rub2 / h), cop, lifted


@njit(cache=True, error_model="numpy")
def _step_body(
    num, r, body, dof, qadr, gravity, h, t, mass_a, inertia_a, ipos_a, iquat_a, qpos, qvel, xfrc, user, applied,
    passive, damping,
):  # fmt: skip
    push = int(num[r + _PUSH])
    n = int(num[r + _PNUM])
    yaw = qpos[qadr + 2]
    c, s = math.cos(yaw), math.sin(yaw)
    v0, v1, v2 = qvel[dof], qvel[dof + 1], qvel[dof + 2]
    o = 6 * body
    out0, out1, out2, out3, out4, out5 = xfrc[o], xfrc[o + 1], xfrc[o + 2], xfrc[o + 3], xfrc[o + 4], xfrc[o + 5]

    # inertia about the vertical through the body frame
    full = mass_a[body]
    scale = max(1.0 - num[r + _LEAK] * (t + 0.5 * h), 0.05)
    mass = full * scale
    qw, qx, qy, qz = iquat_a[4 * body], iquat_a[4 * body + 1], iquat_a[4 * body + 2], iquat_a[4 * body + 3]
    zx, zy, zz = 2.0 * (qx * qz - qw * qy), 2.0 * (qy * qz + qw * qx), 1.0 - 2.0 * (qx * qx + qy * qy)
    izz = inertia_a[3 * body] * zx * zx + inertia_a[3 * body + 1] * zy * zy + inertia_a[3 * body + 2] * zz * zz
    comx, comy, comz = ipos_a[3 * body], ipos_a[3 * body + 1], ipos_a[3 * body + 2]
    lx, ly = c * comx - s * comy, s * comx + c * comy
    i_origin = izz + full * (comx * comx + comy * comy)

    # push: force and moment about the body frame
    fx, fy, fz = user[push], user[push + 1], user[push + 2]
    sxx, sxy, sxz = user[push + 3], user[push + 4], user[push + 5]
    syx, syy, syz = user[push + 6], user[push + 7], user[push + 8]
    szx, szy = user[push + 9], user[push + 10]
    tz = (c * sxy - s * sxx) - (s * syy + c * syx)

    # forces on the joints (through the body frame), and at the centre of mass, where inertia acts, too
    k0, k1, k2 = damping[dof], damping[dof + 1], damping[dof + 2]
    joint0, joint1 = passive[dof] + k0 * v0 + applied[dof] + fx, passive[dof + 1] + k1 * v1 + applied[dof + 1] + fy
    com0, com1 = out0 + mass * gravity[0], out1 + mass * gravity[1]
    e0, e1 = joint0 + com0, joint1 + com1
    e2 = passive[dof + 2] + k2 * v2 + applied[dof + 2] + out5 + tz + lx * com1 - ly * com0

    # where the load must be without friction, from the moments about the centre of mass
    weight = -mass * gravity[2] - fz - out2
    mx = (weight + fz) * lx - (c * sxz - s * syz) + szx - comz * joint0 + out4
    my = (weight + fz) * ly - (s * sxz + c * syz) + szy - comz * joint1 - out3
    if weight > 0.0:
        mx /= weight
        my /= weight

    # into the axes of the law, and back
    turn = num[r + _ANGLE] if num[r + _ALONG] != num[r + _ACROSS] else 0.0
    cr, sr = math.cos(turn), math.sin(turn)
    ca, sa = math.cos(yaw + turn), math.sin(yaw + turn)
    px, py = cr * comx + sr * comy, cr * comy - sr * comx
    end, rub, cop, lifted = _through(
        num, r, n, h, (ca * v0 + sa * v1, ca * v1 - sa * v0, v2), (ca * e0 + sa * e1, ca * e1 - sa * e0, e2),
        (mass, 0.0, -mass * py, mass, mass * px, scale * i_origin),
        (k0 * ca * ca + k1 * sa * sa, ca * sa * (k1 - k0), 0.0, k0 * sa * sa + k1 * ca * ca, 0.0, k2),
        (mass * px, mass * py), weight, (comz - num[r + _BASEZ], comz), (ca * mx + sa * my, ca * my - sa * mx),
        (qpos[qadr], qpos[qadr + 1], yaw + turn), (cr, sr),
    )  # fmt: skip
    x0, x1, x2 = ca * end[0] - sa * end[1], sa * end[0] + ca * end[1], end[2]
    rub0, rub1, rub2 = ca * rub[0] - sa * rub[1], sa * rub[0] + ca * rub[1], rub[2]

    # what MuJoCo must be given so that its step, with its own mass and implicit damping, ends at x
    d0, d1, d2 = (x0 - v0) / h, (x1 - v1) / h, (x2 - v2) / h
    n00, n11 = full + h * k0, full + h * k1
    n02, n12, n22 = -full * ly, full * lx, i_origin + h * k2
    want0 = n00 * d0 + n02 * d2 - full * v2 * v2 * lx - full * gravity[0]
    want1 = n11 * d1 + n12 * d2 - full * v2 * v2 * ly - full * gravity[1]
    want2 = n02 * d0 + n12 * d1 + n22 * d2 - full * (lx * gravity[1] - ly * gravity[0])
    passive[dof] = want0 - applied[dof] - out0
    passive[dof + 1] = want1 - applied[dof + 1] - out1
    passive[dof + 2] = want2 - applied[dof + 2] - out5 - lx * out1 + ly * out0

    o = push + PUSH_SIZE
    user[o] = rub0
    user[o + 1] = rub1
    user[o + 2] = rub2
    user[o + 3] = cop[0]
    user[o + 4] = cop[1]
    user[o + 5] = lifted
    user[o + 6] = math.sqrt(x0 * x0 + x1 * x1)
    user[o + 7] = 0.5 * (rub0 * (x0 + v0) + rub1 * (x1 + v1) + rub2 * (x2 + v2))
    user[o + 8] = max(weight, 0.0)
    user[o + 9] = x2


@njit(cache=True, error_model="numpy")
def _push_free(num, r, dof, q, qpos, user, passive):
    """Push on a body with a free joint: force at the frame's origin, moment in body axes (MuJoCo's convention)."""
    q += 3
    push = int(num[r + _PUSH])
    w, x, y, z = qpos[q], qpos[q + 1], qpos[q + 2], qpos[q + 3]
    rot = np.empty((3, 3))
    rot[0, 0] = 1 - 2 * (y * y + z * z)
    rot[0, 1] = 2 * (x * y - w * z)
    rot[0, 2] = 2 * (x * z + w * y)
    rot[1, 0] = 2 * (x * y + w * z)
    rot[1, 1] = 1 - 2 * (x * x + z * z)
    rot[1, 2] = 2 * (y * z - w * x)
    rot[2, 0] = 2 * (x * z - w * y)
    rot[2, 1] = 2 * (y * z + w * x)
    rot[2, 2] = 1 - 2 * (x * x + y * y)
    t0 = t1 = t2 = 0.0
    for i in range(3):
        s0, s1, s2 = user[push + 3 + 3 * i], user[push + 4 + 3 * i], user[push + 5 + 3 * i]
        t0 += rot[1, i] * s2 - rot[2, i] * s1
        t1 += rot[2, i] * s0 - rot[0, i] * s2
        t2 += rot[0, i] * s1 - rot[1, i] * s0
    for i in range(3):
        passive[dof + i] += user[push + i]
        passive[dof + 3 + i] += rot[0, i] * t0 + rot[1, i] * t1 + rot[2, i] * t2


@njit(cache=True, error_model="numpy")
def _push_upright(num, r, dof, q, qpos, user, passive):
    """Push on a body with slides x, y, z and a hinge about z."""
    push = int(num[r + _PUSH])
    c, s = math.cos(qpos[q + 3]), math.sin(qpos[q + 3])
    sxx, sxy, syx, syy = user[push + 3], user[push + 4], user[push + 6], user[push + 7]
    passive[dof] += user[push]
    passive[dof + 1] += user[push + 1]
    passive[dof + 2] += user[push + 2]
    passive[dof + 3] += (c * sxy - s * sxx) - (s * syy + c * syx)


_MODEL_ARRAYS = (
    "body_user", "body_mass", "body_inertia", "body_ipos", "body_iquat", "dof_damping", "body_dofadr", "body_jntadr",
    "jnt_qposadr",
)  # fmt: skip
_DATA_ARRAYS = ("qpos", "qvel", "xfrc_applied", "userdata", "qfrc_applied", "qfrc_passive")


def _find(address: int, wanted: int | float, size: int = 400_000) -> int:
    """Return the byte offset of a struct's field from a value that nothing else there has."""
    kind = ctypes.c_double if isinstance(wanted, float) else ctypes.c_uint64
    raw = (kind * (size // 8)).from_address(address)
    for i in range(size // 8):
        if raw[i] == wanted:
            return 8 * i
    raise RuntimeError(
        f"mujoco {mujoco.__version__}: a field that the compiled law needs was not found; pin mujoco==3.17.0."
    )


def _offsets() -> tuple[int, ...]:
    """Measure where this MuJoCo build keeps the fields that the law reads; no header is needed."""
    xml = (
        """<mujoco><size nuser_body="7919" nuserdata="6007"/><option timestep="0.00123456789"/><worldbody>
    """
        + 16 * """<body><joint type="slide"/><joint axis="0 1 0"/><geom size=".1"/></body>"""
        + "</worldbody></mujoco>"
    )
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    data.time = 0.00198765432101
    m, d = model._address, data._address  # type: ignore[attr-defined]
    return (
        _find(m, 7919, 4000),
        _find(m, 17, 4000),
        _find(m, 0.00123456789, 4000),
        model.opt.gravity.ctypes.data - m,
        _find(d, 0.00198765432101),
        *(_find(m, getattr(model, name).ctypes.data) for name in _MODEL_ARRAYS),
        *(_find(d, getattr(data, name).ctypes.data) for name in _DATA_ARRAYS),
    )


@njit(cache=True, error_model="numpy")
def _ints(base, offset, size):
    pointer = carray(_as_pointer(types.uint64(base + offset)), (1,), types.uint64)
    return carray(_as_pointer(pointer[0]), (size,), types.int32)


def _compile(
    o_nuser, o_nbody, o_dt, o_gravity, o_time, o_user, o_mass, o_inertia, o_ipos, o_iquat, o_damping, o_dofadr,
    o_jntadr, o_qposadr, o_qpos, o_qvel, o_xfrc, o_userdata, o_applied, o_passive,
):  # fmt: skip
    """Compile the callback for these offsets. They are closure cells, so that numba's cache tells builds apart."""

    @cfunc("void(uint64, uint64)", cache=True)
    def law(m, d):
        nuser = carray(_as_pointer(types.uint64(m + o_nuser)), (1,), types.int64)[0]
        if nuser < STRIDE:
            return
        big = 1 << 30
        num = _load(m, o_user, big)
        nbody = carray(_as_pointer(types.uint64(m + o_nbody)), (1,), types.int64)[0]
        for body in range(1, nbody):
            r = body * nuser
            if num[r] != MAGIC:
                continue
            dof = _ints(m, o_dofadr, big)[body]
            qadr = _ints(m, o_qposadr, big)[_ints(m, o_jntadr, big)[body]]
            kind = num[r + _JOINTS]
            qpos = _load(d, o_qpos, big)
            user = _load(d, o_userdata, big)
            passive = _load(d, o_passive, big)
            if kind == FREE:
                _push_free(num, r, dof, qadr, qpos, user, passive)
            elif kind == UPRIGHT:
                _push_upright(num, r, dof, qadr, qpos, user, passive)
            else:
                gravity = carray(_as_pointer(types.uint64(m + o_gravity)), (3,), types.float64)
                _step_body(
                    num, r, body, dof, qadr, gravity, _scalar(m, o_dt), _scalar(d, o_time),
                    _load(m, o_mass, big), _load(m, o_inertia, big), _load(m, o_ipos, big), _load(m, o_iquat, big),
                    qpos, _load(d, o_qvel, big), _load(d, o_xfrc, big), user, _load(d, o_applied, big), passive,
                    _load(m, o_damping, big),
                )  # fmt: skip

    return law


_INSTALLED: list[object] = []


def install() -> None:
    """Give the law to MuJoCo, once per process. The first call on a machine compiles it (some seconds)."""
    if not _INSTALLED:
        _INSTALLED.append(_compile(*_offsets()))
        passive.install(_INSTALLED[0])
