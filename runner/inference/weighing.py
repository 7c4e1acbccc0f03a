"""Contenders weighed by all episodes, fitted and unseen, with everything that no explanation is asked to account for.

That is mismatch in the direction of every effect, and a force that nothing foretells. How large a force, and how
uncertain residuals are beside it, is of the world that was recorded, and the same for every explanation of it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import softmax

from runner.inference.contender import Contender, memory
from runner.inference.directions import Sensitivities, directions, sensitivities
from runner.inference.evidence import Evidence, evidence
from runner.inference.least_squares import Fit, Fitter
from runner.inference.normal_equations import NormalEquations, normal_equations, together
from runner.settings import SETTINGS


@dataclass(frozen=True)
class Left:
    """What an explanation leaves of some episodes once all small errors have taken their part.

    Args:
        process: Standard deviation that the force that nothing foretells has at least, in units of the usual one.
        excess: What is left beside it, in squared noises.
        gap: What is left before all that, in squared noises.
    """

    process: float
    excess: float
    gap: float


def weigh(
    leaders: Sequence[Contender], there_by: Mapping[int, Fit], nominal: Contender, fitter: Fitter
) -> tuple[list[Contender], dict[int, tuple[Left, Left]]]:
    """Weigh contenders by all episodes, with a force integrated out that nothing foretells.

    Args:
        leaders: The contenders, likeliest first.
        there_by: Each with the start states of unseen episodes fitted, by the identity of its fit.
        nominal: The one without effects among them.
        fitter: Of all episodes.

    Returns:
        The contenders, with what that makes of their errors, and by the identity of a contender's fit what it leaves of
        the fitted and of the unseen episodes.
    """
    best = next((c for c in leaders if c is not nominal), nominal)
    every = directions(fitter.system)

    def around(fit: Fit) -> Sensitivities:
        return sensitivities(fitter, fit, every, process=True)

    fits = {id(c): (c.fit, there_by[id(c.fit)]) for c in leaders}
    alone = [around(fit) for fit in fits[id(nominal)]]
    beside = alone if best is nominal else [around(fit) for fit in fits[id(best)]]
    both: list[tuple[Contender, NormalEquations, NormalEquations, NormalEquations]] = []
    for c in leaders:
        known = zip(alone, beside, strict=True)
        own = [(a,) if c is nominal else (b, a) for a, b in known]
        here, there = (normal_equations(fit, *some) for fit, some in zip(fits[id(c)], own, strict=True))
        both.append((c, here, there, together(here, there)))
    episodes = (*best.fit.episodes, *there_by[id(best.fit)].episodes)
    dispersion, scales = _of_the_world([whole for *_, whole in both], fitter, episodes, memory(best.fit, fitter))
    out, left = list[Contender](), dict[int, tuple[Left, Left]]()

    def left_by(fit: Fit, of: Evidence) -> Left:
        after, before = (fitter.measured.excess(total, fit.episodes) for total in (of.left, fit.total))
        return Left(of.process, after, before)

    for c, here, there, whole in both:
        how = {"dispersion": dispersion, "scales": scales}
        found, seen = (evidence(e, fitter.system, **how) for e in (whole, here))
        unseen_ones = evidence(there, fitter.system, seen.covariance, **how)
        moved = found.log - c.evidence.log
        errors = {"covariance": seen.covariance, "by_prior": seen.by_prior, "dispersion": dispersion}
        out.append(replace(c, log_posterior=c.log_posterior + moved, evidence=replace(c.evidence, **errors)))
        left[id(c.fit)] = left_by(here.fit, seen), left_by(there.fit, unseen_ones)
    at = int(np.argmax(scales))
    plain = [here.left_amid(at) for _, here, _, _ in both], [there.left_amid(at) for _, _, there, _ in both]
    counts = [fitter.measured.count(fit.episodes) for fit in fits[id(best)]]
    return _with_what_is_left(out, plain, counts), left


def _with_what_is_left(
    weighed: Sequence[Contender], plain: Sequence[Sequence[float]], counts: Sequence[int]
) -> list[Contender]:
    """Add what each explanation leaves of the fitted and of the unseen episodes, mismatch left in, as likelihoods.

    Where a body is moved by metres by an offset of millimetres, little mismatch does so too, and once it is integrated
    out hardly anything tells an explanation that predicts from one that does not. The squared residuals are
    overdispersed: what the best explanation leaves beyond the noise is the doing of few errors of the model,
    each of which stands for many residuals. They are taken to be no smaller in the fitted ones.

    Args:
        weighed: All explanations.
        plain: The loss of each in the fitted episodes, and in the unseen ones, process noise alone integrated out.
        counts: How many measurements those hold.
    """
    posterior = np.array([c.log_posterior for c in weighed])
    dispersion = 1.0
    # where parameters have taken up others, one error remains at least
    for k, independent in ((1, SETTINGS.held_out.independent_errors_unseen), (0, 1.0)):
        left = np.maximum(np.array(plain[k]) - counts[k], 0.0)
        dispersion = max(dispersion, 1.0 + left.min() / independent)
        posterior -= 0.5 * left / dispersion
    return [replace(c, log_posterior=float(p)) for c, p in zip(weighed, posterior, strict=True)]


def _of_the_world(
    wholes: Sequence[NormalEquations], fitter: Fitter, episodes: Sequence[int], lasting: float
) -> tuple[float, np.ndarray]:
    """Return how uncertain residuals are, in units of the noise, and how likely each scale of process noise is, (L,).

    Both are of the world and not of an explanation of it: they are told by the one that accounts best for it. Whether
    there is an effect at all is open, and each further one has to be worth its odds. `lasting` is over how many
    samples residuals remain alike.
    """

    def accounts(whole: NormalEquations, found: Evidence) -> float:
        return found.log - SETTINGS.odds.effect_log_odds * max(len(whole.fit.explanation.candidates) - 1, 0)

    alone = [evidence(whole, fitter.system) for whole in wholes]
    left = min(found.left for found in alone)
    dispersion = 1.0 + max(fitter.measured.excess(left, episodes), 0.0) * lasting
    again = [(w, evidence(w, fitter.system, dispersion=dispersion)) for w in wholes]
    _, best = max(again, key=lambda one: accounts(*one))
    return dispersion, softmax(best.scales)
