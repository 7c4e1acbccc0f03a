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
from runner.inference.normal_equations import (
    AmidProcess,
    NormalEquations,
    normal_equations,
    together,
    without_process,
)
from runner.settings import SETTINGS


@dataclass(frozen=True)
class Left:
    """What an explanation leaves of some episodes once all small errors have taken their part.

    Args:
        process: Standard deviation that the force that nothing foretells has at least, in units of the usual one.
        excess: What is left beside it and mismatch, in squared noises.
        plain: What is left beside the force alone, at what is likeliest of it, in squared noises.
        gap: What is left before all that, in squared noises.
    """

    process: float
    excess: float
    plain: float
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
    answers = [one.pushed for one in beside]
    dispersion, scales = _of_the_world([whole for *_, whole in both], fitter, fits[id(best)], answers)
    at = int(np.argmax(scales))
    out, left, plain = list[Contender](), dict[int, tuple[Left, Left]](), list[tuple[AmidProcess, AmidProcess]]()

    def left_by(around: NormalEquations, of: Evidence) -> Left:
        beside = float(around.amid_process[at].gram[-1, -1]) + around.volume
        each = (fitter.measured.excess(total, around.fit.episodes) for total in (of.left, beside, around.fit.total))
        return Left(of.process, *each)

    for c, here, there, whole in both:
        how = {"dispersion": dispersion, "scales": scales}
        found, seen = (evidence(e, fitter.system, **how) for e in (whole, here))
        unseen_ones = evidence(there, fitter.system, seen.covariance, **how)
        moved = found.log - c.evidence.log
        out.append(replace(c, log_posterior=c.log_posterior + moved, evidence=seen))
        left[id(c.fit)] = left_by(here, seen), left_by(there, unseen_ones)
        plain.append((here.amid_process[at], there.amid_process[at]))
    counts = [fitter.measured.count(fit.episodes) for fit in fits[id(best)]]
    volumes = np.array([[here.volume, there.volume] for _, here, there, _ in both])
    quadratic = np.array([[one.gram[-1, -1] for one in parts] for parts in plain]) + volumes
    costs = np.array([[one.cost for one in parts] for parts in plain])
    least = np.min([[one.total for one in fits[id(c)]] for c in leaders], axis=0) - counts
    return _with_what_is_left(out, quadratic + 2.0 * (costs - costs.min(axis=0)), counts, least), left


def _with_what_is_left(
    weighed: Sequence[Contender], plain: np.ndarray, counts: Sequence[int], least: np.ndarray
) -> list[Contender]:
    """Add what each explanation leaves of the fitted and of the unseen episodes, mismatch left in, as likelihoods.

    Where a body is moved by metres by an offset of millimetres, little mismatch does so too, and once it is integrated
    out hardly anything tells an explanation that predicts from one that does not. The squared residuals are
    overdispersed: what the best explanation leaves beyond the noise is the doing of few errors of the model,
    each of which stands for many residuals. They are taken to be no smaller in the fitted ones.

    Args:
        weighed: All explanations.
        plain: The loss of each in the fitted episodes, and in the unseen ones, (contenders, 2), process noise alone
            integrated out.
        counts: How many measurements those hold.
        least: What the explanation that leaves least leaves of each beyond the noise, (2,), the force left in: not all of
            it is the force's doing.
    """
    posterior = np.array([c.log_posterior for c in weighed])
    dispersion = 1.0
    # where parameters have taken up others, one error remains at least
    for k, independent in ((1, SETTINGS.held_out.independent_errors_unseen), (0, 1.0)):
        left = np.maximum(plain[:, k] - counts[k], 0.0)
        dispersion = max(dispersion, 1.0 + max(float(least[k]), 0.0) / independent)
        posterior -= 0.5 * left / dispersion
    return [replace(c, log_posterior=float(p)) for c, p in zip(weighed, posterior, strict=True)]


def _of_the_world(
    wholes: Sequence[NormalEquations],
    fitter: Fitter,
    best: tuple[Fit, Fit],
    answers: Sequence[Sequence[np.ndarray]],
) -> tuple[float, np.ndarray]:
    """Return how uncertain residuals are, in units of the noise, and how likely each scale of process noise is, (L,).

    Both are of the world and not of an explanation of it: they are told by those that account best for it. Whether
    there is an effect at all is open, and each further one has to be worth its odds. What is left beside the force
    counts as often as it lasts, by the likeliest of the explanations before, fitted and in unseen episodes, whose
    `answers` to a force these are.
    """
    odds = SETTINGS.odds.effect_log_odds

    def scales_of(found: Sequence[Evidence]) -> np.ndarray:
        each = [
            one.scales - odds * max(len(whole.fit.explanation.candidates) - 1, 0)
            for whole, one in zip(wholes, found, strict=True)
        ]
        return softmax(np.logaddexp.reduce(each, axis=0))

    alone = [evidence(whole, fitter.system) for whole in wholes]
    at, left = int(np.argmax(scales_of(alone))), min(found.left for found in alone)
    episodes = [e for fit in best for e in fit.episodes]
    lasting = max(memory(without_process(f, a, at), fitter) for f, a in zip(best, answers, strict=True))
    dispersion = 1.0 + max(fitter.measured.excess(left, episodes), 0.0) * lasting
    return dispersion, scales_of([evidence(whole, fitter.system, dispersion=dispersion) for whole in wholes])
