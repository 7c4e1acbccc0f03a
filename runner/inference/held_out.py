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

from runner.effects.base import Scope
from runner.effects.vocabulary import Candidate
from runner.inference.contender import Contender, leading, likeliest_first
from runner.inference.drive_noise import ByNoise, as_told, by_noise, driven_otherwise
from runner.inference.evidence import directions, evidence, normal_equations, sensitivities, together
from runner.inference.foretold import astray, excesses, usually_left
from runner.inference.least_squares import NONE, Fit, Fitter, amplitudes
from runner.inference.materiality import causes_of
from runner.inference.search import Search
from runner.inference.start_draws import improved_starts
from runner.recording import Span
from runner.settings import SETTINGS

VALUES_AT_ONCE = 1_000_000  # measured ones whose start states are fitted together: some hundred megabytes


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


def confirm(found: Search, fitter: Fitter, held_out: Sequence[int]) -> Confirmed:
    """Weigh the leading contenders by all episodes."""
    gap = fitter.measured.excess(found.nominal.total, found.nominal.episodes)
    count = fitter.measured.count(found.nominal.episodes)
    finite = [c for c in found.contenders if np.isfinite(c.log_posterior)]
    plain = next(c.evidence.left for c in finite if not c.fit.explanation.candidates) / count - 1.0
    finite = doubted(finite, fitter.context, plain, count)
    finite = causes_of(likeliest_first(finite), fitter, gap)
    nominal = next(c for c in finite if not c.fit.explanation.candidates)
    leaders, near = leading(finite), finite[0].log_posterior - SETTINGS.held_out.close_log_odds
    leaders += [c for c in finite[len(leaders) :] if c is nominal or c.log_posterior > near]
    before = unseen(nominal, fitter, held_out, None)
    there_by = {id(c.fit): before if c is nominal else unseen(c, fitter, held_out, before) for c in leaders}
    there_by = _unstuck(leaders, there_by, fitter)
    before = there_by[id(nominal.fit)]
    whole_before, fits = before, there_by
    off = astray(before, [t for t in there_by.values() if t is not before], fitter, len(nominal.fit.episodes))
    if off:
        kept = [k for k, e in enumerate(before.episodes) if e not in off]
        there_by = {fit: t.of(kept) for fit, t in there_by.items()}
        before = there_by[id(nominal.fit)]
        held_out = before.episodes
    every = directions(fitter.system)
    alone = sensitivities(fitter, before, every)
    best = next((c for c in leaders if c is not nominal), nominal)
    around_best = alone if best is nominal else sensitivities(fitter, there_by[id(best.fit)], every)
    weighed, loss, left_unseen = [], {}, {}
    dispersion = finite[0].evidence.dispersion
    for c in leaders:
        there = normal_equations(there_by[id(c.fit)], *((alone,) if c is nominal else (around_best, alone)))
        whole = evidence(together(c.around, there), fitter.system, dispersion=dispersion)
        weighed.append(replace(c, log_posterior=c.log_posterior + whole.log - c.evidence.log))
        unfitted = evidence(there, fitter.system, c.evidence.covariance, dispersion=dispersion)
        loss[id(c.fit)], left_unseen[id(c.fit)] = unfitted.loss, unfitted.left
    weighed = _with_what_is_left(weighed, left_unseen, held_out, fitter)
    otherwise = driven_otherwise(fitter)
    by_drive = {id(c.fit): by_noise((c.fit, there_by[id(c.fit)]), fitter, otherwise) for c in leaders}
    everything = (*nominal.fit.episodes, *held_out)
    whole_gap = fitter.measured.excess(nominal.evidence.left + left_unseen[id(nominal.fit)], everything)
    whole_gap -= by_drive[id(nominal.fit)].excess
    against = [
        further(there_by[id(c.fit)], before, fitter, whole_gap) if c.fit.x.size else odds_against_none(whole_gap)
        for c in weighed
    ]
    weighed = [replace(c, log_posterior=c.log_posterior - a) for c, a in zip(weighed, against, strict=True)]
    whole_left = {id(c.fit): c.fit.total + there_by[id(c.fit)].total for c in leaders}
    weighed = likeliest_first(as_told(weighed, whole_left, by_drive))
    # those that were not weighed keep their distance to the first of the leaders, and don't pass the last of them
    moved = next(w for w in weighed if w.fit is leaders[0].fit).log_posterior - leaders[0].log_posterior
    last = min((w.log_posterior for w in weighed if w.fit is not nominal.fit), default=-np.inf)
    others = [replace(c, log_posterior=min(c.log_posterior + moved, last)) for c in finite if id(c.fit) not in there_by]
    contenders = likeliest_first((*weighed, *others))
    top = weighed[0]
    fitted = fitter.measured.excess(top.evidence.loss, top.fit.episodes)
    there = fitter.measured.excess(loss[id(top.fit)], held_out)
    gap_unseen, left = (fitter.measured.excess(f.total, held_out) for f in (before, there_by[id(top.fit)]))
    found = Search(tuple(contenders), found.nominal)
    usual = usually_left(before, there_by[id(top.fit)], fitter)
    left_fitted = fitter.measured.excess(top.fit.total, top.fit.episodes)
    return Confirmed(
        search=found,
        before=whole_before,
        after=fits,
        excess_fitted=float(fitted),
        excess_unseen=float(there),
        gap_unseen=gap_unseen,
        left_unseen=left,
        left_fitted=left_fitted,
        usually_left=usual,
        astray=off,
        by_drive=by_drive[id(top.fit)],
    )


def _with_what_is_left(
    weighed: Sequence[Contender], unseen: Mapping[int, float], held_out: Sequence[int], fitter: Fitter
) -> list[Contender]:
    """Add what each explanation leaves of the unseen and of the fitted episodes, as likelihoods.

    All mismatch is left in but that of numbers that nobody asks for: a wrong size is wrong by every explanation.

    Where a body is moved by metres by an offset of millimetres, little mismatch does so too, and once it is integrated
    out hardly anything tells an explanation that predicts from one that does not. The squared residuals are
    overdispersed: what the best explanation leaves beyond the noise is the doing of few errors of the model,
    each of which stands for many residuals. They are taken to be no smaller in the fitted ones.

    Args:
        weighed: With the evidence of the fitted episodes.
        unseen: What each leaves of the unseen episodes, see `Evidence.left`, by the identity of its fit.
        held_out: Those.
        fitter: Of all.
    """
    count, fitted = fitter.measured.count, weighed[0].fit.episodes
    posterior = np.array([c.log_posterior for c in weighed])
    dispersion = 1.0
    for totals, episodes, independent in (
        ([unseen[id(c.fit)] for c in weighed], held_out, SETTINGS.held_out.independent_errors_unseen),
        ([c.evidence.left for c in weighed], fitted, 1.0),  # where parameters have taken up others, one error remains
    ):
        left = np.maximum(np.array(totals) - count(episodes), 0.0)
        dispersion = max(dispersion, 1.0 + left.min() / independent)
        posterior -= 0.5 * left / dispersion
    return [replace(c, log_posterior=float(p)) for c, p in zip(weighed, posterior, strict=True)]


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


def unseen(contender: Contender, fitter: Fitter, held_out: Sequence[int], nominal: Fit | None) -> Fit:
    """Return a contender at its parameters with the start states of other episodes fitted."""
    explanation, x = contender.fit.explanation, contender.fit.x
    held = _holding(contender, fitter)
    best = held.fit(NONE, held_out, near=nominal)
    # where the body spins fast, a descent of the start states may end in a local minimum: from two sides, save where
    # nothing is left to be gained, or stretches are so short that their ends answer to their starts in proportion
    gains = nominal is not None and best.total >= nominal.total
    if gains and fitter.measured.excess(best.total, held_out) > SETTINGS.search.near_excess:
        best = min(best, held.fit(NONE, held_out), key=lambda f: f.total)
    if held.until_hit(held_out):
        starts = improved_starts(held, held_out, best.starts)
        best = held.fit(NONE, held_out, starts=starts, iterations=0)
    # what is replayed much worse than all that was fitted may begin where it did not: a motion forgets its start
    worst = max(float(excesses(contender.fit, fitter).max()), SETTINGS.search.near_excess)
    off = np.flatnonzero(excesses(best, fitter) > worst)
    if not len(off):
        return fitter.fit(explanation, held_out, x=x, near=best, iterations=0)
    starts = best.starts.copy()
    for k in off:
        starts[k] = _grown_start(held, best.episodes[k], starts[k])
    return fitter.fit(explanation, held_out, x=x, starts=starts, iterations=0)


def _holding(contender: Contender, fitter: Fitter) -> Fitter:
    """Return a fitter of start states alone: with a contender's effects at its parameters in the model."""
    return replace(fitter, held=contender.fit.explanation.make(contender.fit.x, fitter.context))


def _unstuck(leaders: Sequence[Contender], there: Mapping[int, Fit], fitter: Fitter) -> dict[int, Fit]:
    """Return unseen episodes, by the identity of each leader's fit, with starts sought anew where others leave less.

    What is about to rest is held by friction or just not: a descent from the start that suits another explanation may
    end on the wrong side of that, some tens of log units behind. Where much is left, `unseen` has looked already.
    """
    least, out = np.min([t.loss for t in there.values()], axis=0), dict(there)
    stuck, near = SETTINGS.held_out.stuck_loss, SETTINGS.search.near_excess
    for c in leaders:
        fit = there[id(c.fit)]
        behind = [
            k
            for k, e in enumerate(fit.episodes)
            if fit.loss[k] > least[k] + stuck and fitter.measured.excess(float(fit.loss[k]), [e]) < near
        ]
        held = _holding(c, fitter)
        found = {k: held.fit(NONE, [fit.episodes[k]]) for k in behind}
        better = {k: f.starts[0] for k, f in found.items() if f.total < fit.loss[k]}
        if better:
            starts = np.array([better.get(k, start) for k, start in enumerate(fit.starts)])
            out[id(c.fit)] = fitter.fit(c.fit.explanation, fit.episodes, x=c.fit.x, starts=starts, iterations=0)
    return out


def _grown_start(held: Fitter, episode: int, start: np.ndarray) -> np.ndarray:
    """Return an episode's start state, (S,), fitted to longer and longer parts of it; the old one if that is better.

    A mechanism that turns over forgets where it began: fitted to the whole at once, the start ends in a local minimum.
    """
    samples = len(held.measured.values[episode])
    lengths = [max(round(s * samples), SETTINGS.breakaway.min_samples) for s in SETTINGS.held_out.growing_shares]
    parts = [held.parts([Span(episode, 0, length)]) for length in lengths]
    grown = parts[0].first_starts([0])
    for part in parts:
        grown = part.fit(NONE, [0], starts=grown).starts
    before, after = (held.loss(NONE, np.empty(0), s, [episode]) for s in (start[None], grown))
    return grown[0] if after < before else start


def start_states(contender: Contender, fitter: Fitter, episodes: Sequence[int]) -> dict[int, np.ndarray]:
    """Return start states (S,), by which nothing is chosen, of stretches, with a contender at its parameters."""
    held, starts = _holding(contender, fitter), dict[int, np.ndarray]()
    for some in portions(fitter, episodes):
        fit = held.fit(NONE, some, iterations=SETTINGS.held_out.rough_steps, polish=False)
        starts |= zip(fit.episodes, fit.starts, strict=True)
    return starts


def portions(fitter: Fitter, episodes: Sequence[int]) -> list[list[int]]:
    """Part stretches into portions that memory allows; none of them depends on another."""
    out, count = list[list[int]](), np.inf
    for e in episodes:
        size = fitter.measured.values[e].size
        if count + size > VALUES_AT_ONCE:
            out.append([])
            count = 0
        out[-1].append(e)
        count += size
    return out
