"""From weighed explanations to probabilities: `none` and `unknown` too, what can't be told apart taken together."""

from __future__ import annotations

from collections.abc import Container, Iterable, Sequence
from dataclasses import replace

import numpy as np
from scipy.special import expit, softmax

from runner.diagnosis.result import Ranked
from runner.effects.base import Scope
from runner.inference.confounding import Rival, are_one
from runner.inference.contender import Contender, are_confounded
from runner.inference.evidence import by_data
from runner.inference.held_out import Confirmed
from runner.inference.least_squares import Fit, Fitter
from runner.inference.outside import is_outside
from runner.inference.probability import as_unknown, error_of_excess, shares, unknown_by_excess
from runner.inference.search import Search
from runner.settings import SETTINGS
from runner.systems.base import AbstractSystem


def ranking(confirmed: Confirmed, nominal_excess: float, fitter: Fitter) -> tuple[Ranked, ...]:
    """Return the explanations with their probabilities, `unknown` among them, likeliest first.

    Args:
        confirmed: The search, held against the episodes left out.
        nominal_excess: What the nominal model leaves of the fitted episodes, in squared noises.
        fitter: Of the episodes, or stretches, that were searched.
    """
    found = confirmed.search
    unknown = max(unknown_by_episodes(confirmed, nominal_excess, fitter))
    if found.best.fit.x.size and confirmed.fails:
        unknown = max(unknown, SETTINGS.probability.failed_unknown)
    known = (1.0 - unknown) * (1.0 - strained(found.best, found.nominal, fitter, confirmed.by_drive.excess))
    # each effect beside the first may be the doing of something without a name, too
    further = max(len(found.best.fit.explanation.candidates) - 1, 0)
    known *= SETTINGS.probability.max_unknown**further
    return rank(found, fitter.system, as_unknown(1.0 - known), confirmed.after)


def rank(found: Search, system: AbstractSystem, unknown: float, weighed: Container[int]) -> tuple[Ranked, ...]:
    """Turn log posteriors into probabilities, explanations that can't be told apart taken together.

    Args:
        found: All of them.
        system: What was recorded.
        unknown: Probability that it is none of them.
        weighed: The identity of the fit of each that was held against all episodes: of the others it is only known that
            they are no better than the last of those.
    """
    context = system.context
    contenders = [c for c in found.contenders if np.isfinite(c.log_posterior)]
    every = shares(contenders)
    nameless = np.array([is_outside(c, system.vocabulary) for c in contenders])
    known = float(every[~nameless].sum())
    unknown = min(1.0 - (1.0 - unknown) * known, SETTINGS.probability.max_unknown)
    contenders = [c for c in contenders if not is_outside(c, system.vocabulary)]
    share = shares(contenders)

    def alike(a: Fit, b: Fit) -> bool:
        return bool(a.x.size and b.x.size) and (are_confounded(a, b) or are_one(a, b, context))

    groups: list[list[int]] = []
    for i, contender in enumerate(contenders):
        same = [g for g in groups if alike(contenders[g[0]].fit, contender.fit)]
        if same:
            same[0].append(i)
        else:
            groups.append([i])
    out = []
    for group in groups:
        equal = SETTINGS.probability.equal_share * share[group].max()
        # among equals the first name in the vocabulary's order of commonness stands for the rest
        lead = min(group, key=lambda i: (share[i] < equal, _commonness(contenders[i].fit)))
        contender = contenders[lead]
        names = contender.fit.explanation.names or ("none",)
        others: dict[tuple[str, ...], Contender] = {}
        for i in (i for i in group if share[i] > equal):
            others.setdefault(contenders[i].fit.explanation.names or ("none",), contenders[i])
        others.pop(names, None)
        parameters, errors = values_of(contender, context)
        out.append(
            Ranked(
                names,
                tuple(others),
                float(share[group].sum() * (1 - unknown)),
                contender.fit.explanation.make(contender.fit.x, context),
                parameters,
                errors,
                None if contender.fit.x.size else 0.0,
                float(contender.log_posterior - contenders[0].log_posterior) if id(contender.fit) in weighed else None,
                {other: values_of(c, context) for other, c in others.items()},
            )
        )
    # variants of one effect are one explanation to the reader
    merged: dict[tuple[str, ...], Ranked] = {}
    for r in sorted(out, key=lambda r: -r.probability):
        if r.effects in merged:
            first = merged[r.effects]
            merged[r.effects] = replace(first, probability=first.probability + r.probability)
        else:
            merged[r.effects] = r
    merged[("unknown",)] = Ranked(("unknown",), (), unknown, (), {}, {}, None, None)
    return tuple(sorted(merged.values(), key=lambda r: -r.probability))


def with_equals(
    ranked: Sequence[Ranked], top: Contender, rivals: Iterable[Rival], context: Scope
) -> tuple[Ranked, ...]:
    """Return a ranking in which an explanation stands for what is one with it, whether a search has come across or not.

    Args:
        ranked: Likeliest first.
        top: The contender that rivals are of.
        rivals: What could be taken for its effects.
        context: What candidates are told when they describe themselves.
    """
    names = top.fit.explanation.names
    tried = [r.instead for r in rivals if r.one and r.instead is not None]
    # of one name the trial that leaves least, which is put last
    equal = {fit.explanation.names: fit for fit in sorted(tried, key=lambda fit: -fit.total)}
    equal.pop(names, None)
    place = next((k for k, r in enumerate(ranked) if r.effects == names), None)
    if not equal or place is None:
        return tuple(ranked)
    own, others = ranked[place], [r for k, r in enumerate(ranked) if k != place]
    share = sum((r.probability for r in others if r.effects in equal), own.probability)
    equivalent = tuple(dict.fromkeys((*own.equivalent, *sorted(equal))))
    numbers = {e: (_reported(fit, context), {}) for e, fit in equal.items()}
    numbers |= {r.effects: (r.parameters, r.errors) for r in others if r.effects in equal}
    numbers |= own.equal_numbers
    whole = replace(own, equivalent=equivalent, probability=share, equal_numbers=numbers)
    return tuple(sorted((whole, *(r for r in others if r.effects not in equal)), key=lambda r: -r.probability))


def _reported(fit: Fit, context: Scope) -> dict[str, dict[str, float]]:
    """Return the physical values of a fit by effect."""
    parts = fit.explanation.parts(context)
    return {candidate.name: dict(candidate.make(fit.x[part], context)[0].report()) for candidate, part in parts}


def _commonness(fit: Fit) -> tuple[int, ...]:
    commonness = {c.name: c.effect.commonness for c in fit.explanation.candidates}
    return tuple(commonness[name] for name in fit.explanation.names)


def unknown_by_episodes(confirmed: Confirmed, nominal_excess: float, fitter: Fitter) -> tuple[float, float]:
    """Return `unknown_by_excess` of the fitted episodes and of those left out.

    A machine may have been driven so much harder in those left out that the gap is many times as large there: what an
    explanation leaves of them is then held against that. Where nothing is claimed, nothing may leave a share of a gap.
    """
    claimed = confirmed.search.best.fit.x.size > 0
    here, there = (nominal_excess, max(nominal_excess, confirmed.gap_unseen)) if claimed else (0.0, 0.0)
    share, count = fitter.system.unknown_share, fitter.measured.count
    fitted = count(confirmed.search.nominal.episodes)
    unseen = count(e for e in confirmed.before.episodes if e not in confirmed.astray)
    drive = confirmed.by_drive

    def told(excess: float, gap: float, error: float) -> float:
        return unknown_by_excess(excess - drive.excess, gap, share, float(np.hypot(drive.error, error)))

    return (
        told(confirmed.excess_fitted, here, error_of_excess(fitted)),
        told(confirmed.excess_unseen, there, error_of_excess(unseen, fitted)),
    )


def strained(best: Contender, nominal: Fit, fitter: Fitter, by_drive: float = 0.0) -> float:
    """Probability that none of the explanations holds, from how far the simulator must be off for the best to do so.

    Mismatch of many times the usual size can make up for a wrong explanation, or for the want of one, and leave no
    excess. So where the evidence asks for that much, and the explanation alone leaves more of the gap than effects of
    the vocabulary do, something else is going on. What the noise of a measured drive makes, `by_drive`, is known.
    """
    levels, limits = fitter.system.mismatch_levels, SETTINGS.probability
    totals = best.evidence.left, nominal.total
    left, gap = (max(fitter.measured.excess(t, nominal.episodes) - by_drive, 1e-4) for t in totals)
    asked = float(softmax(best.evidence.level) @ np.log2(levels))
    allowed = limits.strained_excess + fitter.system.unknown_share * gap
    far = expit((asked - limits.strained_log2_level) / limits.strained_width)
    return float(far * expit(np.log(left / allowed) / limits.strained_log_width))


def values_of(contender: Contender, context: Scope) -> tuple[dict[str, dict[str, float]], dict[str, dict[str, float]]]:
    """Return parameters and their standard errors by effect, in physical units (the delta method).

    A number that the data hardly tell, such as how far a centre of mass is off along the axis that its body turns
    about, is as uncertain as its prior: as data scatter, it would not move, and would seem to be known.
    """
    x, of = contender.fit.x, contender.evidence
    data = by_data(of, contender.fit, context)
    parameters, errors = {}, {}
    for candidate, part in contender.fit.explanation.parts(context):
        value = candidate.make(x[part], context)[0].report()
        slopes = []
        for step in np.diag([1e-4 * p.scale for p in candidate.parameters(context)]):
            moved = candidate.make(x[part] + step, context)[0].report()
            slopes.append([_turn(name, moved[name] - value[name]) / step.sum() for name in value])
        slope = np.array(slopes).T
        charged, prior = (np.diag(slope @ c[part, part] @ slope.T) for c in (data, of.by_prior))
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
