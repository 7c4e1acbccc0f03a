"""The unknown start of a box: x, y, yaw and their rates, all of which are measured."""

from __future__ import annotations

import numpy as np

from runner.numerics.arrays import FloatArray
from runner.systems.channels import Signals
from runner.systems.initial import AbstractInitialState
from runner.systems.windows import Windows

SMOOTH_S = 0.1  # half width of the local smoother
FIRST = 5  # samples whose median a start is guessed from


class PlanarStart(AbstractInitialState):
    """Six numbers: m, m, rad, m/s, m/s, rad/s, in the order of the channels."""

    steps = np.array([1e-3, 1e-3, 1e-3, 5e-3, 5e-3, 5e-3])

    def __init__(self, rate_hz: float) -> None:
        self._rate_hz = rate_hz

    def scale(self, sigma: FloatArray) -> FloatArray:
        """A start is known about as well as a sample is."""
        return sigma

    def guess(self, signals: Signals, episode: int) -> FloatArray:
        """Return the median of the first samples."""
        first = np.where(signals.valid[episode][:FIRST], signals.values[episode][:FIRST], np.nan)
        return np.nan_to_num(np.nanmedian(first, axis=0), nan=0.0)

    def guess_windows(self, signals: Signals, windows: Windows, *, smooth: bool) -> FloatArray:
        """Return the measured states, or `smooth` those of local cubics through poses and velocities."""
        return self._smoothed(signals, windows) if smooth else _measured(signals, windows)

    def _smoothed(self, signals: Signals, windows: Windows) -> np.ndarray:
        """Return states at the starts of windows from local cubics through poses and velocities, (W, 6)."""
        rate_hz = self._rate_hz
        reach = max(2, round(SMOOTH_S * rate_hz))
        out = np.empty((len(windows), 6))
        for w, (e, f) in enumerate(zip(windows.episode, windows.first, strict=True)):
            span = np.arange(max(0, f - reach), min(len(signals.values[e]), f + reach + 1))
            t = (span - f) / rate_hz
            pose = np.stack([np.ones_like(t), t, t**2 / 2, t**3 / 6], axis=1)
            rate = np.stack([np.zeros_like(t), np.ones_like(t), t, t**2 / 2], axis=1)
            for c in range(3):
                weight = signals.valid[e][span][:, [c, c + 3]] / signals.sigma[[c, c + 3]]
                matrix = np.vstack([pose * weight[:, :1], rate * weight[:, 1:]])
                right = (signals.values[e][span][:, [c, c + 3]] * weight).T.ravel()
                out[w, [c, c + 3]] = np.linalg.lstsq(matrix, right, rcond=None)[0][:2]
        return out


def _measured(signals: Signals, windows: Windows) -> np.ndarray:
    """Return the measured state at the start of each window, (W, 6); a median around it where it doesn't count."""
    out = np.empty((len(windows), len(signals.sigma)))
    for w, (e, f) in enumerate(zip(windows.episode, windows.first, strict=True)):
        near = slice(max(0, f - 2), f + 3)
        around = np.where(signals.valid[e][near], signals.values[e][near], np.nan)
        fine = signals.valid[e][f]
        instead = np.zeros(len(fine)) if fine.all() else np.nan_to_num(_median(around))
        out[w] = np.where(fine, signals.values[e][f], instead)
    return out


def _median(values: np.ndarray) -> np.ndarray:
    """Return medians over rows without NaN, NaN where there is nothing."""
    columns = [column[np.isfinite(column)] for column in values.T]
    return np.array([np.median(column) if len(column) else np.nan for column in columns])
