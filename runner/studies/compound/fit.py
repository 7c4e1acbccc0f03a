"""Least squares for the inertial parameters of one body."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import scipy

from runner.estimation.space.inertial import SIZE, Inertial, from_vector, to_vector
from runner.studies.compound.pokes import PokeSimulator, differences
from runner.teleop.link import NoiseConfig

_STEP = 1e-5  # for differences, of numbers of order one
PRIOR_SD = 1.0  # of each free number: how far the truth may be from what is believed
_TRIED = 2.0 ** np.arange(-2.0, 2.1, 0.5)  # masses to begin with, in those of the start


class InertialFit(NamedTuple):
    """A fitted body, the covariance of its values in the order of `NAMES`, (10, 10), and the loss per number."""

    body: Inertial
    covariance: np.ndarray
    loss: float


def fit(
    episodes: PokeSimulator, measured: np.ndarray, noise: NoiseConfig, start: Inertial, half_size_m: np.ndarray
) -> InertialFit:
    """Fit the inertial parameters of one body to measured episodes.

    Args:
        episodes: The local model.
        measured: (episodes, n, 13).
        noise: To weigh the measurements with; must not be zero.
        start: What is believed; other masses of the same shape are tried as well.
        half_size_m: Of the body, (3,).
    """
    sd = np.repeat([noise.position_m, noise.angle_rad, noise.velocity_m_s, noise.rate_rad_s], 3)

    def residuals(vectors: np.ndarray, upto: int) -> np.ndarray:
        motion = episodes.run([from_vector(x, half_size_m) for x in vectors])
        found = differences(motion[:, :, :upto], measured[:, :upto]) / sd
        return np.hstack([found.reshape(len(vectors), -1), (vectors - believed) / PRIOR_SD])

    believed = to_vector(start, half_size_m)

    samples = measured.shape[1]
    bodies = [Inertial(f * start.mass_kg, start.com_m, f * start.inertia_kg_m2) for f in _TRIED]
    tried = np.array([to_vector(body, half_size_m) for body in bodies])
    # a robust loss, as far-off motions say little
    x = tried[np.log1p(residuals(tried, samples // 2) ** 2).sum(axis=1).argmin()]
    result: Any = None
    # far-off motions count less on the way; at the end it is least squares
    for upto, loss in ((samples // 3, "soft_l1"), (samples, "soft_l1"), (samples, "linear")):

        def derivative(at: np.ndarray, upto: int = upto) -> np.ndarray:
            both = residuals(np.concatenate([at + _STEP * np.eye(SIZE), at - _STEP * np.eye(SIZE)]), upto)
            return ((both[:SIZE] - both[SIZE:]) / (2 * _STEP)).T

        def value(at: np.ndarray, upto: int = upto) -> np.ndarray:
            return residuals(at[None], upto)[0]

        jac: Any = derivative  # a function, which the stubs of scipy do not know of
        result = scipy.optimize.least_squares(value, x, jac, x_scale="jac", loss=loss, max_nfev=40, ftol=1e-8)
        x = result.x
    spread = np.linalg.inv(result.jac.T @ result.jac)
    change = np.stack(
        [
            (from_vector(x + _STEP * e, half_size_m).values - from_vector(x - _STEP * e, half_size_m).values)
            / 2
            / _STEP
            for e in np.eye(SIZE)
        ],
        axis=1,
    )
    return InertialFit(from_vector(x, half_size_m), change @ spread @ change.T, 2 * result.cost / result.fun.size)
