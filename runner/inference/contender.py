"""A fitted explanation as one of several that are compared: amid its surroundings, with its evidence and its odds."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from runner.effects.vocabulary import Candidate
from runner.inference.evidence import (
    Evidence,
    NormalEquations,
    Sensitivities,
    clip,
    evidence,
    normal_equations,
    predicted_gain,
)
from runner.inference.least_squares import Fit, Fitter
from runner.noise.measured import Measured, counting_alike
from runner.settings import SETTINGS
from runner.systems.base import AbstractSystem

Offer = tuple[float, Candidate, np.ndarray]  # the promised gain, the effect, where to begin


@dataclass(frozen=True)
class Contender:
    """A fitted explanation amid its surroundings, and its evidence.

    `against` are prior log odds that it has against it beside those of its size.
    """

    fit: Fit
    around: NormalEquations = field(repr=False)
    evidence: Evidence
    against: float
    log_posterior: float
    gains: dict[Candidate, tuple[float, np.ndarray]] = field(repr=False)

    def weighed(self, system: AbstractSystem, dispersion: float) -> Contender:
        """Return it with its evidence where residuals are so many times as uncertain as noise is."""
        if dispersion == self.evidence.dispersion:
            return self
        found = evidence(self.around, system, dispersion=dispersion)
        return replace(self, evidence=found, log_posterior=log_posterior(self.fit, found, self.against))


def log_posterior(fit: Fit, found: Evidence, against: float) -> float:
    """Return the log posterior of a fit, up to a constant that all explanations of a recording share."""
    return found.log - SETTINGS.odds.effect_log_odds * len(fit.explanation.candidates) - against


def contend(
    fitter: Fitter, fit: Fit, *known: Sensitivities, against: float = 0.0, dispersion: float = 1.0
) -> Contender:
    """Return a fit as a contender.

    Args:
        fitter: Of the fit.
        fit: It.
        known: What all effects do around it, or near it.
        against: Prior log odds that it has against it beside those of its size.
        dispersion: How many times as uncertain residuals are as noise is; see `dispersion_of`.
    """
    around = normal_equations(fit, *known)
    found = evidence(around, fitter.system, dispersion=dispersion)
    gains = predicted_gain(around, fitter.system.screening_level)
    return Contender(fit, around, found, against, log_posterior(fit, found, against), gains)


def account_densities(accounts: Sequence[tuple[Fitter, Fit]]) -> list[float]:
    """Return the log density of a recording by each of several fits with an account of the noise of its own.

    Up to a constant that all share: each is fitted anew to the values that count by all of the accounts.

    Args:
        accounts: Of the same episodes, each with its fitter, whose noise it is.
    """
    alike = counting_alike([fitter.measured for fitter, _ in accounts])
    out = []
    for (fitter, fit), measured in zip(accounts, alike, strict=True):
        again = replace(fitter, measured=measured).fit(fit.explanation, fit.episodes, x=fit.x, starts=fit.starts)
        out.append(log_density(again, measured))
    return out


def log_density(fit: Fit, measured: Measured) -> float:
    """Return the log density of what counts of a recording by a fit and an account of its noise, up to a constant.

    Of fits whose evidence is not comparable, as their noise is another: that of Gaussian noise, less Schwarz's half
    logarithm of the count of values for each parameter (Schwarz 1978), less the prior odds of the effects. The constant
    hangs on which values count, and on their units: see `account_densities`.
    """
    for_parameters = 0.5 * len(fit.x) * np.log(measured.count(fit.episodes))
    for_effects = SETTINGS.odds.effect_log_odds * len(fit.explanation.candidates)
    return float(-0.5 * fit.total - measured.volume(fit.episodes) - for_parameters - for_effects)


def dispersion_of(fit: Fit, fitter: Fitter, left: float) -> float:
    """Return how many times as uncertain as noise the residuals of a recording are, from what its best fit leaves.

    What the best explanation leaves beyond noise are errors of a model that is wrong everywhere and that change slowly:
    as many residuals as such an error lasts tell no more than one. That is a quasi-likelihood with an estimated
    dispersion (Wedderburn 1974): what leaves almost as little is almost as likely, and what leaves many times as much
    is as unlikely as ever.

    Args:
        fit: The best.
        fitter: Of it.
        left: What it leaves, see `Evidence.left`: what a wrong size makes is one error and no part of those.
    """
    return 1.0 + max(fitter.measured.excess(left, fit.episodes), 0.0) * memory(fit, fitter)


def memory(fit: Fit, fitter: Fitter) -> float:
    """Return over how many samples what a fit leaves remains alike: its integrated autocorrelation time, at least 1."""
    channels = len(fitter.system.channels)
    scaled = zip(fit.residual, np.sqrt(fit.spread.dispersion), strict=True)
    parts = [(r / d).reshape(-1, channels) for r, d in scaled]
    size = 2 * max(len(p) for p in parts)
    spectra = [np.abs(np.fft.rfft(p, n=size, axis=0)) ** 2 for p in parts]
    covariance = np.fft.irfft(np.sum(spectra, axis=(0, 2)), n=size)[: size // 2]
    if not covariance[0] > 0:
        return 1.0
    alike = covariance / covariance[0]
    last = int(np.argmax(alike <= 0)) if (alike <= 0).any() else len(alike)
    return float(max(1.0 + 2.0 * alike[1:last].sum(), 1.0))


def least_gain(count: int) -> float:
    """Return what an effect has to take off the loss of so many measurements, however little is left."""
    return SETTINGS.search.min_gain_excess * count


def likeliest_first(contenders: Iterable[Contender]) -> list[Contender]:
    """Return contenders by their odds; of equal ones, in the order in which they come."""
    return sorted(contenders, key=lambda c: -c.log_posterior)


def leading(contenders: Sequence[Contender]) -> list[Contender]:
    """Return the contenders of which one may turn out the likeliest by what is not weighed yet, likeliest first."""
    leaders = likeliest_first(c for c in contenders if np.isfinite(c.log_posterior))[: SETTINGS.held_out.max_leaders]
    hopeless = leaders[0].log_posterior - SETTINGS.held_out.hopeless_log_odds
    return [c for c in leaders if c.log_posterior > hopeless]


def nominal_of(contenders: Iterable[Contender]) -> Contender:
    """Return the one without effects."""
    return next(c for c in contenders if not c.fit.explanation.candidates)


def are_confounded(a: Fit, b: Fit) -> bool:
    """Whether two explanations differ only by effects that such recordings can't tell apart.

    What acts on all of a kind alike may be one with what acts on the whole: all commands late, or all measurements.
    """

    def plain(fit: Fit) -> list[tuple[str, str]]:
        return sorted((min(c.like), c.part or "") for c in fit.explanation.candidates)

    return plain(a) == plain(b)


def offers(contender: Contender, fitter: Fitter) -> list[Offer]:
    """Every effect that is not in yet, nor told apart from one that is, most promising first, with a start vector."""
    held = contender.fit.explanation.candidates
    out = []
    for candidates in fitter.system.vocabulary.by_name.values():
        for candidate in candidates:
            if candidate in contender.gains and candidate.may_join(held):
                gain, vector = contender.gains[candidate]
                out.append((gain, candidate, clip(candidate, vector, fitter.context)))
    return sorted(out, key=lambda o: -o[0])
