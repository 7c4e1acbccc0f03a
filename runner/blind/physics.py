"""A second physics: one rigid box on a dry floor, Newton-Euler, integrated by LSODA.

It shares nothing with the MuJoCo scene or the compiled law that a diagnosis fits with, so that a recording made here
is other people's data to that diagnosis. State: position, yaw and twist of the *geometric centre*, world axes.

    m a_c = F,   I alpha = tau_c,   a_g = a_c - alpha z x r_c + omega^2 r_c,   r_c = R(yaw) com

Friction. The base is a grid of 16 x 16 points. At each, with slip u (body axes) and load N,

    f = -N mu D u / q,   q^2 = u^T Q u + eps^2

Isotropic: D = Q = 1. `associated` anisotropy (f on an ellipse, slip normal to it: Goyal, Ruina & Papadopoulos 1991):
D = Q = diag(r1^2, r2^2). `scaled`: D = diag(r1, r2), Q = 1. eps = `SLIP_EPS`: a body held at a share s of its
friction creeps at eps s / sqrt(1 - s^2).

Load. N_k = W w_k (a + b x_k + d y_k), with a, b, d from the balance of vertical force and of moments about the
horizontal axes: weight at the centre of mass, pushes at their height, inertia at the height of the centre of mass,
friction at the floor. Friction is linear in (a, b, d), hence the balance is one 3 x 3 system without iteration.
Where a corner would pull, the points that pull are left out and the system is solved again.

Commands are constant between samples, so a lag has a closed form within each interval, and LSODA (scipy's `odeint`:
Hindmarsh 1983, Petzold 1983) starts afresh at every change of the command. Where the command changes at every sample,
that would be all it does; there a one-step method (Dormand & Prince 1980, order 5(4)) is tried first, in one to four
steps from sample to sample, and LSODA takes over wherever its error estimate is not met, as near sticking.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numba import njit
from scipy.integrate import ODEintWarning, odeint

from runner.errors import RunnerError, check_range

SLIP_EPS = 5e-6  # m/s
BASE_POINTS = 16  # per side
TEXTURE_CELLS = 64  # per side of the periodic floor texture
TEXTURE_CELL_M = 0.125
SHORT = 2.5  # samples: intervals below are first tried in single steps
WANDER_TERMS = 12  # sinusoids of the wandering force

STATE_NAMES = ("x", "y", "yaw", "vx", "vy", "wz")


class IntegrationError(RunnerError):
    """LSODA could not go on: the time, the state and its message."""


@dataclass(frozen=True)
class World:
    """The box, the floor, the actuator and the sensor. Every default after `gravity` is neutral. SI units, radians."""

    half_size: tuple[float, float, float]
    mass: float
    friction: float
    gravity: float = 9.81
    contact: Literal["patch", "corners"] = "patch"
    inertia: float | None = None  # about the vertical through the centre of mass; None: uniform density
    com: tuple[float, float] = (0.0, 0.0)  # body axes, from the geometric centre
    # floor
    anisotropy: tuple[float, float] = (1.0, 1.0)  # factors on friction along and across the axis
    anisotropy_angle: float = 0.0  # of the axis, body frame
    anisotropy_flow: Literal["associated", "scaled"] = "associated"
    stribeck: float = 0.0  # friction (1 + stribeck exp(-(u / speed)^2))
    stribeck_speed: float = 0.1
    stiction: float = 0.0  # the same form at a speed near zero
    stiction_speed: float = 2e-3
    patch: float = 0.0  # relative change of friction in one place
    patch_place: tuple[float, float] = (0.0, 0.0)
    patch_radius: float = 0.5  # of the disc, or the standard deviation of the Gaussian
    patch_shape: Literal["disc", "gaussian"] = "disc"
    pressure: float = 0.0  # share of the load that is moved to `pressure_where`
    pressure_where: Literal["rim", "middle"] = "rim"
    tilt: float = 0.0  # angle of the floor
    downhill: float = 0.0  # world direction
    texture: float = 0.0  # standard deviation of friction over the floor, relative
    texture_seed: int = 0
    texture_length: float = 0.3  # correlation length, m
    texture_mean: float = 0.0  # taken from the field, so that friction is right on average where the box goes
    # forces
    viscous_drag: float = 0.0  # N s/m, through the geometric centre
    film: float = 0.0  # N s/m, spread over the base
    air_drag: float = 0.0  # N s2/m2
    rotational_damping: float = 0.0  # N m s
    wind: tuple[float, float] = (0.0, 0.0)  # N
    tether: float = 0.0  # N/m, from the geometric centre, slack below its rest length
    tether_place: tuple[float, float] = (0.0, 0.0)
    tether_rest: float = 0.0
    mass_leak: float = 0.0  # share per second, from the start of the episode
    # actuator
    gain: float = 1.0
    saturation: float = math.inf  # N
    misalignment: float = 0.0  # rad, counter-clockwise
    delay: float = 0.0  # s
    lag: float = 0.0  # s
    point_offset: tuple[float, float] = (0.0, 0.0)  # m, body axes
    # sensor
    observation_delay: float = 0.0  # s
    sensor_scale: float = 1.0
    # what the vocabulary has no word for
    periodic: float = 0.0  # N, a force in time along `periodic_direction`
    periodic_direction: float = 0.0
    periodic_hz: float = 1.0
    periodic_phase: float = 0.0
    cogging: float = 0.0  # N m, torque that depends on yaw: cogging sin(teeth yaw + phase)
    cogging_teeth: int = 3
    cogging_phase: float = 0.0
    deflection: float = 0.0  # N s/m, force across the velocity
    wear: float = 0.0  # 1/s, friction grows with the time in use, all episodes together
    deadband: float = 0.0  # N taken from every push
    wander: float = 0.0  # N, standard deviation of a slowly wandering force
    wander_seed: int = 0
    barrier: float = 0.0  # N/m beyond the line n . r = distance
    barrier_direction: float = 0.0  # of n
    barrier_distance: float = 0.0
    barrier_damping: float = 0.0  # N s/m
    vortex: float = 0.0  # N, peak of a force field that circles a place
    vortex_place: tuple[float, float] = (0.0, 0.0)
    vortex_radius: float = 1.0
    quantum: float = 0.0  # N, the force comes in steps
    crosstalk: float = 0.0  # 1/N, fy += crosstalk fx |fx|

    def __post_init__(self) -> None:
        for axis, value in zip("xyz", self.half_size, strict=True):
            check_range(f"world.half_size.{axis}", value, 0.0, 100.0, unit="m", lower_open=True)
        check_range("world.mass", self.mass, 0.0, 1e6, unit="kg", lower_open=True)
        check_range("world.friction", self.friction, 0.0, 10.0)
        check_range("world.gravity", self.gravity, 0.0, 1e3, unit="m/s2")
        for name in ("delay", "lag", "observation_delay", "deadband", "quantum", "tether", "tether_rest"):
            check_range(f"world.{name}", getattr(self, name), 0.0)
        check_range("world.pressure", self.pressure, 0.0, 1.0)

    @property
    def yaw_inertia(self) -> float:
        """Yaw inertia about the centre of mass, kg m2."""
        hx, hy, _ = self.half_size
        return self.mass * (hx * hx + hy * hy) / 3.0 if self.inertia is None else self.inertia


@dataclass(frozen=True)
class Episode:
    """Start state and commands of one episode.

    Args:
        start: State of the geometric centre at the first sample, shape (6,).
        command: fx, fy (N, world), px, py, pz (m, body axes, from the geometric centre) from each sample to the
            next, shape (n, 5).
        rate_hz: Samples per second.
        elapsed_s: Time in use before this episode (matters to wear alone).
        number: Number of the episode (the wandering force differs between episodes).
    """

    start: np.ndarray
    command: np.ndarray
    rate_hz: float
    elapsed_s: float = 0.0
    number: int = 0

    @property
    def duration_s(self) -> float:
        """Time from the first to the last sample."""
        return (len(self.command) - 1) / self.rate_hz


# The right-hand side gets one flat array: scalars, then base points, then the texture.
_SCALARS = (
    "mass", "inertia", "comx", "comy", "height", "weight_g", "friction", "points", "eps",
    "by_point", "d11", "d12", "d22", "q11", "q12", "q22", "stribeck", "stribeck_v", "stiction", "stiction_v",
    "patch", "patch_x", "patch_y", "patch_r", "patch_disc", "texture", "cell", "hx", "hy",
    "drag", "film", "film_xx", "air", "spin", "fx", "fy", "gx", "gy",
    "tether", "tether_x", "tether_y", "tether_rest", "leak",
    "t0", "lag_rate", "a0", "a1", "a2", "a3", "a4", "a5", "a6", "a7", "b0", "b1", "b2", "b3", "b4", "b5", "b6", "b7",
    "periodic_x", "periodic_y", "periodic_w", "periodic_p", "cogging", "teeth", "cogging_p", "deflection",
    "wear", "elapsed", "wander", "barrier", "barrier_x", "barrier_y", "barrier_d", "barrier_c",
    "vortex", "vortex_x", "vortex_y", "vortex_r",
)  # fmt: skip
_AT = {name: i for i, name in enumerate(_SCALARS)}
(
    _MASS, _INERTIA, _COMX, _COMY, _HEIGHT, _WEIGHT_G, _MU, _POINTS, _EPS,
    _BY_POINT, _D11, _D12, _D22, _Q11, _Q12, _Q22, _STRIBECK, _STRIBECK_V, _STICTION, _STICTION_V,
    _PATCH, _PATCH_X, _PATCH_Y, _PATCH_R, _PATCH_DISC, _TEXTURE, _CELL, _HX, _HY,
    _DRAG, _FILM, _FILM_XX, _AIR, _SPIN, _FX, _FY, _GX, _GY,
    _TETHER, _TETHER_X, _TETHER_Y, _TETHER_REST, _LEAK,
    _T0, _LAG_RATE, _A0, _A1, _A2, _A3, _A4, _A5, _A6, _A7, _B0, _B1, _B2, _B3, _B4, _B5, _B6, _B7,
    _PERIODIC_X, _PERIODIC_Y, _PERIODIC_W, _PERIODIC_P, _COGGING, _TEETH, _COGGING_P, _DEFLECTION,
    _WEAR, _ELAPSED, _WANDER, _BARRIER, _BARRIER_X, _BARRIER_Y, _BARRIER_D, _BARRIER_C,
    _VORTEX, _VORTEX_X, _VORTEX_Y, _VORTEX_R,
) = range(len(_SCALARS))  # fmt: skip
_WANDER_AT = len(_SCALARS)  # frequency, x sine, x cosine, y sine, y cosine for each term
_POINTS_AT = _WANDER_AT + 5 * WANDER_TERMS  # all x, all y, all weights
_FAST = {"nnan", "ninf", "contract", "reassoc", "arcp", "nsz"}


@njit(cache=True, error_model="numpy", fastmath=_FAST)
def _sums(bx, by, w, mu, v0, v1, v2, d11, d12, d22, q11, q12, q22, eps2, a, b, d, out):
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


@njit(cache=True, error_model="numpy")
def _coefficients(p, n, bx, by, rx, ry, c, s, v0, v1, v2, level, mu):
    """Friction coefficient at each point: patch, texture and speed."""
    eps2 = p[_EPS] * p[_EPS]
    stribeck, stiction, patch, texture = p[_STRIBECK], p[_STICTION], p[_PATCH], p[_TEXTURE]
    i_stribeck = 1.0 / (p[_STRIBECK_V] * p[_STRIBECK_V])
    i_stiction = 1.0 / (p[_STICTION_V] * p[_STICTION_V])
    grid = _POINTS_AT + 3 * n
    for i in range(n):
        m = level
        if stribeck != 0.0 or stiction != 0.0:
            ux = v0 - v2 * by[i]
            uy = v1 + v2 * bx[i]
            u2 = ux * ux + uy * uy + eps2
            m *= 1.0 + stribeck * math.exp(-u2 * i_stribeck) + stiction * math.exp(-u2 * i_stiction)
        if patch != 0.0 or texture != 0.0:
            wx = rx + c * bx[i] - s * by[i]
            wy = ry + s * bx[i] + c * by[i]
            if patch != 0.0:
                dx = wx - p[_PATCH_X]
                dy = wy - p[_PATCH_Y]
                r2 = dx * dx + dy * dy
                if p[_PATCH_DISC] > 0.0:
                    z = (math.sqrt(r2) - p[_PATCH_R]) / 0.02
                    if z < 40.0:
                        m *= 1.0 + patch / (1.0 + math.exp(z))
                else:
                    m *= 1.0 + patch * math.exp(-0.5 * r2 / (p[_PATCH_R] * p[_PATCH_R]))
            if texture != 0.0:
                gx = wx / p[_CELL]
                gy = wy / p[_CELL]
                ix = math.floor(gx)
                iy = math.floor(gy)
                ax = gx - ix
                ay = gy - iy
                i0 = int(ix) % TEXTURE_CELLS
                j0 = int(iy) % TEXTURE_CELLS
                i1 = (i0 + 1) % TEXTURE_CELLS
                j1 = (j0 + 1) % TEXTURE_CELLS
                value = (1.0 - ax) * (
                    (1.0 - ay) * p[grid + TEXTURE_CELLS * i0 + j0] + ay * p[grid + TEXTURE_CELLS * i0 + j1]
                )
                value += ax * ((1.0 - ay) * p[grid + TEXTURE_CELLS * i1 + j0] + ay * p[grid + TEXTURE_CELLS * i1 + j1])
                m *= 1.0 + texture * value
        mu[i] = m


@njit(cache=True, error_model="numpy")
def _solve3(m00, m01, m02, m10, m11, m12, m20, m21, m22, r0, r1, r2):
    c00 = m11 * m22 - m12 * m21
    c01 = m12 * m20 - m10 * m22
    c02 = m10 * m21 - m11 * m20
    det = m00 * c00 + m01 * c01 + m02 * c02
    x0 = (c00 * r0 + (m02 * m21 - m01 * m22) * r1 + (m01 * m12 - m02 * m11) * r2) / det
    x1 = (c01 * r0 + (m00 * m22 - m02 * m20) * r1 + (m02 * m10 - m00 * m12) * r2) / det
    x2 = (c02 * r0 + (m01 * m20 - m00 * m21) * r1 + (m00 * m11 - m01 * m10) * r2) / det
    return x0, x1, x2


@njit(cache=True, error_model="numpy")
def _balance(p, y, t, mu, out):
    """Fill `mu` and the sums `out`, and return what the two callers share.

    Returns:
        a, b, d of the load; the weight W; force without friction (x, y in body axes) and torque about the geometric
        centre.
    """
    n = int(p[_POINTS])
    bx = p[_POINTS_AT : _POINTS_AT + n]
    by = p[_POINTS_AT + n : _POINTS_AT + 2 * n]
    w = p[_POINTS_AT + 2 * n : _POINTS_AT + 3 * n]
    c = math.cos(y[2])
    s = math.sin(y[2])
    v0 = c * y[3] + s * y[4]
    v1 = c * y[4] - s * y[3]
    v2 = y[5]
    share = 1.0 - p[_LEAK] * t if p[_LEAK] != 0.0 else 1.0
    weight = p[_WEIGHT_G] * share

    # the push: force, first moment and force times height, each a + b exp(-(t - t0) / lag)
    e = math.exp(-(t - p[_T0]) * p[_LAG_RATE]) if p[_LAG_RATE] > 0.0 else 0.0
    fx = p[_A0] + p[_B0] * e
    fy = p[_A1] + p[_B1] * e
    px_fx = p[_A2] + p[_B2] * e
    px_fy = p[_A3] + p[_B3] * e
    py_fx = p[_A4] + p[_B4] * e
    py_fy = p[_A5] + p[_B5] * e
    zx = p[_A6] + p[_B6] * e
    zy = p[_A7] + p[_B7] * e
    torque = c * (px_fy - py_fx) - s * (px_fx + py_fy)  # (R p) x F

    # forces through the geometric centre at its height
    fx += p[_FX] - p[_DRAG] * y[3] - p[_DEFLECTION] * y[4]
    fy += p[_FY] - p[_DRAG] * y[4] + p[_DEFLECTION] * y[3]
    if p[_AIR] != 0.0:
        speed = math.sqrt(y[3] * y[3] + y[4] * y[4])
        fx -= p[_AIR] * speed * y[3]
        fy -= p[_AIR] * speed * y[4]
    if p[_TETHER] != 0.0:
        dx = p[_TETHER_X] - y[0]
        dy = p[_TETHER_Y] - y[1]
        length = math.sqrt(dx * dx + dy * dy)
        if length > p[_TETHER_REST] and length > 0.0:
            pull = p[_TETHER] * (length - p[_TETHER_REST]) / length
            fx += pull * dx
            fy += pull * dy
    if p[_PERIODIC_X] != 0.0 or p[_PERIODIC_Y] != 0.0:
        wave = math.sin(p[_PERIODIC_W] * (p[_ELAPSED] + t) + p[_PERIODIC_P])
        fx += p[_PERIODIC_X] * wave
        fy += p[_PERIODIC_Y] * wave
    if p[_WANDER] != 0.0:
        for i in range(WANDER_TERMS):
            j = _WANDER_AT + 5 * i
            sine = math.sin(p[j] * t)
            cosine = math.cos(p[j] * t)
            fx += p[_WANDER] * (p[j + 1] * sine + p[j + 2] * cosine)
            fy += p[_WANDER] * (p[j + 3] * sine + p[j + 4] * cosine)
    if p[_BARRIER] != 0.0:
        depth = p[_BARRIER_X] * y[0] + p[_BARRIER_Y] * y[1] - p[_BARRIER_D]
        if depth > 0.0:
            rate = p[_BARRIER_X] * y[3] + p[_BARRIER_Y] * y[4]
            push = max(p[_BARRIER] * depth + p[_BARRIER_C] * rate, 0.0)
            fx -= push * p[_BARRIER_X]
            fy -= push * p[_BARRIER_Y]
    if p[_VORTEX] != 0.0:
        dx = (y[0] - p[_VORTEX_X]) / p[_VORTEX_R]
        dy = (y[1] - p[_VORTEX_Y]) / p[_VORTEX_R]
        level = p[_VORTEX] * math.exp(0.5 - 0.5 * (dx * dx + dy * dy))
        fx -= level * dy
        fy += level * dx
    torque -= p[_SPIN] * v2
    if p[_COGGING] != 0.0:
        torque += p[_COGGING] * math.sin(p[_TEETH] * y[2] + p[_COGGING_P])

    # gravity along the floor acts at the centre of mass
    gx = p[_MASS] * share * p[_GX]
    gy = p[_MASS] * share * p[_GY]
    cx = c * p[_COMX] - s * p[_COMY]
    cy = s * p[_COMX] + c * p[_COMY]
    torque += cx * gy - cy * gx
    fx += gx
    fy += gy
    f0 = c * fx + s * fy
    f1 = c * fy - s * fx
    film0 = -p[_FILM] * v0
    film1 = -p[_FILM] * v1
    torque -= p[_FILM] * p[_FILM_XX] * v2
    h = p[_HEIGHT]
    # moments of the push about the height of the centre of mass, over the weight; and of the film
    m0 = p[_COMX] + ((c * zx + s * zy) - h * film0) / weight
    m1 = p[_COMY] + ((c * zy - s * zx) - h * film1) / weight

    level = p[_MU]
    if p[_WEAR] != 0.0:
        level *= 1.0 + p[_WEAR] * (p[_ELAPSED] + t)
    eps2 = p[_EPS] * p[_EPS]
    if p[_BY_POINT] > 0.0:
        _coefficients(p, n, bx, by, y[0], y[1], c, s, v0, v1, v2, level, mu)
    else:
        mu[:] = level
    d11, d12, d22, q11, q12, q22 = p[_D11], p[_D12], p[_D22], p[_Q11], p[_Q12], p[_Q22]
    a, b, d = 1.0, 0.0, 0.0
    settled = False
    for k in range(12):
        _sums(bx, by, w, mu, v0, v1, v2, d11, d12, d22, q11, q12, q22, eps2, a, b, d, out)
        na, nb, nd = _solve3(
            out[0], out[1], out[2],
            out[1] - h * out[6], out[3] - h * out[7], out[4] - h * out[8],
            out[2] - h * out[9], out[4] - h * out[10], out[5] - h * out[11],
            1.0, m0, m1,
        )  # fmt: skip
        if not (math.isfinite(na) and math.isfinite(nb) and math.isfinite(nd)):
            break
        bears = k == 0 and na - abs(nb) * p[_HX] - abs(nd) * p[_HY] >= 0.0  # everywhere
        settled = bears or abs(na - a) + abs(nb - b) * p[_HX] + abs(nd - d) * p[_HY] < 1e-10 * (1.0 + abs(na))
        a, b, d = na, nb, nd
        if settled:
            break
    if not settled:
        a = math.nan  # no load balances the moments: the box tips
    return a, b, d, weight, f0 + film0, f1 + film1, torque


@njit(cache=True, error_model="numpy")
def _rate(y, t, p):
    """Time derivative of the state, shape (6,)."""
    n = int(p[_POINTS])
    mu = np.empty(n)
    out = np.empty(15)
    a, b, d, weight, f0, f1, torque = _balance(p, y, t, mu, out)
    f0 -= weight * (a * out[6] + b * out[7] + d * out[8])
    f1 -= weight * (a * out[9] + b * out[10] + d * out[11])
    torque -= weight * (a * out[12] + b * out[13] + d * out[14])
    share = 1.0 - p[_LEAK] * t if p[_LEAK] != 0.0 else 1.0
    mass = p[_MASS] * share
    alpha = (torque - (p[_COMX] * f1 - p[_COMY] * f0)) / (p[_INERTIA] * share)
    w2 = y[5] * y[5]
    a0 = f0 / mass + alpha * p[_COMY] + w2 * p[_COMX]
    a1 = f1 / mass - alpha * p[_COMX] + w2 * p[_COMY]
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


@njit(cache=True, error_model="numpy")
def _jacobian(y, t, p):
    """Derivative of the rate by the state, shape (6, 6): friction by velocity, the stiff part, and the kinematics."""
    n = int(p[_POINTS])
    mu = np.empty(n)
    out = np.empty(15)
    a, b, d, weight, _, _, _ = _balance(p, y, t, mu, out)
    c = math.cos(y[2])
    s = math.sin(y[2])
    v0 = c * y[3] + s * y[4]
    v1 = c * y[4] - s * y[3]
    v2 = y[5]
    eps2 = p[_EPS] * p[_EPS]
    d11, d12, d22, q11, q12, q22 = p[_D11], p[_D12], p[_D22], p[_Q11], p[_Q12], p[_Q22]
    h00 = h01 = h02 = h10 = h11 = h12 = h20 = h21 = h22 = 0.0
    for i in range(n):
        x = p[_POINTS_AT + i]
        z = p[_POINTS_AT + n + i]
        load = p[_POINTS_AT + 2 * n + i] * (a + b * x + d * z)
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
        if p[_STRIBECK] != 0.0 or p[_STICTION] != 0.0:
            u2 = ux * ux + uy * uy + eps2
            e1 = p[_STRIBECK] * math.exp(-u2 / p[_STRIBECK_V] ** 2)
            e2 = p[_STICTION] * math.exp(-u2 / p[_STICTION_V] ** 2)
            g = -2.0 * k * (e1 / p[_STRIBECK_V] ** 2 + e2 / p[_STICTION_V] ** 2) / (1.0 + e1 + e2)
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
    # the load shifts with the friction: (a, b, d) follow by the same 3 x 3 system
    h = p[_HEIGHT]
    jac = np.zeros((6, 6))
    hh = np.array([[h00, h01, h02], [h10, h11, h12], [h20, h21, h22]])
    full = np.empty((3, 3))
    for j in range(3):
        da, db, dd = _solve3(
            out[0], out[1], out[2],
            out[1] - h * out[6], out[3] - h * out[7], out[4] - h * out[8],
            out[2] - h * out[9], out[4] - h * out[10], out[5] - h * out[11],
            0.0, h * hh[0, j], h * hh[1, j],
        )  # fmt: skip
        for i in range(3):
            r = 6 + 3 * i
            full[i, j] = -weight * (hh[i, j] + out[r] * da + out[r + 1] * db + out[r + 2] * dd)
    full[0, 0] -= p[_DRAG] + p[_FILM]
    full[1, 1] -= p[_DRAG] + p[_FILM]
    full[2, 2] -= p[_SPIN] + p[_FILM] * p[_FILM_XX]
    share = 1.0 - p[_LEAK] * t if p[_LEAK] != 0.0 else 1.0
    for j in range(3):
        f0, f1, torque = full[0, j], full[1, j], full[2, j]
        alpha = (torque - (p[_COMX] * f1 - p[_COMY] * f0)) / (p[_INERTIA] * share)
        a0 = f0 / (p[_MASS] * share) + alpha * p[_COMY]
        a1 = f1 / (p[_MASS] * share) - alpha * p[_COMX]
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


@njit(cache=True, error_model="numpy")
def _dormand_prince(y, t, h, p, rtol, atol):
    """Return the state after one step, and its estimated error over the tolerance."""
    k1 = _rate(y, t, p)
    k2 = _rate(y + h * 0.2 * k1, t + 0.2 * h, p)
    k3 = _rate(y + h * (0.075 * k1 + 0.225 * k2), t + 0.3 * h, p)
    k4 = _rate(y + h * (44.0 / 45.0 * k1 - 56.0 / 15.0 * k2 + 32.0 / 9.0 * k3), t + 0.8 * h, p)
    k5 = _rate(
        y + h * (19372.0 / 6561.0 * k1 - 25360.0 / 2187.0 * k2 + 64448.0 / 6561.0 * k3 - 212.0 / 729.0 * k4),
        t + 8.0 / 9.0 * h,
        p,
    )
    k6 = _rate(
        y
        + h * (9017.0 / 3168.0 * k1 - 355.0 / 33.0 * k2 + 46732.0 / 5247.0 * k3 + 49.0 / 176.0 * k4)
        - h * 5103.0 / 18656.0 * k5,
        t + h,
        p,
    )
    new = y + h * (
        35.0 / 384.0 * k1 + 500.0 / 1113.0 * k3 + 125.0 / 192.0 * k4 - 2187.0 / 6784.0 * k5 + 11.0 / 84.0 * k6
    )
    k7 = _rate(new, t + h, p)
    error = 0.0
    for i in range(6):
        e = 71.0 / 57600.0 * k1[i] - 71.0 / 16695.0 * k3[i] + 71.0 / 1920.0 * k4[i]
        e += -17253.0 / 339200.0 * k5[i] + 22.0 / 525.0 * k6[i] - 0.025 * k7[i]
        error = max(error, abs(h * e) / (atol + rtol * abs(new[i])))
    return new, error


@njit(cache=True, error_model="numpy")
def _march(p, y, starts, targets, held, lag, first, last, end, sample, filled, result, rtol, atol):
    """Go through the intervals first <= k < last by single steps as long as their error allows; fill `result`.

    Returns:
        The interval that was not finished (`last` where all were) and the number of samples filled. `y` and `held`
        are those at the start of that interval.
    """
    n = sample.size
    for k in range(first, last):
        p[_T0] = starts[k]
        for i in range(8):
            p[_A0 + i] = targets[k, i]
            p[_B0 + i] = held[i] - targets[k, i] if lag > 0.0 else 0.0
        stop = min(starts[k + 1], end) if k + 1 < starts.size else end
        now = y.copy()
        t = starts[k]
        reached = filled
        while True:
            while reached < n and sample[reached] <= t + 1e-9:
                result[reached] = now
                reached += 1
            if t >= stop - 1e-12 or reached >= n:
                break
            goal = min(stop, sample[reached])
            step = goal - t
            tries = 0
            while t < goal - 1e-12 and tries < 6:
                new, error = _dormand_prince(now, t, step, p, rtol, atol)
                tries += 1
                if error <= 1.0:
                    now = new
                    t += step
                    step = min(step, goal - t)
                elif error < 1e3:
                    step *= 0.5
                else:
                    break  # stiff: the body sticks or is about to
            if t < goal - 1e-12:
                return k, filled
            t = goal
        y[:] = now
        filled = reached
        if lag > 0.0 and k + 1 < starts.size:
            decay = math.exp(-(starts[k + 1] - starts[k]) / lag)
            for i in range(8):
                held[i] = targets[k, i] + (held[i] - targets[k, i]) * decay
    return last, filled


def base_points(world: World, points: int = BASE_POINTS) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return x, y (m, body axes), share of the load at rest, and share of the area of each point, shape (n,) each.

    Gauss-Legendre in both axes; `corners`: the four corners. A rim is the band of the outer 20 % of each half size, a
    middle is the inner half of it; each takes `pressure` of the whole load, with the nodes laid out in panels that end
    where the pressure jumps.
    """
    hx, hy, _ = world.half_size
    if world.contact == "corners":
        x, y = np.array([1.0, 1.0, -1.0, -1.0]), np.array([1.0, -1.0, 1.0, -1.0])
        return x * hx, y * hy, np.full(4, 0.25), np.full(4, 0.25)
    panels = [(-1.0, 1.0, points)]
    if world.pressure > 0.0:
        outer, inner = max(points * 3 // 16, 1), max(points // 4, 1)
        panels = [(-1.0, -0.8, outer), (-0.8, -0.5, outer), (-0.5, 0.5, inner), (0.5, 0.8, outer), (0.8, 1.0, outer)]
    nodes, weights = [], []
    for low, high, n in panels:
        z, v = np.polynomial.legendre.leggauss(n)
        nodes.append(0.5 * (low + high) + 0.5 * (high - low) * z)
        weights.append(0.25 * (high - low) * v)
    x, y = (a.ravel() for a in np.meshgrid(np.concatenate(nodes), np.concatenate(nodes), indexing="ij"))
    area = np.outer(np.concatenate(weights), np.concatenate(weights)).ravel()
    load = area
    if world.pressure > 0.0:
        radius = np.maximum(abs(x), abs(y))
        chosen = area * ((radius > 0.8) if world.pressure_where == "rim" else (radius < 0.5))
        load = (1.0 - world.pressure) * area + world.pressure * chosen / chosen.sum()
    return x * hx, y * hy, load, area


def floor_texture(world: World) -> np.ndarray:
    """Return the texture at the nodes of its periodic grid, shape (TEXTURE_CELLS, TEXTURE_CELLS): x, then y.

    A Gaussian random field of standard deviation 1 and mean `-texture_mean`, to be multiplied by `texture`.
    """
    white = np.random.default_rng(world.texture_seed).standard_normal((TEXTURE_CELLS, TEXTURE_CELLS))
    k = 2.0 * math.pi * np.fft.fftfreq(TEXTURE_CELLS, TEXTURE_CELL_M)
    spectrum = np.exp(-0.25 * (k[:, None] ** 2 + k[None, :] ** 2) * world.texture_length**2)
    smooth = np.fft.ifft2(np.fft.fft2(white) * spectrum).real
    smooth -= smooth.mean()
    return smooth / smooth.std() - world.texture_mean


def wander_terms(seed: int, number: int) -> np.ndarray:
    """Return frequency (rad/s) and four amplitudes of each sinusoid of the wandering force, shape (WANDER_TERMS, 5).

    Long correlation: power per octave falls with frequency (0.05-1.5 Hz). Standard deviation 1 along each axis.
    """
    generator = np.random.default_rng([seed, number])
    hz = np.geomspace(0.05, 1.5, WANDER_TERMS) * generator.uniform(0.9, 1.1, WANDER_TERMS)
    level = hz**-0.5
    level /= math.sqrt(np.sum(level**2))
    return np.column_stack([2.0 * math.pi * hz, level[:, None] * generator.standard_normal((WANDER_TERMS, 4))])


def pack(world: World, *, points: int = BASE_POINTS, slip_eps: float = SLIP_EPS) -> np.ndarray:
    """Return the flat array that the right-hand side reads, everything but what changes within an episode."""
    x, y, w, area = base_points(world, points)
    p = np.zeros(_POINTS_AT + 3 * len(x) + TEXTURE_CELLS**2)

    def put(**values: float) -> None:
        for name, value in values.items():
            p[_AT[name]] = value

    hx, hy, hz = world.half_size
    r1, r2 = world.anisotropy
    c, s = math.cos(world.anisotropy_angle), math.sin(world.anisotropy_angle)
    turn = np.array([[c, -s], [s, c]])
    square = turn @ np.diag([r1 * r1, r2 * r2]) @ turn.T
    flow, norm = (
        (square, square) if world.anisotropy_flow == "associated" else (turn @ np.diag([r1, r2]) @ turn.T, np.eye(2))
    )
    by_point = world.stribeck != 0.0 or world.stiction != 0.0 or world.patch != 0.0 or world.texture != 0.0
    put(
        mass=world.mass, inertia=world.yaw_inertia, comx=world.com[0], comy=world.com[1], height=hz,
        weight_g=world.mass * world.gravity * math.cos(world.tilt), friction=world.friction, points=len(x),
        eps=slip_eps, by_point=float(by_point), hx=hx, hy=hy,
        d11=flow[0, 0], d12=flow[0, 1], d22=flow[1, 1], q11=norm[0, 0], q12=norm[0, 1], q22=norm[1, 1],
        stribeck=world.stribeck, stribeck_v=world.stribeck_speed,
        stiction=world.stiction, stiction_v=world.stiction_speed,
        patch=world.patch, patch_x=world.patch_place[0], patch_y=world.patch_place[1], patch_r=world.patch_radius,
        patch_disc=float(world.patch_shape == "disc"), texture=world.texture, cell=TEXTURE_CELL_M,
        drag=world.viscous_drag, film=world.film, film_xx=float(area @ (x * x + y * y)), air=world.air_drag,
        spin=world.rotational_damping, fx=world.wind[0], fy=world.wind[1],
        gx=world.gravity * math.sin(world.tilt) * math.cos(world.downhill),
        gy=world.gravity * math.sin(world.tilt) * math.sin(world.downhill),
        tether=world.tether, tether_x=world.tether_place[0], tether_y=world.tether_place[1],
        tether_rest=world.tether_rest, leak=world.mass_leak,
        lag_rate=1.0 / world.lag if world.lag > 0.0 else 0.0,
        periodic_x=world.periodic * math.cos(world.periodic_direction),
        periodic_y=world.periodic * math.sin(world.periodic_direction),
        periodic_w=2.0 * math.pi * world.periodic_hz, periodic_p=world.periodic_phase,
        cogging=world.cogging, teeth=world.cogging_teeth, cogging_p=world.cogging_phase, deflection=world.deflection,
        wear=world.wear, wander=world.wander,
        barrier=world.barrier, barrier_x=math.cos(world.barrier_direction), barrier_y=math.sin(world.barrier_direction),
        barrier_d=world.barrier_distance, barrier_c=world.barrier_damping,
        vortex=world.vortex, vortex_x=world.vortex_place[0], vortex_y=world.vortex_place[1],
        vortex_r=world.vortex_radius,
    )  # fmt: skip
    n = len(x)
    p[_POINTS_AT : _POINTS_AT + 3 * n] = np.concatenate([x, y, w])
    if world.texture != 0.0:
        p[_POINTS_AT + 3 * n :] = floor_texture(world).ravel()
    return p


def carried_out(world: World, command: np.ndarray) -> np.ndarray:
    """Return the wrench that the actuator makes of each command before delay and lag, shape (n, 8).

    Columns: force (2, N, world), first moments px fx, px fy, py fx, py fy (N m), height times force (2, N m).
    Order: steps, deadband, gain, crosstalk, limit, misalignment, offset of the point.
    """
    force = np.array(command[:, :2], float)
    if world.quantum > 0.0:
        force = np.round(force / world.quantum) * world.quantum
    if world.deadband > 0.0:
        size = np.hypot(force[:, 0], force[:, 1])
        force *= (np.maximum(size - world.deadband, 0.0) / np.where(size > 0.0, size, 1.0))[:, None]
    force *= world.gain
    if world.crosstalk != 0.0:
        force = np.column_stack([force[:, 0], force[:, 1] + world.crosstalk * force[:, 0] * abs(force[:, 0])])
    if math.isfinite(world.saturation):
        size = np.hypot(force[:, 0], force[:, 1])
        force *= np.minimum(1.0, world.saturation / np.where(size > 0.0, size, 1.0))[:, None]
    if world.misalignment != 0.0:
        c, s = math.cos(world.misalignment), math.sin(world.misalignment)
        force = force @ np.array([[c, s], [-s, c]])
    px, py = command[:, 2] + world.point_offset[0], command[:, 3] + world.point_offset[1]
    fx, fy, pz = force[:, 0], force[:, 1], command[:, 4]
    return np.column_stack([fx, fy, px * fx, px * fy, py * fx, py * fy, pz * fx, pz * fy])


def simulate(
    world: World,
    episode: Episode,
    *,
    rtol: float = 1e-7,
    atol: float = 1e-8,
    points: int = BASE_POINTS,
    slip_eps: float = SLIP_EPS,
    packed: np.ndarray | None = None,
) -> np.ndarray:
    """Return the state that the sensor shows at every sample, without noise, shape (n, 6).

    With an observation delay the first sample shows the start state, which the body then had one delay earlier; no
    force acts before the first sample. So it equals a delay of the actuator by as much. A scaled sensor shows the start
    state too: the true one is that over the scale.

    Args:
        world: The box and all around it.
        episode: Start state and commands.
        rtol, atol: Tolerances of LSODA.
        points: Base points per side.
        slip_eps: Regularising slip speed, m/s.
        packed: `pack(world, ...)` where it is at hand already.

    Raises:
        IntegrationError: Where LSODA gives up or the load tips the box.
    """
    p = (pack(world, points=points, slip_eps=slip_eps) if packed is None else packed).copy()
    n = len(episode.command)
    dt = 1.0 / episode.rate_hz
    p[_ELAPSED] = episode.elapsed_s
    if world.wander != 0.0:
        p[_WANDER_AT:_POINTS_AT] = wander_terms(world.wander_seed, episode.number).ravel()
    wrench = carried_out(world, episode.command)

    # intervals of constant force, in the time of the body; the sensor's clock is behind by `observation_delay`
    changed = np.flatnonzero(np.any(wrench[1:] != wrench[:-1], axis=1)) + 1
    begin = -world.observation_delay
    edges = np.concatenate([[0], changed]) * dt + world.delay
    forces = wrench[np.concatenate([[0], changed])]
    sample = np.arange(n) * dt - world.observation_delay
    end = sample[-1]
    starts = np.concatenate([[begin], edges])
    targets = np.vstack([np.zeros(8), forces])
    result = np.full((n, 6), math.nan)
    y = np.array(episode.start, float)
    y[[0, 1, 3, 4]] /= world.sensor_scale
    held = np.zeros(8)  # wrench at the start of an interval
    lengths = np.append(np.diff(starts), math.inf)
    filled, k = 0, 0
    while filled < n:
        if lengths[k] < SHORT * dt:
            run = k + int(np.argmax(lengths[k:] >= SHORT * dt))  # the last interval has no end
            k, filled = _march(
                p, y, starts, targets, held, world.lag, k, run, end, sample, filled, result, rtol, atol
            )  # fmt: skip
            if k == run or filled >= n:
                continue
        t_start, t_end = starts[k], starts[k] + lengths[k]
        p[_T0] = t_start
        p[_A0 : _A7 + 1] = targets[k]
        p[_B0 : _B7 + 1] = held - targets[k] if world.lag > 0.0 else 0.0
        last = int(np.searchsorted(sample, t_end - 1e-9, side="left"))  # samples before the end of the interval
        times = np.concatenate([[t_start], sample[filled:last], [min(t_end, end)]])
        kept = np.append(True, np.diff(times) > 1e-12)
        path = _odeint(p, y, times[kept], rtol, atol) if kept.sum() > 1 else y[None, :]
        at = np.cumsum(kept) - 1  # row of the path for each time
        result[filled:last] = path[at[1 : 1 + last - filled]]
        filled = max(filled, last)
        y = path[-1].copy()
        if world.lag > 0.0 and math.isfinite(t_end):
            held = targets[k] + (held - targets[k]) * math.exp(-lengths[k] / world.lag)
        k += 1
    result[:, [0, 1, 3, 4]] *= world.sensor_scale
    return result


def _odeint(p: np.ndarray, y: np.ndarray, times: np.ndarray, rtol: float, atol: float) -> np.ndarray:
    if not np.all(np.isfinite(_rate(y, times[0], p))):
        raise IntegrationError(f"physics: no load on the base balances the moments at {times[0]:.4f} s: the box tips.")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ODEintWarning)  # its message is read below
        path, info = odeint(
            _rate, y, times, args=(p,), Dfun=_jacobian, rtol=rtol, atol=atol, mxstep=20000, full_output=True
        )
    if info["message"] != "Integration successful." or not np.all(np.isfinite(path)):
        raise IntegrationError(
            f"physics: LSODA stopped between {times[0]:.4f} s and {times[-1]:.4f} s: {info['message']}"
        )
    return path


def simulate_all(world: World, episodes: list[Episode], **options: float) -> list[np.ndarray]:
    """Return `simulate` of every episode."""
    packed = pack(
        world, points=int(options.get("points", BASE_POINTS)), slip_eps=float(options.get("slip_eps", SLIP_EPS))
    )
    return [simulate(world, episode, packed=packed, **options) for episode in episodes]  # pyright: ignore[reportArgumentType]


def base_load(world: World, state: np.ndarray, *, wrench: np.ndarray | None = None) -> dict[str, float]:
    """Return how the base bears: centre of load (m), share lifted, friction (N, N m), all in body axes.

    Args:
        world: The box and all around it.
        state: Shape (6,).
        wrench: As `carried_out` gives it, shape (8,); none: no push.
    """
    p = pack(world)
    if wrench is not None:
        p[_A0 : _A7 + 1] = wrench
    n = int(p[_POINTS])
    mu, out = np.empty(n), np.empty(15)
    a, b, d, weight, *_ = _balance(p, np.asarray(state, float), 0.0, mu, out)
    x, y, w, _ = base_points(world)
    load = w * np.maximum(a + b * x + d * y, 0.0)
    return {
        "x_m": float(load @ x),
        "y_m": float(load @ y),
        "total": float(load.sum()),
        "lifted": float(w[load <= 0.0].sum()),
        "fx_n": -weight * float(np.array([a, b, d]) @ out[6:9]),
        "fy_n": -weight * float(np.array([a, b, d]) @ out[9:12]),
        "torque_n_m": -weight * float(np.array([a, b, d]) @ out[12:15]),
    }
