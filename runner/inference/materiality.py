"""Causes and small deviations: an explanation is told without what moves nothing by as much as the noise.

A long recording by good sensors tells a limit that is off by one per cent, or a torque that reads one per cent high,
from one that isn't. Such errors are in every model, beside whatever causes the gap. Where an explanation holds
effects that move no channel by the noise, and what is left without them is no more than the small errors of a model
leave, the explanation without them stands for both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from runner.effects.vocabulary import Candidate
from runner.inference.contender import Contender, likeliest_first
from runner.inference.least_squares import Fit, Fitter
from runner.inference.probability import allowed_excess
from runner.inference.warm_start import key_of
from runner.settings import SETTINGS
from runner.systems.simulator import Run


def influence(fit: Fit, fitter: Fitter) -> dict[Candidate, float]:
    """Return how far each effect of an explanation moves the prediction, everything else as it is.

    In noises, root mean square over the fitted episodes in the channel that it moves most.
    """
    context, explanation, channels = fitter.context, fit.explanation, len(fitter.system.channels)
    whole = explanation.make(fit.x, context)
    fewer = [explanation.without(c).make(np.delete(fit.x, part), context) for c, part in explanation.parts(context)]
    squares, count = np.zeros((len(fewer), channels)), np.zeros(channels)
    each = zip(fit.episodes, fit.starts, strict=True)
    every = fitter.whitened([(e, [Run(effects, start) for effects in (whole, *fewer)]) for e, start in each])
    for e, rows in zip(fit.episodes, every, strict=True):
        moved = (rows[1:] - rows[0]).reshape(len(fewer), -1, channels)
        squares += np.nan_to_num(moved**2).sum(axis=1)
        count += fitter.measured.counted(e).sum(axis=0)
    largest = np.sqrt(squares / np.maximum(count, 1)).max(axis=1)
    return dict(zip(explanation.candidates, largest.tolist(), strict=True))


def causes_of(contenders: Sequence[Contender], fitter: Fitter, gap: float) -> list[Contender]:
    """Return contenders, likeliest first, those of them that stand for others with the odds of both.

    Args:
        contenders: With finite odds, likeliest first.
        fitter: Of their fits.
        gap: What the nominal model leaves of them, in squared noises.
    """
    known = {key_of(c.fit.explanation): c for c in contenders}
    for contender in contenders:
        if contender.log_posterior < contenders[0].log_posterior - SETTINGS.odds.told_log_odds:
            break
        taken, given = contender, known.pop(key_of(contender.fit.explanation))
        while (fewer := _without_least(taken, known, fitter, gap)) is not None:
            taken = fewer
        key = key_of(taken.fit.explanation)
        if taken is contender:
            known[key] = given
        else:
            t = SETTINGS.probability.temperature
            together = t * np.logaddexp(taken.log_posterior / t, given.log_posterior / t)
            known[key] = replace(taken, log_posterior=float(together))
    return likeliest_first(known.values())


def _without_least(
    contender: Contender, known: dict[tuple[Candidate, ...], Contender], fitter: Fitter, gap: float
) -> Contender | None:
    """Return what stands for a contender of several effects without the one that moves least; None: nothing does."""
    if len(contender.fit.explanation.candidates) < 2:
        return None
    moved = influence(contender.fit, fitter)
    least = min(moved, key=lambda c: moved[c])
    fewer = known.get(key_of(contender.fit.explanation.without(least)))
    if moved[least] >= SETTINGS.odds.visible_noises or fewer is None:
        return None
    left = fitter.measured.excess(fewer.evidence.loss, fewer.fit.episodes)
    return fewer if left < allowed_excess(gap, fitter.system.unknown_share) else None
