"""Forward selection: what is fitted next, explanations of the beam with one more effect in them.

Around the fits so far every further effect promises a gain (a linear model, one batch of simulations). The promising
ones are fitted; a fit that falls hopelessly behind is not finished.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from runner.effects.vocabulary import Candidate
from runner.inference.contender import Contender, Offer, are_confounded, offers
from runner.inference.evidence import joined
from runner.inference.leap import leap
from runner.inference.least_squares import Explanation, Fit
from runner.inference.rounds import Rounds
from runner.inference.shortlist import gain, with_fit
from runner.inference.start_draws import tried_from_the_air
from runner.inference.warm_start import key_of, over_edges, where_to_begin
from runner.settings import SETTINGS


def fits_of(rounds: Rounds, size: int, beam: Sequence[Contender]) -> list[Fit]:
    """Fit explanations of so many effects: those of the beam with one more, and those that an earlier look left."""
    fits: list[Fit] = []
    target = min(rounds.least_foreseen, rounds.least_reached if size > 1 else np.inf)
    for contender in beam:
        for _, candidate, vector in _worth_a_fit(rounds, contender, size):
            fit = _with_one_more(rounds, contender, candidate, vector, size, target)
            if fit is not None and (size == 1 or gain(fit, rounds.contenders) > rounds.worth):
                if size == 1 and fit.total < min((f.total for f in fits), default=contender.fit.total):
                    rounds.tell(rounds.worthy(fit, rounds.alone))  # all single fits may take minutes
                fits = with_fit(fits, fit)
                target = min(target, _mark(rounds, fit))
    for key in [k for k in rounds.seeds if len(k) == size]:
        seed = rounds.seeds.pop(key)
        rounds.answered.discard(key)
        rounds.seen.add(key)
        begin = where_to_begin(rounds.fitter, seed.explanation, seed.x, rounds.nominal, seed)
        steps, patience = SETTINGS.fit.warm_steps, SETTINGS.fit.patience_steps
        how = {"target": target, "patience": patience, "iterations": steps, "polish": False}
        fit = rounds.fitter.fit(seed.explanation, rounds.episodes, **begin, **how)
        if size == 1 or gain(fit, rounds.contenders) > rounds.worth:
            fits = with_fit(fits, fit)
            target = min(target, _mark(rounds, fit))
    return fits


def _mark(rounds: Rounds, fit: Fit) -> float:
    """Return what a fit leaves for others to come near to."""
    return fit.total if rounds.is_possible(fit) else np.inf


def next_beam(rounds: Rounds, new: Sequence[Contender]) -> list[Contender]:
    """Return what is worth adding to, of contenders of one size, likeliest first."""
    beam: list[Contender] = []
    left = rounds.least_foreseen - rounds.count
    limits = SETTINGS.search
    for contender in new:
        if contender.fit.total - rounds.count > limits.leap_lead_ratio * max(left, rounds.worth):
            continue  # a set of more effects is so far ahead that one more beside this will not reach it
        settled = max(limits.settled_share * (rounds.nominal.total - rounds.count), rounds.worth)
        if beam and beam[0].fit.total - rounds.count < settled:
            break
        near = contender.log_posterior > new[0].log_posterior - limits.expansion_log_odds
        if near and len(beam) < limits.beam_width and not any(are_confounded(contender.fit, b.fit) for b in beam):
            beam.append(contender)
    return beam


def leap_ahead(rounds: Rounds) -> None:
    """Go on with what the linear model proposes at once, from the effect or the seed that leaves least."""
    begin = min((c.fit for c in rounds.contenders if rounds.is_possible(c)), key=lambda f: f.total)
    if rounds.least_foreseen < begin.total:
        seed = min(filter(rounds.is_possible, rounds.seeds.values()), key=lambda s: s.total)
        steps = SETTINGS.fit.warm_steps
        fit = rounds.fitter.fit(
            seed.explanation, rounds.episodes, x=seed.x, starts=seed.starts, iterations=steps, polish=False
        )
        if rounds.is_possible(fit):
            rounds.keep_seed(fit)
            begin = fit
    fit, rounds.last = leap(rounds.fitter, begin, rounds.every, rounds.around(begin), rounds.worth_beside)
    if fit is not begin:
        rounds.keep_seed(fit)


def _worth_a_fit(rounds: Rounds, contender: Contender, size: int) -> list[Offer]:
    """Return the effects that are tried beside those of a contender, most promising first."""
    left, limits = contender.fit.total - rounds.count, SETTINGS.search
    if size > 1 and left < rounds.worth:
        return []  # nothing is left that would be worth an effect
    promised = _offers(rounds, contender, size)
    if size == 1 and rounds.pieces:
        return _likely(rounds, promised)
    if size == 1 and rounds.hits:
        return promised  # an amount that was tried with starts of something else promises too little
    if size == 1:
        foreseen = rounds.least_foreseen - rounds.count
        if foreseen < limits.settled_share * left:
            return promised[: limits.most_promising]  # an earlier look has found where to begin
        every = left >= limits.near_excess * rounds.count
        ahead = limits.lead_ratio * max(foreseen, rounds.worth) < left
        if ahead or every:
            return _likely(rounds, promised)
        few, enough = limits.most_promising, limits.min_promise_share * rounds.worth
        return [o for i, o in enumerate(promised) if i < few or o[0] > enough]
    reached = min(rounds.least_foreseen, rounds.least_reached) - rounds.count
    behind = left - limits.leap_lead_ratio * max(reached, rounds.worth)
    enough = max(limits.min_promise_share * rounds.worth, behind)
    return [o for o in promised[: limits.most_promising] if o[0] > enough]


def _offers(rounds: Rounds, contender: Contender, size: int) -> list[Offer]:
    """Return the effects that may stand beside those of a contender, most promising first.

    What hits something keeps no linear promise: there an amount of each that is open is tried.
    """
    promised = offers(contender, rounds.fitter)
    if not rounds.hits:
        return promised
    promised = [o for o in promised if _is_open(rounds, contender, o[1], size)]
    begun = tried_from_the_air(rounds.fitter, contender.fit, promised)
    for start in begun:
        rounds.tried[key_of(start.explanation)] = start
    gains = [contender.fit.total - start.total for start in begun]
    found = [(gain, c, vector) for gain, (_, c, vector) in zip(gains, promised, strict=True)]
    return sorted(found, key=lambda o: -o[0])


def _likely(rounds: Rounds, promised: list[Offer]) -> list[Offer]:
    """Return the most promising, and of those whose promise says little."""
    jumps = [o for o in promised if o[1].effect.discontinuous or o[1].is_placed(rounds.fitter.context)]
    nonlinear = {o[1] for o in jumps[: SETTINGS.search.nonlinear_candidates]}
    few, near = SETTINGS.search.candidates, SETTINGS.search.comparable_promise
    return [o for i, o in enumerate(promised) if i < few or o[1] in nonlinear or o[0] > near * promised[0][0]]


def _with_one_more(
    rounds: Rounds, contender: Contender, candidate: Candidate, vector: np.ndarray, size: int, target: float
) -> Fit | None:
    """Fit a contender's effects and one more; None: that has been tried."""
    if not _is_open(rounds, contender, candidate, size):
        return None
    explanation, x = joined(contender.fit, candidate, vector)
    key = key_of(explanation)
    rounds.seen.add(key)
    rounds.answered.discard(key)
    steps = SETTINGS.fit.screening_steps if size == 1 or rounds.pieces else SETTINGS.fit.warm_steps
    patience = _patience(rounds, size, candidate)
    how: dict[str, Any] = {"target": target, "patience": patience, "iterations": steps, "polish": False}
    seed = min(
        (s for s in (rounds.seeds.pop(key, None), rounds.tried.pop(key, None)) if s),
        key=lambda s: s.total,
        default=None,
    )
    begin = where_to_begin(rounds.fitter, explanation, x, contender.fit, seed)
    fit = rounds.fitter.fit(explanation, rounds.episodes, **(how | begin))
    if candidate.effect.discontinuous and rounds.is_far(fit):
        fit = over_edges(rounds.fitter, fit, contender.fit)
    return fit


def _is_open(rounds: Rounds, contender: Contender, candidate: Candidate, size: int) -> bool:
    """Whether an effect beside those of a contender is still to be tried.

    What has a place may have missed it without what is in now.
    """
    key = key_of(contender.fit.explanation + Explanation((candidate,)))
    anew = size > 1 and rounds.is_far(contender.fit) and candidate.is_placed(rounds.fitter.context)
    return key not in rounds.ruled_out and (key not in rounds.seen or anew)


def _patience(rounds: Rounds, size: int, candidate: Candidate) -> int:
    """Return after how many steps a fit is judged by whether it will come near the best one.

    What begins at a place or a range of its own has some way to go before it can be judged; a delay, too, where a
    leap has set the mark and the model is far from it.
    """
    at_once = rounds.pieces or (size == 1 and not candidate.is_placed(rounds.fitter.context))
    return 1 if at_once else SETTINGS.fit.patience_steps
