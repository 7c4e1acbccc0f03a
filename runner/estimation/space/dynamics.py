"""A rigid body in space under a wrench at its tracked point: how it moves on, and what its motion hangs on.

Newton and Euler about the tracked point, the origin of the body frame, in body axes, are linear in the ten standard
parameters (Atkeson, An and Hollerbach 1986):

    force  = m a + alpha x h + w x (w x h)
    torque = I alpha + w x (I w) + h x a            =>      wrench = Y(a, alpha, w) parameters

a is the specific force, what an accelerometer at the tracked point says: its acceleration less gravity, in body axes;
h is mass times centre of mass, I the inertia about the tracked point. The same equation solved for (a, alpha) drives
the motion, and Y is the derivative of that by the parameters: d(a, alpha) = M^-1 (d wrench - Y d parameters - C d w).

Between two readings the wrench goes from the one to the next along a straight line. A step is one of the classical
Runge-Kutta method of fourth order, with the motion's sensitivities beside it. Turns are matrices, body to world; a
small turn of a motion is one about body axes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy

from runner.estimation.space.inertial import SIZE, derivative, standard_of

MOTION, WRENCH = 12, 6  # numbers of a motion that are free: position, turn, velocity, rate
_INERTIA = np.array([[0, 3, 4], [3, 1, 5], [4, 5, 2]])  # places of xx, yy, zz, xy, xz, yz in the matrix


class Motion(NamedTuple):
    """Of the tracked point and the body: position and velocity (..., 3), world; turn (..., 3, 3); rate (..., 3), body.

    m, m/s, rad/s.
    """

    position: np.ndarray
    turn: np.ndarray
    velocity: np.ndarray
    rate: np.ndarray

    def of(self, lanes: np.ndarray | int | slice) -> Motion:
        """Return some of the motions."""
        return Motion(*(part[lanes] for part in self))

    def moved(self, by: np.ndarray) -> Motion:
        """Return motions that are a small step (..., 12) away: position, turn, velocity, rate."""
        return Motion(
            self.position + by[..., :3], self.turn @ _turned(by[..., 3:6]), self.velocity + by[..., 6:9],
            self.rate + by[..., 9:],
        )  # fmt: skip

    def less(self, other: Motion) -> np.ndarray:
        """Return the step (..., 12) that leads from another motion to this one."""
        turn = other.turn.swapaxes(-1, -2) @ self.turn
        vector = scipy.spatial.transform.Rotation.from_matrix(turn.reshape(-1, 3, 3)).as_rotvec()
        return np.concatenate(
            [
                self.position - other.position,
                vector.reshape(turn.shape[:-1]),
                self.velocity - other.velocity,
                self.rate - other.rate,
            ],
            axis=-1,
        )


class Body(NamedTuple):
    """Bodies as their motion needs them.

    Attributes:
        first: Mass times centre of mass, (..., 3), kg m.
        inertia: About the tracked point, (..., 3, 3), kg m2.
        inverse: Of the matrix that makes a wrench of (a, alpha), (..., 6, 6).
        standard: Derivative of the standard parameters by the free numbers, (..., 10, 10).
    """

    first: np.ndarray
    inertia: np.ndarray
    inverse: np.ndarray
    standard: np.ndarray

    def of(self, lanes: np.ndarray) -> Body:
        """Return some of the bodies."""
        return Body(*(part[lanes] for part in self))


def body_of(x: np.ndarray, half_size_m: np.ndarray) -> Body:
    """Return bodies of free numbers (..., 10), see `inertial`."""
    standard = standard_of(x, half_size_m)
    first, inertia = standard[..., 1:4], standard[..., 4:][..., _INERTIA]
    matrix = np.zeros((*x.shape[:-1], WRENCH, WRENCH))
    matrix[..., range(3), range(3)] = standard[..., :1]
    matrix[..., :3, 3:], matrix[..., 3:, :3] = -cross(first), cross(first)
    matrix[..., 3:, 3:] = inertia
    return Body(first, inertia, np.linalg.inv(matrix), derivative(standard_of, x, half_size_m))


def cross(v: np.ndarray) -> np.ndarray:
    """Return the matrices (..., 3, 3) of the cross product with vectors (..., 3)."""
    out = np.zeros((*v.shape, 3))
    out[..., 2, 1], out[..., 0, 2], out[..., 1, 0] = v[..., 0], v[..., 1], v[..., 2]
    out[..., 1, 2], out[..., 2, 0], out[..., 0, 1] = -v[..., 0], -v[..., 1], -v[..., 2]
    return out


def times(matrix: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Return products of matrices (..., i, j) and vectors (..., j)."""
    return (matrix @ vector[..., None])[..., 0]


def accelerations(body: Body, rate: np.ndarray, wrench: np.ndarray) -> np.ndarray:
    """Return specific force and angular acceleration, (..., 6), m/s2, rad/s2, of a wrench at the tracked point."""
    w = cross(rate)
    return times(
        body.inverse, wrench - np.concatenate([times(w @ w, body.first), times(w, times(body.inertia, rate))], axis=-1)
    )


def regressor(acceleration: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """Return what makes the wrench of the standard parameters, (..., 6, 10)."""
    specific, turning, w = acceleration[..., :3], acceleration[..., 3:], cross(rate)
    out = np.zeros((*rate.shape[:-1], WRENCH, SIZE))
    out[..., :3, 0] = specific
    out[..., :3, 1:4] = cross(turning) + w @ w
    out[..., 3:, 1:4] = -cross(specific)
    out[..., 3:, 4:] = _inertia_by(turning) + w @ _inertia_by(rate)
    return out


def _inertia_by(v: np.ndarray) -> np.ndarray:
    """Return the matrices (..., 3, 6) that make I v of the six numbers of I."""
    out = np.zeros((*v.shape, 6))
    for row in range(3):
        for column in range(3):
            out[..., row, _INERTIA[row, column]] = v[..., column]
    return out


class Slopes(NamedTuple):
    """Derivatives of the accelerations by rate (..., 6, 3), free numbers (..., 6, 10) and wrench (..., 6, 6)."""

    rate: np.ndarray
    numbers: np.ndarray
    wrench: np.ndarray


def slopes(body: Body, rate: np.ndarray, acceleration: np.ndarray) -> Slopes:
    """Return how accelerations (..., 6), made of the same body and rate, change."""
    w = cross(rate)
    by_rate = np.concatenate(
        [
            -cross(times(w, body.first)) - w @ cross(body.first),
            w @ body.inertia - cross(times(body.inertia, rate)),
        ],
        axis=-2,
    )
    by_numbers = regressor(acceleration, rate) @ body.standard
    return Slopes(-body.inverse @ by_rate, -body.inverse @ by_numbers, body.inverse)


def step(
    body: Body, motion: Motion, wrench: tuple[np.ndarray, np.ndarray], step_s: float, gravity: np.ndarray
) -> Motion:
    """Return the motion one step later.

    Args:
        body: One for each motion.
        motion: Now.
        wrench: At the tracked point, body axes, now and one step later, (..., 6) each, N, N m.
        step_s: Its length.
        gravity: (3,), m/s2, world.
    """
    return _stepped(body, motion, wrench, step_s, gravity, None)[0]


def step_with_sensitivities(
    body: Body, motion: Motion, wrench: tuple[np.ndarray, np.ndarray], step_s: float, gravity: np.ndarray
) -> tuple[Motion, np.ndarray]:
    """Return the motion one step later, and what it hangs on, (..., 12, 34).

    The columns are the motion now (12), the free numbers of the body (10), and the wrench now (6) and then (6).
    """
    start = np.zeros((*motion.position.shape[:-1], MOTION, MOTION + SIZE + 2 * WRENCH))
    start[..., range(MOTION), range(MOTION)] = 1.0
    later, by = _stepped(body, motion, wrench, step_s, gravity, start)
    assert by is not None
    return later, by


def _stepped(
    body: Body,
    motion: Motion,
    wrench: tuple[np.ndarray, np.ndarray],
    step_s: float,
    gravity: np.ndarray,
    by: np.ndarray | None,
) -> tuple[Motion, np.ndarray | None]:
    """Step the motion, and its sensitivities if they are given."""
    at, at_by = motion, by
    total = [np.zeros_like(part) for part in motion]
    total_by = None if by is None else np.zeros_like(by)
    for share, weight, ahead in ((0.0, 1 / 6, 0.5), (0.5, 1 / 3, 0.5), (0.5, 1 / 3, 1.0), (1.0, 1 / 6, 0.0)):
        acceleration = accelerations(body, at.rate, (1 - share) * wrench[0] + share * wrench[1])
        slope = (
            at.velocity,
            at.turn @ cross(at.rate),
            times(at.turn, acceleration[..., :3]) + gravity,
            acceleration[..., 3:],
        )
        for part, grown in zip(total, slope, strict=True):
            part += weight * step_s * grown
        if by is not None and at_by is not None and total_by is not None:
            slope_by = _slope_by(body, at, acceleration, at_by, share)
            total_by += weight * step_s * slope_by
            at_by = by + ahead * step_s * slope_by
        at = Motion(*(part + ahead * step_s * grown for part, grown in zip(motion, slope, strict=True)))
    later = Motion(*(part + grown for part, grown in zip(motion, total, strict=True)))
    # back to a turn: one step of Newton's method towards the nearest one
    turn = later.turn @ (1.5 * np.eye(3) - 0.5 * later.turn.swapaxes(-1, -2) @ later.turn)
    return later._replace(turn=turn), None if by is None or total_by is None else by + total_by


def _slope_by(body: Body, motion: Motion, acceleration: np.ndarray, by: np.ndarray, share: float) -> np.ndarray:
    """Return how fast sensitivities (..., 12, 34) grow."""
    slope = slopes(body, motion.rate, acceleration)
    change = slope.rate @ by[..., 9:, :]
    change[..., MOTION : MOTION + SIZE] += slope.numbers
    change[..., -2 * WRENCH : -WRENCH] += (1 - share) * slope.wrench
    change[..., -WRENCH:] += share * slope.wrench
    turned = by[..., 3:6, :]
    return np.concatenate(
        [
            by[..., 6:9, :],
            by[..., 9:, :] - cross(motion.rate) @ turned,
            motion.turn @ (change[..., :3, :] - cross(acceleration[..., :3]) @ turned),
            change[..., 3:, :],
        ],
        axis=-2,
    )


def _turned(vector: np.ndarray) -> np.ndarray:
    """Return the turns (..., 3, 3) of rotation vectors (..., 3)."""
    turn = scipy.spatial.transform.Rotation.from_rotvec(vector.reshape(-1, 3)).as_matrix()
    return turn.reshape(*vector.shape, 3)
