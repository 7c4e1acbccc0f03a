"""What was measured, ready for fitting: one array per episode, the noise of each channel, and which samples count.

Nothing here knows what moved, or how. A channel is a column of numbers with a noise level and a colour.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter
from scipy.signal import detrend

from runner.recording import Episode, Recording

CHANNELS = ("x", "y", "yaw", "vx", "vy", "wz")
UNITS = ("m", "m", "rad", "m/s", "m/s", "rad/s")
KINDS = ("position", "position", "yaw", "velocity", "velocity", "rate")
OUTLIER_SIGMAS = 6.0
COLOUR_FLOOR = 0.15  # a smaller lag-one correlation is not told from none


@dataclass(frozen=True)
class Measured:
    """The measured channels of all episodes.

    Args:
        values: Per episode (T, C).
        sigma: Noise standard deviation of each channel, (C,).
        colour: Lag-one autocorrelation of the noise of each channel, (C,).
        valid: Per episode (T, C): False for outliers and what was not measured.
        stated: Whether the owner stated the noise of each channel, (C,).
    """

    values: tuple[np.ndarray, ...]
    sigma: np.ndarray
    colour: np.ndarray
    valid: tuple[np.ndarray, ...]
    stated: np.ndarray

    def whiten(self, episode: int, residual: np.ndarray) -> np.ndarray:
        """Return residuals (..., T, C) in units of the noise and with its colour taken out; invalid ones are 0."""
        scaled = np.where(self.valid[episode], residual / self.sigma, 0.0)
        if not self.colour.any():
            return scaled
        out = scaled.copy()
        # a jump over an invalid sample is damped with the rest: rare enough not to matter
        out[..., 1:, :] = (scaled[..., 1:, :] - self.colour * scaled[..., :-1, :]) / np.sqrt(1 - self.colour**2)
        return np.where(self.valid[episode], out, 0.0)

    def count(self, episode: int) -> int:
        """Number of values that count."""
        return int(self.valid[episode].sum())


def measure(recording: Recording) -> Measured:
    """Prepare a planar recording: estimate the noise where it isn't stated, its colour, and outliers."""
    values = tuple(np.hstack([e.pose, e.twist]) for e in recording.episodes)
    noise = recording.nominal.noise
    given = {
        "position": noise.position_m,
        "yaw": noise.yaw_rad,
        "velocity": noise.velocity_m_s,
        "rate": noise.rate_rad_s,
    }
    rest = [rest_segments(e) for e in recording.episodes]
    sigma, colour = np.empty(len(KINDS)), np.zeros(len(KINDS))
    for kind in dict.fromkeys(KINDS):
        columns = [i for i, k in enumerate(KINDS) if k == kind]
        estimate, phi = _noise([v[:, columns] for v in values], rest)
        stated = given[kind]
        sigma[columns] = estimate if stated is None else stated
        colour[columns] = phi
    valid = tuple(_inliers(v, sigma) for v in values)
    return Measured(values, sigma, colour, valid, np.array([given[k] is not None for k in KINDS]))


def rest_segments(episode: Episode, settle_s: float = 1.0, least_s: float = 0.3) -> list[slice]:
    """Return where nothing has been commanded for long enough that friction has stopped the body, or it never moved."""
    pushed = np.linalg.norm(np.nan_to_num(episode.force_n), axis=1) > 0
    settle, least = int(settle_s / episode.step_s), max(int(least_s / episode.step_s), 8)
    edges = np.flatnonzero(np.diff(np.concatenate([[True], pushed, [True]]).astype(int)))
    out = []
    for begin, end in zip(edges[::2], edges[1::2], strict=False):
        begin += settle
        if end - begin >= least:
            part = episode.twist[begin:end]
            # at rest the mean velocity is nothing but noise
            error = part.std(axis=0) / np.sqrt(len(part)) * 4 + 1e-12
            if np.all(np.abs(part.mean(axis=0)) < error):
                out.append(slice(begin, end))
    return out


def _noise(values: Sequence[np.ndarray], rest: Sequence[Sequence[slice]]) -> tuple[float, float]:
    """Return the noise level and its lag-one correlation, over channels of one kind, each (T, k)."""
    # third differences leave nothing of a smooth motion: variance 20 sigma^2 for white noise
    third = np.concatenate([np.diff(v, 3, axis=0).ravel() for v in values])
    white = float(np.median(np.abs(third))) / 0.6745 / np.sqrt(20.0)
    above = below = lag = 0.0
    count = 0
    for value, segments in zip(values, rest, strict=True):
        for segment in segments:
            # the last of the motion, and slow drift, go with the line; two degrees of freedom per channel with it
            part = detrend(value[segment], axis=0)
            part = np.clip(part, -5 * part.std(), 5 * part.std())
            n = len(part)
            above += float((part[1:] * part[:-1]).sum())
            below += float((part**2).sum())
            lag += 4.0 * part.shape[1]  # what subtracting the line takes from both sums, in units of the variance
            count += n * part.shape[1]
    if count < 300:
        return white, 0.0
    variance = below / max(count - lag / 2, 1.0)
    phi = above / max(below, 1e-300) + lag / 2 / count
    if phi < max(COLOUR_FLOOR, 4.0 / np.sqrt(count)):
        return white, 0.0
    return float(np.sqrt(variance)), float(min(phi, 0.95))


def _inliers(values: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """Mark values that don't stick out of their neighbours by many noise levels."""
    distance = np.abs(values - median_filter(values, size=(5, 1), mode="nearest"))
    return np.isfinite(values) & (distance < OUTLIER_SIGMAS * sigma + 3.0 * np.median(distance, axis=0))
