"""Start states fitted to windows of a recording: shooting from many places at once.

Every window is begun anew from a state of its own, which is measured with noise and therefore fitted, all windows side
by side.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from runner.noise.measured import Measured
from runner.numerics.levenberg_marquardt import Schedule, Trial, damped, descend
from runner.settings import SETTINGS

PRIOR_SIGMAS = 10.0  # a fitted start state may lie some such distances from the measured one, and hardly more
DAMPING = Schedule(1e-3, stiffening=30.0)
WINDOWS_AT_ONCE = 400  # bounds the memory of one batch

Predict = Callable[[np.ndarray, int, np.ndarray], np.ndarray]  # of start states, how many samples, of which windows


def whiten(residual: np.ndarray, valid: np.ndarray, signals: Measured) -> np.ndarray:
    """Return residuals (..., n, C) in units of the noise, its colour taken out; what doesn't count is 0."""
    return np.where(valid, signals.noise_model.whiten(np.where(valid, residual / signals.sigma, 0.0)), 0.0)


@dataclass(frozen=True)
class Fitted:
    """Windows with fitted start states.

    Args:
        starts: The start states, (W, S).
        residual: Prediction less measurement, physical units, (W, n, C).
        change: Derivatives of the prediction by the start states, both in units of the noise, (W, n, C, S).
        jacobian: The same whitened.
    """

    starts: np.ndarray
    residual: np.ndarray
    change: np.ndarray
    jacobian: np.ndarray

    def followed(self, valid: np.ndarray) -> np.ndarray:
        """Return how many values of each channel the fit follows, (W, C).

        So many times the variance of the noise is what it takes off the sum of squared residuals of a perfect model, be
        the noise white or coloured: diag(J (J^T C^-1 J)^-1 J^T) with C the noise's covariance.
        """
        w, n, c, p = self.jacobian.shape
        matrix = self.jacobian.reshape(w, n * c, p)
        # the weak prior holds what the window says nothing of
        normal = np.einsum("wip,wiq->wpq", matrix, matrix) + np.eye(p) / PRIOR_SIGMAS**2
        followed = np.einsum("wncp,wpq,wncq->wnc", self.change, np.linalg.inv(normal), self.change, optimize=True)
        return np.where(valid, followed, 0.0).sum(axis=1)


def fit_starts(
    predict: Predict,
    values: np.ndarray,
    valid: np.ndarray,
    signals: Measured,
    first: np.ndarray,
    steps: np.ndarray,
    scale: np.ndarray,
    *,
    shares: Sequence[float] = (1.0,),
    iterations: int = 4,
    tolerance: float = 0.1,
) -> Fitted:
    """Fit the start state of each window by Levenberg-Marquardt steps, all windows that are not at rest side by side.

    A window keeps a step only if it lowers its loss. A motion that amplifies its start has many local minima over a
    long time, and one valley over a short one: then starts are fitted to longer and longer parts of the windows.

    Args:
        predict: From start states (k, K, S) of k of the windows, at these positions (k,), to predictions of their first
            n samples, (k, K, n, C).
        values: What was measured, (W, n, C).
        valid: What of it counts, (W, n, C).
        signals: The noise.
        first: Start states as they were measured, (W, S).
        steps: Of the start states, for differences, (S,).
        scale: How far they may be from the measured ones, (S,).
        shares: Of each window, one after the other: each fit begins where the one before ended.
        iterations: At most so many steps, of each share.
        tolerance: A window rests when it expects to gain no more than this and a small share of its sum of squares.
    """
    samples = values.shape[1]

    def fit(begin: np.ndarray, share: float) -> Fitted:
        n = math.ceil(share * samples)
        problem = _Problem(predict, values[:, :n], valid[:, :n], signals, first, steps, scale, tolerance)
        point = problem.begin(begin)
        return descend(problem.attempt, point, DAMPING, iterations=iterations, blocks=len(values)).fitted

    begin = first
    for share in shares[:-1]:
        begin = fit(begin, share).starts
    return fit(begin, shares[-1])


@dataclass(frozen=True)
class _Point:
    """Where all windows stand, and the loss of each, (W,)."""

    fitted: Fitted
    loss: np.ndarray


@dataclass(frozen=True)
class _Problem:
    """The windows, as in `fit_starts`. Those that have come to rest are not simulated again."""

    predict: Predict
    values: np.ndarray
    valid: np.ndarray
    signals: Measured
    first: np.ndarray
    steps: np.ndarray
    scale: np.ndarray
    tolerance: float

    def begin(self, starts: np.ndarray) -> _Point:
        """Return where windows with these start states stand."""
        every = np.arange(len(starts))
        residual, change, jacobian = self._linearised(starts, every)
        return _Point(Fitted(starts, residual, change, jacobian), self._losses(residual, starts, every))

    def _linearised(self, starts: np.ndarray, windows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return what windows with these start states leave, and its derivatives: residual, change, jacobian."""
        moves = np.vstack([np.zeros(len(self.steps)), np.diag(self.steps)])
        rows = self.predict(starts[:, None, :] + moves, self.values.shape[1], windows)
        moved = (rows[:, 1:] - rows[:, :1]) / self.steps[:, None, None] * self.scale[:, None, None]
        jacobian = np.moveaxis(whiten(moved, self.valid[windows][:, None], self.signals), 1, -1)
        return rows[:, 0] - self.values[windows], np.moveaxis(moved / self.signals.sigma, 1, -1), jacobian

    def attempt(self, _: int, point: _Point, windows: np.ndarray, damping: np.ndarray) -> Trial[_Point]:
        """Step the windows that go on; one that gains nothing stays where it is."""
        at, w = point.fitted, len(windows)
        matrix = at.jacobian[windows].reshape(w, -1, len(self.steps))
        left = whiten(at.residual[windows], self.valid[windows], self.signals)
        right = np.einsum("wip,wi->wp", matrix, left.reshape(w, -1))
        right += (at.starts - self.first)[windows] / self.scale / PRIOR_SIGMAS**2
        normal = np.einsum("wip,wiq->wpq", matrix, matrix) + np.eye(len(self.steps)) / PRIOR_SIGMAS**2
        step = -np.linalg.solve(damped(normal, damping), right[:, :, None])[:, :, 0]
        promised = -2 * (right * step).sum(axis=1) - np.einsum("wp,wpq,wq->w", step, normal, step)
        rests = promised < self.tolerance + SETTINGS.fit.rest_share * point.loss[windows]
        on = windows[~rests]
        if not len(on):
            return Trial(point, rests=True)
        trial = at.starts[on] + step[~rests] * self.scale
        residual = self.predict(trial[:, None, :], self.values.shape[1], on)[:, 0] - self.values[on]
        losses = self._losses(residual, trial, on)
        gained = losses < point.loss[on]
        starts, left, loss = at.starts.copy(), at.residual.copy(), point.loss.copy()
        starts[on[gained]], left[on[gained]], loss[on[gained]] = trial[gained], residual[gained], losses[gained]
        change, jacobian = at.change, at.jacobian
        if gained.any():
            change, jacobian = change.copy(), jacobian.copy()
            change[on[gained]], jacobian[on[gained]] = self._linearised(trial[gained], on[gained])[1:]
        eased, refused = rests & False, rests & False
        eased[~rests], refused[~rests] = gained, ~gained
        return Trial(_Point(Fitted(starts, left, change, jacobian), loss), eased=eased, refused=refused, rests=rests)

    def _losses(self, residual: np.ndarray, starts: np.ndarray, windows: np.ndarray) -> np.ndarray:
        prior = ((starts - self.first[windows]) / self.scale / PRIOR_SIGMAS) ** 2
        return (whiten(residual, self.valid[windows], self.signals) ** 2).sum(axis=(1, 2)) + prior.sum(axis=1)
