"""What the noise of a measured drive does to a comparison: explanations replayed as might as well have been recorded.

A force that a sensor has measured is replayed with the sensor's noise, which moves what it pushes. That makes part of
what every explanation leaves, less of it the less an explanation answers a force: by itself it speaks for a heavier
body. How much it makes, and how far it could turn a comparison, shows where the same explanation is replayed with more
noise of that size (as in SIMEX, Cook and Stefanski 1994).

An error of a force moves all that comes after it, so what it makes grows with time. Once that is more than what sensors
add, a longer replay repeats the same error and tells nothing new: such recordings are replayed in parts. They are, too,
where a motion lets small differences grow many times over: what a sensor shows of a force from sample to sample is not
all that the force did.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import log_ndtr

from runner.effects.base import Effects
from runner.inference.contender import Contender
from runner.inference.least_squares import NONE, Fit, Fitter
from runner.inference.variable_projection import project
from runner.numerics.arrays import FloatArray
from runner.recording import Span
from runner.settings import SETTINGS
from runner.systems.base import AbstractSystem
from runner.systems.simulator import Run


@dataclass(frozen=True)
class ByNoise:
    """What the noise of the drive makes of the squares that a fit leaves.

    Args:
        made: Squared noises that it makes by itself, in each draw, (D,).
        turned: By how much the sum of squares is other with more noise, in each draw, (D,).
        count: Of how many values.
    """

    made: FloatArray
    turned: FloatArray
    count: int

    @property
    def excess(self) -> float:
        """What it makes of the mean square, in squared noises."""
        return float(self.made.mean()) / max(self.count, 1)

    @property
    def error(self) -> float:
        """How much that scatters from one recording to the next."""
        return float(self.made.std()) / max(self.count, 1)

    @property
    def most(self) -> float:
        """What it hardly makes more than, in squared noises."""
        return self.excess + SETTINGS.probability.chance_errors * self.error

    @classmethod
    def none(cls) -> ByNoise:
        """The drive is known."""
        return cls(np.zeros(1), np.zeros(1), 0)


def by_noise(fits: Sequence[Fit], fitter: Fitter, others: Sequence[Fitter]) -> ByNoise:
    """Return what noise of the drive makes of some fits of one explanation, whose starts follow it.

    Args:
        fits: Of different episodes.
        fitter: Of them.
        others: The same with more noise on the drive, D of them; none: it is known.
    """
    if not others:
        return ByNoise.none()
    made, turned = np.zeros(len(others)), np.zeros(len(others))
    for fit in fits:
        effects = fit.explanation.make(fit.x, fitter.context)
        for k, (left, dispersion) in enumerate(zip(fit.residual, fit.spread.dispersion, strict=True)):
            for d, other in enumerate(others):
                moved = _moved_beside_starts(fit, k, effects, other)
                made[d] += moved @ moved / dispersion
                turned[d] += (moved @ moved + 2.0 * moved @ left) / dispersion
    return ByNoise(made, turned, fitter.measured.count(e for fit in fits for e in fit.episodes))


def _moved_beside_starts(fit: Fit, k: int, effects: Effects, other: Fitter) -> FloatArray:
    """Return by how much other noise of the drive moves one episode of a fit, (n,), once its start has followed.

    A start follows by a step of Gauss and Newton, and where that leads astray as far as derivatives take it.
    """
    episode, start, left = fit.episodes[k], fit.starts[k], fit.residual[k]
    q, r = fit.basis.q[k], fit.basis.r[k]
    first = np.nan_to_num(other.whitened([(episode, [Run(effects, start)])])[0][0] - left)
    follow = start - np.linalg.pinv(r) @ (q.T @ first)
    then = np.nan_to_num(other.whitened([(episode, [Run(effects, follow)])])[0][0] - left)
    return min(project(first, q), project(then, q), key=lambda moved: float(moved @ moved))


def driven_otherwise(fitter: Fitter) -> tuple[Fitter, ...]:
    """Return the fitter with more noise on what drove the object, some times over; none where that is known."""
    return tuple(fitter.with_system(s) for s in fitter.system.driven_otherwise(SETTINGS.odds.drive_draws))


def told_apart_from_noise(whole: Fitter) -> list[Span] | None:
    """Return parts of the episodes over which noise of the drive makes no more than the sensors' does, nor grows much.

    None: over whole episodes it does not. Starts are free; parts are tried each a third shorter or so than the last.

    Args:
        whole: Of whole episodes, with the noise as it shows before any model was looked at; by what it holds.
    """
    systems = whole.system.driven_otherwise(SETTINGS.odds.drive_draws)
    if not systems:
        return None
    every = range(len(whole.measured.values))
    longest_s, count, spans, part = whole.longest_s(every), 1, None, whole
    while _is_too_long(part, systems):
        count = math.ceil(count * 4 / 3)
        shorter = whole.pieces(longest_s / count, every)
        if longest_s / count < SETTINGS.pieces.min_length_s or {s.episode for s in shorter} != set(every):
            break
        spans, part = shorter, whole.parts(shorter)
    return spans


def _is_too_long(fitter: Fitter, systems: Sequence[AbstractSystem]) -> bool:
    """Whether noise of the drive makes more than that of all that was measured does, or the motion lets it grow.

    What start states take up of it is taken off.

    Args:
        fitter: Of what was recorded.
        systems: The same with more noise on the drive.
    """
    fit = fitter.fit(NONE, range(len(fitter.measured.values)), iterations=SETTINGS.fit.nominal_steps)
    if by_noise((fit,), fitter, [fitter.with_system(s) for s in systems]).excess > 1.0:
        return True
    return _growth(fit, fitter) > SETTINGS.pieces.most_growth


def _growth(fit: Fit, fitter: Fitter) -> float:
    """Return what one noise of where stretches begin grows to, RMS in noises of the channel where that is most.

    That of their speeds is not counted: it leads far away in a free motion, too, and a fit finds them.
    """
    initial, measured = fitter.system.initial, fitter.measured
    noise = initial.scale(measured.sigma)[: initial.size // 2]
    grown, counts = np.zeros(len(measured.sigma)), np.zeros(len(measured.sigma))
    for e, q, r in zip(fit.episodes, fit.basis.q, fit.basis.r, strict=True):
        moved = (q @ (r[:, : len(noise)] * noise)).reshape(*measured.values[e].shape, -1)
        grown += (moved**2).sum(axis=(0, 2))
        counts += measured.counted(e).sum(axis=0)
    return float(np.sqrt(grown / np.maximum(counts, 1)).max())


def as_told(
    contenders: Sequence[Contender], left: Mapping[int, float], noise: Mapping[int, ByNoise]
) -> list[Contender]:
    """Return contenders whose odds are no surer than the noise of the drive lets a comparison with the first be.

    What the noise makes by itself is taken off what each leaves; the rest of a difference is as sure as it is many
    times as large as that noise could make it. By what is left of a wrong explanation a little noise makes much of a
    difference; one that leaves many times what the noise makes of it is unlikely for all that, see `_surely_told`.
    Where it tells nothing, what was likelier beforehand is.

    Args:
        contenders: Weighed, with finite odds.
        left: What each leaves of all episodes, twice a log likelihood, by the identity of its fit.
        noise: What the noise makes of that.
    """
    first = max(contenders, key=lambda c: c.log_posterior)
    theirs = noise[id(first.fit)]

    def own(contender: Contender) -> float:
        return max(left[id(contender.fit)] - float(noise[id(contender.fit)].made.mean()), 0.0)

    def surely_told(contender: Contender) -> float:
        return _surely_told(left[id(contender.fit)], noise[id(contender.fit)])

    out = []
    for c in contenders:
        if c is not first and theirs.count:
            scatter = float((noise[id(c.fit)].turned - theirs.turned).std())
            errors = (own(c) - own(first)) / max(scatter, 1e-12)
            told, surely = float(log_ndtr(errors) - log_ndtr(-errors)), surely_told(c) - surely_told(first)
            told = max(told, surely) if surely > 0 else told
            told += beforehand(first) - beforehand(c)
            c = replace(c, log_posterior=first.log_posterior - min(first.log_posterior - c.log_posterior, told))
        out.append(c)
    return out


def _surely_told(left: float, noise: ByNoise) -> float:
    """Return the log odds against an explanation, at the least, from what it leaves beyond what the noise makes of it.

    Of Gaussian errors of a given mean square those along one single direction have the heaviest tail: the exponent of a
    chi-square of one degree of freedom. The scatter of what the sensors add is counted in.
    """
    made = float(noise.made.mean())
    return 0.5 * max(left - noise.count - made, 0.0) / (made + float(np.sqrt(2.0 * noise.count)))


def beforehand(contender: Contender) -> float:
    """Return the log odds of an explanation before anything was recorded, up to a constant that all share."""
    return -SETTINGS.odds.effect_log_odds * len(contender.fit.explanation.candidates) - contender.against
