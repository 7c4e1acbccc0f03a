"""Ten inertial parameters of a rigid body, as ten free numbers of which every choice is a possible body.

The parameters are those of the pseudo-inertia matrix (Wensing, Kim and Slotine 2018)

    J = [ S  h ]     S = integral of x x^T dm = tr(I) / 2 - I about the body frame,   h = m c
        [ h' m ]

which is positive definite for every body that has mass anywhere in 3-D, and for no other numbers. With J = L L^T, L
lower triangular with a positive diagonal, the logarithms of the diagonal and the other six entries are ten free numbers
(log-Cholesky, Rucker and Wensing 2022): whatever the search tries is a possible body.
"""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np

NAMES = (
    "mass_kg", "com_x_m", "com_y_m", "com_z_m", "inertia_xx_kg_m2", "inertia_yy_kg_m2", "inertia_zz_kg_m2",
    "inertia_xy_kg_m2", "inertia_xz_kg_m2", "inertia_yz_kg_m2",
)  # fmt: skip
SIZE = len(NAMES)
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
    """Return the body of ten free numbers; whatever they are, it can exist."""
    lower = np.eye(4)
    lower[_LOWER] = x[4:]
    lower = lower * np.exp(x[:4])
    scale = np.append(half_size_m, 1.0)
    matrix = scale[:, None] * (lower @ lower.T)[::-1, ::-1] * scale
    mass = float(matrix[3, 3])
    com = matrix[:3, 3] / mass
    second = matrix[:3, :3] - mass * np.outer(com, com)
    return Inertial(mass, com, np.trace(second) * np.eye(3) - second)


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
