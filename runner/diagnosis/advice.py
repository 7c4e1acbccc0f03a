"""What could be taken for the answer, and which experiment would tell."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from runner.diagnosis.next_experiment import best_experiment
from runner.diagnosis.ranking import contender_of
from runner.diagnosis.result import Ranked
from runner.effects.vocabulary import Vocabulary, spoken
from runner.effects.wording import number
from runner.inference.confounding import Rival, rivals
from runner.inference.contender import Contender
from runner.inference.evidence import directions, normal_equations, sensitivities
from runner.inference.least_squares import Fitter
from runner.inference.search import Search
from runner.settings import SETTINGS

PLENTY = math.log(1000.0)  # natural log odds: nobody asks for more


def found_rivals(best: Contender, found: Search, fitter: Fitter) -> tuple[Rival, ...]:
    """Return what could be taken for the effects of the best explanation that a search has found."""
    if not best.fit.explanation.candidates:
        return ()
    around = normal_equations(best.fit, sensitivities(fitter, best.fit, directions(fitter.system)))
    return rivals(around, best.evidence, fitter, [c.fit for c in found.contenders])


def next_push(
    ranked: Sequence[Ranked], found: Search, rivals_found: Sequence[Rival], fitter: Fitter, threads: int | None
) -> str | None:
    """Say which further push would tell the leading explanations apart, if they need to be.

    Args:
        ranked: The explanations with their probabilities.
        found: The search that they are from.
        rivals_found: What could be taken for the effects of the first of them.
        fitter: Of the episodes.
        threads: For the simulations; None: one per core.
    """
    named = [r for r in ranked if r.effects != ("unknown",)]
    lead, near = named[0], [r for r in rivals_found if r.confounded]
    one = {n for e in lead.equivalent for n in e}
    names = set(lead.effects) | one | {r.rival for r in near}
    if advice := _advice(names, fitter.system.vocabulary):
        return advice
    first = contender_of(found, lead, fitter.context).fit
    if len(named) > 1 and named[1].probability > SETTINGS.probability.noteworthy:
        second = contender_of(found, named[1], fitter.context)
        covariance, rival = second.evidence.covariance, second.fit
    else:
        # what is one with it no experiment of this kind tells from it
        instead = next((r.instead for r in near if r.instead is not None and r.rival not in one), None)
        if instead is None:
            return None
        covariance, rival = np.linalg.pinv(instead.information(), hermitian=True), instead
    push = best_experiment(
        fitter.system,
        fitter.measured,
        (first.explanation, first.x),
        (rival.explanation, rival.x),
        covariance,
        threads=threads,
    )
    told = " from ".join(" and ".join(map(spoken, f.explanation.names or ("none",))) for f in (first, rival))
    if push is None or push.log_odds < 1.0:
        system = fitter.system
        return f"No {system.experiment} within {system.reach} would tell {told}; {system.reach_further}."
    sure = push.log_odds > PLENTY
    odds = f"more than {math.exp(PLENTY):.0f}" if sure else f"about {number(math.exp(push.log_odds), 2)}"
    next_one = f"Next {fitter.system.experiment}: {push.sentence[0].lower()}{push.sentence[1:]}"
    return f"{next_one} One such is expected to tell {told}, at odds of {odds} to 1."


def _advice(names: set[str], vocabulary: Vocabulary) -> str | None:
    """Return what would tell apart two of these effects that no recording like this one can."""
    of_kind = {name.partition("[")[0]: name for name in sorted(names, reverse=True)}
    for candidate in vocabulary:
        for other in candidate.effect.confounded:
            if {candidate.effect.name, other.name} <= set(of_kind):
                pair = f"{spoken(of_kind[candidate.effect.name])} from {spoken(of_kind[other.name])}"
                return f"To tell {pair}: {other.advice[0].lower()}{other.advice[1:]}"
    return None
