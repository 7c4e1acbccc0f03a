"""The colour of measurement noise: how far one sample's error says something of the next. (Its level: `measured`.)

Filters and fusion in a tracking system leave noise that is partly white and partly slow. It is taken for the sum of
white noise and a first-order autoregression, an ARMA(1, 1) process: its correlation at lag k >= 1 is `share *
memory**k`. Left out of account, it makes every standard error too small by a factor of up to
sqrt((1 + memory) / (1 - memory)).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve, toeplitz
from scipy.optimize import minimize
from scipy.special import wrightomega

from runner.numerics.recursive_filter import filtered
from runner.settings import SETTINGS


@dataclass(frozen=True)
class NoiseModel:
    """The colour of each channel's noise.

    Args:
        share: Share of the variance that is slow, (C,); 0: white.
        memory: Correlation of the slow part from one sample to the next, (C,).
    """

    share: np.ndarray
    memory: np.ndarray

    @classmethod
    def white(cls, channels: int) -> NoiseModel:
        """No colour."""
        return cls(np.zeros(channels), np.zeros(channels))

    @property
    def lag_one(self) -> np.ndarray:
        """Correlation of the noise from one sample to the next, (C,)."""
        return self.share * self.memory

    def innovation(self) -> np.ndarray:
        """Return the standard deviation of what is new in a sample, given all before it, in units of the noise, (C,).

        Of the settled Kalman filter of `whiten`: 1 where the noise is white.
        """
        white, new = 1.0 - self.share, self.share * (1.0 - self.memory**2)
        # the variance P of the slow part before the sample is seen: P = memory^2 P white / (P + white) + new
        half = 0.5 * (white * (1.0 - self.memory**2) - new)
        return np.sqrt(np.sqrt(half**2 + new * white) - half + white)

    def whiten(self, scaled: np.ndarray) -> np.ndarray:
        """Return the innovations (..., n, C) of residuals in units of the noise (..., n, C), of unit variance.

        The Kalman filter of the slow part, from its stationary state; its gain settles within some samples, and from
        there on it is a recursive filter.
        """
        slow = np.flatnonzero(self.lag_one)
        if not len(slow):
            return scaled
        out = scaled.copy()
        for share, memory in {(self.share[c], self.memory[c]) for c in slow}:
            which = [c for c in slow if (self.share[c], self.memory[c]) == (share, memory)]
            out[..., which] = _innovations(scaled[..., which], share, memory)
        return out


def _innovations(x: np.ndarray, share: float, memory: float) -> np.ndarray:
    out = np.empty_like(x)
    n = x.shape[-2]
    variance, slow = share, np.zeros_like(x[..., 0, :])
    for k in range(n):
        total = variance + 1.0 - share
        gain = variance / total
        error = x[..., k, :] - slow
        out[..., k, :] = error / np.sqrt(total)
        slow = memory * (slow + gain * error)
        before, variance = variance, memory**2 * variance * (1.0 - gain) + share * (1.0 - memory**2)
        if abs(variance - before) < 1e-9 and k + 1 < n:
            tail = filtered(np.swapaxes(x[..., k + 1 :, :], -1, -2), 1.0, -memory, memory * (1.0 - gain), -slow)
            out[..., k + 1 :, :] = np.swapaxes(tail, -1, -2) / np.sqrt(total)
            break
    return out


@dataclass(frozen=True)
class Found:
    """An estimate of the noise: level of each kind, (K,), and what is common to all: share and memory, 0 if white."""

    level: np.ndarray
    share: float
    memory: float


def _with_belief(shown: np.ndarray, freedom: np.ndarray, known: np.ndarray, doubt: float) -> tuple[np.ndarray, float]:
    """Return the likeliest variances, (K,), and minus twice the log density of the belief there.

    Args:
        shown: Variance that the data show, (K,).
        freedom: Of how many values, (K,).
        known: Believed levels, NaN where there is none, (K,).
        doubt: Standard deviation of their logarithm; 0: they hold.
    """
    believed = np.where(np.isfinite(known), known**2, shown)
    if doubt == 0.0:
        return believed, 0.0
    held = np.isfinite(known)
    # where the slope of both by the log of the variance vanishes, w + log(w) = log(odds * shown / believed) + odds with
    # w = log(variance / believed) + odds: Wright's omega
    odds = 2.0 * doubt**2 * freedom
    off = np.where(held, wrightomega(np.log(odds * shown / believed) + odds) - odds, 0.0)
    return believed * np.exp(off), float(np.sum(off**2)) / (4.0 * doubt**2)


def _held(stretches: Sequence[np.ndarray], n: int) -> int:
    """Return how many values of stretches (T, k) lie in whole windows of n samples."""
    return sum(len(r) // n * n * r.shape[1] for r in stretches)


def estimate(
    kinds: Sequence[Sequence[np.ndarray]],
    step_s: float,
    known: np.ndarray,
    *,
    doubt: float = 0.0,
    shorten: bool = False,
) -> Found | None:
    """Estimate the noise from stretches of what a model leaves, or of rest.

    Half-second windows, of which only what no cubic follows is looked at: neither a motion nor a model's error is
    there, and what the cubics take of the noise is accounted for. Maximum likelihood for Gaussian noise; one colour for
    all kinds (they come from one instrument, as a tracking system), each with its own level.

    Args:
        kinds: Stretches of each kind of channel, each (T, k), without NaN.
        step_s: Between samples.
        known: Level of each kind where it is known, else NaN, (K,).
        doubt: How well it is known: standard deviation of its logarithm (a log-normal prior); 0: exactly.
        shorten: Where hardly a stretch is half a second long, as flights that soon end in a hit, windows are as long
            as half of the stretches are, and what is known of a level holds.

    Returns:
        None with too little to tell.
    """
    limits = SETTINGS.noise
    terms = limits.smooth_degree + 1
    n = min(max(3 * terms, round(limits.window_s / step_s)), limits.max_window_samples)
    if shorten and not all(_held(stretches, n) >= limits.min_samples for stretches in kinds):
        n = min(n, max(3 * terms, int(np.median([len(r) for stretches in kinds for r in stretches]))))
        doubt = 0.0  # of slow noise so little shows in them that the rest would pass for all
    every = np.linalg.qr(np.polynomial.legendre.legvander(np.linspace(-1, 1, n), n - 1))[0]
    rough = every[:, terms:]
    spreads, counts = [], []
    for stretches in kinds:
        parts = [r[i : i + n] for r in stretches for i in range(0, len(r) - n + 1, n)]
        if not parts or _held(stretches, n) < limits.min_samples:
            return None
        left = rough.T @ np.concatenate(parts, axis=1)  # (n - 4, windows * k)
        powers = [(some**2).sum(axis=0) for some in (left, left[: limits.slow_terms])]
        left = left[:, np.all([power <= limits.max_window_power * np.median(power) for power in powers], axis=0)]
        spreads.append(left @ left.T / left.shape[1])
        counts.append(left.shape[1])
    spread, count = np.array(spreads), np.array(counts)
    dimension = n - terms

    def fit(share: float, memory: float) -> tuple[float, np.ndarray]:
        """Return -2 log likelihood and the levels."""
        factor = cho_factor(rough.T @ (share * toeplitz(memory ** np.arange(n)) + (1 - share) * np.eye(n)) @ rough)
        square = np.array([np.trace(cho_solve(factor, one)) for one in spread])
        # a channel that never moves at rest has no noise to speak of; its likelihood must stay finite
        shown = np.maximum(square / dimension, limits.min_variance)
        variance, against = _with_belief(shown, count * dimension, known, doubt)
        volume = 2 * np.log(np.diag(factor[0])).sum()
        loss = count @ (volume + dimension * np.log(variance) + square / variance)
        return float(loss + against), np.sqrt(variance)

    white, level = fit(0.0, 0.0)
    longest, shortest = np.exp(-step_s / limits.max_memory_s), np.exp(-step_s / limits.min_memory_s)
    bounds = [(0.0, 1.0), (shortest, longest)]
    starts = [(0.5, 0.5 * (shortest + longest)), (0.7, 0.95 * longest)]
    found = min(
        (minimize(lambda p: fit(*p)[0] - white, start, bounds=bounds, method="L-BFGS-B") for start in starts),
        key=lambda result: result.fun,
    )
    share, memory = map(float, found.x)
    if found.fun > -limits.colour_loss or share * memory < limits.min_lag_one:
        return Found(level, 0.0, 0.0)
    return Found(fit(share, memory)[1], share, memory)
