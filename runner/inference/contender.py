"""A fitted explanation as one of several that are compared: amid its surroundings, with its evidence and its odds."""

from __future__ import annotations

from dataclasses import dataclass, field

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

ONE_MORE = 15.0  # log prior odds against each further effect
Offer = tuple[float, Candidate, np.ndarray]  # the promised gain, the effect, where to begin


@dataclass(frozen=True)
class Contender:
    """A fitted explanation amid its surroundings, and its evidence.

    `log_posterior` includes the prior odds against many effects, and against effects that hardly matter.
    """

    fit: Fit
    around: NormalEquations = field(repr=False)
    evidence: Evidence
    log_posterior: float
    gains: dict[Candidate, tuple[float, np.ndarray]] = field(repr=False)


def contend(fitter: Fitter, fit: Fit, *known: Sensitivities, against: float = 0.0) -> Contender:
    """Return a fit as a contender; `against` are prior log odds that it has against it beside those of its size."""
    around = normal_equations(fit, *known)
    found = evidence(around, fitter.system)
    size = len(fit.explanation.candidates)
    gains = predicted_gain(around, fitter.system.screening_level)
    return Contender(fit, around, found, found.log - ONE_MORE * size - against, gains)


def are_confounded(a: Fit, b: Fit) -> bool:
    """Whether two explanations differ only by effects that such recordings can't tell apart."""

    def plain(fit: Fit) -> list[tuple[str, str]]:
        return sorted(
            (min((c.effect.name, *(o.name for o in c.effect.confounded))), c.key[1]) for c in fit.explanation.candidates
        )

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
