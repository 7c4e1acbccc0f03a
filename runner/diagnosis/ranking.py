"""From weighed explanations to probabilities: `none` and `unknown` too, what can't be told apart taken together."""

from __future__ import annotations

import numpy as np
from scipy.special import expit, softmax

from runner.diagnosis.result import Ranked
from runner.effects.base import Scope
from runner.inference.contender import Contender, are_confounded
from runner.inference.held_out import Confirmed
from runner.inference.least_squares import Fit, Fitter
from runner.inference.outside import is_outside
from runner.inference.probability import LEAST_UNKNOWN, MOST_UNKNOWN, not_none, shares, unknown_by_excess
from runner.inference.search import Search
from runner.systems.base import AbstractSystem

# see `strained`: level of mismatch (base 2 log), from which on, how sharply; what is left, of the noise and of the gap
STRAINED, STRAINED_WIDTH = 2.5, 0.25
STRAINED_LEFT, STRAINED_SHARE, STRAINED_LEFT_WIDTH = 0.05, 0.02, 0.3
FAILED = 0.7  # where the best explanation does not close half of a plain gap in episodes it has not seen
EQUAL = 0.05  # of the likeliest of a group: what is less likely is not its equal
# By the plain theory 97 % of 235 planted values of two sets lay within 1.96 standard errors and half within 0.2 of
# one: the mismatch is charged in full to every parameter. With so much of it, 95 % do.
CHARGED = 0.8


def ranking(confirmed: Confirmed, nominal_excess: float, fitter: Fitter) -> tuple[Ranked, ...]:
    """Return the explanations with their probabilities, `unknown` among them, likeliest first.

    Args:
        confirmed: The search, held against the episodes left out.
        nominal_excess: What the nominal model leaves of the fitted episodes, in squared noises.
        fitter: Of the episodes, or stretches, that were searched.
    """
    found = confirmed.search
    if found.best.fit.x.size:
        unknown = max(
            *unknown_by_episodes(confirmed, nominal_excess, fitter.system), FAILED if confirmed.fails else 0.0
        )
    else:
        unknown = not_none(confirmed.gap)
    known = (1.0 - unknown) * (1.0 - strained(found.best, found.nominal, fitter))
    return rank(found, fitter.system, float(np.clip(1.0 - known, LEAST_UNKNOWN, MOST_UNKNOWN)))


def rank(found: Search, system: AbstractSystem, unknown: float) -> tuple[Ranked, ...]:
    """Turn log posteriors into probabilities, explanations that can't be told apart taken together."""
    context = system.context
    contenders = [c for c in found.contenders if np.isfinite(c.log_posterior)]
    every = shares(contenders)
    nameless = np.array([is_outside(c, system.vocabulary) for c in contenders])
    known = float(every[~nameless].sum())
    unknown = min(1.0 - (1.0 - unknown) * known, MOST_UNKNOWN)
    contenders = [c for c in contenders if not is_outside(c, system.vocabulary)]
    share = shares(contenders)
    groups: list[list[int]] = []
    for i, contender in enumerate(contenders):
        same = [g for g in groups if contender.fit.x.size and are_confounded(contenders[g[0]].fit, contender.fit)]
        if same:
            same[0].append(i)
        else:
            groups.append([i])
    out = []
    for group in groups:
        # among equals the first name in the vocabulary's order of commonness stands for the rest
        lead = min(group, key=lambda i: (share[i] < EQUAL * share[group].max(), _commonness(contenders[i].fit)))
        contender = contenders[lead]
        names = contender.fit.explanation.names or ("none",)
        others = tuple(
            dict.fromkeys(
                n
                for i in group
                if (n := contenders[i].fit.explanation.names or ("none",)) != names
                and share[i] > EQUAL * share[group].max()
            )
        )
        parameters, errors = values_of(contender, context)
        out.append(
            Ranked(
                names,
                others,
                float(share[group].sum() * (1 - unknown)),
                contender.fit.explanation.make(contender.fit.x, context),
                parameters,
                errors,
                None if contender.fit.x.size else 0.0,
                float(contender.log_posterior - contenders[0].log_posterior),
            )
        )
    # variants of one effect are one explanation to the reader
    merged: dict[tuple[str, ...], Ranked] = {}
    for r in sorted(out, key=lambda r: -r.probability):
        if r.effects in merged:
            first = merged[r.effects]
            merged[r.effects] = Ranked(**{**vars(first), "probability": first.probability + r.probability})
        else:
            merged[r.effects] = r
    merged[("unknown",)] = Ranked(("unknown",), (), unknown, (), {}, {}, None, None)
    return tuple(sorted(merged.values(), key=lambda r: -r.probability))


def _commonness(fit: Fit) -> tuple[int, ...]:
    commonness = {c.name: c.effect.commonness for c in fit.explanation.candidates}
    return tuple(commonness[name] for name in fit.explanation.names)


def unknown_by_episodes(confirmed: Confirmed, nominal_excess: float, system: AbstractSystem) -> tuple[float, float]:
    """Return `unknown_by_excess` of the fitted episodes and of those left out.

    A machine may have been driven so much harder in those left out that the gap is many times as large there: what an
    explanation leaves of them is then held against that.
    """
    there = max(nominal_excess, confirmed.gap_unseen)
    return (
        unknown_by_excess(confirmed.excess_fitted, nominal_excess, system.unknown_share),
        unknown_by_excess(confirmed.excess_unseen, there, system.unknown_share),
    )


def strained(best: Contender, nominal: Fit, fitter: Fitter) -> float:
    """Probability that none of the explanations holds, from how far the simulator must be off for the best to do so.

    Mismatch of many times the usual size can make up for a wrong explanation, and leave no excess. So where the
    evidence asks for that much, and the explanation alone leaves more of the gap than effects of the vocabulary do,
    something else is going on.
    """
    if not best.fit.x.size:
        return 0.0  # nothing is claimed
    levels = fitter.system.mismatch_levels
    left, gap = (max(fitter.measured.excess(f.total, f.episodes), 1e-4) for f in (best.fit, nominal))
    asked = float(softmax(best.evidence.level) @ np.log2(levels))
    allowed = STRAINED_LEFT + max(STRAINED_SHARE, fitter.system.unknown_share) * gap
    return float(expit((asked - STRAINED) / STRAINED_WIDTH) * expit(np.log(left / allowed) / STRAINED_LEFT_WIDTH))


def values_of(contender: Contender, context: Scope) -> tuple[dict[str, dict[str, float]], dict[str, dict[str, float]]]:
    """Return parameters and their standard errors by effect, in physical units (the delta method).

    A number that the data hardly tell, such as how far a centre of mass is off along the axis that its body turns
    about, is as uncertain as its prior: as data scatter, it would not move, and would seem to be known.
    """
    x, of = contender.fit.x, contender.evidence
    parameters, errors = {}, {}
    for candidate, part in contender.fit.explanation.parts(context):
        value = candidate.make(x[part], context)[0].report()
        slopes = []
        for step in np.diag([1e-4 * p.scale for p in candidate.parameters(context)]):
            moved = candidate.make(x[part] + step, context)[0].report()
            slopes.append([_turn(name, moved[name] - value[name]) / step.sum() for name in value])
        slope = np.array(slopes).T
        charged, prior = (np.diag(slope @ c[part, part] @ slope.T) for c in (CHARGED**2 * of.covariance, of.by_prior))
        parameters[candidate.name] = dict(value)
        stated = np.sqrt(np.maximum(np.maximum(charged, prior), 0.0))
        errors[candidate.name] = dict(zip(value, stated.tolist(), strict=True))
    return parameters, errors


def _turn(name: str, difference: float) -> float:
    """An angle's change, taken the short way round."""
    return float((difference + np.pi) % (2 * np.pi) - np.pi) if name.endswith("_rad") else difference


def contender_of(found: Search, ranked: Ranked, context: Scope) -> Contender:
    """Return the contender that an entry of the ranking speaks of."""
    finite = (c for c in found.contenders if np.isfinite(c.log_posterior))
    return next(c for c in finite if c.fit.explanation.make(c.fit.x, context) == ranked.values)
