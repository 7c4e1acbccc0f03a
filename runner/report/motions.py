"""The motions that a report shows: measured, as the nominal model has it, and as the corrected one has it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from runner.localise.where import Where, localise
from runner.systems.simulator import Run

if TYPE_CHECKING:
    from runner.diagnosis.result import Diagnosis


@dataclass(frozen=True)
class Paths:
    """One episode, channels as in `AbstractSystem.channels`.

    Args:
        episode: Its place in the recording.
        held_out: Whether it was kept from the fit.
        t_s: Time from its start, (T,).
        measured: (T, C), NaN where not measured or an outlier.
        nominal: (T, C), from the start state that suits the nominal model best.
        corrected: (T, C), likewise of the corrected model.
    """

    episode: int
    held_out: bool
    t_s: np.ndarray
    measured: np.ndarray
    nominal: np.ndarray
    corrected: np.ndarray


def replay(diagnosis: Diagnosis) -> list[Paths]:
    """Simulate every episode with and without the effects found, in the order of the recording.

    Where stretches are parts of an episode, their motions follow one another; NaN in between.
    """
    simulator = diagnosis.system.simulator().parts(diagnosis.stretches)
    out = []
    for e, episode in enumerate(diagnosis.recording.episodes):
        before = np.full(diagnosis.measured.values[e].shape, np.nan)
        after = before.copy()
        for i, span in enumerate(diagnosis.stretches):
            if span.episode != e or i not in diagnosis.nominal_starts or i not in diagnosis.corrected_starts:
                continue
            runs = [
                Run((), np.asarray(diagnosis.nominal_starts[i], float)),
                Run(tuple(diagnosis.effects), np.asarray(diagnosis.corrected_starts[i], float)),
            ]
            before[span.begin : span.end], after[span.begin : span.end] = simulator.predict(i, runs)
        if np.isnan(before).all():
            continue
        measured = np.where(diagnosis.measured.valid[e], diagnosis.measured.values[e], np.nan)
        t_s = np.asarray(episode.t_s) - episode.t_s[0]
        out.append(Paths(e, e in diagnosis.held_out, t_s, measured, before, after))
    return out


def where_after(diagnosis: Diagnosis) -> Where | None:
    """Return where the corrected model still misses; None: nothing was corrected."""
    if not diagnosis.effects:
        return None
    if diagnosis.abstention is not None:
        return diagnosis.abstention.after
    return localise(
        diagnosis.system,
        diagnosis.measured,
        diagnosis.corrected_starts,
        tuple(diagnosis.effects),
        stretches=diagnosis.stretches,
    )


def autocorrelation(residual: np.ndarray, most: int) -> tuple[np.ndarray, int]:
    """Return the autocorrelation of one channel over episodes at lags 1 to `most`, and the number of values.

    Args:
        residual: Whitened residuals, (E, T), NaN where there is none.
        most: The longest lag.
    """
    r = np.asarray(residual, float)
    r = r - np.nanmean(r)
    power = np.nanmean(r * r)
    count = int(np.isfinite(r).sum())
    if not power > 0:
        return np.zeros(most), count
    # the products of episodes are summed, those across their borders are not formed
    return np.array([np.nansum(r[:, k:] * r[:, :-k]) for k in range(1, most + 1)]) / (power * count), count


def whitened(diagnosis: Diagnosis, paths: list[Paths], which: str) -> np.ndarray:
    """Return whitened residuals of `nominal` or `corrected`, (C, E, T), NaN beyond an episode's end."""
    longest = max(len(p.t_s) for p in paths)
    channels = paths[0].measured.shape[1]
    out = np.full((channels, len(paths), longest), np.nan)
    for k, p in enumerate(paths):
        difference = getattr(p, which) - diagnosis.measured.values[p.episode]
        white = replace(diagnosis.measured, hung={}).whiten(p.episode, difference)
        out[:, k, : len(p.t_s)] = np.where(diagnosis.measured.valid[p.episode], white, np.nan).T
    return out
