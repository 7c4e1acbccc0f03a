"""Forces on the box but friction: the push, what surrounds the box, and the wandering force."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from runner.blind.planar_box.physics import layout as at
from runner.blind.planar_box.physics.layout import WANDER_TERMS


def wander_terms(seed: int, number: int) -> np.ndarray:
    """Return frequency (rad/s) and four amplitudes of each sinusoid of the wandering force, shape (WANDER_TERMS, 5).

    Long correlation: power per octave falls with frequency (0.05-1.5 Hz). Standard deviation 1 along each axis.
    """
    generator = np.random.default_rng([seed, number])
    hz = np.geomspace(0.05, 1.5, WANDER_TERMS) * generator.uniform(0.9, 1.1, WANDER_TERMS)
    level = hz**-0.5
    level /= math.sqrt(np.sum(level**2))
    return np.column_stack([2.0 * math.pi * hz, level[:, None] * generator.standard_normal((WANDER_TERMS, 4))])


@njit(error_model="numpy")
def pushed(p, t, c, s):
    """Return the force of the push (x, y), its torque about the geometric centre, and force times height (x, y).

    Each of its first moments is a + b exp(-(t - t0) / lag); c and s are those of the yaw.
    """
    e = math.exp(-(t - p[at.T0]) * p[at.LAG_RATE]) if p[at.LAG_RATE] > 0.0 else 0.0
    fx = p[at.A0] + p[at.B0] * e
    fy = p[at.A1] + p[at.B1] * e
    px_fx = p[at.A2] + p[at.B2] * e
    px_fy = p[at.A3] + p[at.B3] * e
    py_fx = p[at.A4] + p[at.B4] * e
    py_fy = p[at.A5] + p[at.B5] * e
    zx = p[at.A6] + p[at.B6] * e
    zy = p[at.A7] + p[at.B7] * e
    torque = c * (px_fy - py_fx) - s * (px_fx + py_fy)  # (R p) x F
    return fx, fy, torque, zx, zy


@njit(error_model="numpy")
def add_surrounding(p, y, t, fx, fy):
    """Add to a force (x, y, world) all that acts through the geometric centre at its height, and return the sum."""
    fx += p[at.FX] - p[at.DRAG] * y[3] - p[at.DEFLECTION] * y[4]
    fy += p[at.FY] - p[at.DRAG] * y[4] + p[at.DEFLECTION] * y[3]
    if p[at.AIR] != 0.0:
        speed = math.sqrt(y[3] * y[3] + y[4] * y[4])
        fx -= p[at.AIR] * speed * y[3]
        fy -= p[at.AIR] * speed * y[4]
    if p[at.TETHER] != 0.0:
        dx = p[at.TETHER_X] - y[0]
        dy = p[at.TETHER_Y] - y[1]
        length = math.sqrt(dx * dx + dy * dy)
        if length > p[at.TETHER_REST] and length > 0.0:
            pull = p[at.TETHER] * (length - p[at.TETHER_REST]) / length
            fx += pull * dx
            fy += pull * dy
    if p[at.PERIODIC_X] != 0.0 or p[at.PERIODIC_Y] != 0.0:
        wave = math.sin(p[at.PERIODIC_W] * (p[at.ELAPSED] + t) + p[at.PERIODIC_P])
        fx += p[at.PERIODIC_X] * wave
        fy += p[at.PERIODIC_Y] * wave
    if p[at.WANDER] != 0.0:
        for i in range(WANDER_TERMS):
            j = at.WANDER_AT + 5 * i
            sine = math.sin(p[j] * t)
            cosine = math.cos(p[j] * t)
            fx += p[at.WANDER] * (p[j + 1] * sine + p[j + 2] * cosine)
            fy += p[at.WANDER] * (p[j + 3] * sine + p[j + 4] * cosine)
    if p[at.BARRIER] != 0.0:
        depth = p[at.BARRIER_X] * y[0] + p[at.BARRIER_Y] * y[1] - p[at.BARRIER_D]
        if depth > 0.0:
            rate = p[at.BARRIER_X] * y[3] + p[at.BARRIER_Y] * y[4]
            push = max(p[at.BARRIER] * depth + p[at.BARRIER_C] * rate, 0.0)
            fx -= push * p[at.BARRIER_X]
            fy -= push * p[at.BARRIER_Y]
    if p[at.VORTEX] != 0.0:
        dx = (y[0] - p[at.VORTEX_X]) / p[at.VORTEX_R]
        dy = (y[1] - p[at.VORTEX_Y]) / p[at.VORTEX_R]
        level = p[at.VORTEX] * math.exp(0.5 - 0.5 * (dx * dx + dy * dy))
        fx -= level * dy
        fy += level * dx
    return fx, fy
