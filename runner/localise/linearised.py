"""The model in short windows of a recording, linearised around the state in which each is begun anew.

Start states are unknowns of every window and projected out, so that a window tells of its own time alone. What is
left, in units of the noise, is reduced to its slow part (polynomials in time of the degree that noise is told by, per
channel): noise has little of it, and a missing force has hardly anything else.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from runner.effects.base import Effects
from runner.noise.measured import Measured
from runner.settings import SETTINGS
from runner.simulate.shooting import PRIOR_SIGMAS, whiten
from runner.systems.base import AbstractSystem
from runner.systems.simulator import AbstractSimulator
from runner.systems.windows import Windows


@dataclass(frozen=True)
class Model:
    """A system with effects in its model, ready for windows."""

    system: AbstractSystem
    simulator: AbstractSimulator
    effects: Effects

    def predict(self, windows: Windows, starts: np.ndarray, disturbance: np.ndarray | None = None) -> np.ndarray:
        """Return the predicted channels in windows, (W, K, n, C), as `AbstractSimulator.predict_windows`."""
        return self.simulator.predict_windows(self.effects, windows, starts, disturbance)


@dataclass(frozen=True)
class Linearised:
    """Windows around their start states: everything in units of the noise.

    `starts` (W, S), `scale` of them (S,); `residual` whitened (W, n, C); `raw` the same in physical units; `jacobian`
    by the starts, per scale, whitened (W, n, C, S), and `change` the same not whitened; `by_force` per step, whitened
    (W, n, C, D).
    """

    measured: Measured
    scale: np.ndarray
    starts: np.ndarray
    valid: np.ndarray
    raw: np.ndarray
    residual: np.ndarray
    change: np.ndarray
    jacobian: np.ndarray
    by_force: np.ndarray

    def _solve(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the inverse of the normal equations, (W, S, S), and the step of the starts, (W, S), per scale."""
        w, size = self.starts.shape
        matrix = self.jacobian.reshape(w, -1, size)
        inverse = np.linalg.inv(matrix.transpose(0, 2, 1) @ matrix + np.eye(size) / PRIOR_SIGMAS**2)
        right = matrix.transpose(0, 2, 1) @ self.residual.reshape(w, -1, 1)
        return inverse, -(inverse @ right)[..., 0]

    def fitted(self) -> np.ndarray:
        """Return start states one step closer to the measurement."""
        return self.starts + self._solve()[1] * self.scale

    def left(self) -> tuple[np.ndarray, np.ndarray]:
        """Return sums of squares per channel, the start states fitted, physical units, and their freedom, (C,) each."""
        inverse, step = self._solve()
        left = self.raw + (self.change @ step[:, None, :, None])[..., 0] * self.measured.sigma
        followed = ((self.change @ inverse[:, None]) * self.change).sum(axis=-1)
        freedom = np.where(self.valid, 1.0 - followed, 0.0)
        return np.where(self.valid, left**2, 0.0).sum(axis=(0, 1)), freedom.sum(axis=(0, 1))

    def slow(self) -> tuple[np.ndarray, np.ndarray]:
        """Return sums of squares of the slow residual, and what noise makes of them, per window and channel, (W, C)."""
        return _slow_part(self.residual, self.jacobian, self.valid)

    def missing_force(self, prior_steps: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the missing force in steps, (W, D), and its covariance, (W, D, D), inflated where the fit is bad."""
        w, n, c, s = self.jacobian.shape
        d = len(prior_steps)
        matrix = np.concatenate([self.jacobian, self.by_force], axis=-1).reshape(w, n * c, s + d)
        weak = np.diag([PRIOR_SIGMAS**-2] * s + list(prior_steps**-2.0))
        inverse = np.linalg.inv(matrix.transpose(0, 2, 1) @ matrix + weak)
        flat = self.residual.reshape(w, n * c, 1)
        solution = -(inverse @ (matrix.transpose(0, 2, 1) @ flat))
        left = flat + matrix @ solution
        misfit = (left[..., 0] ** 2).sum(axis=1) / np.maximum(self.valid.sum(axis=(1, 2)) - s - d, 1)
        return solution[:, s:, 0], inverse[:, s:, s:] * np.maximum(misfit, 1.0)[:, None, None]


def linearised(
    model: Model, windows: Windows, measured: Measured, starts: np.ndarray, forces: np.ndarray | None = None
) -> Linearised:
    """Return the model around start states, (W, S), and around forces in each window, (D, D), none if None.

    It holds some 30 numbers for each that was measured: of many windows, so many at a time as memory allows.
    """
    steps, scale = model.system.initial.steps, model.system.initial.scale(measured.sigma)
    size, d = len(steps), len(model.system.disturbance.steps)
    extra = np.zeros((0, d)) if forces is None else forces
    offsets = np.vstack([np.zeros(size), np.diag(steps), np.zeros((len(extra), size))])
    push = np.vstack([np.zeros((1 + size, d)), extra]) if len(extra) else None
    rows = model.predict(windows, starts[:, None] + offsets, push)
    values = windows.of(measured.values)
    valid = model.system.initial.settled(windows.of(measured.valid), model.system.rate_hz)
    raw = rows[:, 0] - values
    moved = (rows[:, 1 : 1 + size] - rows[:, :1]) / steps[:, None, None] * scale[:, None, None]
    return Linearised(
        measured=measured,
        scale=scale,
        starts=starts,
        valid=valid,
        raw=raw,
        residual=whiten(raw, valid, measured),
        change=np.moveaxis(moved / measured.sigma, 1, -1),
        jacobian=np.moveaxis(whiten(moved, valid[:, None], measured), 1, -1),
        by_force=np.moveaxis(whiten(rows[:, 1 + size :] - rows[:, :1], valid[:, None], measured), 1, -1),
    )


def slow_beside_constants(values: np.ndarray, valid: np.ndarray, measured: Measured) -> tuple[np.ndarray, np.ndarray]:
    """Return what `Linearised.slow` does, (W, C) each, of measured values, (W, n, C), that should stand still.

    Of each channel its mean is all that is taken off.
    """
    w, n, c = values.shape
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.where(valid, values, 0.0).sum(axis=1, keepdims=True) / valid.sum(axis=1, keepdims=True)
    levels = np.zeros((w, n, c, c))
    levels[..., np.arange(c), np.arange(c)] = whiten(np.ones((w, n, c)), valid, measured)
    return _slow_part(whiten(np.where(valid, values - mean, 0.0), valid, measured), levels, valid)


def _slow_part(residual: np.ndarray, jacobian: np.ndarray, valid: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the slow part of residuals, (W, n, C), that unknowns, (W, n, C, P), may take away; see `slow`."""
    w, n, c, p = jacobian.shape
    basis = np.linalg.qr(
        np.polynomial.legendre.legvander(np.linspace(-1, 1, n), min(SETTINGS.noise.smooth_degree, n - 1))
    )[0]
    d = basis.shape[1]
    part = np.einsum("nd,wnc->wcd", basis, residual).reshape(w, c * d)
    starts = np.einsum("nd,wncp->wcdp", basis, jacobian, optimize=True).reshape(w, c * d, p)
    normal = starts.transpose(0, 2, 1) @ starts + np.eye(p) / PRIOR_SIGMAS**2
    out = np.eye(c * d) - starts @ np.linalg.solve(normal, starts.transpose(0, 2, 1))
    # what doesn't count has no noise either
    noise = np.zeros((w, c, d, c, d))
    gram = np.einsum("nd,wnc,ne->wcde", basis, valid, basis, optimize=True)
    noise[:, np.arange(c), :, np.arange(c), :] = gram.transpose(1, 0, 2, 3)
    spread = out @ noise.reshape(w, c * d, c * d)
    freedom = (spread * out).sum(axis=2).reshape(w, c, d).sum(axis=2)
    left = (out @ part[..., None])[..., 0].reshape(w, c, d)
    return (left**2).sum(axis=2), freedom
