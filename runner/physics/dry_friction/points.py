"""The base points of a body in the axes of friction, and what depends on the direction of the slip there."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from runner.physics.dry_friction.coefficients import ACROSS, ALONG, NORMALITY, bend_flow, coefficients
from runner.physics.dry_friction.matrix3 import Symmetric, Triple, solve
from runner.physics.dry_friction.record import COLUMN, POINT_STRIDE, STRIDE

FILM, PRESSURE = COLUMN["film"], COLUMN["pressure"]
BASE_X, BASE_Y, BEARING_RADIUS = COLUMN["base_x"], COLUMN["base_y"], COLUMN["bearing_radius"]


class Points(NamedTuple):
    """The base points, what is worked out for each of them, and sums over them."""

    x: np.ndarray  # (n,)
    y: np.ndarray  # (n,)
    weight: np.ndarray  # (n,), of an even load
    mu: np.ndarray  # (n,)
    load: np.ndarray  # (n,), N
    limit: np.ndarray  # (n,), what friction can exert: mu * load, or its impulse
    sums: np.ndarray  # (10,), what `kernel` returns
    whole: np.ndarray  # (9,), `moments` of all weights
    share: np.ndarray  # (12,), a, b, c of the load, and `moments` of the weights that bear
    reach: tuple[float, float]  # of the outermost points, in body axes
    base: tuple[float, float, float, float]  # a disc that surely bears: centre, radius; above 0: an outline
    films: Symmetric  # damping by the film


class Anisotropy(NamedTuple):
    """How friction depends on direction: `along` and `across` of the potential, and whether the flow is bent."""

    along: float
    across: float
    bends: bool
    ahead: Triple  # where a point at rest would slip


SUMS, WHOLE, SHARE = 10, 9, 12  # numbers of those fields


@njit(error_model="numpy")
def room_for(n):
    """Return the memory for n base points and the sums over them, to be taken once for many steps."""
    return np.empty(6 * n + SUMS + WHOLE + SHARE)


@njit(error_model="numpy", forceinline=True)
def lay_out(record, n, turn, room):
    """Return the base points of a body in the axes of friction; their weights do not sum to 1 yet but to the second."""
    cr, sr = turn
    rx, ry, w = room[:n], room[n : 2 * n], room[2 * n : 3 * n]
    film, pressure = record[FILM], record[PRESSURE]
    f0 = f2 = f4 = f5 = 0.0
    reach_x = reach_y = total = 0.0
    bears = record[BEARING_RADIUS]
    for i in range(n):
        j = STRIDE + POINT_STRIDE * i
        bx, by = record[j], record[j + 1]
        rx[i] = cr * bx + sr * by
        ry[i] = cr * by - sr * bx
        w[i] = record[j + 2] * max(1.0 + pressure * record[j + 3], 0.0)
        total += w[i]
        if w[i] > 0.0:
            reach_x = max(reach_x, abs(bx))
            reach_y = max(reach_y, abs(by))
        else:
            bears = 0.0
        if film > 0.0:
            z = film * record[j + 2]
            f0 += z
            f2 -= z * ry[i]
            f4 += z * rx[i]
            f5 += z * (rx[i] * rx[i] + ry[i] * ry[i])
    films = (f0, 0.0, f2, f0, f4, f5)
    base_x, base_y = record[BASE_X], record[BASE_Y]
    base = (cr * base_x + sr * base_y, cr * base_y - sr * base_x, bears, record[BEARING_RADIUS])
    points = Points(
        rx, ry, w, room[3 * n : 4 * n], room[4 * n : 5 * n], room[5 * n : 6 * n],
        room[6 * n : 6 * n + SUMS], room[6 * n + SUMS : 6 * n + SUMS + WHOLE], room[6 * n + SUMS + WHOLE :],
        (reach_x, reach_y), base, films,
    )  # fmt: skip
    return points, total


@njit(error_model="numpy", forceinline=True)
def anisotropy(record, v, body):
    a, b, normality = record[ALONG], record[ACROSS], record[NORMALITY]
    if a == b or normality == 1.0:
        return Anisotropy(a, b, False, v)
    a, b = a ** (0.5 + 0.5 * normality), b ** (0.5 + 0.5 * normality)
    # a slip that friction answers with what opposes the force
    s0, s1, s2 = solve(*body.mass, *body.force)
    return Anisotropy(a, b, True, (s0 / (a * a), s1 / (b * b), s2))


@njit(error_model="numpy", forceinline=True)
def set_coefficients(record, n, points, axes, v, place):
    coefficients(record, n, points.x, points.y, v, place, points.mu)
    if axes.bends:
        bend_flow(record, n, points.x, points.y, v, axes.ahead, points.mu, 1)
