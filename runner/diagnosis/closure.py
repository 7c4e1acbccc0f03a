"""How far the gap shrinks on the episodes that nothing was fitted to."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
import pandas as pd

from runner.diagnosis.result import Closure
from runner.effects.base import Effects
from runner.inference.least_squares import Fit, Fitter
from runner.noise.measured import Measured
from runner.systems.simulator import Run


def close(
    starts: Mapping[int, tuple[np.ndarray, np.ndarray]],
    measured: Measured,
    fitter: Fitter,
    effects: Effects,
    regimes: pd.DataFrame,
) -> Closure:
    """Compare residuals of held-out episodes without and with the effects.

    Args:
        starts: Of all that is held out, by what `fitter` calls its episode: the start states, (S,), that were fitted to
            it with the nominal model and with the corrected one.
        measured: Channels and noise of what `fitter` calls episodes: recorded ones, or stretches of them.
        fitter: Simulates them.
        effects: What the corrected model holds.
        regimes: For the result, see `Closure`.
    """
    rows, pairs, episode = [], [], []
    by_recorded: dict[int, list[int]] = {}
    for e in starts:
        by_recorded.setdefault(measured.spans[e].episode, []).append(e)
    for recorded, members in by_recorded.items():
        residuals = []
        for e in members:
            runs = [Run(model, start) for model, start in zip(((), effects), starts[e], strict=True)]
            both = fitter.simulator.predict(e, runs) - measured.values[e]
            residuals.append([np.where(measured.valid[e], r, np.nan) for r in both])
        old, new = (np.concatenate(of) for of in zip(*residuals, strict=True))
        # before anything is hit it is that of the sensors
        scale = np.concatenate([np.broadcast_to(measured.scale(e), measured.values[e].shape) for e in members])
        rows += [
            {
                "episode": fitter.system.recording.episodes[recorded].index,
                "channel": channel.name,
                "unit": channel.unit,
                "before": float(np.sqrt(np.nanmean(old[:, i] ** 2))),
                "after": float(np.sqrt(np.nanmean(new[:, i] ** 2))),
                "noise": float(np.sqrt(np.mean(scale[np.isfinite(old[:, i]), i] ** 2))),
            }
            for i, channel in enumerate(fitter.system.channels)
            if np.isfinite(old[:, i]).any()
        ]
        block = max(int(1.0 / fitter.system.recording.episodes[recorded].step_s), 1)
        for begin in range(0, len(old), block):
            some = [(r / scale)[begin : begin + block] for r in (old, new)]
            if np.isfinite(some[0]).any():
                pairs.append((*(np.nanmean(r**2) for r in some), min(block, len(old) - begin)))
                episode.append(recorded)
    squares, of = np.array(pairs), np.array(episode)
    total = _closed(squares)
    g, by_episode = np.random.default_rng(0), [squares[of == e] for e in np.unique(of)]
    closed = []
    for _ in range(400):
        drawn = [by_episode[k] for k in g.integers(len(by_episode), size=len(by_episode))]
        closed.append(_closed(np.concatenate([b[g.integers(len(b), size=len(b))] for b in drawn]))[0])
    low, high = np.quantile(closed, [0.025, 0.975])
    return Closure(pd.DataFrame(rows), regimes, total[0], float(low), float(high), total[1])


def left_by_episode(fits: Iterable[Fit], fitter: Fitter) -> dict[int, float]:
    """Return what fits leave beyond the noise, squared noises summed over values, by number of the recorded episode."""
    left: dict[int, float] = {}
    for fit in fits:
        for e, loss in zip(fit.episodes, fit.loss, strict=True):
            number = fitter.system.recording.episodes[fitter.measured.spans[e].episode].index
            left[number] = left.get(number, 0.0) + float(loss) - fitter.measured.count([e])
    return left


def _closed(squares: np.ndarray) -> tuple[float, float]:
    """Share of the error, and share of the closable mean square (before minus noise), that went."""
    before, after = np.average(squares[:, :2], axis=0, weights=squares[:, 2])
    closable = max(before - 1.0, 1e-9)
    return float(1 - np.sqrt(after / before)), float((before - after) / closable)
