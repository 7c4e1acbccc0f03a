"""What of a box's motion was measured, and a rough account of all of it."""

from __future__ import annotations

import numpy as np

from runner.recording import Recording
from runner.recording.kinematics import without_gaps


def measured_columns(recording: Recording) -> np.ndarray:
    """Return which of x, y, yaw, vx, vy, wz were measured at all, (K,) indices."""
    seen = [np.isfinite(np.hstack([e.pose, e.twist])).any(axis=0) for e in recording.episodes]
    return np.flatnonzero(np.any(seen, axis=0))


def motion(recording: Recording) -> tuple[np.ndarray, ...]:
    """Return pose and twist of each episode without gaps, (T, 6): lines between samples, slopes for velocities."""
    return tuple(np.hstack(without_gaps(e.t_s, e.pose, e.twist)) for e in recording.episodes)
