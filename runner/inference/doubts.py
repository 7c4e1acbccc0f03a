"""What speaks against an explanation beside its evidence: how far its effects, or a gap, stand out of small errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from runner.effects.base import Scope
from runner.effects.vocabulary import Candidate
from runner.inference.contender import Contender
from runner.inference.least_squares import Fit, Fitter, amplitudes
from runner.settings import SETTINGS


def doubted(contenders: Sequence[Contender], context: Scope, gap: float, count: int) -> list[Contender]:
    """Return contenders with the odds against effects that do not stand out of their own errors.

    The evidence asks whether an effect's pattern is in the residual; the plain errors, the simulator's own mismatch
    included, how far it is from not being there at all. Effects that make up for another's wrong form fail that.
    Whether there is one effect at all is asked of the likeliest: which it is, the evidence tells. A plain gap has a
    cause, however many small errors could do the same: neither where one effect closes it, nor of one of several
    without which one is left, is that asked.

    Args:
        contenders: All of them.
        context: What candidates are told.
        gap: What the nominal model leaves of what was fitted, see `Evidence.left`, in squared noises.
        count: How many measurements were.
    """
    limits, common = SETTINGS.odds, 0.0
    alone = [c for c in contenders if len(c.fit.explanation.candidates) == 1]
    if alone and gap <= limits.visible_gap_excess:
        common = unsure(max(alone, key=lambda c: c.log_posterior), contenders, context, limits.min_errors_alone)
    out = []
    for c in contenders:
        single = len(c.fit.explanation.candidates) == 1
        enough = limits.min_errors_beside_others
        against = common if single else unsure(c, contenders, context, enough, needed(c, contenders, count))
        out.append(replace(c, log_posterior=c.log_posterior - against - faint(c, context)))
    return out


def needed(contender: Contender, contenders: Sequence[Contender], count: int) -> frozenset[Candidate]:
    """Return the effects of an explanation without which the best of the others leaves a plain gap that it closes.

    Plain beside the noise, and many times what the explanation itself leaves: where the form of an effect is wrong,
    another takes up some of that.
    """
    whole, out = contender.fit.explanation.candidates, []
    limits = SETTINGS.odds
    plain = max(limits.visible_gap_excess * count, limits.form_error_ratio * (contender.evidence.left - count))
    for candidate in whole:
        if taken_off(contender, candidate, contenders) > plain:
            out.append(candidate)
    return frozenset(out)


def taken_off(contender: Contender, candidate: Candidate, contenders: Sequence[Contender]) -> float:
    """Return how much less loss an explanation leaves than the best of the others without one of its effects."""
    rest = {c for c in contender.fit.explanation.candidates if c != candidate}
    fewer = [c.evidence.left for c in contenders if rest.issuperset(c.fit.explanation.candidates)]
    return min(fewer, default=-np.inf) - contender.evidence.left


def unsure_effects(contender: Contender, others: Sequence[Contender], context: Scope) -> tuple[str, ...]:
    """Return which effects of an explanation do not stand out of their own errors."""
    parts, enough = contender.fit.explanation.parts(context), SETTINGS.odds.min_errors_beside_others
    return tuple(c.name for c, whole in parts if errors_off(contender, c, whole, context, others) < enough)


def unsure(
    contender: Contender,
    contenders: Sequence[Contender],
    context: Scope,
    enough: float,
    beyond_doubt: frozenset[Candidate] = frozenset(),
) -> float:
    """Return the log odds against effects that are no `enough` standard errors away from not being there."""
    parts = [(c, whole) for c, whole in contender.fit.explanation.parts(context) if c not in beyond_doubt]
    lacks = (1.0 - errors_off(contender, c, whole, context, contenders) / enough for c, whole in parts)
    return sum((SETTINGS.odds.rejection_log_odds * max(lack, 0.0) for lack in lacks), 0.0)


def errors_off(
    contender: Contender, candidate: Candidate, whole: slice, context: Scope, contenders: Sequence[Contender]
) -> float:
    """Return how many of its standard errors an effect of an explanation is away from not being there.

    A switch has no derivative, and so no standard error: there it is the root of the likelihood ratio (Wilks 1938).
    """
    if candidate.effect.switch:
        return float(np.sqrt(max(taken_off(contender, candidate, contenders), 0.0) / contender.evidence.dispersion))
    x, covariance, part = contender.fit.x, contender.evidence.covariance, amplitudes(candidate, whole, context)
    return float(np.sqrt(x[part] @ np.linalg.pinv(covariance[part, part], hermitian=True) @ x[part]))


def faint(contender: Contender, context: Scope) -> float:
    """Return the log odds against effects that are nothing beside the unevenness of any surface."""
    found = 0.0
    for candidate, whole in contender.fit.explanation.parts(context):
        limit = candidate.effect.detection_limit
        if limit > 0:
            lack = 1.0 - abs(float(contender.fit.x[whole.start])) / limit
            found += SETTINGS.odds.rejection_log_odds * max(lack, 0.0)
    return found


def odds_against_none(excess: float) -> float:
    """Return the log odds against `none` from what the nominal model leaves of all episodes, in squared noises."""
    limits = SETTINGS.odds
    visible = limits.visible_gap_excess
    beyond = max(excess / visible - 1.0, 0.0)  # so that value and slope go on where the logarithm ends
    e_folds = float(np.log(min(max(excess, 0.01), visible) / limits.even_gap_excess))
    return limits.log_odds_per_efold * (e_folds + beyond)


def further(there: Fit, before: Fit, fitter: Fitter, gap: float) -> float:
    """Return the log odds against an effect from what it, and what the nominal model, leaves of unseen episodes.

    `gap` is what the nominal model leaves of all of them, in squared noises.
    """
    if gap > SETTINGS.odds.visible_gap_excess:
        return 0.0
    more = (there.total - before.total) / fitter.measured.count(before.episodes)
    return float(np.clip(SETTINGS.odds.worse_log_odds * more, 0.0, SETTINGS.odds.max_worse_log_odds))
