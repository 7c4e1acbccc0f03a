"""What the data can tell at best: the Cramer-Rao bound, and the batch least-squares answer as a reference."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from runner.estimation.belief import UNKNOWNS
from runner.estimation.copies import STATE, Copies

_STEP = 1e-5


def trajectory(
    copies: Copies, unknowns: np.ndarray, pushes: np.ndarray, ends: np.ndarray, *, first: int = 0
) -> np.ndarray:
    """Return the states (k, m, 6) of k copies after some numbers of steps.

    Args:
        copies: The model.
        unknowns: Start state and parameters of each, (k, 11).
        pushes: Commands, (n, 12).
        ends: After how many steps, (m,), growing.
        first: At which step the copies start.
    """
    states, out, done = unknowns[:, :STATE], [], first
    for end in ends.tolist():
        states = copies.run(unknowns[:, STATE:], states, pushes[done:end])
        out.append(states)
        done = end
    return np.stack(out, axis=1)


def information(
    copies: Copies, unknowns: np.ndarray, pushes: np.ndarray, ends: np.ndarray, noise_sd: np.ndarray
) -> np.ndarray:
    """Return Fisher's information on start state and parameters after each measurement, (m, 11, 11).

    By central differences of the whole trajectory at the true unknowns (11,); noise white and normal, (6,).
    """
    steps = _STEP * np.vstack([np.eye(UNKNOWNS), -np.eye(UNKNOWNS)])
    states = trajectory(copies, unknowns + steps, pushes, ends)
    by_unknowns = (states[:UNKNOWNS] - states[UNKNOWNS:]) / (2 * _STEP) / noise_sd
    return np.cumsum(np.einsum("ami,bmi->mab", by_unknowns, by_unknowns), axis=0)


def bound(info: np.ndarray) -> np.ndarray:
    """Return the least standard deviation of an unbiased estimate of the parameters, (..., 5), start state unknown.

    Infinite where the data say nothing.
    """
    state, across, parameters = info[..., :STATE, :STATE], info[..., :STATE, STATE:], info[..., STATE:, STATE:]
    left = parameters - across.swapaxes(-1, -2) @ np.linalg.pinv(state, hermitian=True) @ across
    scale = np.sqrt(np.maximum(np.einsum("...ii->...i", parameters), 1e-300))
    values, vectors = np.linalg.eigh(left / scale[..., :, None] / scale[..., None, :])
    with np.errstate(divide="ignore"):
        inverse = np.where(values > 1e-12, 1 / np.maximum(values, 1e-300), np.inf)
    spread = np.where(vectors**2 > 1e-12, vectors**2, 0.0)
    with np.errstate(invalid="ignore"):
        parts = np.where(spread > 0, spread * inverse[..., None, :], 0.0)
    return np.sqrt(parts.sum(axis=-1)) / scale


@dataclass(frozen=True)
class BatchFit:
    """The least-squares answer to all data at once: unknowns (11,), their covariance (11, 11), the loss."""

    unknowns: np.ndarray
    covariance: np.ndarray
    loss: float


def batch_fit(
    copies: Copies,
    start: np.ndarray,
    pushes: np.ndarray,
    ends: np.ndarray,
    measured: np.ndarray,
    noise_sd: np.ndarray,
) -> BatchFit:
    """Fit start state and parameters to all measurements at once by `scipy.optimize.least_squares`; no prior.

    Args:
        copies: The model.
        start: Where to begin, (11,).
        pushes: Commands, (n, 12).
        ends: After how many steps each measurement comes, (m,).
        measured: (m, 6).
        noise_sd: Of the measurements, (6,).
    """

    def jacobian(u: np.ndarray) -> np.ndarray:
        steps = _STEP * np.vstack([np.eye(UNKNOWNS), -np.eye(UNKNOWNS)])
        states = trajectory(copies, u + steps, pushes, ends) / noise_sd
        return ((states[:UNKNOWNS] - states[UNKNOWNS:]) / (2 * _STEP)).reshape(UNKNOWNS, -1).T

    # in units in which a first step of one goes a few standard deviations: further away there are other minima; none is
    # more than 1 (SI): what says nothing at the start, as the speed of a body that friction stops at once, may later
    scale = 10.0 / np.maximum(np.linalg.norm(jacobian(start), axis=0), 10.0)

    def residuals(p: np.ndarray) -> np.ndarray:
        return ((trajectory(copies, (start + scale * p)[None], pushes, ends)[0] - measured) / noise_sd).ravel()

    found = scipy.optimize.least_squares(
        residuals,
        np.zeros(UNKNOWNS),
        lambda p: jacobian(start + scale * p) * scale,
        ftol=1e-12,
        xtol=1e-12,
    )
    covariance = np.linalg.pinv(found.jac.T @ found.jac, hermitian=True)
    return BatchFit(start + scale * found.x, covariance * np.outer(scale, scale), float(2 * found.cost))
