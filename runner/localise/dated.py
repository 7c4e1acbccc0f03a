"""Dated disturbances: a force that acted for some time in one episode, and on nothing that happens again.

What somebody does to a machine while it records (a hand, a cable that catches) is no effect of a vocabulary: nothing
foretells it. It shows once the best explanation is in the model: a force is then missing for a while, far beyond what
that explanation lacks everywhere else. Beginning, end and size come from the force that is missing in overlapping
windows, each of which sees the share of it that falls into the window.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from runner.effects.base import Effects
from runner.effects.wording import plus_minus
from runner.localise.excess import window_excess
from runner.localise.linearised import Model
from runner.localise.missing_force import missing_force
from runner.noise.measured import Measured
from runner.numerics.arrays import FloatArray
from runner.settings import SETTINGS
from runner.systems.base import AbstractSystem
from runner.systems.simulator import AbstractSimulator
from runner.systems.windows import Windows


@dataclass(frozen=True)
class DatedDisturbance:
    """A force that acted for some time in one episode.

    Args:
        episode: Its number in the recording.
        label: Of the force, with its unit.
        force: Its mean size while it acted, in that unit, and its standard error.
        from_s: Since the episode began, with its standard error.
        until_s: The same of its end.
    """

    episode: int
    label: str
    force: tuple[float, float]
    from_s: tuple[float, float]
    until_s: tuple[float, float]

    @property
    def sentence(self) -> str:
        """It in a sentence."""
        words, _, unit = self.label.removesuffix("]").partition(" [")
        size, begin, end = plus_minus(*self.force, unit), plus_minus(*self.from_s, "s"), plus_minus(*self.until_s, "s")
        return (
            f"In episode {self.episode} something pushed that is not in the log, {words}: {size} "
            f"from {begin} until {end}."
        )


@dataclass(frozen=True)
class _Run:
    """Windows in a row that lack a force of one sign: the episode, which force, first and last sample."""

    episode: int
    force: int
    first: int
    last: int
    surprise: float


def dated_disturbances(
    system: AbstractSystem, simulator: AbstractSimulator, effects: Effects, measured: Measured
) -> tuple[DatedDisturbance, ...]:
    """Return the disturbances of a recording, the plainest first.

    Args:
        system: What was recorded.
        simulator: Of it.
        effects: The best explanation.
        measured: Channels and noise of whole episodes.
    """
    samples = max(2 * SETTINGS.noise.smooth_degree, round(SETTINGS.disturbance.window_s * system.rate_hz))
    lengths = [len(v) for v in measured.values]
    fits = [(e, f) for e, n in enumerate(lengths) for f in range(0, n - samples + 1, samples)]
    if len(fits) < 1.0 / SETTINGS.where.significance:
        return ()  # too few to know what is usual
    model = Model(system, simulator, effects)
    at = np.array(fits)
    value, error = _missing(model, Windows(at[:, 0], at[:, 1], samples), measured)
    usual = _usual(value)
    runs = sorted(_runs(at, value, error, usual, samples), key=lambda r: -r.surprise)
    if not 0 < len(runs) <= SETTINGS.disturbance.max_count:
        return ()
    dated = (_dated(run, model, measured, usual, samples) for run in runs)
    return tuple(d for d in dated if d is not None)


def _missing(model: Model, windows: Windows, measured: Measured) -> tuple[FloatArray, FloatArray]:
    """Return the force that is missing in windows, and its standard error, (W, D) each."""
    found = window_excess(model, windows, measured, np.ones(len(model.system.channels)))
    value, covariance = missing_force(model.system, found)
    return value, np.sqrt(np.einsum("wdd->wd", covariance))


def _usual(value: FloatArray) -> FloatArray:
    """Return how much force is missing everywhere: of a Laplace distribution with this median, its scale, (D,)."""
    return np.asarray(np.median(np.abs(value), axis=0) / np.log(2.0))


def _runs(at: np.ndarray, value: FloatArray, error: FloatArray, usual: FloatArray, samples: int) -> list[_Run]:
    """Return runs of windows that lack more of one force than is likely anywhere.

    What an explanation lacks has heavy tails: it is taken for a Laplace distribution around zero.
    """
    found = []
    for d in range(value.shape[1]):
        # what is badly known is not surprising
        surprise = np.abs(value[:, d]) / np.hypot(usual[d], error[:, d])
        sign = np.where(surprise > SETTINGS.disturbance.min_surprise, np.sign(value[:, d]), 0.0)
        edges = np.flatnonzero((np.diff(sign) != 0) | (np.diff(at[:, 0]) != 0)) + 1
        for part in np.split(np.arange(len(at)), edges):
            total = float(surprise[part].sum())
            if sign[part[0]] and total > np.log(value.size / SETTINGS.where.significance):
                found.append(_Run(int(at[part[0], 0]), d, int(at[part[0], 1]), int(at[part[-1], 1]) + samples, total))
    return found


def _dated(run: _Run, model: Model, measured: Measured, usual: FloatArray, samples: int) -> DatedDisturbance | None:
    """Return beginning, end and size by least squares over overlapping windows; None where that tells no size."""
    recorded = model.system.recording.episodes[run.episode]
    overlap, margin = SETTINGS.disturbance.overlap, SETTINGS.disturbance.margin
    hop = max(1, samples // overlap)
    last = len(measured.values[run.episode]) - samples
    first = np.arange(max(run.first - margin * samples, 0), min(run.last + (margin - 1) * samples, last) + 1, hop)
    value, error = _missing(model, Windows(np.full(len(first), run.episode), first, samples), measured)
    weight = 1.0 / np.hypot(usual[run.force], error[:, run.force])
    step_s, length_s = recorded.step_s, samples * recorded.step_s
    begin_s, seen = first * step_s, value[:, run.force]

    def share(x: FloatArray) -> FloatArray:
        overlap = np.minimum(begin_s + length_s, x[2]) - np.maximum(begin_s, x[1])
        return np.asarray(np.clip(overlap / length_s, 0.0, 1.0))

    def left(x: FloatArray) -> FloatArray:
        return np.asarray((x[0] * share(x) - seen) * weight)

    inside = (first >= run.first) & (first + samples <= run.last)
    x = np.array([np.median(seen[inside]), run.first * step_s, run.last * step_s])
    size = np.array([max(abs(x[0]), usual[run.force]), length_s, length_s])
    fit = least_squares(left, x, x_scale=size, diff_step=1e-3, loss="soft_l1")
    force, from_s, until_s = fit.x
    if until_s - from_s < step_s:
        return None
    # neighbours share most of their samples
    spread = np.linalg.pinv(fit.jac.T @ fit.jac) * overlap
    errors = np.sqrt(np.diag(spread) * max(2.0 * fit.cost / len(seen), 1e-12))
    if abs(force) < SETTINGS.odds.min_errors_beside_others * errors[0]:
        return None  # a push that is over within a window has no size of its own
    return DatedDisturbance(
        recorded.index,
        model.system.disturbance.labels[run.force],
        (float(force), float(errors[0])),
        (float(from_s), float(errors[1])),
        (float(until_s), float(errors[2])),
    )
