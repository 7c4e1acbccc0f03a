"""What a search knows while it goes on: contenders, where an earlier look ended, and what was tried."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from runner.inference.contender import Contender, contend, dispersion_of
from runner.inference.evidence import Direction, Sensitivities, directions, sensitivities
from runner.inference.least_squares import NONE, Fit, Fitter, are_near
from runner.inference.parameters import is_possible
from runner.inference.probability import error_of_excess, shares, unknown_by_excess
from runner.inference.shortlist import worth_of
from runner.inference.warm_start import Beginning, Key, WarmStart, key_of
from runner.settings import SETTINGS


@dataclass
class Rounds:
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
        short: Which single effects leave much of a flight that others explain.
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
    short: frozenset[Key]
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
    ) -> Rounds:
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
            short=beginning.short,
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
        return self.worth_beside(min(self.least_foreseen, self.least_reached))

    @property
    def least_foreseen(self) -> float:
        """The least that a beginning from an earlier look leaves which an explanation may leave."""
        return min((s.total for s in self.seeds.values() if self.is_possible(s)), default=np.inf)

    @property
    def least_reached(self) -> float:
        """The least that a contender leaves which may be one."""
        return min(c.fit.total for c in self.contenders if self.is_possible(c))

    def is_possible(self, one: Contender | Fit | WarmStart) -> bool:
        """Whether it is an explanation, rather than one out of its range that does the work of another."""
        return is_possible(one.fit if isinstance(one, Contender) else one, self.fitter.context)

    def worth_beside(self, total: float) -> float:
        """Return what an effect has to take off the loss where that much is left."""
        return worth_of(self.fitter.system, self.count, self.nominal.total, total)

    def is_far(self, fit: Fit) -> bool:
        """Whether a fit leaves so much that it may be in the wrong place."""
        return fit.total - self.count > SETTINGS.search.near_excess * self.count

    def around(self, fit: Fit) -> Sensitivities:
        """Return what every effect does beside a fit; of the last one that is known."""
        if fit.episodes != self.last[0].episodes or not are_near(fit, self.last[0], self.fitter.context):
            self.last = fit, sensitivities(self.fitter, fit, self.every)
        return self.last[1]

    def keep_seed(self, fit: Fit) -> None:
        """Let the search begin at a fit, too, if it leaves less than what it begins at with the same effects."""
        key = key_of(fit.explanation)
        if key not in self.seeds or self.seeds[key].total > fit.total:
            self.seeds[key] = WarmStart(fit.explanation, fit.x, fit.starts, fit.total)

    def worthy(self, fit: Fit, around_best: Sensitivities) -> Contender:
        """Return a fit as a contender; a single effect that hardly matters has that against it."""
        lacks = self.worth - (self.nominal.total - fit.total) if len(fit.explanation.candidates) == 1 else 0.0
        against = 0.5 * max(lacks, 0.0)
        return contend(self.fitter, fit, around_best, self.alone, against=against, dispersion=self.dispersion)

    def with_better(self, new: list[Contender], fit: Fit, around_best: Sensitivities) -> list[Contender]:
        """Add a fit to the contenders: one that found a better place takes the place of the one before."""
        again, key = self.worthy(fit, around_best), key_of(fit.explanation)
        self.seen.add(key)
        others = [c for c in self.contenders if key_of(c.fit.explanation) != key]
        same = [c for c in self.contenders if key_of(c.fit.explanation) == key]
        if all(again.log_posterior >= c.log_posterior for c in same):
            self.contenders = [*others, again]
            new = [*(c for c in new if key_of(c.fit.explanation) != key), again]
        return new

    def take(self, fit: Fit, around: Sensitivities) -> None:
        """Let a fit be a contender; one that leaves least says how uncertain residuals are."""
        self.disperse(self.worthy(fit, around))
        self.with_better([], fit, around)

    def disperse(self, new: Contender) -> None:
        """Weigh all contenders by how uncertain residuals are by what a new one leaves, if it leaves least."""
        left = new.evidence.left
        before = min(c.evidence.left for c in self.contenders if self.is_possible(c))
        if left >= before or not self.is_possible(new):
            return
        self.dispersion = dispersion_of(new.fit, self.fitter, left)
        self.contenders = [c.weighed(self.fitter.system, self.dispersion) for c in self.contenders]

    def tell(self, *begun: Contender) -> None:
        """Tell the observer of the likeliest so far, of all contenders and of others that are not finished."""
        if self.answered:
            return
        best, noises, probability = likeliest((*self.contenders, *begun), self.nominal, self.fitter)
        self.fitter.observer.best(best.fit.explanation.names, noises, probability, self.fitter.part)


def likeliest(contenders: Iterable[Contender], nominal: Fit, fitter: Fitter) -> tuple[Contender, float, float]:
    """Return the likeliest contender, the root mean square that it leaves, in noises, and its probability.

    That is by what was fitted so far and nothing that is held out, `unknown` counted in.
    """
    finite, count = [c for c in contenders if np.isfinite(c.log_posterior)], fitter.measured.count(nominal.episodes)
    best = max(finite, key=lambda c: c.log_posterior)
    alike = [c.fit.explanation.names == best.fit.explanation.names for c in finite]
    gap, left = ((t - count) / count for t in (nominal.total, best.evidence.loss))
    gap = gap if best.fit.x.size else 0.0  # where nothing is claimed, nothing may leave a share of one
    unknown = unknown_by_excess(left, gap, fitter.system.unknown_share, error_of_excess(count))
    probability = float(shares(finite)[alike].sum()) * (1.0 - unknown)
    return best, float(np.sqrt(best.fit.total / count)), probability
