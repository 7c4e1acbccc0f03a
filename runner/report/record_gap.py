"""How much of the gap comes about in each window of an episode, as share and as colour."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from runner.report.motions import Paths

if TYPE_CHECKING:
    from runner.diagnosis.result import Diagnosis

LEAST, MUCH = (205, 207, 210), (136, 20, 110)  # from no gap to most of it: darker, too, so that lightness tells
HIGH = 97.0  # percentile of the windows that has the full colour


@dataclass(frozen=True)
class WindowGap:
    """The windows of one episode.

    Args:
        t_s: Their middles from the start of the episode, (n,), rising.
        begin_s: Where each begins, (n,); the first at 0.
        share: Of all that exceeds the noise in all episodes, (n,), at least 0.
        strength: Of the colour, (n,), 0 to 1.
    """

    t_s: np.ndarray
    begin_s: np.ndarray
    share: np.ndarray
    strength: np.ndarray


def window_gaps(diagnosis: Diagnosis, paths: Sequence[Paths]) -> list[WindowGap | None]:
    """Return the windows of each episode; None: it is told in no windows."""
    where = diagnosis.where
    if not len(where.windows):
        return [None] * len(paths)
    table = where.windows
    excess = np.maximum(table["excess"].to_numpy(float), 0.0)
    share = excess / max(float(excess.sum()), 1e-12)
    top = max(float(np.percentile(share, HIGH)), 1e-12)
    of, at = table["episode"].to_numpy(dtype=object), table["t_s"].to_numpy(float)
    out: list[WindowGap | None] = []
    for path in paths:
        recorded = diagnosis.recording.episodes[path.episode]
        here = np.flatnonzero(of == f"episode {recorded.index}")
        here = here[np.argsort(at[here])]
        t_s = at[here] - float(recorded.t_s[0])
        begin_s = np.concatenate([[0.0], (t_s[1:] + t_s[:-1]) / 2]) if len(here) else t_s
        out.append(WindowGap(t_s, begin_s, share[here], np.minimum(share[here] / top, 1.0)) if len(here) else None)
    return out


def blended(strength: float) -> tuple[int, int, int]:
    """Return the colour of a strength from 0 to 1."""
    r, g, b = (round(low + strength * (high - low)) for low, high in zip(LEAST, MUCH, strict=True))
    return r, g, b
