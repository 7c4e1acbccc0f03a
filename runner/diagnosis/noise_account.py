"""What noise is told from: how samples differ, what the nominal model leaves, or what explains a recording does."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from runner.effects.base import Effects
from runner.inference.least_squares import NONE, Fit, Fitter
from runner.inference.warm_start import WarmStart
from runner.noise.measured import Measured, refine
from runner.settings import SETTINGS
from runner.systems.simulator import Run


def fit_nominal(fitter: Fitter, stretches: Sequence[int], *, by_model: bool = False) -> tuple[Fitter, Fit]:
    """Fit the nominal model and tell the noise from what it leaves; where that is far more, only `by_model`."""
    starts, steps = None, SETTINGS.fit.nominal_steps
    if before := fitter.until_hit(stretches):
        # through an impact a start descends to anywhere: it begins where it was told in the air
        flown = fitter.parts(before).fit(NONE, range(len(before)), iterations=steps)
        starts = fitter.first_starts(stretches)
        starts[[stretches.index(s.episode) for s in before]] = flown.starts
        starts, _ = fitter.best_starts((), starts[:, None], stretches)
    nominal = fitter.fit(NONE, stretches, starts=starts, iterations=steps)
    stated = not np.isnan(fitter.system.noise_by_owner()).any()
    if not (stated or by_model) and _outweighs_noise(nominal, fitter):
        return fitter, nominal
    return replace(fitter, measured=refine(fitter.measured, fitter.system, left_by(nominal, (), fitter))), nominal


def _outweighs_noise(nominal: Fit, fitter: Fitter) -> bool:
    """Whether the model as believed misses so much more than the noise that nothing of that tells what the noise is.

    Where nobody has stated the noise, what is missed would pass for it, most of all for slow noise, and hide in it all
    causes but the largest. How samples differ tells what a sensor adds to each; what the likeliest explanation leaves
    tells the rest.
    """
    count = fitter.measured.count(nominal.episodes)
    return bool(nominal.total > SETTINGS.pieces.far_mean_square * count)


def is_hopeless(nominal: Fit, begun: Iterable[WarmStart], fitter: Fitter) -> bool:
    """Whether all that pieces suggest is so far from noise as samples differ that sets of the same do not reach it."""
    least = min([nominal.total, *(start.total for start in begun)])
    return bool(least > SETTINGS.pieces.hopeless_mean_square * fitter.measured.count(nominal.episodes))


def is_explained(best: Fit, nominal: Fit, fitter: Fitter) -> bool:
    """Whether what was found leaves little beside noise as samples differ, or beside what the believed model misses.

    Where nothing does, a part of what is missed is noise, for want of anything better.
    """
    count = fitter.measured.count(best.episodes)
    left = fitter.loss(best.explanation, best.x, best.starts, best.episodes)
    share = SETTINGS.search.min_gain_share * max(nominal.total - count, 0.0)
    return bool(left < max(SETTINGS.pieces.far_mean_square * count, count + share))


def has_hidden(best: Fit, was: Measured, again: Measured) -> bool:
    """Whether noise may have hidden something from a search: not in a channel of which the best leaves plainly more.

    Args:
        best: What the search has found.
        was: The noise that it went by.
        again: The noise that what it leaves shows.
    """
    counts = np.sum([was.counted(e).sum(axis=0) for e in best.episodes], axis=0)
    squares = sum((r.reshape(-1, len(counts)) ** 2).sum(axis=0) for r in best.residual)
    near = squares < (1.0 + SETTINGS.search.near_excess) * np.maximum(counts, 1)
    less = np.log(was.sensor / again.sensor) > SETTINGS.noise.material_log_change
    return bool((near & less).any() or near.all())


def left_by(fit: Fit, effects: Effects, fitter: Fitter) -> dict[int, np.ndarray]:
    """Return what a fit leaves, per episode of the fitter (T, C), physical units, as large as the noise is in it.

    What its start takes of the noise is a share of it, in short stretches a large one.
    """
    left = {}
    for e, start, q in zip(fit.episodes, fit.starts, fit.basis.q, strict=True):
        residual, there = residual_of(fitter, e, effects, start), fitter.measured.counted(e).sum(axis=0)
        taken = (q[: residual.size].reshape(*residual.shape, -1) ** 2).sum(axis=(0, 2))
        left[e] = residual * np.sqrt(np.maximum(there, 1) / np.maximum(there - taken, 1.0))
    return left


def residual_of(fitter: Fitter, episode: int, effects: Effects, start: np.ndarray) -> np.ndarray:
    """Return prediction less measurement, (T, C), physical units."""
    return fitter.simulator.predict(episode, [Run(effects, start)])[0] - fitter.measured.values[episode]
