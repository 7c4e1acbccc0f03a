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
velocity at the end of the step minimises

    1/2 (v - v_free)^T M (v - v_free) + h sum_k mu_k N_k |u_k(v)|

with u_k the slip at point k (backward Euler on the friction potential: Moreau 1988; Acary & Brogliato 2008).
Stick is then a true minimum. The only creep is that of the regularising speed `SLIP_EPS`.

Load. N_k = w_k (a + b x_k + c y_k), clipped at zero, with a, b, c from the balance of the vertical force and of
the moments about the horizontal axes: the pushes at their height, inertia at the height of the centre of mass,
friction at the floor. It is iterated together with the friction.
"""

from __future__ import annotations

import ctypes
import math
from dataclasses import dataclass, field, fields

import mujoco
import numpy as np
from numba import carray, cfunc, njit, types
from numba.core import cgutils
from numba.extending import intrinsic

MAGIC = 271828.1828
PLANAR, UPRIGHT, FREE = 3, 4, 6
SLIP_EPS = 1e-7  # m/s, regularises the norm of the slip
PUSH_SIZE = 12
OUT_SIZE = 10
USERDATA_SIZE = PUSH_SIZE + OUT_SIZE  # per body

# Offsets inside the `userdata` block of a body, after the push.
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
    # mu * along on the body axis at aniso_angle, mu * across at right angles to it (elliptic, associated flow)
    along: float = 1.0
    across: float = 1.0
    aniso_angle: float = 0.0
    # mu * (1 + stribeck * exp(-(u / stribeck_speed)^2))
    stribeck: float = 0.0
    stribeck_speed: float = 0.1
    # mu * (1 + stiction) below stiction_speed
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


FIELDS = tuple(f.name for f in fields(LawBody))
STRIDE = len(FIELDS)
COLUMN = {name: i for i, name in enumerate(FIELDS)}
POINT_STRIDE = 4  # x, y, weight, pressure shape

(
    _MAGIC, _JOINTS, _PUSH, _PNUM, _BASEZ, _MU, _ALONG, _ACROSS, _ANGLE, _STRIBECK, _STRIBECK_V, _STICTION, _STICTION_V,
    _PATCH, _PATCH_X, _PATCH_Y, _PATCH_R, _FILM, _AIR, _LEAK, _PRESSURE,
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
    # radius: 0 at the middle, 1 at the edge. A pressure 1 + s (2 r^2 - 1) has mean 1 over the square, as r^2 averages 1/2.
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


@intrinsic
def _as_pointer(typingctx, address):  # noqa: ANN001, ANN202
    def codegen(context, builder, signature, args):  # noqa: ANN001, ANN202
        return builder.inttoptr(args[0], cgutils.voidptr_t)

    return types.voidptr(types.uint64), codegen


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


@njit(cache=True, error_model="numpy", fastmath={"nnan", "ninf", "contract", "reassoc", "arcp", "nsz"})
def _cost(x0, x1, x2, n, rx, ry, k1, ux_m, uy_m, cr, sr, film_h, eps2):
    """Friction part of the objective at velocity x (rates of the frictional potential)."""
    total = 0.0
    for i in range(n):
        ux = x0 - x2 * ry[i]
        uy = x1 + x2 * rx[i]
        p = ux_m * (cr * ux + sr * uy)
        q = uy_m * (cr * uy - sr * ux)
        total += k1[i] * math.sqrt(p * p + q * q + eps2)
        total += 0.5 * film_h[i] * (ux * ux + uy * uy)
    return total


@njit(cache=True, error_model="numpy", fastmath={"nnan", "ninf", "contract", "reassoc", "arcp", "nsz"})
def _terms(x0, x1, x2, n, rx, ry, k1, am, bm, cr, sr, film_h, eps2, out):
    """Gradient (3) and Hessian (6) of the friction part, into `out`."""
    g0 = g1 = g2 = 0.0
    h00 = h01 = h02 = h11 = h12 = h22 = 0.0
    for i in range(n):
        x = rx[i]
        y = ry[i]
        ux = x0 - x2 * y
        uy = x1 + x2 * x
        p = am * (cr * ux + sr * uy)
        q = bm * (cr * uy - sr * ux)
        s = 1.0 / math.sqrt(p * p + q * q + eps2)
        p *= s
        q *= s
        k = k1[i]
        # gradient and Hessian of |D R u| in the friction axes, then back to the world
        gp = k * am * p
        gq = k * bm * q
        gx = cr * gp - sr * gq + film_h[i] * ux
        gy = sr * gp + cr * gq + film_h[i] * uy
        g0 += gx
        g1 += gy
        g2 += x * gy - y * gx
        ks = k * s
        hpp = ks * am * am * (1.0 - p * p)
        hqq = ks * bm * bm * (1.0 - q * q)
        hpq = -ks * am * bm * p * q
        a = cr * cr * hpp - 2.0 * cr * sr * hpq + sr * sr * hqq + film_h[i]
        d = sr * sr * hpp + 2.0 * cr * sr * hpq + cr * cr * hqq + film_h[i]
        b = cr * sr * (hpp - hqq) + (cr * cr - sr * sr) * hpq
        h00 += a
        h01 += b
        h11 += d
        jx = -a * y + b * x
        jy = -b * y + d * x
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


@njit(cache=True, error_model="numpy")
def _share_load(n, bx, by, w, cx, cy, load, weight):
    """Fill `load` with N_k = weight * w_k (a + b x_k + c y_k), clipped at zero, with its centre at (cx, cy).

    Returns how much of the base (by weight w) is lifted. Newton on a, b, c over the points that bear.
    """
    a, b, c = 1.0, 0.0, 0.0
    lifted = 0.0
    for _ in range(30):
        s0 = sx = sy = sxx = sxy = syy = 0.0
        lifted = 0.0
        for i in range(n):
            if a + b * bx[i] + c * by[i] > 0.0:
                wi = w[i]
                s0 += wi
                sx += wi * bx[i]
                sy += wi * by[i]
                sxx += wi * bx[i] * bx[i]
                sxy += wi * bx[i] * by[i]
                syy += wi * by[i] * by[i]
            else:
                lifted += w[i]
        if s0 * sxx * syy < 1e-12 * (sxx + syy) * (sxx + syy):
            break  # bears on an edge or less: keep the last distribution
        na, nb, nc = _solve3(s0, sx, sy, sxx, sxy, syy, 1.0, cx, cy)
        done = abs(na - a) + abs(nb - b) + abs(nc - c) < 1e-12
        a, b, c = na, nb, nc
        clipped = 0.0
        for i in range(n):
            if a + b * bx[i] + c * by[i] <= 0.0:
                clipped += w[i]
        if done or clipped == lifted:
            break
    total = 0.0
    lifted = 0.0
    for i in range(n):
        p = a + b * bx[i] + c * by[i]
        if p <= 0.0:
            lifted += w[i]
            p = 0.0
        load[i] = w[i] * p
        total += load[i]
    scale = weight / total if total > 0.0 else 0.0
    for i in range(n):
        load[i] *= scale
    return lifted


@njit(cache=True, error_model="numpy")
def _step_body(
    num,
    r,
    body,
    dof,
    qadr,
    gravity,
    h,
    t,
    mass_a,
    inertia_a,
    ipos_a,
    iquat_a,
    qpos,
    qvel,
    xfrc,
    user,
    applied,
    passive,
    damping,
):
    push = int(num[r + _PUSH])
    n = int(num[r + _PNUM])
    padr = r + STRIDE
    yaw = qpos[qadr + 2]
    c, s = math.cos(yaw), math.sin(yaw)
    v0, v1, v2 = qvel[dof], qvel[dof + 1], qvel[dof + 2]

    # inertia about the centre of mass and the vertical
    scale = 1.0 - num[r + _LEAK] * t
    if scale < 0.05:
        scale = 0.05
    mass = mass_a[body] * scale
    qw, qx, qy, qz = iquat_a[4 * body], iquat_a[4 * body + 1], iquat_a[4 * body + 2], iquat_a[4 * body + 3]
    zx, zy, zz = 2.0 * (qx * qz - qw * qy), 2.0 * (qy * qz + qw * qx), 1.0 - 2.0 * (qx * qx + qy * qy)
    izz = inertia_a[3 * body] * zx * zx + inertia_a[3 * body + 1] * zy * zy + inertia_a[3 * body + 2] * zz * zz
    comx, comy, comz = ipos_a[3 * body], ipos_a[3 * body + 1], ipos_a[3 * body + 2]
    lx, ly = c * comx - s * comy, s * comx + c * comy
    full = mass_a[body]
    i_origin = izz + full * (comx * comx + comy * comy)

    # push: force and moment about the body frame
    fx, fy, fz = user[push], user[push + 1], user[push + 2]
    sxx, sxy = user[push + 3], user[push + 4]
    syx, syy = user[push + 6], user[push + 7]
    szx, szy = user[push + 9], user[push + 10]
    tz = (c * sxy - s * sxx) - (s * syy + c * syx)
    speed = math.sqrt(v0 * v0 + v1 * v1)
    air = num[r + _AIR] * speed

    # all that acts on the body but friction
    e0 = passive[dof] + applied[dof] + xfrc[6 * body] + mass_a[body] * scale * gravity[0] + fx - air * v0
    e1 = passive[dof + 1] + applied[dof + 1] + xfrc[6 * body + 1] + mass_a[body] * scale * gravity[1] + fy - air * v1
    mgx, mgy = mass * gravity[0], mass * gravity[1]
    e2 = (
        passive[dof + 2]
        + applied[dof + 2]
        + xfrc[6 * body + 5]
        + tz
        + lx * (xfrc[6 * body + 1] + mgy)
        - ly * (xfrc[6 * body] + mgx)
    )
    # centrifugal force of the centre of mass (the yaw term cancels)
    e0 += mass * v2 * v2 * lx
    e1 += mass * v2 * v2 * ly

    # MuJoCo's Euler step treats joint damping implicitly; so must the mass matrix here
    m00 = mass + h * damping[dof]
    m11 = mass + h * damping[dof + 1]
    m02 = -mass * ly
    m12 = mass * lx
    m22 = i_origin * scale + h * damping[dof + 2]
    a0, a1, a2 = _solve3(m00, 0.0, m02, m11, m12, m22, e0, e1, e2)
    f0, f1, f2 = v0 + h * a0, v1 + h * a1, v2 + h * a2

    x0, x1, x2 = f0, f1, f2
    lifted = 0.0
    cpx, cpy = 0.0, 0.0
    weight = 0.0
    fr0 = fr1 = fr2 = 0.0
    if n > 0:
        bx = np.empty(n)
        by = np.empty(n)
        rx = np.empty(n)
        ry = np.empty(n)
        w = np.empty(n)
        mu = np.empty(n)
        load = np.empty(n)
        k1 = np.empty(n)
        film_h = np.empty(n)
        out = np.empty(9)
        film = num[r + _FILM]
        st, sv = num[r + _STRIBECK], num[r + _STRIBECK_V]
        sk, skv = num[r + _STICTION], num[r + _STICTION_V]
        pt, px, py, pr = num[r + _PATCH], num[r + _PATCH_X], num[r + _PATCH_Y], num[r + _PATCH_R]
        pressure = num[r + _PRESSURE]
        wsum = 0.0
        for i in range(n):
            j = padr + POINT_STRIDE * i
            bx[i] = num[j]
            by[i] = num[j + 1]
            w[i] = num[j + 2] * max(1.0 + pressure * num[j + 3], 0.0)
            wsum += w[i]
            rx[i] = c * bx[i] - s * by[i]
            ry[i] = s * bx[i] + c * by[i]
            film_h[i] = h * film * num[j + 2]
            m_i = num[r + _MU]
            if st != 0.0 or sk != 0.0:
                ux = v0 - v2 * ry[i]
                uy = v1 + v2 * rx[i]
                u2 = ux * ux + uy * uy
                m_i *= 1.0 + st * math.exp(-u2 / (sv * sv)) + sk * math.exp(-u2 / (skv * skv))
            if pt != 0.0:
                dx = qpos[qadr] + rx[i] - px
                dy = qpos[qadr + 1] + ry[i] - py
                d = math.sqrt(dx * dx + dy * dy)
                z = (d - pr) / (0.08 * pr)
                if z < 30.0:
                    m_i *= 1.0 + pt / (1.0 + math.exp(z))
            mu[i] = m_i
        for i in range(n):
            w[i] /= wsum
        am, bm = num[r + _ALONG], num[r + _ACROSS]
        cr, sr = 1.0, 0.0
        if am != bm:
            cr, sr = math.cos(yaw + num[r + _ANGLE]), math.sin(yaw + num[r + _ANGLE])
        eps2 = SLIP_EPS * SLIP_EPS
        weight = mass * -gravity[2] - fz
        if weight < 0.0:
            weight = 0.0
        zf = num[r + _BASEZ]
        # moments about the base's centre, world axes, that do not depend on the solution
        push_mx = szx - fx * zf  # height above the floor times force
        push_my = szy - fy * zf
        # a vertical push at a body point moves the load too
        sxz, syz = user[push + 5], user[push + 8]
        vx_m, vy_m = c * sxz - s * syz, s * sxz + c * syz
        zc = comz - zf
        other0, other1 = e0 - fx - mass * v2 * v2 * lx, e1 - fy - mass * v2 * v2 * ly

        # friction of the last iterate; first guess: full slip along the free velocity, or what holds it at rest
        sp = math.sqrt(f0 * f0 + f1 * f1)
        guess = num[r + _MU] * weight
        stop = mass * sp / h
        if stop < guess:
            guess = stop
        if sp > 0.0:
            fr0, fr1 = -guess * f0 / sp, -guess * f1 / sp
        # start at rest or at the current velocity, whichever is lower; fast motion needs no look at rest
        x0, x1, x2 = v0, v1, v2
        old_cx, old_cy = 1e9, 1e9
        for outer in range(12):
            # mass times the acceleration of the centre of mass = all horizontal forces
            tot0 = other0 + fx + fr0
            tot1 = other1 + fy + fr1
            if weight > 0.0:
                wx = (mass * -gravity[2] * lx - vx_m + push_mx + zc * (other0 - tot0)) / weight
                wy = (mass * -gravity[2] * ly - vy_m + push_my + zc * (other1 - tot1)) / weight
            else:
                wx, wy = 0.0, 0.0
            cpx, cpy = c * wx + s * wy, -s * wx + c * wy
            if outer > 1 and abs(cpx - old_cx) + abs(cpy - old_cy) < 1e-7:
                break
            old_cx, old_cy = cpx, cpy
            lifted = _share_load(n, bx, by, w, cpx, cpy, load, weight)
            for i in range(n):
                k1[i] = h * mu[i] * load[i]
            if outer == 0:
                cost_rest = 0.5 * (m00 * f0 * f0 + m11 * f1 * f1 + m22 * f2 * f2) + m02 * f0 * f2 + m12 * f1 * f2
                cost_rest += _cost(0.0, 0.0, 0.0, n, rx, ry, k1, am, bm, cr, sr, film_h, eps2)
                d0, d1, d2 = v0 - f0, v1 - f1, v2 - f2
                cost = 0.5 * (m00 * d0 * d0 + m11 * d1 * d1 + m22 * d2 * d2) + m02 * d0 * d2 + m12 * d1 * d2
                cost += _cost(v0, v1, v2, n, rx, ry, k1, am, bm, cr, sr, film_h, eps2)
                if cost_rest < cost:
                    x0, x1, x2 = 0.0, 0.0, 0.0
            _terms(x0, x1, x2, n, rx, ry, k1, am, bm, cr, sr, film_h, eps2, out)
            d0, d1, d2 = x0 - f0, x1 - f1, x2 - f2
            g0 = m00 * d0 + m02 * d2 + out[0]
            g1 = m11 * d1 + m12 * d2 + out[1]
            g2 = m02 * d0 + m12 * d1 + m22 * d2 + out[2]
            tolerance = (1e-11 if outer > 3 else 1e-5 * 0.01**outer) * (mass + i_origin)
            for _ in range(40):
                if abs(g0) + abs(g1) + abs(g2) < tolerance:
                    break
                p0, p1, p2 = _solve3(
                    m00 + out[3], out[4], m02 + out[5], m11 + out[6], m12 + out[7], m22 + out[8], g0, g1, g2
                )
                slope = g0 * p0 + g1 * p1 + g2 * p2
                step = 1.0
                # the objective is convex: shorten by the secant rule until its slope along the step is small
                for _ls in range(30):
                    y0, y1, y2 = x0 - step * p0, x1 - step * p1, x2 - step * p2
                    _terms(y0, y1, y2, n, rx, ry, k1, am, bm, cr, sr, film_h, eps2, out)
                    d0, d1, d2 = y0 - f0, y1 - f1, y2 - f2
                    g0 = m00 * d0 + m02 * d2 + out[0]
                    g1 = m11 * d1 + m12 * d2 + out[1]
                    g2 = m02 * d0 + m12 * d1 + m22 * d2 + out[2]
                    past = -(g0 * p0 + g1 * p1 + g2 * p2)
                    if past <= 0.5 * slope:
                        break
                    step *= max(slope / (slope + past), 0.1)
                x0, x1, x2 = y0, y1, y2
            fr0, fr1, fr2 = -out[0] / h, -out[1] / h, -out[2] / h
        # from the balance of momentum: exact also where the regularised law is stiff
        d0, d1, d2 = x0 - f0, x1 - f1, x2 - f2
        fr0 = (m00 * d0 + m02 * d2) / h
        fr1 = (m11 * d1 + m12 * d2) / h
        fr2 = (m02 * d0 + m12 * d1 + m22 * d2) / h

    # what MuJoCo must be given so that its step, with its own mass, ends at x
    d0, d1, d2 = (x0 - v0) / h, (x1 - v1) / h, (x2 - v2) / h
    n00, n11 = full + h * damping[dof], full + h * damping[dof + 1]
    n02, n12, n22 = -full * ly, full * lx, i_origin + h * damping[dof + 2]
    want0 = n00 * d0 + n02 * d2 - full * v2 * v2 * lx - full * gravity[0]
    want1 = n11 * d1 + n12 * d2 - full * v2 * v2 * ly - full * gravity[1]
    want2 = n02 * d0 + n12 * d1 + n22 * d2 - full * (lx * gravity[1] - ly * gravity[0])
    passive[dof] = want0 - applied[dof] - xfrc[6 * body]
    passive[dof + 1] = want1 - applied[dof + 1] - xfrc[6 * body + 1]
    passive[dof + 2] = want2 - applied[dof + 2] - xfrc[6 * body + 5] - lx * xfrc[6 * body + 1] + ly * xfrc[6 * body]

    o = push + PUSH_SIZE
    user[o] = fr0
    user[o + 1] = fr1
    user[o + 2] = fr2
    user[o + 3] = cpx
    user[o + 4] = cpy
    user[o + 5] = lifted
    user[o + 6] = math.sqrt(x0 * x0 + x1 * x1)
    user[o + 7] = 0.5 * (fr0 * (x0 + v0) + fr1 * (x1 + v1) + fr2 * (x2 + v2))
    user[o + 8] = weight
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
    o_nuser, o_nbody, o_dt, o_gravity, o_time, o_user, o_mass, o_inertia, o_ipos, o_iquat, o_damping, o_dofadr, o_jntadr,
    o_qposadr, o_qpos, o_qvel, o_xfrc, o_userdata, o_applied, o_passive,
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


_INSTALLED: list[object] = []  # keeps the callback alive for as long as MuJoCo may call it


def install() -> None:
    """Give the law to MuJoCo, once per process. The first call on a machine compiles it (some seconds)."""
    if not _INSTALLED:
        law = _compile(*_offsets())
        callback = ctypes.CFUNCTYPE(None, ctypes.c_uint64, ctypes.c_uint64)(law.address)
        _INSTALLED.extend([law, callback])
        mujoco.set_mjcb_passive(callback)
