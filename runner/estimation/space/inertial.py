"""Ten inertial parameters of a rigid body, as ten free numbers of which every choice is a possible body.

The parameters are those of the pseudo-inertia matrix (Wensing, Kim and Slotine 2018)

    J = [ S  h ]     S = integral of x x^T dm = tr(I) / 2 - I about the body frame,   h = m c
        [ h' m ]

which is positive definite for every body that has mass anywhere in 3-D, and for no other numbers. With J = L L^T, L
lower triangular with a positive diagonal, the logarithms of the diagonal and the other six entries are ten free numbers
(log-Cholesky, Rucker and Wensing 2022): whatever the search tries is a possible body.

A body of the same shape and another density has the same numbers but for the first four, which are larger or smaller by
the same amount, half the logarithm of the ratio of the densities (`SCALE`). Where no force acts, neither that nor the
mass at the same inertia leaves a trace in the motion: two of the ten are never told then (`SHARES`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import mujoco
import numpy as np

NAMES = (
    "mass_kg", "com_x_m", "com_y_m", "com_z_m", "inertia_xx_kg_m2", "inertia_yy_kg_m2", "inertia_zz_kg_m2",
    "inertia_xy_kg_m2", "inertia_xz_kg_m2", "inertia_yz_kg_m2",
)  # fmt: skip
SIZE = len(NAMES)
# what can be told where no force is measured
SHARES = (*NAMES[1:4], *(f"{name.removesuffix('_kg_m2')}_share" for name in NAMES[4:]))
SCALE = np.array([1.0] * 4 + [0.0] * 6)  # by the free numbers: half the logarithm of the density
_OFF = ([0, 0, 1], [1, 2, 2])  # xy, xz, yz
_LOWER = np.tril_indices(4, -1)


class Inertial(NamedTuple):
    """Mass, kg, centre of mass (3,), m, body axes, and inertia about it, (3, 3), kg m2, body axes."""

    mass_kg: float
    com_m: np.ndarray
    inertia_kg_m2: np.ndarray

    @property
    def values(self) -> np.ndarray:
        """In the order of `NAMES`, (10,)."""
        inertia = self.inertia_kg_m2
        return np.concatenate([[self.mass_kg], self.com_m, np.diag(inertia), inertia[_OFF]])


def pseudo_inertia(body: Inertial) -> np.ndarray:
    """Return the pseudo-inertia matrix about the body frame, (4, 4)."""
    m, c = body.mass_kg, body.com_m
    out = np.empty((4, 4))
    out[:3, :3] = 0.5 * np.trace(body.inertia_kg_m2) * np.eye(3) - body.inertia_kg_m2 + m * np.outer(c, c)
    out[:3, 3] = out[3, :3] = m * c
    out[3, 3] = m
    return out


def to_vector(body: Inertial, half_size_m: np.ndarray) -> np.ndarray:
    """Return the ten free numbers of a body, (10,), lengths in half sizes.

    Raises:
        numpy.linalg.LinAlgError: If no distribution of mass has these parameters.
    """
    scale = np.append(1.0 / half_size_m, 1.0)
    # mass first, so that its logarithm is one of the numbers
    lower = np.linalg.cholesky((scale[:, None] * pseudo_inertia(body) * scale)[::-1, ::-1])
    ratio = lower / np.diag(lower)  # columns in units of their diagonal: all of order one
    return np.concatenate([np.log(np.diag(lower)), ratio[_LOWER]])


def from_vector(x: np.ndarray, half_size_m: np.ndarray) -> Inertial:
    """Return the body of ten free numbers (10,); whatever they are, it can exist."""
    matrix = matrix_of(x, half_size_m)
    mass = float(matrix[3, 3])
    com = matrix[:3, 3] / mass
    second = matrix[:3, :3] - mass * np.outer(com, com)
    return Inertial(mass, com, np.trace(second) * np.eye(3) - second)


def matrix_of(x: np.ndarray, half_size_m: np.ndarray) -> np.ndarray:
    """Return the pseudo-inertia matrices (..., 4, 4) of free numbers (..., 10), which may be complex."""
    lower = np.zeros((*x.shape[:-1], 4, 4), dtype=x.dtype)
    lower[..., range(4), range(4)] = 1.0
    lower[..., _LOWER[0], _LOWER[1]] = x[..., 4:]
    lower = lower * np.exp(x[..., None, :4])
    scale = np.append(half_size_m, 1.0)
    return scale[:, None] * (lower @ lower.swapaxes(-1, -2))[..., ::-1, ::-1] * scale


def standard_of(x: np.ndarray, half_size_m: np.ndarray) -> np.ndarray:
    """Return the parameters in which Newton-Euler is linear (Atkeson, An and Hollerbach 1986), (..., 10).

    Mass, mass times centre of mass (3), and inertia about the origin of the body frame: xx, yy, zz, xy, xz, yz.
    """
    matrix = matrix_of(x, half_size_m)
    return np.concatenate([matrix[..., 3, 3:], matrix[..., :3, 3], _moments(matrix[..., :3, :3])], axis=-1)


def values_of(x: np.ndarray, half_size_m: np.ndarray) -> np.ndarray:
    """Return mass, centre of mass and the inertia about it in the order of `NAMES`, (..., 10)."""
    matrix = matrix_of(x, half_size_m)
    mass = matrix[..., 3, 3:]
    com = matrix[..., :3, 3] / mass
    second = matrix[..., :3, :3] - mass[..., None] * com[..., :, None] * com[..., None, :]
    return np.concatenate([mass, com, _moments(second)], axis=-1)


def shares_of(x: np.ndarray, half_size_m: np.ndarray) -> np.ndarray:
    """Return what does not depend on the density, in the order of `SHARES`, (..., 9).

    The centre of mass, and the inertia about it as shares of the sum of its moments.
    """
    values = values_of(x, half_size_m)
    inertia = values[..., 4:]
    return np.concatenate([values[..., 1:4], inertia / inertia[..., :3].sum(axis=-1, keepdims=True)], axis=-1)


def units_of(values: np.ndarray, half_size_m: np.ndarray) -> np.ndarray:
    """Return what errors of values (..., 10) or (..., 9), ordered as `NAMES` or `SHARES`, are large or small against.

    The mass itself, half sizes, and the mean moment of inertia.
    """
    mean = np.repeat(values[..., -6:-3].mean(axis=-1, keepdims=True), 6, axis=-1)
    half = np.broadcast_to(half_size_m, (*values.shape[:-1], 3))
    return np.concatenate([values[..., :-9], half, mean], axis=-1)


def _moments(second: np.ndarray) -> np.ndarray:
    """Return the inertia (..., 6) of second moments (..., 3, 3): xx, yy, zz, xy, xz, yz."""
    own = np.einsum("...ii->...i", second)
    return np.concatenate([own.sum(axis=-1, keepdims=True) - own, -second[..., _OFF[0], _OFF[1]]], axis=-1)


def derivative(
    function: Callable[[np.ndarray, np.ndarray], np.ndarray], x: np.ndarray, half_size_m: np.ndarray
) -> np.ndarray:
    """Return the derivatives (..., k, 10) of such a function of free numbers (..., 10), exact to the last digit.

    By complex steps (Squire and Trapp 1998).
    """
    tiny = 1e-30
    stepped = x[..., None, :] + 1j * tiny * np.eye(SIZE)
    return (np.imag(function(stepped, half_size_m)) / tiny).swapaxes(-1, -2)


def inertial_in(model: mujoco.MjModel, body_id: int) -> Inertial:
    """Return what a compiled model says of a body."""
    turn = np.empty(9)
    mujoco.mju_quat2Mat(turn, model.body_iquat[body_id])
    axes = turn.reshape(3, 3)
    inertia = axes @ np.diag(model.body_inertia[body_id]) @ axes.T
    return Inertial(float(model.body_mass[body_id]), model.body_ipos[body_id].copy(), inertia)


def write_inertial(model: mujoco.MjModel, scratch: mujoco.MjData, body_id: int, body: Inertial) -> None:
    """Write mass, centre of mass and inertia into a compiled model."""
    moments, axes = np.linalg.eigh(body.inertia_kg_m2)
    if np.linalg.det(axes) < 0:
        axes[:, 0] *= -1
    model.body_mass[body_id], model.body_ipos[body_id] = body.mass_kg, body.com_m
    model.body_inertia[body_id] = moments
    mujoco.mju_mat2Quat(model.body_iquat[body_id], np.ascontiguousarray(axes).ravel())
    mujoco.mj_setConst(model, scratch)
