"""What was measured, ready for fitting: one array per episode, the noise of each channel, and which samples count.

Nothing here knows what moved, or how. A channel is a column of numbers with a noise level and a colour.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.ndimage import median_filter

from runner.noise.model import Colour, Found, estimate
from runner.recording import Episode, Recording, Span

CHANNELS = ("x", "y", "yaw", "vx", "vy", "wz")
UNITS = ("m", "m", "rad", "m/s", "m/s", "rad/s")
KINDS = ("position", "position", "yaw", "velocity", "velocity", "rate")
OUTLIER_SIGMAS = 6.0
MATERIAL = 0.05  # a noise level that moved by this share, or a colour by twice as much, is another one


@dataclass(frozen=True)
class Measured:
    """The measured channels of all episodes.

    Args:
        values: Per episode (T, C).
        sigma: Noise standard deviation of each channel, (C,).
        colour: Of the noise of each channel.
        valid: Per episode (T, C): False for outliers and what was not measured.
        stated: Whether the owner stated the noise of each channel, (C,).
        hung: The first sample of an episode that hangs on a breakaway: from there on it says nothing to a fit.
    """

    values: tuple[np.ndarray, ...]
    sigma: np.ndarray
    colour: Colour
    valid: tuple[np.ndarray, ...]
    stated: np.ndarray
    hung: Mapping[int, int] = field(default_factory=dict)

    def counted(self, episode: int) -> np.ndarray:
        """Return what counts in a fit, (T, C)."""
        if episode not in self.hung:
            return self.valid[episode]
        return self.valid[episode] & (np.arange(len(self.valid[episode])) < self.hung[episode])[:, None]

    def whiten(self, episode: int, residual: np.ndarray) -> np.ndarray:
        """Return residuals (..., T, C) in units of the noise, its colour taken out; 0 where they don't count."""
        valid = self.counted(episode)
        return np.where(valid, self.colour.whiten(np.where(valid, residual / self.sigma, 0.0)), 0.0)

    def parts(self, spans: Sequence[Span]) -> Measured:
        """Return parts of the episodes as episodes of their own; the noise is what it was."""
        values, valid = (tuple(v[s.episode][s.begin : s.end] for s in spans) for v in (self.values, self.valid))
        hung = {i: max(self.hung[s.episode] - s.begin, 0) for i, s in enumerate(spans) if s.episode in self.hung}
        return replace(self, values=values, valid=valid, hung=hung)

    def without(self, hung: Mapping[int, int]) -> Measured:
        """Return the same less what hangs on a breakaway, from such a sample of an episode on."""
        earliest = {e: min(hung.get(e, s), self.hung.get(e, s)) for e, s in {**self.hung, **hung}.items()}
        return replace(self, hung=earliest)

    def count(self, episodes: Iterable[int]) -> int:
        """Number of values of these episodes that count."""
        return int(sum(self.counted(e).sum() for e in episodes))

    def excess(self, loss: float, episodes: Iterable[int]) -> float:
        """Return what a sum of squared whitened residuals of these episodes leaves beyond the noise, as a share."""
        return loss / self.count(episodes) - 1.0


def measure(recording: Recording) -> Measured:
    """Prepare a planar recording: the noise where it isn't stated, and its colour, from its rests; outliers."""
    values = tuple(np.hstack([e.pose, e.twist]) for e in recording.episodes)
    rests = [v[s] for v, e in zip(values, recording.episodes, strict=True) for s in rest_segments(e)]
    stated = _stated(recording)
    white = np.array([_white([v[:, columns] for v in values]) for columns in _columns().values()])
    sigma, colour = _noise([r for r in rests if np.isfinite(r).all()], recording.episodes[0].step_s, stated, white)
    return Measured(values, sigma, colour, tuple(_inliers(v, sigma) for v in values), np.isfinite(stated))


def refine(measured: Measured, recording: Recording, residuals: dict[int, np.ndarray]) -> Measured:
    """Look at the noise again in what a model leaves, which is far closer to noise than a motion is.

    Args:
        measured: What is known so far.
        recording: Where it comes from.
        residuals: Per episode (T, C), prediction less measurement in physical units.
    """
    stretches = []
    for e, residual in residuals.items():
        # an outlier must not pass for noise; the line between its neighbours does no harm
        filled = residual.copy()
        for c in range(filled.shape[1]):
            bad = ~measured.valid[e][:, c]
            if bad.any() and not bad.all():
                filled[bad, c] = np.interp(np.flatnonzero(bad), np.flatnonzero(~bad), filled[~bad, c])
        stretches.append(np.nan_to_num(filled)[: measured.hung.get(e, len(filled))])
    sigma, colour = _noise(stretches, recording.episodes[0].step_s, _stated(recording), measured.sigma[_firsts()])
    valid = list(measured.valid)
    for e, residual in residuals.items():
        valid[e] = np.isfinite(measured.values[e]) & _inliers(residual, sigma)
    return Measured(measured.values, sigma, colour, tuple(valid), measured.stated, measured.hung)


def materially_different(a: Measured, b: Measured) -> bool:
    """Whether two accounts of the noise of a recording lead to other standard errors."""
    return bool(
        np.any(np.abs(np.log(a.sigma / b.sigma)) > MATERIAL)
        or np.any(np.abs(a.colour.lag_one - b.colour.lag_one) > 2 * MATERIAL)
    )


def _columns() -> dict[str, list[int]]:
    return {kind: [i for i, k in enumerate(KINDS) if k == kind] for kind in dict.fromkeys(KINDS)}


def _firsts() -> list[int]:
    return [columns[0] for columns in _columns().values()]


def _stated(recording: Recording) -> np.ndarray:
    """Return the stated noise of each channel, NaN where there is none, (C,)."""
    noise = recording.nominal.noise
    given = {
        "position": noise.position_m,
        "yaw": noise.yaw_rad,
        "velocity": noise.velocity_m_s,
        "rate": noise.rate_rad_s,
    }
    return np.array([np.nan if given[k] is None else given[k] for k in KINDS], float)


def _noise(
    stretches: Sequence[np.ndarray], step_s: float, stated: np.ndarray, otherwise: np.ndarray
) -> tuple[np.ndarray, Colour]:
    """Return the noise of each channel, (C,), and its colour; `otherwise` per kind where too little is there."""
    columns = list(_columns().values())
    known = stated[_firsts()]
    found = estimate([[s[:, c] for s in stretches] for c in columns], step_s, known)
    if found is None:
        found = Found(np.where(np.isfinite(known), known, otherwise), 0.0, 0.0)
    sigma = np.empty(len(KINDS))
    for c, level in zip(columns, found.level, strict=True):
        sigma[c] = level
    return sigma, Colour(np.full(len(KINDS), found.share), np.full(len(KINDS), found.memory))


def _white(values: Sequence[np.ndarray]) -> float:
    """Return the noise level of channels of one kind, each (T, k), if it is white."""
    # third differences leave nothing of a smooth motion: variance 20 sigma^2 for white noise
    third = np.concatenate([np.diff(v, 3, axis=0).ravel() for v in values])
    return float(np.nanmedian(np.abs(third))) / 0.6745 / np.sqrt(20.0)


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


def _inliers(values: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """Mark values that don't stick out of their neighbours by many noise levels."""
    distance = np.abs(values - median_filter(values, size=(5, 1), mode="nearest"))
    return np.isfinite(values) & (distance < OUTLIER_SIGMAS * sigma + 3.0 * np.median(distance, axis=0))
