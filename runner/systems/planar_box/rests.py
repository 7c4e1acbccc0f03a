"""Where a box surely stands still, so that what is measured of it is noise."""

from __future__ import annotations

import numpy as np

from runner.recording import Episode
from runner.recording.kinematics import without_gaps


def rest_segments(episode: Episode, settle_s: float = 1.0, least_s: float = 0.3) -> list[slice]:
    """Return where nothing has been commanded for long enough that friction has stopped the body, or it never moved."""
    twist = without_gaps(episode.t_s, episode.pose, episode.twist)[1]
    pushed = np.linalg.norm(np.nan_to_num(episode.force_n), axis=1) > 0
    settle, least = int(settle_s / episode.step_s), max(int(least_s / episode.step_s), 8)
    edges = np.flatnonzero(np.diff(np.concatenate([[True], pushed, [True]]).astype(int)))
    out = []
    for begin, end in zip(edges[::2], edges[1::2], strict=False):
        begin += settle
        if end - begin >= least:
            part = twist[begin:end]
            # at rest the mean velocity is nothing but noise
            error = part.std(axis=0) / np.sqrt(len(part)) * 4 + 1e-12
            if np.all(np.abs(part.mean(axis=0)) < error):
                out.append(slice(begin, end))
    return out
