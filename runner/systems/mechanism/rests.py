"""Where a mechanism surely stands still, so that what is measured of it is noise."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from runner.recording.model_form import MechanismEpisode, MechanismRecording
from runner.systems.mechanism.settings import MECHANISM
from runner.systems.raw_signals import spreads


def resting(recording: MechanismRecording) -> list[tuple[int, slice]]:
    """Return where commands have not changed for long and no channel has spread or trend: episode and samples."""
    spread = spreads([e.values for e in recording.episodes])
    moving = [c for c, s in enumerate(recording.mapping.sources) if s.quantity == "position"]
    return [(i, span) for i, e in enumerate(recording.episodes) for span in _spans(e, spread, moving)]


def _spans(episode: MechanismEpisode, spread: np.ndarray, moving: list[int]) -> list[slice]:
    """Return the rests of an episode: positions that neither spread nor drift while commands are constant."""
    if not moving:
        return []
    driven = np.hstack([episode.commands, episode.forces_n.reshape(len(episode), -1)])
    changes = np.flatnonzero(np.any(np.diff(driven, axis=0) != 0, axis=1)) + 1
    limits = MECHANISM.signal
    settle = round(limits.settle_s / episode.step_s)
    least = max(round(limits.min_rest_s / episode.step_s), limits.min_rest_samples)
    out = []
    for begin, end in pairwise([0, *changes.tolist(), len(episode)]):
        span = slice(begin + settle, end)
        if end - begin - settle >= least and all(_is_flat(episode, span, c, spread[c]) for c in moving):
            out.append(span)
    return out


def _is_flat(episode: MechanismEpisode, span: slice, channel: int, spread: float) -> bool:
    """Whether a channel has no trend and next to no spread in a stretch."""
    limits = MECHANISM.signal
    values, t = episode.values[span, channel], episode.t_s[span]
    known = np.isfinite(values)
    if known.sum() < limits.min_rest_samples:
        return False
    fit, covariance = np.polyfit(t[known] - t[known].mean(), values[known], 1, cov=True)
    return bool(
        np.std(values[known]) < limits.flat * spread and abs(fit[0]) <= limits.still_errors * np.sqrt(covariance[0, 0])
    )
