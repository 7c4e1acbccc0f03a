"""The gap between a recording and a model of what was recorded, open loop: how far apart the two drift, and how fast.

The model replays the recorded commands from measured states, in windows that begin at regular times and over whole
episodes. A measured state carries noise, and that noise grows with the horizon: a gap from measured starts is never
as small as the noise of a sample. So two gaps are told: from the start states as they were measured, beside what the
noise of sample and start alone would make of it; and from start states that are fitted to the window, with what such a
fit takes from the noise put back, so that a perfect model has a gap of one noise at every horizon. A window of which
its measured start leaves less keeps that.

A force that a sensor has measured is replayed with the sensor's noise, and moves what it pushes by that: what this
makes of a gap shows where the same model is replayed with more noise of that size.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from runner.effects.base import Effects
from runner.errors import RecordingError
from runner.noise.measured import Measured
from runner.recording import Span
from runner.settings import SETTINGS
from runner.simulate.shooting import WINDOWS_AT_ONCE, Fitted, Predict, fit_starts
from runner.systems.base import AbstractSystem
from runner.systems.simulator import AbstractSimulator, Run
from runner.systems.windows import Windows, windows_of

HORIZONS_S = (0.1, 0.5, 1.0)
WHOLE_EPISODE = "episode"
# Of a descent of starts. Speeds guessed from positions of 30 a second are far off: after two steps windows of a second
# still missed ten times what they miss in the end.
START_STEPS = 8


@dataclass(frozen=True)
class Gap:
    """The gap of a case.

    Args:
        table: One row per channel, horizon and kind of start: `horizon` ("0.1 s", ..., "episode"), `horizon_s` (NaN for
            whole episodes), `starts` ("measured" or "fitted"), `channel`, `unit`, `rms` (physical), `noise`, `stated`
            (False: the noise is estimated), `noises` (rms / noise), `noises_expected` (the same of a perfect model),
            `noises_median` (`noises` of the window in the middle, from fitted starts), `windows`, `values`; NaN where
            there are none. A perfect model misses the noise, and what that of a measured force makes.
        episodes: The same for each whole episode: `episode` is its number in the recording.
        starts: Fitted start states of the whole episodes, by position of the episode, (S,) each.
        growth: By horizon what one noise of where a window begins grows to, in noises of the channel where that is
            most. Noise of its speeds is not counted: it leads far away in a free motion, too, and a fit finds them.
    """

    table: pd.DataFrame
    episodes: pd.DataFrame
    starts: dict[int, np.ndarray]
    growth: Mapping[str, float]

    @property
    def told(self) -> str:
        """The longest horizon at which what is missed says something of the model.

        Where noise grows many times over, any small difference becomes as large as the motion.
        """
        horizons = list(self.growth)
        return next((h for h in horizons[::-1] if not self.growth[h] > SETTINGS.pieces.most_growth), horizons[0])

    def _repr_html_(self) -> str:
        return self.table.to_html(index=False, float_format="{:.3g}".format)


def of_a_sample(horizons_s: Sequence[float], rate_hz: float) -> tuple[float, ...]:
    """Return the horizons, s, that are at least a sample long: of what is sampled slowly some of the usual are not."""
    return tuple(h for h in horizons_s if round(h * rate_hz) >= 1)


def measure_gap(
    system: AbstractSystem,
    signals: Measured,
    *,
    effects: Effects = (),
    horizons_s: Sequence[float] = HORIZONS_S,
    episodes: Sequence[int] | None = None,
    whole_episodes: bool = True,
    advance: Callable[..., None] = lambda steps=1: None,
) -> Gap:
    """Measure the gap between a recording and its nominal model, or a corrected one.

    Args:
        system: What was recorded, and what its owner believes.
        signals: Its measured channels, and their noise.
        effects: What the corrected model holds; none: the nominal model.
        horizons_s: Lengths of windows, s, or none. Longer than any episode they are left out, but for the shortest.
        episodes: Positions of the episodes that count; None: all.
        whole_episodes: Whether the gap over whole episodes, and their start states, are wanted, too.
        advance: Called after each horizon and each episode: `len(horizons_s) + len(episodes)` times.

    Raises:
        RecordingError: If a horizon is shorter than a sample, or no episode is as long as the shortest of them.
    """
    lengths = [len(e) for e in system.recording.episodes]
    chosen = list(range(len(lengths))) if episodes is None else list(episodes)
    simulator = system.simulator()
    noisier = [s.simulator() for s in system.driven_otherwise(SETTINGS.odds.drive_draws)]
    rows, growth = [], dict[str, float]()
    for horizon in horizons_s:
        samples = _samples(system, horizon)
        windows = windows_of(lengths, samples, chosen)
        if len(windows) == 0 and horizon > min(horizons_s):
            # a shorter one tells what there is to tell; whole episodes follow
            advance()
            continue
        if len(windows) == 0:
            longest = max(lengths[e] for e in chosen) - 1
            raise RecordingError(
                f"{system.recording.path}: no episode is as long as the horizon {horizon:g} s; "
                f"the longest has {longest / system.rate_hz:g} s."
            )
        sums = []
        for _, some in windows.chunks(WINDOWS_AT_ONCE):

            def by(simulator: AbstractSimulator, some: Windows = some) -> Predict:
                return lambda s, n, of: simulator.predict_windows(effects, replace(some.at(of), samples=n), s)

            sums.append(_sums(system, by(simulator), some, signals, map(by, noisier)))
        rows += _rows(system, f"{horizon:g} s", horizon, _total(sums), signals)
        growth[f"{horizon:g} s"] = _growth(_total(sums))
        advance()
    by_episode, starts, kept = [], {}, []
    for e in chosen if whole_episodes else ():
        windows = Windows(np.array([e]), np.array([0]), lengths[e])

        def whole(simulator: AbstractSimulator, e: int = e) -> Predict:
            def predict(states: np.ndarray, n: int, _: np.ndarray) -> np.ndarray:
                runs = [Run(effects, simulator.seen_start(effects, s)) for s in states[0]]
                part = simulator if n == lengths[e] else simulator.parts([Span(e, 0, n)])
                return part.predict(e if part is simulator else 0, runs)[None]

            return predict

        one = _sums(system, whole(simulator), windows, signals, map(whole, noisier), grow=True)
        kept.append(one)
        starts[e] = simulator.seen_start(effects, one.starts[0])
        number = system.recording.episodes[e].index
        by_episode += [{"episode": number} | row for row in _rows(system, WHOLE_EPISODE, math.nan, one, signals)]
        advance()
    if kept:
        rows += _rows(system, WHOLE_EPISODE, math.nan, _total(kept), signals)
        growth[WHOLE_EPISODE] = _growth(_total(kept))
    return Gap(pd.DataFrame(rows), pd.DataFrame(by_episode), starts, growth)


def _growth(sums: _Sums) -> float:
    return float(np.sqrt(sums.grown / np.maximum(sums.values, 1.0)).max())


def _samples(system: AbstractSystem, horizon_s: float) -> int:
    samples = round(horizon_s * system.rate_hz)
    if samples < 1:
        raise RecordingError(
            f"horizons_s: must be at least one sample, {1 / system.rate_hz:.4g} s, got {horizon_s:g} s."
        )
    return samples


@dataclass(frozen=True)
class _Sums:
    """Sums over windows and samples, per channel (C,): squares, how many values they hold, and what noise makes."""

    windows: int
    squares: np.ndarray  # from measured starts, without the first sample, which is the start
    values: np.ndarray
    expected: np.ndarray  # of the squares, for a perfect model
    grown: np.ndarray  # of them, in squared noises, what noise of where the windows begin makes
    made: np.ndarray  # of the fitted squares, by noise of a measured force
    fitted_squares: np.ndarray  # with what the fit takes from the noise put back
    fitted_values: np.ndarray
    by_window: np.ndarray  # those per value, in squared noises, (W, C); NaN where a window has no reading
    starts: np.ndarray  # (W, S)


def _sums(
    system: AbstractSystem,
    predict: Predict,
    windows: Windows,
    signals: Measured,
    noisier: Iterable[Predict] = (),
    *,
    grow: bool = False,
) -> _Sums:
    """Return the sums of windows, which are simulated by `predict` from start states as they are shown.

    `noisier`: by each of these with more noise on what drove the object.
    `grow`: there is one window, and where its motion amplifies the start, that is sought over shorter parts first.
    """
    values, valid = windows.of(signals.values), system.initial.settled(windows.of(signals.valid), system.rate_hz)
    steps, scale = system.initial.steps, system.initial.scale(signals.sigma)
    errors = system.initial.errors(signals, windows)[..., None, None]
    measured = system.initial.guess_windows(signals, windows, smooth=False)
    every = np.arange(len(windows))
    rows = predict(np.stack([measured, *(measured + d for d in np.diag(steps))], axis=1), windows.samples, every)
    residual = rows[:, 0] - values
    # how the noise of the start state spreads
    change = (rows[:, 1:] - rows[:, :1]) / steps[:, None, None] * errors
    spread = (change**2).sum(axis=1)
    counts = valid.copy()
    counts[:, 0] = False
    sound = valid[:, 0, system.initial.channels].all(axis=1)
    if sound.any():
        # a start without all of its measurements says nothing of what measured starts are worth
        counts[~sound] = False
    expected = np.where(counts, spread + signals.sigma**2, 0.0).sum(axis=(0, 1))
    places = (change[:, : system.initial.size // 2] / signals.sigma) ** 2
    grown = np.where(counts, places.sum(axis=1), 0.0).sum(axis=(0, 1))
    most = SETTINGS.pieces.most_growth
    amplifies = grow and (expected > most**2 * signals.sigma**2 * counts.sum(axis=(0, 1))).any()
    shares = SETTINGS.held_out.growing_shares if amplifies else (1.0,)
    problem = (predict, values, valid, signals, measured, steps, scale)
    fitted = fit_starts(*problem, shares=shares, iterations=START_STEPS)
    moved = [(p(fitted.starts[:, None], windows.samples, every)[:, 0] - values - fitted.residual) for p in noisier]
    made, taken_up = _made(np.array(moved), fitted, valid, signals)
    expected = expected + np.where(counts, made, 0.0).sum(axis=(0, 1))
    # through a hit a descent may end where more is left than it began with, or where the motion diverges
    left, before = (np.where(valid, (r / signals.sigma) ** 2, 0.0) for r in (fitted.residual, residual))
    worse = np.nan_to_num(left.sum(axis=(1, 2)), nan=np.inf) > np.nan_to_num(before.sum(axis=(1, 2)), nan=np.inf)
    left[worse] = before[worse]
    squares, followed = left.sum(axis=(0, 1)), fitted.followed(valid)[~worse].sum(axis=0)
    # as much of what it follows as of what it leaves, but noise at most: what is missed beyond that it does not take
    back = followed * np.minimum(squares / np.maximum(valid.sum(axis=(0, 1)) - followed, 1e-9), 1.0)
    return _Sums(
        len(windows),
        np.where(counts, residual**2, 0.0).sum(axis=(0, 1)),
        counts.sum(axis=(0, 1)),
        expected,
        grown,
        np.where(valid, taken_up, 0.0).sum(axis=(0, 1)),
        (squares + back) * signals.sigma**2,
        valid.sum(axis=(0, 1)),
        np.where(
            valid.any(axis=1),
            left.sum(axis=1) / np.maximum(valid.sum(axis=1), 1) * (1.0 + back / np.maximum(squares, 1e-12)),
            np.nan,
        ),
        np.where(worse[:, None], measured, fitted.starts),
    )


def _made(moved: np.ndarray, fitted: Fitted, valid: np.ndarray, signals: Measured) -> tuple[np.ndarray, np.ndarray]:
    """Return what noise of a measured force makes of squares, (W, n, C), and of those that a fit of the start leaves.

    Args:
        moved: By how much predictions are other with more of it, in each draw, (D, W, n, C).
        fitted: The windows, with their starts fitted.
        valid: What counts, (W, n, C).
        signals: The noise.
    """
    if not len(moved):
        return np.zeros(valid.shape), np.zeros(valid.shape)
    scaled = np.where(valid, moved / signals.sigma, 0.0)
    flat = scaled.reshape(*scaled.shape[:2], -1)
    columns = np.where(valid[..., None], fitted.change, 0.0).reshape(flat.shape[1], flat.shape[2], -1)
    follows = np.einsum("wip,dwp->dwi", columns, np.einsum("wpi,dwi->dwp", np.linalg.pinv(columns), flat))
    left = (flat - follows).reshape(scaled.shape)
    return (scaled**2).mean(axis=0) * signals.sigma**2, (left**2).mean(axis=0) * signals.sigma**2


def _total(sums: Sequence[_Sums]) -> _Sums:
    def add(name: str) -> np.ndarray:
        return np.sum([getattr(s, name) for s in sums], axis=0)

    return _Sums(
        windows=sum(s.windows for s in sums),
        squares=add("squares"),
        values=add("values"),
        expected=add("expected"),
        grown=add("grown"),
        made=add("made"),
        fitted_squares=add("fitted_squares"),
        fitted_values=add("fitted_values"),
        by_window=np.concatenate([s.by_window for s in sums]),
        starts=np.concatenate([s.starts for s in sums]),
    )


def _rows(
    system: AbstractSystem, horizon: str, horizon_s: float, sums: _Sums, signals: Measured
) -> list[dict[str, object]]:
    measured, fitted = (np.where(v > 0, v, np.nan) for v in (sums.values, sums.fitted_values))
    kinds = {
        "measured": (
            np.sqrt(sums.squares / measured),
            np.sqrt(sums.expected / measured) / signals.sigma,
            sums.values,
        ),
        "fitted": (
            np.sqrt(sums.fitted_squares / fitted),
            np.sqrt(1.0 + np.nan_to_num(sums.made / fitted) / signals.sigma**2),
            sums.fitted_values,
        ),
    }
    read = ~np.isnan(sums.by_window)
    middle = [float(np.median(w[r])) if r.any() else math.nan for w, r in zip(sums.by_window.T, read.T, strict=True)]
    return [
        {
            "horizon": horizon,
            "horizon_s": horizon_s,
            "starts": starts,
            "channel": channel.name,
            "unit": channel.unit,
            "rms": float(rms[c]),
            "noise": float(signals.sigma[c]),
            "stated": bool(np.isfinite(signals.stated[c])),
            "noises": float(rms[c] / signals.sigma[c]),
            "noises_expected": float(expected[c]),
            "noises_median": float(np.sqrt(middle[c])) if starts == "fitted" else math.nan,
            "windows": sums.windows,
            "values": float(values[c]),
        }
        for starts, (rms, expected, values) in kinds.items()
        for c, channel in enumerate(system.channels)
    ]
