"""What the owner says is known, and the recording says otherwise.

What is known is never tried, so that an answer holds if it is true. Where it is not, something else stands in its
place, with a probability that is as sure: so each is fitted once the answer is found, and has no say in it.
"""

from __future__ import annotations

import copy
from dataclasses import replace

from runner.diagnosis.ranking import values_of
from runner.effects.wording import Values
from runner.inference.least_squares import Fitter
from runner.inference.search import Search, search
from runner.settings import SETTINGS


def contradicted(found: Search, fitter: Fitter) -> str:
    """Say which effect that is known not to be the case would alone explain a recording better than what was found.

    Args:
        found: The search, without what is known.
        fitter: Of it.

    Returns:
        A sentence; empty where nothing is known, or nothing speaks against it.
    """
    vocabulary = fitter.system.vocabulary
    if not vocabulary.ruled_out:
        return ""
    system = copy.copy(fitter.system)
    system.vocabulary = replace(vocabulary, candidates=vocabulary.ruled_out, ruled_out=vocabulary.candidates)
    # a fitter of its own: what surveys of this one have kept is of other effects
    tried = search(fitter.with_system(system), found.nominal.episodes, most=1, starts=found.nominal.starts)
    dispersion = found.best.evidence.dispersion
    single = [c.weighed(system, dispersion) for c in tried.contenders if len(c.fit.explanation.candidates) == 1]
    # the same number on all of a kind is known because that of one is
    single = [c for c in single if not c.fit.explanation.candidates[0].targets]
    best = max(single, key=lambda c: c.log_posterior, default=None)
    if best is None or best.log_posterior < found.best.log_posterior + SETTINGS.odds.told_apart_log_odds:
        return ""
    (candidate,) = best.fit.explanation.candidates
    values, errors = values_of(best, fitter.context)
    of = Values(values[candidate.name], errors.get(candidate.name, {}))
    phrase = candidate.effect.phrase(of, system.beliefs, candidate.target)
    amount = f" ({phrase.amount})" if phrase.amount else ""
    return (
        f"nominal.yaml says that {candidate.name} is known, and yet this would explain the recording better than the "
        f"answer: {phrase.what}{amount}. If nobody has measured it, take it out of `known` and diagnose again."
    )
