"""Where a box surely stands still, so that what is measured of it is noise."""

from __future__ import annotations

import numpy as np

from runner.recording import Episode
from runner.recording.kinematics import without_gaps

# of a pin: the body has stopped so long after it (at 1 m/s and a friction of 0.5 it does so in 0.2 s), in which it may
# have crept by no more than such a share of its radius
PIN_SETTLE_S, PIN_LEAST_S, PIN_CREEPS = 0.2, 0.05, 0.01


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


def pin_rest_segments(episode: Episode, radius_m: float) -> list[slice]:
    """Return where a pin has stood for long enough that friction has stopped the body, or has not moved yet."""
    if episode.pin_m is None:
        return []
    settle, least = int(PIN_SETTLE_S / episode.step_s), max(int(PIN_LEAST_S / episode.step_s), 8)
    crept = PIN_CREEPS * radius_m
    from_start = np.linalg.norm(episode.pin_m - episode.pin_m[0], axis=1) > crept
    from_end = np.linalg.norm(episode.pin_m - episode.pin_m[-1], axis=1) > crept
    begins = int(np.argmax(from_start)) if from_start.any() else len(episode)
    ends = int(len(episode) - np.argmax(from_end[::-1])) if from_end.any() else len(episode)
    found = [slice(0, begins), slice(ends + settle, len(episode))]
    return [s for s in found if s.stop - s.start >= least]
