"""The excess of windows: by how much the slow part of what the model leaves is more than noise makes of it.

A window's *excess* is the sum of squares of its slow residual less what noise makes of it. Noise that is slow itself
shows where the body rests, and is allowed for everywhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr  # of scipy.stats' import every diagnosis would wait for a second

from runner.localise.linearised import Model, linearised
from runner.localise.windows import window_lengths_s, windows_of_length
from runner.noise.measured import Measured
from runner.settings import SETTINGS
from runner.simulate.shooting import WINDOWS_AT_ONCE
from runner.systems.channels import Space
from runner.systems.windows import Labels, Windows


@dataclass(frozen=True)
class WindowExcess:
    """Windows of one length, and what they show.

    Args:
        samples: Of each window.
        labels: What went on in them.
        excess: In squared noises, (W, C).
        freedom: What noise makes of the slow residual, (W, C).
        noise: How much more slow noise there is at rest than there should be, (C,).
        force: The constant force that is missing in each, in steps of the system's disturbance, (W, D).
        force_covariance: Of it, by the noise as it is stated, (W, D, D).
    """

    samples: int
    labels: Labels
    excess: np.ndarray
    freedom: np.ndarray
    noise: np.ndarray
    force: np.ndarray
    force_covariance: np.ndarray

    @property
    def p(self) -> float:
        """Probability of so much excess by noise."""
        return probability_by_noise(float(self.excess.sum()), float(self.freedom.sum()))


def probability_by_noise(excess: float, freedom: float) -> float:
    """Return how likely noise alone makes so much excess, of so many values."""
    return float(ndtr((SETTINGS.where.noise_variance_share * freedom - excess) / np.sqrt(2 * max(freedom, 1e-9))))


def shortest_that_tells(model: Model, measured: Measured, episodes: Sequence[int]) -> tuple[WindowExcess, WindowExcess]:
    """Return the excess in the shortest windows, and in the shortest that show any: the shortest again if none do.

    Args:
        model: What may miss the recording.
        measured: The channels and their noise.
        episodes: Those that count, by their position.
    """
    system, limits = model.system, SETTINGS.where
    first_s, *longer_s = window_lengths_s(system, episodes)
    windows = windows_of_length(system, first_s, episodes)
    shortest = telling = window_excess(model, windows, measured, np.ones(len(system.channels)))
    noise = shortest.noise
    for window_s in longer_s:
        windows = windows_of_length(system, window_s, episodes)
        if telling.p < limits.significance or len(windows) < limits.min_windows:
            break
        longer = window_excess(model, windows, measured, noise)
        noise = longer.noise
        telling = longer if longer.p < limits.significance else telling
    return shortest, telling


def window_excess(model: Model, windows: Windows, measured: Measured, shorter: np.ndarray) -> WindowExcess:
    """Return the excess in windows; `shorter`: the `noise` of windows of half the length, (C,), 1 if there are none."""
    system = model.system
    weak = system.disturbance.prior / system.disturbance.steps
    parts = []
    # what all windows do around their starts is more than fits into memory: of each only what it shows is kept
    for _, some in windows.chunks(WINDOWS_AT_ONCE):
        first = linearised(model, some, measured, system.initial.guess_windows(measured, some, smooth=True))
        local = linearised(model, some, measured, first.fitted(), np.diag(system.disturbance.steps))
        parts.append((*local.slow(), *local.slow_of_what_stands_still(), *local.missing_force(weak)))
    slow, freedom, wanders, free, force, covariance = (np.concatenate(every) for every in zip(*parts, strict=True))
    labels = system.label(measured, windows)
    rest = labels.table["regime"].to_numpy() == system.regimes[0]
    # what the model leaves where nothing moves, and the measurement does not show, it has wrong: where a joint comes to
    # rest under a load, say
    shown = _noise_at_rest(wanders, free, rest, np.full(len(shorter), np.inf))
    seen = np.array([c.space is not Space.ROTATION for c in system.channels])
    noise = np.fmin(_noise_at_rest(slow, freedom, rest, shorter), np.where(seen, shown, np.inf))
    return WindowExcess(windows.samples, labels, slow / noise - freedom, freedom, noise, force, covariance)


def _noise_at_rest(slow: np.ndarray, freedom: np.ndarray, rest: np.ndarray, shorter: np.ndarray) -> np.ndarray:
    """Return how much more slow noise each channel has at rest than it should, at least 1, (C,).

    Where there is too little rest to tell, noise that was slow in `shorter` windows of half the length is taken for
    slower still: its ratio squared.
    """
    free = freedom[rest].sum(axis=0)
    ratio = slow[rest].sum(axis=0) / np.maximum(free, 1e-9)
    sure = ratio > 1 + 2 * np.sqrt(2 / np.maximum(free, 1e-9))
    return np.where(free >= SETTINGS.where.min_rest_values, np.where(sure, ratio, 1.0), shorter**2)
