"""The excess of windows: by how much the slow part of what the model leaves is more than noise makes of it.

A window's *excess* is the sum of squares of its slow residual less what noise makes of it. Noise that is slow itself
shows where the body rests, and is allowed for everywhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr  # of scipy.stats' import every diagnosis would wait for a second

from runner.localise.linearised import Model, linearised, slow_beside_constants
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
        parts.append((*local.slow(), *local.missing_force(weak)))
    slow, freedom, force, covariance = (np.concatenate(every) for every in zip(*parts, strict=True))
    labels = system.label(measured, windows)
    rest = labels.table["regime"].to_numpy() == system.regimes[0]
    noise = _noise_at_rest(slow[rest], freedom[rest], shorter)
    if rest.any():
        # what the model leaves where nothing moves, and the measurement does not show, it has wrong: of a joint that
        # rests under a load, say; of orientations a recording holds no number
        shown = _noise_at_rest(*_wanders(model, windows.at(rest), measured), np.full(len(noise), np.inf))
        noise = np.where([c.space is Space.ROTATION for c in system.channels], noise, np.fmin(noise, shown))
    return WindowExcess(windows.samples, labels, slow / noise - freedom, freedom, noise, force, covariance)


def _wanders(model: Model, still: Windows, measured: Measured) -> tuple[np.ndarray, np.ndarray]:
    """Return how much what was measured moves slowly by itself in windows at rest, and what noise makes of it."""
    parts = []
    for _, some in still.chunks(WINDOWS_AT_ONCE):
        valid = model.system.initial.settled(some.of(measured.valid), model.system.rate_hz)
        parts.append(slow_beside_constants(some.of(measured.values), valid, measured))
    slow, freedom = (np.concatenate(every) for every in zip(*parts, strict=True))
    return slow, freedom


def _noise_at_rest(slow: np.ndarray, freedom: np.ndarray, shorter: np.ndarray) -> np.ndarray:
    """Return how much more slow noise each channel has in windows at rest, (W, C), than it should, at least 1, (C,).

    Where there is too little rest to tell, noise that was slow in `shorter` windows of half the length is taken for
    slower still: its ratio squared.
    """
    free = freedom.sum(axis=0)
    ratio = slow.sum(axis=0) / np.maximum(free, 1e-9)
    sure = ratio > 1 + 2 * np.sqrt(2 / np.maximum(free, 1e-9))
    return np.where(free >= SETTINGS.where.min_rest_values, np.where(sure, ratio, 1.0), shorter**2)
