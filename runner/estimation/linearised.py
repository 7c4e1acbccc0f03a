"""What the linear model around a belief's point of linearisation says: the loss, the estimate, the way to it.

The loss is -2 log posterior.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from runner.estimation.belief import Belief, times
from runner.estimation.copies import STATE
from runner.numerics.levenberg_marquardt import damped

_STRIDE, _FARTHEST = 1.5, 4.0  # of the parameters: the longest step, and how far from the prior, in its deviations


def unexplained(belief: Belief) -> np.ndarray:
    """Return where the measurements are further away than their noise can be, (N,)."""
    return expected_loss(belief) > belief.count + 6 * np.sqrt(2 * belief.count) + 20


def loss_at_point(belief: Belief) -> np.ndarray:
    """Return the loss (-2 log posterior) at the point of linearisation, (N,)."""
    return belief.misfit + (belief.point**2).sum(axis=1)


def expected_gain(belief: Belief) -> np.ndarray:
    """Return by how much the linear model expects the loss to fall from the point to the estimate, (N,).

    That is their squared distance in standard deviations of the estimate.
    """
    return (_downhill(belief) * (belief.z - belief.point)).sum(axis=1)


def expected_loss(belief: Belief) -> np.ndarray:
    """Return the loss that the linear model expects at the estimate, (N,)."""
    return loss_at_point(belief) - expected_gain(belief)


def _downhill(belief: Belief) -> np.ndarray:
    """Return the negative gradient of half the loss by z at the point, (N, 11)."""
    return times(belief.root.transpose(0, 2, 1), belief.gradient) - belief.point


def solved(belief: Belief, damping: np.ndarray | None = None) -> Belief:
    """Return the belief with the estimate of the linear model; `damping` (N,) shortens the way from the point."""
    normal = belief.normal
    if damping is not None:
        normal = damped(normal, damping)
    scale = np.sqrt(np.einsum("nii->ni", normal))
    step = np.linalg.solve(normal / scale[:, :, None] / scale[:, None, :], (_downhill(belief) / scale)[..., None])
    return replace(belief, z=belief.point + step[..., 0] / scale)


def shortened(belief: Belief, z: np.ndarray) -> np.ndarray:
    """Return the end (N, 11) of the way from the point towards `z`, cut where the linear model says nothing more."""
    way = z - belief.point
    largest = np.abs(way[:, STATE:]).max(axis=1) / _STRIDE
    out = belief.point + way / np.maximum(largest, 1.0)[:, None]
    out[:, STATE:] = np.clip(out[:, STATE:], -_FARTHEST, _FARTHEST)
    return out
