"""Hold the leading explanations against the episodes that were left out of their fits.

An explanation must predict what it has not seen. With its parameters as they were fitted, the start states of the
episodes left out are found, and the evidence is then that of all episodes together: what a leader lacks there counts
against it, and what it has there counts for it. Its parameters stay as they are, so that the closure on these
episodes is one of prediction.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from runner.inference.contender import Contender, leading, likeliest_first, nominal_of
from runner.inference.doubts import doubted, further, odds_against_none
from runner.inference.drive_noise import ByNoise, as_told, by_noise, driven_otherwise
from runner.inference.evidence import Evidence, directions, evidence, normal_equations, sensitivities, together
from runner.inference.foretold import astray, usually_left
from runner.inference.least_squares import Fit, Fitter
from runner.inference.materiality import causes_of
from runner.inference.search import Search
from runner.inference.unseen import unseen, unstuck
from runner.settings import SETTINGS


@dataclass(frozen=True)
class Confirmed:
    """The search with its contenders in their new order, and what they make of the episodes left out.

    Args:
        search: Leaders first, by the evidence of all episodes; the others after them.
        before: Start states of the episodes left out fitted with the nominal model.
        after: The same with each explanation that was weighed, by the identity of its fit.
        excess_fitted: What the best explanation leaves, as a share: whitened mean square minus one, mismatch taken out.
        excess_unseen: The same of the episodes left out.
        gap_unseen: What the nominal model leaves of the episodes left out, nothing taken out.
        left_unseen: What the best explanation does.
        left_fitted: And what it leaves of the fitted ones.
        usually_left: Share of the gap that it leaves of an unseen episode in which there is one, see `usually_left`.
        astray: Which of the episodes left out say nothing of the explanations, see `astray`.
        by_drive: What noise of a measured drive makes of what the best explanation leaves.
    """

    search: Search
    before: Fit
    after: dict[int, Fit]
    excess_fitted: float
    excess_unseen: float
    gap_unseen: float
    left_unseen: float
    left_fitted: float
    usually_left: float
    astray: tuple[int, ...] = ()
    by_drive: ByNoise = field(default_factory=ByNoise.none)

    @property
    def fails(self) -> bool:
        """Whether the best explanation leaves most of what is plain to see in episodes it has not seen, or makes it.

        Of all of them together and of most: in one of them the motion may hang on a hair. Where what is missing hardly
        acts in them (no push reached a limit), and little more is to be seen than the explanation leaves of any
        episode, they say nothing of it.
        """
        limits = SETTINGS.held_out
        plain = max(self.gap_unseen, self.left_unseen) > limits.plain_excess + max(self.left_fitted, 0.0)
        return plain and self.left_unseen > limits.most * self.gap_unseen and self.usually_left > limits.most

    @property
    def excess(self) -> float:
        """Whichever leave more."""
        return max(self.excess_fitted, self.excess_unseen)


@dataclass(frozen=True)
class _Replayed:
    """The leaders with episodes that were left out.

    Args:
        fitter: Of all episodes.
        nominal: The contender without effects.
        leaders: Likeliest first, that one among them.
        there: The episodes left out with each leader at its parameters, by the identity of its fit.
    """

    fitter: Fitter
    nominal: Contender
    leaders: Sequence[Contender]
    there: dict[int, Fit]

    def of(self, leader: Contender) -> Fit:
        """Return the episodes with a leader."""
        return self.there[id(leader.fit)]

    @property
    def before(self) -> Fit:
        """The same with the nominal model."""
        return self.of(self.nominal)

    @property
    def after(self) -> list[Fit]:
        """The same with each of those that hold effects."""
        return [t for t in self.there.values() if t is not self.before]

    def without(self, off: Sequence[int]) -> _Replayed:
        """Return the other episodes."""
        kept = [k for k, e in enumerate(self.before.episodes) if e not in off]
        return replace(self, there={fit: t.of(kept) for fit, t in self.there.items()}) if off else self


def confirm(found: Search, fitter: Fitter, held_out: Sequence[int]) -> Confirmed:
    """Weigh the leading contenders by all episodes."""
    told = _told(found, fitter)
    whole = _replayed(told, fitter, held_out)
    off = astray(whole.before, whole.after, fitter, len(whole.nominal.fit.episodes))
    replayed = whole.without(off)
    otherwise = driven_otherwise(fitter)
    by_drive = {id(c.fit): by_noise((c.fit, replayed.of(c)), fitter, otherwise) for c in replayed.leaders}
    weighed, left = _with_evidence_of_all(replayed, told[0].evidence.dispersion)
    weighed = _with_what_is_left(weighed, left, replayed.before.episodes, fitter)
    weighed = _with_prior_odds(weighed, replayed, left, by_drive)
    whole_left = {id(c.fit): c.fit.total + replayed.of(c).total for c in replayed.leaders}
    weighed = likeliest_first(as_told(weighed, whole_left, by_drive))
    excess, top = fitter.measured.excess, weighed[0]
    before, after = replayed.before, replayed.of(top)
    return Confirmed(
        search=Search(tuple(_and_the_others(weighed, told, replayed)), found.nominal),
        before=whole.before,
        after=whole.there,
        excess_fitted=excess(top.evidence.loss, top.fit.episodes),
        excess_unseen=excess(left[id(top.fit)].loss, before.episodes),
        gap_unseen=excess(before.total, before.episodes),
        left_unseen=excess(after.total, before.episodes),
        left_fitted=excess(top.fit.total, top.fit.episodes),
        usually_left=usually_left(before, after, fitter),
        astray=off,
        by_drive=by_drive[id(top.fit)],
    )


def _told(found: Search, fitter: Fitter) -> list[Contender]:
    """Return the contenders with finite odds, likeliest first, by what stands out of the fitted episodes."""
    gap = fitter.measured.excess(found.nominal.total, found.nominal.episodes)
    count = fitter.measured.count(found.nominal.episodes)
    finite = [c for c in found.contenders if np.isfinite(c.log_posterior)]
    plain = nominal_of(finite).evidence.left / count - 1.0
    return causes_of(likeliest_first(doubted(finite, fitter.context, plain, count)), fitter, gap)


def _replayed(told: Sequence[Contender], fitter: Fitter, held_out: Sequence[int]) -> _Replayed:
    """Return what leads, and what is close or has no effect, with the episodes left out."""
    nominal, near = nominal_of(told), told[0].log_posterior - SETTINGS.held_out.close_log_odds
    leaders = leading(told)
    leaders += [c for c in told[len(leaders) :] if c is nominal or c.log_posterior > near]
    before = unseen(nominal, fitter, held_out, None)
    there = {id(c.fit): before if c is nominal else unseen(c, fitter, held_out, before) for c in leaders}
    return _Replayed(fitter, nominal, leaders, unstuck(leaders, there, fitter))


def _with_evidence_of_all(replayed: _Replayed, dispersion: float) -> tuple[list[Contender], dict[int, Evidence]]:
    """Return the leaders with the evidence of the fitted and the unseen episodes in their odds.

    And what each leaves of the unseen ones by themselves, with the covariance of its parameters, by the identity of its
    fit.
    """
    fitter, nominal, leaders = replayed.fitter, replayed.nominal, replayed.leaders
    every = directions(fitter.system)
    alone = sensitivities(fitter, replayed.before, every)
    best = next((c for c in leaders if c is not nominal), nominal)
    around_best = alone if best is nominal else sensitivities(fitter, replayed.of(best), every)
    weighed, left = [], dict[int, Evidence]()
    for c in leaders:
        there = normal_equations(replayed.of(c), *((alone,) if c is nominal else (around_best, alone)))
        whole = evidence(together(c.around, there), fitter.system, dispersion=dispersion)
        weighed.append(replace(c, log_posterior=c.log_posterior + whole.log - c.evidence.log))
        left[id(c.fit)] = evidence(there, fitter.system, c.evidence.covariance, dispersion=dispersion)
    return weighed, left


def _with_prior_odds(
    weighed: Sequence[Contender], replayed: _Replayed, left: Mapping[int, Evidence], by_drive: Mapping[int, ByNoise]
) -> list[Contender]:
    """Take off the odds against no effect where there is a gap, and those against effects that foretell worse."""
    fitter, nominal = replayed.fitter, replayed.nominal
    everything = (*nominal.fit.episodes, *replayed.before.episodes)
    gap = fitter.measured.excess(nominal.evidence.left + left[id(nominal.fit)].left, everything)
    gap -= by_drive[id(nominal.fit)].excess
    against = [
        further(replayed.of(c), replayed.before, fitter, gap) if c.fit.x.size else odds_against_none(gap)
        for c in weighed
    ]
    return [replace(c, log_posterior=c.log_posterior - a) for c, a in zip(weighed, against, strict=True)]


def _and_the_others(weighed: Sequence[Contender], told: Sequence[Contender], replayed: _Replayed) -> list[Contender]:
    """Return all contenders, likeliest first.

    Those that were not weighed keep their distance to the first of the leaders, and don't pass the last of them.
    """
    first = replayed.leaders[0]
    moved = next(w for w in weighed if w.fit is first.fit).log_posterior - first.log_posterior
    last = min((w.log_posterior for w in weighed if w.fit is not replayed.nominal.fit), default=-np.inf)
    rest = [c for c in told if id(c.fit) not in replayed.there]
    others = [replace(c, log_posterior=min(c.log_posterior + moved, last)) for c in rest]
    return likeliest_first((*weighed, *others))


def _with_what_is_left(
    weighed: Sequence[Contender], unseen: Mapping[int, Evidence], held_out: Sequence[int], fitter: Fitter
) -> list[Contender]:
    """Add what each explanation leaves of the unseen and of the fitted episodes, as likelihoods.

    All mismatch is left in but that of numbers that nobody asks for: a wrong size is wrong by every explanation.

    Where a body is moved by metres by an offset of millimetres, little mismatch does so too, and once it is integrated
    out hardly anything tells an explanation that predicts from one that does not. The squared residuals are
    overdispersed: what the best explanation leaves beyond the noise is the doing of few errors of the model,
    each of which stands for many residuals. They are taken to be no smaller in the fitted ones. What holds a likelier
    explanation and more is not asked for them: whether what that leaves is mismatch or one effect more is what their
    evidence has told, and the effect would take the errors for its own.

    Args:
        weighed: With the evidence of the fitted episodes.
        unseen: What each leaves of the unseen episodes, by the identity of its fit.
        held_out: Those.
        fitter: Of all.
    """
    count, fitted = fitter.measured.count, weighed[0].fit.episodes
    posterior = np.array([c.log_posterior for c in weighed])
    asked = [not _holds_a_likelier(c, weighed) for c in weighed]
    dispersion = 1.0
    for totals, episodes, independent in (
        ([unseen[id(c.fit)].left for c in weighed], held_out, SETTINGS.held_out.independent_errors_unseen),
        ([c.evidence.left for c in weighed], fitted, 1.0),  # where parameters have taken up others, one error remains
    ):
        left = np.maximum(np.array(totals) - count(episodes), 0.0)
        dispersion = max(dispersion, 1.0 + left[asked].min() / independent)
        posterior -= 0.5 * left / dispersion
    return [replace(c, log_posterior=float(p)) for c, p in zip(weighed, posterior, strict=True)]


def _holds_a_likelier(contender: Contender, others: Sequence[Contender]) -> bool:
    """Whether one of several explanations holds fewer of a contender's effects, one at least, and is likelier."""
    whole = frozenset(contender.fit.explanation.candidates)
    return any(
        frozenset() < frozenset(other.fit.explanation.candidates) < whole
        and other.log_posterior > contender.log_posterior
        for other in others
    )
