"""A second, independent way to move a box on a dry floor: `scipy.integrate.solve_ivp` on a fine grid of base points.

It shares nothing with `dry_friction`: the equations stand about the centre of mass in world axes, the base is a grid of
cells, time steps are chosen by an error bound, and friction is `-mu N u / sqrt(u^2 + eps^2)`. The load is affine
over the base; as friction is linear in it, both follow from one 3 x 3 system, without iteration as long as all bears.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import solve_ivp

Push = Callable[[float], tuple[np.ndarray, np.ndarray]]  # t_s -> force (3,), world axes, N; point (3,), body axes, m


def no_push(t_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Leave the box alone."""
    return np.zeros(3), np.zeros(3)


def cells(half_size_m: tuple[float, float, float], n: int) -> np.ndarray:
    """Return n x n equal cells of a base, each as the four points of Gauss's rule in it, (4 n n, 2)."""
    middle = (np.arange(n) + 0.5) / n * 2 - 1
    edge = (middle[:, None] + np.array([-1, 1]) / (np.sqrt(3) * n)).ravel()
    x, y = np.meshgrid(edge * half_size_m[0], edge * half_size_m[1])
    return np.column_stack([x.ravel(), y.ravel()])


def corners(half_size_m: tuple[float, float, float]) -> np.ndarray:
    """Return the corners of a base, (4, 2)."""
    hx, hy, _ = half_size_m
    return np.array([[hx, hy], [-hx, hy], [hx, -hy], [-hx, -hy]])


@dataclass(frozen=True)
class Loads:
    """What acts on a box in one state: force (2,) and torque about the CoM, and what of it is friction and film (2,).

    `carried_n` is the load on the base, `centre_m` its place from the box's middle, world axes, (2,).
    """

    force_n: np.ndarray
    torque_nm: float
    friction_n: np.ndarray
    carried_n: float
    centre_m: np.ndarray
    share: np.ndarray  # load per point relative to an even one


@dataclass(frozen=True)
class Box:
    """A box on its base, SI units. The frame is at the geometric centre; `com_m` is relative to it, body axes.

    Args:
        mass_kg: Mass.
        friction: Coulomb coefficient.
        inertia_kg_m2: About the vertical through the centre of mass.
        half_size_m: Half edges.
        com_m: Centre of mass.
        gravity_m_s2: Vector, world axes.
        points: Base points, body axes, (n, 2), m; default: those of 8 x 8 cells.
        areas: Share of the base that each stands for, (n,); default: equal.
        pressure: Relative pressure at each point, (n,), before the moments shift it; default: 1.
        slip_eps_m_s: Regularises the slip; a stuck body creeps by about this speed.
        friction_of: Coefficient from slip speed (n,) and world place (n, 2) instead of `friction`.
        axes: Friction along and across the body axis at `axis_rad`, as multiples; slip at right angles to the limit.
        axis_rad: See `axes`.
        normality: 0: slip is not at right angles to the limit, each axis has its own coefficient; see the effect.
        film_n_s_m: Viscous film under the base, in all.
        air_n_s2_m2: Drag on the geometric centre, by speed squared.
        leak_per_s: Share of mass and inertia lost per second.
    """

    mass_kg: float
    friction: float
    inertia_kg_m2: float
    half_size_m: tuple[float, float, float] = (0.5, 0.5, 0.5)
    com_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    gravity_m_s2: tuple[float, float, float] = (0.0, 0.0, -9.81)
    points: np.ndarray = field(default_factory=lambda: np.empty((0, 2)), repr=False)
    areas: np.ndarray = field(default_factory=lambda: np.empty(0), repr=False)
    pressure: np.ndarray = field(default_factory=lambda: np.ones(1), repr=False)
    slip_eps_m_s: float = 1e-5
    friction_of: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None
    axes: tuple[float, float] = (1.0, 1.0)
    axis_rad: float = 0.0
    normality: float = 1.0
    film_n_s_m: float = 0.0
    air_n_s2_m2: float = 0.0
    leak_per_s: float = 0.0
    _weights: np.ndarray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if not len(self.points):
            object.__setattr__(self, "points", cells(self.half_size_m, 8))
        if not len(self.areas):
            object.__setattr__(self, "areas", np.full(len(self.points), 1 / len(self.points)))
        weights = self.areas * self.pressure
        object.__setattr__(self, "_weights", weights / weights.sum())

    def loads(self, t_s: float, state: np.ndarray, push: Push) -> Loads:
        """Return what acts; `state` is the CoM's position, yaw and their rates, (6,)."""
        c, s = math.cos(state[2]), math.sin(state[2])
        turn = np.array([[c, -s], [s, c]])
        com_x, com_y = turn @ self.com_m[:2]
        arm = self.points @ turn.T - (com_x, com_y)  # (n, 2), from the CoM
        slip = np.empty_like(arm)
        slip[:, 0], slip[:, 1] = state[3] - state[5] * arm[:, 1], state[4] + state[5] * arm[:, 0]
        drag = self._drag(slip, state[:2] + arm, turn)  # (n, 2), friction per load
        mass = self.mass_kg * (1 - self.leak_per_s * t_s)
        (fx, fy, fz), point = push(t_s)
        x, y = c * point[0] - s * point[1] - com_x, s * point[0] + c * point[1] - com_y
        z = point[2] - self.com_m[2]
        gx, gy, gz = self.gravity_m_s2
        carried = -mass * gz - fz
        height = self.com_m[2] + self.half_size_m[2]  # of the CoM above the floor
        middle_x, middle_y = state[3] + state[5] * com_y, state[4] - state[5] * com_x
        air = -self.air_n_s2_m2 * math.hypot(middle_x, middle_y)
        ax, ay = air * middle_x, air * middle_y
        # moments about the CoM of all but friction and load; the film acts at the floor, the air on the middle
        mx, my = y * fz - z * fy + self.com_m[2] * ay, z * fx - x * fz - self.com_m[2] * ax
        smear = np.zeros_like(slip)
        if self.film_n_s_m:
            smear = -self.film_n_s_m * self.areas[:, None] * slip
            film_x, film_y = smear.sum(axis=0)
            mx, my = mx + height * film_y, my - height * film_x
        share = self._share(arm, drag, carried, height, mx, my)
        load = self._weights * share
        rub = smear + (carried * load)[:, None] * drag
        torque = x * fy - y * fx + arm[:, 0] @ rub[:, 1] - arm[:, 1] @ rub[:, 0] + com_y * ax - com_x * ay
        friction = rub.sum(axis=0)
        total = friction + np.array([fx + ax + mass * gx, fy + ay + mass * gy])
        return Loads(total, torque, friction, carried, (com_x, com_y) + load @ arm, share)

    def _drag(self, slip: np.ndarray, place: np.ndarray, turn: np.ndarray) -> np.ndarray:
        speed = np.sqrt((slip**2).sum(axis=1) + self.slip_eps_m_s**2)
        mu = self.friction if self.friction_of is None else self.friction_of(speed, place)[:, None]
        if self.axes == (1.0, 1.0):
            return -mu * slip / speed[:, None]
        c, s = np.cos(self.axis_rad), np.sin(self.axis_rad)
        rotate = turn @ np.array([[c, -s], [s, c]])
        stretch = np.array(self.axes)
        local = slip @ rotate * stretch**self.normality
        local /= np.sqrt((local**2).sum(axis=1) + self.slip_eps_m_s**2)[:, None]
        return -mu * (local * stretch) @ rotate.T

    def _share(
        self, arm: np.ndarray, drag: np.ndarray, carried: float, height: float, mx: float, my: float
    ) -> np.ndarray:
        table = np.empty((len(arm), 5))  # 1, x, y, friction per load
        table[:, 0], table[:, 1:3], table[:, 3:] = 1.0, arm, drag
        bearing = self._weights
        share = np.ones(len(arm))
        for _ in range(100):
            # load = carried * w * (a + b x + c y); sums over the base of 1, x, y, friction, per a, b, c
            sums = (table[:, :3] * bearing[:, None]).T @ table  # (3, 5)
            # about the CoM: N y + height * f_y = -Mx, -N x - height * f_x = -My
            system = sums[:, :3].T.copy()
            system[1:] += height * sums[:, 3:].T
            try:
                share = table[:, :3] @ np.linalg.solve(system, (1.0, my / carried, -mx / carried))
            except np.linalg.LinAlgError:
                break  # it tips over an edge: only where an integrator tries a step that is too long
            now = np.where(share > 0, self._weights, 0.0)
            if (now == bearing).all():
                break
            bearing = now
        return np.maximum(share, 0.0)

    def run(
        self,
        times_s: np.ndarray,
        push: Push = no_push,
        start: ArrayLike = (0.0,) * 6,
        breaks_s: tuple[float, ...] = (),
        tolerance: float = 1e-6,
    ) -> np.ndarray:
        """Return x, y, yaw, vx, vy, wz of the geometric centre at these times, (T, 6).

        Args:
            times_s: Increasing from the start, (T,).
            push: Force and point of application by time.
            start: State of the geometric centre at `times_s[0]`, (6,).
            breaks_s: Times inside the span at which the push jumps.
            tolerance: Absolute and relative, of the integrator.
        """

        def rate(t_s: float, state: np.ndarray) -> np.ndarray:
            loads = self.loads(t_s, state, push)
            left = 1 - self.leak_per_s * t_s
            force, torque = loads.force_n / self.mass_kg, loads.torque_nm / self.inertia_kg_m2
            return np.array([*state[3:], *(force / left), torque / left])

        state = self.to_com(np.array(start, float)[None])[0]
        parts = []
        end_s = times_s[-1]
        for left_s, right_s in pairwise([times_s[0], *breaks_s, end_s]):
            inside = times_s[(times_s >= left_s) & ((times_s < right_s) | (right_s == end_s))]
            limits: dict[str, Any] = {"rtol": tolerance, "atol": tolerance, "max_step": 0.05}
            solution = solve_ivp(rate, (left_s, right_s), state, "LSODA", dense_output=True, **limits)
            assert solution.success
            assert solution.sol is not None
            parts.append(solution.sol(inside).T)
            state = solution.y[:, -1]
        return self.to_com(np.concatenate(parts), -1.0)

    def to_com(self, states: np.ndarray, sign: float = 1.0) -> np.ndarray:
        """Return the states (T, 6) of the CoM from those of the geometric centre, or back with sign -1."""
        c, s = np.cos(states[:, 2]), np.sin(states[:, 2])
        x, y = self.com_m[:2]
        lx, ly = c * x - s * y, s * x + c * y
        shift = np.column_stack([lx, ly, 0 * lx, -states[:, 5] * ly, states[:, 5] * lx, 0 * lx])
        return states + sign * shift
