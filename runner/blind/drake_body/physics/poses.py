"""Paths of poses: x, y, z and the quaternion w, x, y, z, body to world, one row for each sample, (T, 7)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation


def turns_of(path: np.ndarray) -> Rotation:
    """Return the orientations of a path."""
    return Rotation.from_quat(path[:, [4, 5, 6, 3]])


def path_of(places: np.ndarray, turns: Rotation) -> np.ndarray:
    """Return a path of places (T, 3) and orientations, the sign of quaternions as it is nearest to the one before."""
    quaternions = turns.as_quat()[:, [3, 0, 1, 2]]
    same = np.sum(quaternions[1:] * quaternions[:-1], axis=1) >= 0.0
    signs = np.cumprod(np.concatenate([[1.0], np.where(same, 1.0, -1.0)]))
    return np.column_stack([places, quaternions * signs[:, None]])


def away(paths: Sequence[np.ndarray], others: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Return how far paths are from others: m and, as the vector of the turn between them, rad; (T, 6) each."""
    return [
        np.column_stack([a[:, :3] - b[:, :3], (turns_of(a) * turns_of(b).inv()).as_rotvec()])
        for a, b in zip(paths, others, strict=True)
    ]


def moved(path: np.ndarray, by: np.ndarray) -> np.ndarray:
    """Return a path moved by m and rad in the world, (T, 6), as `away` has them."""
    return path_of(path[:, :3] + by[:, :3], Rotation.from_rotvec(by[:, 3:]) * turns_of(path))
