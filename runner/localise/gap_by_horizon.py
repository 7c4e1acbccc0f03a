"""The gap per channel over longer and longer times, start states fitted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from runner.localise.linearised import Model, linearised
from runner.noise.measured import Measured
from runner.recording import Span
from runner.settings import SETTINGS
from runner.simulate.gap import HORIZONS_S, WHOLE_EPISODE, of_a_sample
from runner.simulate.shooting import WINDOWS_AT_ONCE
from runner.systems.base import AbstractSystem
from runner.systems.simulator import Run
from runner.systems.windows import windows_of


def gap_by_horizon(
    model: Model, measured: Measured, starts: Mapping[int, np.ndarray], stretches: Sequence[Span]
) -> pd.DataFrame:
    """Return the gap per channel and horizon, as `Where.gap` has it.

    Args:
        model: What is replayed.
        measured: The channels and their noise.
        starts: Start state of each stretch that counts, by its position, (S,).
        stretches: What is replayed from such a start, for the longest horizon.
    """
    system, simulator, rate = model.system, model.simulator, model.system.rate_hz
    lengths = [len(e) for e in system.recording.episodes]
    episodes = sorted({stretches[i].episode for i in starts})
    rows = []
    for horizon in of_a_sample(HORIZONS_S, rate):
        windows = windows_of(lengths, round(horizon * rate), episodes)
        if len(windows):
            enough = SETTINGS.where.horizon_searched * system.searched_s / horizon
            windows = windows.some(max(SETTINGS.where.horizon_min_windows, int(min(enough, len(windows)))))
            parts = []
            for _, some in windows.chunks(WINDOWS_AT_ONCE):
                smoothed = system.initial.guess_windows(measured, some, smooth=True)
                parts.append(linearised(model, some, measured, smoothed).left())
            squares, count = (np.sum(every, axis=0) for every in zip(*parts, strict=True))
            rows += _rows(system, f"{horizon:g} s", squares, count, measured)
    parts, order = measured.parts(stretches), sorted(starts)
    replayed = simulator.parts(stretches)
    shown = np.concatenate(replayed.predict_each([(i, [Run(model.effects, starts[i])]) for i in order]), axis=1)[0]
    valid = np.concatenate([parts.valid[i] for i in order])
    squares = np.where(valid, (shown - np.concatenate([parts.values[i] for i in order])) ** 2, 0.0).sum(axis=0)
    rows += _rows(system, _longest(stretches, lengths, rate), squares, valid.sum(axis=0) - len(order), measured)
    return pd.DataFrame(rows)


def _longest(spans: Sequence[Span], lengths: Sequence[int], rate: float) -> str:
    """Return what the longest time is called over which a model is replayed."""
    if list(spans) == [Span(e, 0, n) for e, n in enumerate(lengths)]:
        return WHOLE_EPISODE
    return f"{(max(s.end - s.begin for s in spans) - 1) / rate:.2g} s"


def _rows(
    system: AbstractSystem, horizon: str, squares: np.ndarray, count: np.ndarray, measured: Measured
) -> list[dict[str, object]]:
    rms = np.sqrt(squares / np.where(count > 0, count, np.nan))
    return [
        {
            "channel": channel.name,
            "unit": channel.unit,
            "horizon": horizon,
            "rms": float(rms[c]),
            "noise": float(measured.sigma[c]),
            "noises": float(rms[c] / measured.sigma[c]),
        }
        for c, channel in enumerate(system.channels)
    ]
