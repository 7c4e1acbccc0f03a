"""The unknown start of a box: x, y, yaw and their rates, measured or (rates) told from the slopes of the others."""

from __future__ import annotations

import numpy as np

from runner.numerics.arrays import FloatArray
from runner.systems.channels import Signals
from runner.systems.initial import AbstractInitialState, level_around, told_around
from runner.systems.windows import Windows

SMOOTH_S = 0.1  # half width of the local smoother
FIRST = 5  # samples whose median a start is guessed from, or one that was lost
REACH = 3  # samples to each side that the smoother has at least where it tells velocities from positions alone
SETTLING_S = 0.1  # of a pin and a body that noise of the start has put too near, too far, or at other speeds
SLOPE_S = 0.1  # a slope over a window that short: its error is that of a sample over so many seconds


class PlanarStart(AbstractInitialState):
    """Six numbers: m, m, rad, m/s, m/s, rad/s, in the order of the channels."""

    steps = np.array([1e-3, 1e-3, 1e-3, 5e-3, 5e-3, 5e-3])

    def __init__(self, rate_hz: float, columns: np.ndarray) -> None:
        """Of a recording whose first channels are these of the six numbers, (K,) indices."""
        self._rate_hz, self._columns = rate_hz, columns
        self.channels, self.settling_s = slice(len(columns)), SETTLING_S
        self._lacking = np.setdiff1d(np.arange(3, 6), columns)

    def scale(self, sigma: FloatArray) -> FloatArray:
        """A start is known about as well as a sample is, or a slope of a few."""
        out = np.empty(6)
        out[self._columns] = sigma[self.channels]
        out[self._lacking] = out[self._lacking - 3] / SLOPE_S
        return out

    def guess(self, signals: Signals, episode: int) -> FloatArray:
        """Return the median of the first samples that were measured."""
        if len(self._lacking):
            return self._smoothed(signals, Windows(np.array([episode]), np.array([0]), 1))[0]
        values, valid = (every[episode][:, self.channels] for every in (signals.values, signals.valid))
        return level_around(values, valid, 0, FIRST - 1, least=FIRST)

    def guess_windows(self, signals: Signals, windows: Windows, *, smooth: bool) -> FloatArray:
        """Return the measured states, or `smooth` those of local cubics through poses and velocities."""
        if smooth:
            return self._smoothed(signals, windows)
        out = np.empty((len(windows), 6))
        for w, (e, f) in enumerate(zip(windows.episode, windows.first, strict=True)):
            out[w, self._columns] = self._measured(signals, int(e), int(f))
        if len(self._lacking):
            out[:, self._lacking] = self._smoothed(signals, windows)[:, self._lacking]
        return out

    def _smoothed(self, signals: Signals, windows: Windows) -> np.ndarray:
        """Return states at the starts of windows from local cubics through poses and velocities, (W, 6)."""
        rate_hz = self._rate_hz
        reach = max(REACH if len(self._lacking) else 2, round(SMOOTH_S * rate_hz))
        sigma = self.scale(signals.sigma)
        out = np.empty((len(windows), 6))
        for w, (e, f) in enumerate(zip(windows.episode, windows.first, strict=True)):
            near = told_around(signals.valid[e][:, self.channels], f, reach, least=reach + 1)
            valid, values = self._states(signals, e, near)
            t = (np.arange(near.start, near.stop) - f) / rate_hz
            pose = np.stack([np.ones_like(t), t, t**2 / 2, t**3 / 6], axis=1)
            rate = np.stack([np.zeros_like(t), np.ones_like(t), t, t**2 / 2], axis=1)
            for c in range(3):
                weight = valid[:, [c, c + 3]] / sigma[[c, c + 3]]
                matrix = np.vstack([pose * weight[:, :1], rate * weight[:, 1:]])
                right = (values[:, [c, c + 3]] * weight).T.ravel()
                out[w, [c, c + 3]] = np.linalg.lstsq(matrix, right, rcond=None)[0][:2]
        return out

    def _measured(self, signals: Signals, episode: int, first: int) -> np.ndarray:
        """Return what was measured at a sample, (K,); a median around it where that doesn't count."""
        values, valid = (every[episode][:, self.channels] for every in (signals.values, signals.valid))
        if valid[first].all():
            return values[first]
        return np.where(valid[first], values[first], level_around(values, valid, first, FIRST // 2))

    def _states(self, signals: Signals, episode: int, near: slice) -> tuple[np.ndarray, np.ndarray]:
        """Return what of the six numbers counts at some samples, and their values, 0 where not, both (T, 6)."""
        there = signals.valid[episode][near, self.channels]
        valid, values = np.zeros((len(there), 6), bool), np.zeros((len(there), 6))
        valid[:, self._columns] = there
        values[:, self._columns] = np.where(there, signals.values[episode][near, self.channels], 0.0)
        return valid, values
