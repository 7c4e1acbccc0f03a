"""Search for the explanation: none, one effect, or several by forward selection with a beam.

Each round fits explanations of one effect more (`runner.inference.forward_selection`) and compares them by evidence;
then effects are taken out again, or exchanged for others. A search may begin where an earlier look ended (see
`runner.inference.multiple_shooting`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from runner.effects.vocabulary import Vocabulary
from runner.inference.contender import Contender, contend, leading, likeliest_first
from runner.inference.evidence import Sensitivities, sensitivities
from runner.inference.exchange import one_for_another, one_for_two, other_variants
from runner.inference.forward_selection import fits_of, leap_ahead, next_beam
from runner.inference.least_squares import Fit, Fitter
from runner.inference.rounds import Rounds
from runner.inference.shortlist import finished, without_one
from runner.inference.start_draws import begun_elsewhere
from runner.inference.untold import without_untold
from runner.inference.warm_start import Beginning, Key, WarmStart, key_of
from runner.settings import SETTINGS


@dataclass(frozen=True)
class Search:
    """All contenders, likeliest first, and the fit of the nominal model."""

    contenders: tuple[Contender, ...]
    nominal: Fit

    @property
    def best(self) -> Contender:
        """The likeliest."""
        return self.contenders[0]


def search(
    fitter: Fitter,
    episodes: Sequence[int],
    *,
    most: int | None = None,
    starts: np.ndarray | None = None,
    beginning: Beginning | None = None,
    pieces: bool = False,
) -> Search:
    """Fit and compare explanations of up to `most` effects on these episodes; None: as many as the system may have.

    `starts` are start states to begin with, (E, S). `pieces` says that they are pieces of episodes: short, so that few
    steps will do.
    """
    rounds = Rounds.begun(fitter, episodes, starts, beginning or Beginning(), pieces=pieces)
    beam = list(rounds.contenders)
    rounds.tell()
    most = fitter.system.most_effects if most is None else most
    for size in range(1, most + 1):
        fits = fits_of(rounds, size, beam)
        # where several are far ahead of each alone, or of fewer, only they come from before
        new = _weighed(rounds, size, fits) if fits else None
        if size == 1 < most and not rounds.hits:
            leap_ahead(rounds)
        if new is None and not any(len(key) > size for key in rounds.seeds):
            break
        # in pieces, where fits only begin, a leap is enough
        beam = [] if pieces else next_beam(rounds, new or [])
    if pieces:
        return _of(rounds)
    _share_starts(rounds)
    _in_other_words(rounds)
    return _ended(rounds)


def _weighed(rounds: Rounds, size: int, fits: Sequence[Fit]) -> list[Contender] | None:
    """Finish fits of so many effects and compare them by evidence; None: nothing speaks for a further effect."""
    fits = sorted(fits, key=lambda f: f.total)
    limits, how = SETTINGS.search, SETTINGS.fit
    leaders = limits.beam_width if rounds.pieces else 2 * limits.beam_width
    steps = how.screening_steps if rounds.pieces else how.final_steps
    fits = finished(rounds.fitter, fits, rounds.count, leaders, steps=steps)
    around_best = rounds.around(next(filter(rounds.is_possible, fits), fits[0]))
    new = [rounds.worthy(fit, around_best) for fit in fits[: limits.compared]]
    if any(map(rounds.is_possible, new)):
        rounds.disperse(min(filter(rounds.is_possible, new), key=lambda c: c.evidence.left))
    new = [c.weighed(rounds.fitter.system, rounds.dispersion) for c in new]
    best = max(c.log_posterior for c in rounds.contenders)
    left_before = rounds.least_reached - rounds.count
    rounds.contenders += new
    if size == 1:
        new = _and_with_another(rounds, new, around_best)
    new = likeliest_first(new)
    rounds.tell()
    if size == 1:
        return new
    if not rounds.pieces:
        new = _pared(rounds, size, new, around_best)
    left = min((c.fit.total for c in new if rounds.is_possible(c)), default=np.inf) - rounds.count
    stalled = left > rounds.fitter.system.worth_another * left_before > rounds.worth
    return None if new[0].log_posterior < best or stalled else new


def _pared(rounds: Rounds, size: int, new: list[Contender], around_best: Sensitivities) -> list[Contender]:
    """Return contenders of one size and what they are with less in them, likeliest first.

    Of what a leap has put together more than one effect may go.
    """
    while True:
        new = likeliest_first(_and_with_one_less(rounds, new, around_best))
        if not 1 < len(new[0].fit.explanation.candidates) < size:
            new = likeliest_first(_and_with_one_for_two(rounds, new, around_best))
        likeliest = len(new[0].fit.explanation.candidates)
        if not 1 < likeliest < size:
            return new
        size = likeliest


def _and_with_one_less(rounds: Rounds, new: list[Contender], around_best: Sensitivities) -> list[Contender]:
    """Add what the likeliest, and the one that leaves least, are with one effect taken out of them."""
    least = min(new, key=lambda c: c.fit.total)
    for whole in {id(c): c for c in (least, new[0])}.values():
        if key_of(whole.fit.explanation) in rounds.taken_apart:
            continue
        rounds.taken_apart.add(key_of(whole.fit.explanation))
        for fit in without_one(rounds.fitter, whole, rounds.contenders, rounds.episodes, rounds.short):
            new = rounds.with_better(new, fit, around_best)
    return new


def _and_with_another(rounds: Rounds, new: list[Contender], around_best: Sensitivities) -> list[Contender]:
    """Add what the one that leaves least is with another effect in its place."""
    least = min(new, key=lambda c: c.fit.total)
    for fit in _with_one_exchanged(rounds, least):
        new = rounds.with_better(new, fit, around_best)
    return new


def _with_one_exchanged(rounds: Rounds, whole: Contender) -> list[Fit]:
    """Return fits with another effect in the place of one, but for those that have been fitted as well."""
    reached = {key_of(c.fit.explanation): c.fit.total for c in rounds.contenders}
    return one_for_another(rounds.fitter, whole, reached, rounds.short)


def _and_with_one_for_two(rounds: Rounds, new: list[Contender], around_best: Sensitivities) -> list[Contender]:
    """Add what the likeliest is with one effect in the place of two.

    Not where only some explain a flight: what is put in is told by a linear model, which does not hold through a hit,
    and what is taken out may be what a flight tells.
    """
    if rounds.short:
        return new
    fits = one_for_two(rounds.fitter, new[0], rounds.seen) + other_variants(rounds.fitter, new[0], rounds.seen)
    rounds.seen |= {key_of(f.explanation) for f in fits}
    fewer = [rounds.worthy(fit, around_best) for fit in fits]
    rounds.contenders += fewer
    return [*new, *fewer]


def _share_starts(rounds: Rounds) -> None:
    """Let every leader begin each episode where any of them does, or where its flight lets it, if less is left.

    What is about to rest, or to hit with one corner or the other, holds a start on one side of that: an effect that
    another has by its side would be thanked for nothing but the other side.
    """
    leaders = leading(rounds.contenders)
    starts = np.stack([c.fit.starts for c in leaders], axis=1)
    for c in leaders:
        # what a start takes off at once, a descent from it may go on to take off a few times
        behind = leaders[0].log_posterior - c.log_posterior if c.fit.explanation.candidates else 0.0
        enough = 2.0 * behind / SETTINGS.fit.promise_factor
        begin = begun_elsewhere(rounds.fitter, c.fit, starts, enough)
        if begin is None:
            continue
        steps = SETTINGS.fit.final_steps
        # what holds fewer effects leaves more, and may still be likelier
        like = len(c.fit.explanation.candidates) >= len(leaders[0].fit.explanation.candidates)
        target = leaders[0].fit.total if like else np.inf
        fit = rounds.fitter.fit(
            c.fit.explanation,
            rounds.episodes,
            x=c.fit.x,
            starts=begin,
            target=target,
            iterations=steps,
            patience=SETTINGS.fit.patience_steps,
        )
        if fit.explanation.candidates:
            again = rounds.worthy(fit, rounds.around(fit))
        else:
            rounds.nominal, rounds.alone = fit, sensitivities(rounds.fitter, fit, rounds.every)
            again = contend(rounds.fitter, fit, rounds.alone, dispersion=rounds.dispersion)
        _put(rounds, again, c.fit)


def _put(rounds: Rounds, again: Contender, before: Fit) -> None:
    """Put a contender in the place of the one that had another fit of the same explanation."""
    rounds.disperse(again)
    again = again.weighed(rounds.fitter.system, rounds.dispersion)
    rounds.contenders = [again if other.fit is before else other for other in rounds.contenders]


def _carry_on(rounds: Rounds) -> None:
    """Let the likeliest explanation come to rest where its steps have been used up: its numbers are what is told."""
    best = likeliest_first(rounds.contenders)[0].fit
    if best.converged or not best.explanation.candidates:
        return
    steps = SETTINGS.fit.nominal_steps
    fit = rounds.fitter.fit(best.explanation, best.episodes, x=best.x, starts=best.starts, iterations=steps)
    _put(rounds, rounds.worthy(fit, rounds.around(fit)), best)


def _in_other_words(rounds: Rounds) -> None:
    """Let other effects take the place of each one of the likeliest explanation, begun at the motion that it has found.

    Two effects may be two words for one motion, and then only one of them has come along with the others: what it is
    called would hang on which was tried first.
    """
    likeliest = likeliest_first(rounds.contenders)[0]
    if len(likeliest.fit.explanation.candidates) < 2:
        return  # of single effects each has been fitted
    around = rounds.around(likeliest.fit)
    for fit in _with_one_exchanged(rounds, rounds.worthy(likeliest.fit, around)):
        rounds.take(fit, around)


def _take_out_untold(rounds: Rounds) -> None:
    """Let every leader be without the numbers that the data do not tell from zero."""
    for c in leading(rounds.contenders):
        fit = without_untold(c, rounds.fitter)
        if fit is not None:
            again = rounds.worthy(fit, rounds.around(fit))
            rounds.contenders = [again if other is c else other for other in rounds.contenders]


def near_likeliest(found: Search) -> list[Fit]:
    """Return the fits of effects that are not hopelessly behind the likeliest."""
    hopeless = found.best.log_posterior - SETTINGS.held_out.hopeless_log_odds
    return [c.fit for c in found.contenders if c.log_posterior > hopeless and c.fit.explanation.candidates]


def fitted_again(found: Search, fitter: Fitter) -> Search:
    """Return the nominal model and what is near the likeliest, fitted anew to the same episodes by another simulator.

    It moves by less than the noise of one reading otherwise: which effects may be meant has been told, by how much and
    how likely each of them is has not. What is hopelessly behind stays as it is.
    """
    rounds = _begun_with(near_likeliest(found), found.nominal, fitter)
    known = {key_of(c.fit.explanation) for c in rounds.contenders}
    left = (c for c in found.contenders if key_of(c.fit.explanation) not in known)
    rounds.contenders += [c.weighed(fitter.system, rounds.dispersion) for c in left]
    return _ended(rounds)


def weighed_again(found: Search, fitter: Fitter) -> Search:
    """Return the nominal model and the likeliest, fitted anew to the same episodes with another account of the noise.

    And what has some of their effects, from which it is told whether each is needed. How likely each of the others was
    is of no use then: evidence with one noise is not held against that with another.
    """
    explained = {key_of(c.fit.explanation): c.fit for c in reversed(found.contenders) if c.fit.explanation.candidates}
    likeliest = [key_of(f.explanation) for f in near_likeliest(found)]
    likeliest += [key for key in reversed(explained) if key not in likeliest][: SETTINGS.search.compared]
    kept = [f for key, f in explained.items() if any(set(key) <= set(whole) for whole in likeliest)]
    return _ended(_begun_with(kept, found.nominal, fitter))


def _begun_with(explained: Sequence[Fit], nominal: Fit, fitter: Fitter) -> Rounds:
    """Return rounds whose contenders are the nominal model and some explanations, fitted anew."""
    episodes, how, fits = nominal.episodes, SETTINGS.fit, list[Fit]()
    rounds = Rounds.begun(fitter, episodes, nominal.starts, Beginning(), pieces=False)
    for before in sorted(explained, key=lambda f: f.total):
        fit = fitter.fit(
            before.explanation,
            episodes,
            x=before.x,
            starts=before.starts,
            target=min((f.total for f in fits), default=np.inf),
            patience=how.patience_steps,
            iterations=how.final_steps,
        )
        fits.append(fit)
    fits.sort(key=lambda f: f.total)
    for fit in fits:
        rounds.take(fit, rounds.around(fits[0]))
    return rounds


def _ended(rounds: Rounds) -> Search:
    """Return what whole episodes have been searched for, without what nothing tells, and tell of the likeliest."""
    _carry_on(rounds)
    _take_out_untold(rounds)
    rounds.answered.clear()
    rounds.tell()
    return _of(rounds)


def _of(rounds: Rounds) -> Search:
    return Search(tuple(likeliest_first(rounds.contenders)), rounds.nominal)


def resumed(before: Search, fitter: Fitter, first: Beginning | None = None) -> Beginning:
    """Return where a search of the same episodes with another account of the noise begins: where the last one ended.

    `first` is where the last one began: what flights tell still holds.
    """
    near = [
        c for c in before.contenders if c.log_posterior > before.best.log_posterior - SETTINGS.search.expansion_log_odds
    ]
    fits = [c.fit for c in near if c.fit.explanation.candidates]
    tried = {key_of(f.explanation) for f in fits}
    seeds = {
        key_of(f.explanation): WarmStart(
            f.explanation, f.x, f.starts, fitter.loss(f.explanation, f.x, f.starts, f.episodes)
        )
        for f in fits
    }
    short = first.short if first else frozenset[Key]()
    return Beginning(seeds, singles(fitter.system.vocabulary) - tried, short - tried, answered=True)


def singles(vocabulary: Vocabulary) -> frozenset[Key]:
    """Return all explanations of one effect."""
    return frozenset((candidate,) for candidate in vocabulary)
