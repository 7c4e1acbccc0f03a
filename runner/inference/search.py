"""Search for the explanation: none, one effect, or several by forward selection with a beam.

Around the fits so far every further effect promises a gain (a linear model, one batch of simulations). The promising
ones are fitted; a fit that falls hopelessly behind is not finished. Explanations are then compared by evidence. A
search may begin where an earlier look ended (see `runner.inference.multiple_shooting`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from runner.effects.vocabulary import Candidate, Vocabulary
from runner.inference.contender import Contender, Offer, are_confounded, contend, dispersion_of, offers
from runner.inference.evidence import (
    Direction,
    Sensitivities,
    directions,
    joined,
    sensitivities,
)
from runner.inference.exchange import one_for_another, one_for_two, other_variants
from runner.inference.leap import leap
from runner.inference.least_squares import NONE, Explanation, Fit, Fitter, are_near
from runner.inference.probability import error_of_excess, shares, unknown_by_excess
from runner.inference.shortlist import finished, gain, with_fit, without_one, worth_of
from runner.inference.start_draws import begun_elsewhere, tried_from_the_air
from runner.inference.untold import without_untold
from runner.inference.warm_start import (
    Beginning,
    Key,
    WarmStart,
    key_of,
    over_edges,
    where_to_begin,
)
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
    rounds = _Rounds.begun(fitter, episodes, starts, beginning or Beginning(), pieces=pieces)
    beam = list(rounds.contenders)
    rounds.tell()
    most = fitter.system.most_effects if most is None else most
    for size in range(1, most + 1):
        fits = rounds.fitted(size, beam)
        # where several are far ahead of each alone, or of fewer, only they come from before
        new = rounds.weighed(size, fits) if fits else None
        if size == 1 < most and not rounds.hits:
            rounds.leap()
        if new is None and not any(len(key) > size for key in rounds.seeds):
            break
        # in pieces, where fits only begin, a leap is enough
        beam = [] if pieces else rounds.beam(new or [])
    if not pieces:
        rounds.share_starts()
        rounds.take_out_untold()
        rounds.answered.clear()
        rounds.tell()
    return Search(tuple(_likeliest_first(rounds.contenders)), rounds.nominal)


@dataclass
class _Rounds:
    """What a search knows while it goes on, from explanations of one effect to those of several.

    Args:
        fitter: Of the episodes.
        episodes: Which are fitted.
        pieces: Whether they are pieces of episodes.
        every: All directions in which a model may change.
        nominal: The fit without effects.
        alone: What every effect does beside that.
        count: How many measurements there are.
        seeds: Beginnings from an earlier look that are not used up.
        ruled_out: What is not to be tried again.
        answered: Seeds that were told as the best so far: until they are fitted nothing else is.
        tried: Beginnings from before anything was hit that are not used up, of what hits something.
        contenders: Compared by evidence so far.
        seen: What was fitted.
        taken_apart: Sets whose effects were left out one by one.
        last: A fit and what every effect does beside it.
        dispersion: How many times as uncertain as noise residuals are, from the fit that leaves least.
    """

    fitter: Fitter
    episodes: Sequence[int]
    pieces: bool
    every: Sequence[Direction]
    nominal: Fit
    alone: Sensitivities
    count: int
    seeds: dict[Key, WarmStart]
    ruled_out: frozenset[Key]
    answered: set[Key]
    tried: dict[Key, WarmStart]
    contenders: list[Contender]
    seen: set[Key]
    taken_apart: set[Key]
    last: tuple[Fit, Sensitivities]
    dispersion: float

    @classmethod
    def begun(
        cls, fitter: Fitter, episodes: Sequence[int], starts: np.ndarray | None, beginning: Beginning, *, pieces: bool
    ) -> _Rounds:
        """Return the rounds before the first: the nominal model is the one contender."""
        every = directions(fitter.system)
        nominal = fitter.fit(NONE, episodes, starts=starts, iterations=SETTINGS.fit.nominal_steps)
        count = fitter.measured.count(episodes)
        alone = sensitivities(fitter, nominal, every)
        none = contend(fitter, nominal, alone)
        dispersion = dispersion_of(nominal, fitter, none.evidence.left)
        return cls(
            fitter=fitter,
            episodes=episodes,
            pieces=pieces,
            every=every,
            nominal=nominal,
            alone=alone,
            count=count,
            seeds=dict(beginning.seeds),
            ruled_out=beginning.ruled_out,
            answered=set(beginning.seeds) if beginning.answered else set(),
            tried={},
            contenders=[none.weighed(fitter.system, dispersion)],
            dispersion=dispersion,
            seen={NONE.candidates},
            taken_apart=set(),
            last=(nominal, alone),
        )

    @property
    def hits(self) -> bool:
        """Whether this is of an object that hits something: through a hit no linear model holds."""
        return not self.pieces and bool(self.fitter.until_hit(self.episodes))

    @property
    def worth(self) -> float:
        """What an effect has to take off the loss."""
        totals = [c.fit.total for c in self.contenders] + [s.total for s in self.seeds.values()]
        return self._worth_beside(min(totals))

    def _worth_beside(self, total: float) -> float:
        """Return what an effect has to take off the loss where that much is left."""
        return worth_of(self.fitter.system, self.count, self.nominal.total, total)

    def leap(self) -> None:
        """Go on with what the linear model proposes at once, from the effect or the seed that leaves least."""
        begin = min((c.fit for c in self.contenders), key=lambda f: f.total)
        if self.seeds:
            seed = min(self.seeds.values(), key=lambda s: s.total)
            if seed.total < begin.total:
                steps = SETTINGS.fit.warm_steps
                begin = self.fitter.fit(
                    seed.explanation, self.episodes, x=seed.x, starts=seed.starts, iterations=steps, polish=False
                )
                self._seed(begin)
        fit, self.last = leap(self.fitter, begin, self.every, self._around(begin), self._worth_beside)
        if fit is not begin:
            self._seed(fit)

    def _around(self, fit: Fit) -> Sensitivities:
        """Return what every effect does beside a fit; of the last one that is known."""
        if fit.episodes != self.last[0].episodes or not are_near(fit, self.last[0], self.fitter.context):
            self.last = fit, sensitivities(self.fitter, fit, self.every)
        return self.last[1]

    def _seed(self, fit: Fit) -> None:
        key = key_of(fit.explanation)
        if key not in self.seeds or self.seeds[key].total > fit.total:
            self.seeds[key] = WarmStart(fit.explanation, fit.x, fit.starts, fit.total)

    def fitted(self, size: int, beam: Sequence[Contender]) -> list[Fit]:
        """Fit explanations of so many effects: those of the beam with one more, and those that an earlier look left."""
        fits: list[Fit] = []
        reached = [s.total for s in self.seeds.values()] + [c.fit.total for c in self.contenders if size > 1]
        target = min(reached, default=np.inf)
        for contender in beam:
            for _, candidate, vector in self._worth_a_fit(contender, size):
                fit = self._with_one_more(contender, candidate, vector, size, target)
                if fit is not None and (size == 1 or gain(fit, self.contenders) > self.worth):
                    if size == 1 and fit.total < min((f.total for f in fits), default=contender.fit.total):
                        self.tell(self._worthy(fit, self.alone))  # all single fits may take minutes
                    fits = with_fit(fits, fit)
                    target = min(target, fit.total)
        for key in [k for k in self.seeds if len(k) == size]:
            seed = self.seeds.pop(key)
            self.answered.discard(key)
            self.seen.add(key)
            begin = where_to_begin(self.fitter, seed.explanation, seed.x, self.nominal, seed)
            steps, patience = SETTINGS.fit.warm_steps, SETTINGS.fit.patience_steps
            how = {"target": target, "patience": patience, "iterations": steps, "polish": False}
            fit = self.fitter.fit(seed.explanation, self.episodes, **begin, **how)
            if size == 1 or gain(fit, self.contenders) > self.worth:
                fits = with_fit(fits, fit)
                target = min(target, fit.total)
        return fits

    def weighed(self, size: int, fits: Sequence[Fit]) -> list[Contender] | None:
        """Finish fits of so many effects and compare them by evidence; None: nothing speaks for a further effect."""
        fits = sorted(fits, key=lambda f: f.total)
        limits, how = SETTINGS.search, SETTINGS.fit
        leaders = limits.beam_width if self.pieces else 2 * limits.beam_width
        steps = how.screening_steps if self.pieces else how.final_steps
        fits = finished(self.fitter, fits, self.count, leaders, steps=steps)
        around_best = self._around(fits[0])
        new = [self._worthy(fit, around_best) for fit in fits[: limits.compared]]
        self._disperse(min(new, key=lambda c: c.evidence.left))
        new = [c.weighed(self.fitter.system, self.dispersion) for c in new]
        best = max(c.log_posterior for c in self.contenders)
        left_before = min(c.fit.total for c in self.contenders) - self.count
        self.contenders += new
        if size == 1:
            new = self._and_with_another(new, around_best)
        new.sort(key=lambda c: -c.log_posterior)
        self.tell()
        if size == 1:
            return new
        if not self.pieces:
            new = self._pared(size, new, around_best)
        stalled = (
            min(c.fit.total for c in new) - self.count > self.fitter.system.worth_another * left_before > self.worth
        )
        return None if new[0].log_posterior < best or stalled else new

    def _disperse(self, new: Contender) -> None:
        """Weigh all contenders by how uncertain residuals are by what a new one leaves, if it leaves least."""
        left = new.evidence.left
        if left >= min(c.evidence.left for c in self.contenders):
            return
        self.dispersion = dispersion_of(new.fit, self.fitter, left)
        self.contenders = [c.weighed(self.fitter.system, self.dispersion) for c in self.contenders]

    def tell(self, *begun: Contender) -> None:
        """Tell the observer of the likeliest so far, of all contenders and of others that are not finished."""
        if self.answered:
            return
        finite = [c for c in (*self.contenders, *begun) if np.isfinite(c.log_posterior)]
        best = max(finite, key=lambda c: c.log_posterior)
        alike = [c.fit.explanation.names == best.fit.explanation.names for c in finite]
        gap, left = ((t - self.count) / self.count for t in (self.nominal.total, best.evidence.loss))
        gap = gap if best.fit.x.size else 0.0  # where nothing is claimed, nothing may leave a share of one
        unknown = unknown_by_excess(left, gap, self.fitter.system.unknown_share, error_of_excess(self.count))
        probability = float(shares(finite)[alike].sum()) * (1.0 - unknown)
        noises = float(np.sqrt(best.fit.total / self.count))
        self.fitter.observer.best(best.fit.explanation.names, noises, probability)

    def beam(self, new: Sequence[Contender]) -> list[Contender]:
        """Return what is worth adding to, of contenders of one size, likeliest first."""
        beam: list[Contender] = []
        left = min((s.total for s in self.seeds.values()), default=np.inf) - self.count
        limits = SETTINGS.search
        for contender in new:
            if contender.fit.total - self.count > limits.leap_lead_ratio * max(left, self.worth):
                continue  # a set of more effects is so far ahead that one more beside this will not reach it
            settled = max(limits.settled_share * (self.nominal.total - self.count), self.worth)
            if beam and beam[0].fit.total - self.count < settled:
                break
            near = contender.log_posterior > new[0].log_posterior - limits.expansion_log_odds
            if near and len(beam) < limits.beam_width and not any(are_confounded(contender.fit, b.fit) for b in beam):
                beam.append(contender)
        return beam

    def _worth_a_fit(self, contender: Contender, size: int) -> list[Offer]:
        """Return the effects that are tried beside those of a contender, most promising first."""
        left, limits = contender.fit.total - self.count, SETTINGS.search
        if size > 1 and left < self.worth:
            return []  # nothing is left that would be worth an effect
        promised = self._offers(contender, size)
        if size == 1 and self.pieces:
            return self._likely(promised)
        if size == 1 and self.hits:
            return promised  # an amount that was tried with starts of something else promises too little
        if size == 1:
            foreseen = min((s.total for s in self.seeds.values()), default=np.inf) - self.count
            if foreseen < limits.settled_share * left:
                return promised[: limits.most_promising]  # an earlier look has found where to begin
            every = left >= limits.near_excess * self.count
            ahead = limits.lead_ratio * max(foreseen, self.worth) < left
            if ahead or every:
                return self._likely(promised)
            few, enough = limits.most_promising, limits.min_promise_share * self.worth
            return [o for i, o in enumerate(promised) if i < few or o[0] > enough]
        reached = min(s.total for s in (*self.seeds.values(), *(c.fit for c in self.contenders))) - self.count
        behind = left - limits.leap_lead_ratio * max(reached, self.worth)
        enough = max(limits.min_promise_share * self.worth, behind)
        return [o for o in promised[: limits.most_promising] if o[0] > enough]

    def _offers(self, contender: Contender, size: int) -> list[Offer]:
        """Return the effects that may stand beside those of a contender, most promising first.

        What hits something keeps no linear promise: there an amount of each that is open is tried.
        """
        promised = offers(contender, self.fitter)
        if not self.hits:
            return promised
        promised = [o for o in promised if self._is_open(contender, o[1], size)]
        begun = tried_from_the_air(self.fitter, contender.fit, promised)
        for start in begun:
            self.tried[key_of(start.explanation)] = start
        gains = [contender.fit.total - start.total for start in begun]
        found = [(gain, c, vector) for gain, (_, c, vector) in zip(gains, promised, strict=True)]
        return sorted(found, key=lambda o: -o[0])

    def _likely(self, promised: list[Offer]) -> list[Offer]:
        """Return the most promising, and of those whose promise says little."""
        jumps = [o for o in promised if o[1].effect.discontinuous or o[1].is_placed(self.fitter.context)]
        nonlinear = {o[1] for o in jumps[: SETTINGS.search.nonlinear_candidates]}
        return [o for i, o in enumerate(promised) if i < SETTINGS.search.candidates or o[1] in nonlinear]

    def _with_one_more(
        self, contender: Contender, candidate: Candidate, vector: np.ndarray, size: int, target: float
    ) -> Fit | None:
        """Fit a contender's effects and one more; None: that has been tried."""
        if not self._is_open(contender, candidate, size):
            return None
        explanation, x = joined(contender.fit, candidate, vector)
        key = key_of(explanation)
        self.seen.add(key)
        self.answered.discard(key)
        steps = SETTINGS.fit.screening_steps if size == 1 or self.pieces else SETTINGS.fit.warm_steps
        how = {"target": target, "patience": self._patience(size, candidate), "iterations": steps, "polish": False}
        seed = min(
            (s for s in (self.seeds.pop(key, None), self.tried.pop(key, None)) if s),
            key=lambda s: s.total,
            default=None,
        )
        begin = where_to_begin(self.fitter, explanation, x, contender.fit, seed)
        fit = self.fitter.fit(explanation, self.episodes, **begin, **how)
        if candidate.effect.discontinuous and self._is_far(fit):
            fit = over_edges(self.fitter, fit, contender.fit)
        return fit

    def _is_open(self, contender: Contender, candidate: Candidate, size: int) -> bool:
        """Whether an effect beside those of a contender is still to be tried.

        What has a place may have missed it without what is in now.
        """
        key = key_of(contender.fit.explanation + Explanation((candidate,)))
        anew = size > 1 and self._is_far(contender.fit) and candidate.is_placed(self.fitter.context)
        return key not in self.ruled_out and (key not in self.seen or anew)

    def _is_far(self, fit: Fit) -> bool:
        """Whether a fit leaves so much that it may be in the wrong place."""
        return fit.total - self.count > SETTINGS.search.near_excess * self.count

    def _patience(self, size: int, candidate: Candidate) -> int:
        """Return after how many steps a fit is judged by whether it will come near the best one.

        What begins at a place or a range of its own has some way to go before it can be judged; a delay, too, where a
        leap has set the mark and the model is far from it.
        """
        at_once = self.pieces or (size == 1 and not candidate.is_placed(self.fitter.context))
        return 1 if at_once else SETTINGS.fit.patience_steps

    def _pared(self, size: int, new: list[Contender], around_best: Sensitivities) -> list[Contender]:
        """Return contenders of one size and what they are with less in them, likeliest first.

        Of what a leap has put together more than one effect may go.
        """
        while True:
            new = _likeliest_first(self._and_with_one_less(new, around_best))
            if not 1 < len(new[0].fit.explanation.candidates) < size:
                new = _likeliest_first(self._and_with_one_for_two(new, around_best))
            likeliest = len(new[0].fit.explanation.candidates)
            if not 1 < likeliest < size:
                return new
            size = likeliest

    def _and_with_one_less(self, new: list[Contender], around_best: Sensitivities) -> list[Contender]:
        """Add what the likeliest, and the one that leaves least, are with one effect taken out of them."""
        least = min(new, key=lambda c: c.fit.total)
        for whole in {id(c): c for c in (least, new[0])}.values():
            if key_of(whole.fit.explanation) in self.taken_apart:
                continue
            self.taken_apart.add(key_of(whole.fit.explanation))
            for fit in without_one(self.fitter, whole, self.contenders, self.episodes):
                new = self._with_better(new, fit, around_best)
        return new

    def _with_better(self, new: list[Contender], fit: Fit, around_best: Sensitivities) -> list[Contender]:
        """Add a fit to the contenders: one that found a better place takes the place of the one before."""
        again, key = self._worthy(fit, around_best), key_of(fit.explanation)
        self.seen.add(key)
        others = [c for c in self.contenders if key_of(c.fit.explanation) != key]
        same = [c for c in self.contenders if key_of(c.fit.explanation) == key]
        if all(again.log_posterior >= c.log_posterior for c in same):
            self.contenders = [*others, again]
            new = [*(c for c in new if key_of(c.fit.explanation) != key), again]
        return new

    def _and_with_another(self, new: list[Contender], around_best: Sensitivities) -> list[Contender]:
        """Add what the one that leaves least is with another effect in its place."""
        least = min(new, key=lambda c: c.fit.total)
        reached = {key_of(c.fit.explanation): c.fit.total for c in self.contenders}
        for fit in one_for_another(self.fitter, least, reached):
            new = self._with_better(new, fit, around_best)
        return new

    def _and_with_one_for_two(self, new: list[Contender], around_best: Sensitivities) -> list[Contender]:
        """Add what the likeliest is with one effect in the place of two."""
        fits = one_for_two(self.fitter, new[0], self.seen) + other_variants(self.fitter, new[0], self.seen)
        self.seen |= {key_of(f.explanation) for f in fits}
        fewer = [self._worthy(fit, around_best) for fit in fits]
        self.contenders += fewer
        return [*new, *fewer]

    def share_starts(self) -> None:
        """Let every leader begin each episode where any of them does, or where its flight lets it, if less is left.

        What is about to rest, or to hit with one corner or the other, holds a start on one side of that: an effect that
        another has by its side would be thanked for nothing but the other side.
        """
        leaders = self._leaders()
        starts = np.stack([c.fit.starts for c in leaders], axis=1)
        for c in leaders:
            # what a start takes off at once, a descent from it may go on to take off a few times
            behind = leaders[0].log_posterior - c.log_posterior if c.fit.explanation.candidates else 0.0
            enough = 2.0 * behind / SETTINGS.fit.promise_factor
            begin = begun_elsewhere(self.fitter, c.fit, starts, enough)
            if begin is None:
                continue
            steps = SETTINGS.fit.final_steps
            # what holds fewer effects leaves more, and may still be likelier
            like = len(c.fit.explanation.candidates) >= len(leaders[0].fit.explanation.candidates)
            target = leaders[0].fit.total if like else np.inf
            fit = self.fitter.fit(
                c.fit.explanation,
                self.episodes,
                x=c.fit.x,
                starts=begin,
                target=target,
                iterations=steps,
                patience=SETTINGS.fit.patience_steps,
            )
            if fit.explanation.candidates:
                again = self._worthy(fit, self._around(fit))
            else:
                self.nominal, self.alone = fit, sensitivities(self.fitter, fit, self.every)
                again = contend(self.fitter, fit, self.alone, dispersion=self.dispersion)
            self._disperse(again)
            again = again.weighed(self.fitter.system, self.dispersion)
            self.contenders = [again if other.fit is c.fit else other for other in self.contenders]

    def take_out_untold(self) -> None:
        """Let every leader be without the numbers that the data do not tell from zero."""
        for c in self._leaders():
            fit = without_untold(c, self.fitter)
            if fit is not None:
                again = self._worthy(fit, self._around(fit))
                self.contenders = [again if other is c else other for other in self.contenders]

    def _leaders(self) -> list[Contender]:
        """Return the contenders of which one may turn out the likeliest, likeliest first."""
        leaders = _likeliest_first([c for c in self.contenders if np.isfinite(c.log_posterior)])
        hopeless = leaders[0].log_posterior - SETTINGS.held_out.hopeless_log_odds
        return [c for c in leaders[: SETTINGS.held_out.max_leaders] if c.log_posterior > hopeless]

    def _worthy(self, fit: Fit, around_best: Sensitivities) -> Contender:
        """Return a fit as a contender; a single effect that hardly matters has that against it."""
        lacks = self.worth - (self.nominal.total - fit.total) if len(fit.explanation.candidates) == 1 else 0.0
        against = 0.5 * max(lacks, 0.0)
        return contend(self.fitter, fit, around_best, self.alone, against=against, dispersion=self.dispersion)


def _likeliest_first(contenders: Sequence[Contender]) -> list[Contender]:
    return sorted(contenders, key=lambda c: -c.log_posterior)


def resumed(before: Search, fitter: Fitter) -> Beginning:
    """Return where a search of the same episodes with another account of the noise begins: where the last one ended."""
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
    return Beginning(seeds, singles(fitter.system.vocabulary) - tried, answered=True)


def singles(vocabulary: Vocabulary) -> frozenset[Key]:
    """Return all explanations of one effect."""
    return frozenset((candidate,) for candidate in vocabulary)
