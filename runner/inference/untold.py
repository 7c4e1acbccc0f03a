"""Numbers of an effect that the data do not tell, though their standard errors would have it so.

A standard error speaks of the slopes where a fit ended. What acts in second order about where it is absent has no slope
there, and has one everywhere else: the tilt of gravity about an axis along which nothing can move makes it weaker by
half its square, so that noise, or a model that is a little wrong, leads a descent away from zero to where a tilt of
either sign does what was lacking. There it is twice as many standard errors from zero as the data say.

So what is left without a number is asked, too: the ratio of likelihoods does not hang on how a model is parametrised
(Wilks 1938). Where that may be chance, and is less than the standard error claims, the number is zero, and as uncertain
as it is by the slopes there: where there are none, as its prior.
"""

from __future__ import annotations

import numpy as np
from scipy.special import chdtri, erfc

from runner.inference.contender import Contender
from runner.inference.evidence import by_data, log_densities
from runner.inference.least_squares import Fit, Fitter, amplitudes
from runner.settings import SETTINGS


def without_untold(contender: Contender, fitter: Fitter) -> Fit | None:
    """Return a fit with the numbers at zero that the data do not tell from it; None: there are none.

    Of effects of several numbers, each of which may be absent; what is left of an effect is asked of the evidence. What
    acts in proportion stays as it is, however little told: there both ways of asking come to the same.
    """
    fit, chance = contender.fit, SETTINGS.probability.chance_errors
    if not fit.explanation.candidates:
        return None
    charged, by_noise = _errors(contender, fitter)
    held: list[int] = []
    while claimed := _claimed(fit, charged, held, fitter):
        # what mismatch may do to a number counts as much here as in its standard error
        weight = {i: (by_noise[i] / charged[i]) ** 2 / contender.evidence.dispersion for i in claimed}
        # of all that are at zero together as rare a ratio of likelihoods as `chance` is of one
        together = chdtri(len(held) + 1, erfc(chance / np.sqrt(2.0)))
        most = {i: contender.fit.total + together / weight[i] for i in claimed}
        without = {i: _without(fit, [*held, i], fitter, most[i]) for i in claimed}
        told = {i: np.sqrt(max(f.total - fit.total, 0.0) * weight[i]) for i, f in without.items()}
        by_chance = [i for i, f in without.items() if f.total < most[i]]
        # a number claims as many errors as are told if it acts in proportion, twice as many if by its square: between
        untold = [i for i in by_chance if told[i] < chance and claimed[i] > np.sqrt(2.0) * told[i]]
        if not untold:
            break
        least = min(untold, key=lambda i: told[i])
        held, fit = [*held, least], without[least]
    return fit if held else None


def _errors(contender: Contender, fitter: Fitter) -> tuple[np.ndarray, np.ndarray]:
    """Return the standard error of each number of an explanation, (p,): as it is stated, and by the noise alone."""
    fit, of = contender.fit, contender.evidence
    free, by_noise = np.flatnonzero(~fit.at_bound), np.full(len(fit.x), np.inf)
    width = np.diag(2 * np.pi * np.exp(2 * log_densities(fit, fitter.context)))
    told = (fit.information() / of.dispersion + width)[np.ix_(free, free)]
    by_noise[free] = np.sqrt(np.diag(np.linalg.inv(told)))
    charged = np.sqrt(np.maximum(np.diag(by_data(of, fit, fitter.context)), np.diag(of.by_prior)))
    return np.maximum(charged, by_noise), by_noise


def _claimed(fit: Fit, errors: np.ndarray, held: list[int], fitter: Fitter) -> dict[int, float]:
    """Return by how many of their standard errors (p,) numbers are away from zero, of those that may well be zero.

    By their positions; what is within its standard error claims nothing.
    """
    parameters, out = fit.explanation.parameters(fitter.context), dict[int, float]()
    for candidate, part in fit.explanation.parts(fitter.context):
        some = amplitudes(candidate, part, fitter.context)
        here = [i for i in range(some.start, some.stop) if fit.x[i] != 0.0 and i not in held]
        if len(here) < 2:
            continue  # without its last number there is no effect
        for i in here:
            away = float(abs(fit.x[i]) / errors[i])
            if away > 1.0 and not fit.at_bound[i] and parameters[i].lower < 0.0 < parameters[i].upper:
                out[i] = away
    return out


def _without(fit: Fit, held: list[int], fitter: Fitter, target: float) -> Fit:
    """Return a fit with some of its numbers at zero, the others fitted anew, as long as it may come near a target."""
    x = fit.x.copy()
    x[held] = 0.0
    return fitter.fit(
        fit.explanation,
        fit.episodes,
        x=x,
        starts=fit.starts,
        target=target,
        patience=SETTINGS.fit.patience_steps,
        iterations=SETTINGS.fit.final_steps,
        kept=held,
    )
