"""One split of a recording into what is fitted and what is held out: first look, search, and the check on the rest.

A fit replays *stretches*: whole episodes as a rule; parts of them, each with a start of its own, where small
differences grow out of proportion over a whole episode, or where nothing that is known comes near the recording, so
that over long times errors of the model pile up instead of telling what they are (multiple shooting, Bock 1983).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from runner.diagnosis.noise_account import fit_nominal, has_hidden, is_explained, is_hopeless, left_by, residual_of
from runner.diagnosis.ranking import unknown_by_episodes
from runner.effects.base import Effects
from runner.inference.breakaway import hanging
from runner.inference.contender import account_densities
from runner.inference.drive_noise import told_apart_from_noise
from runner.inference.evidence import directions, least_errors, sensitivities
from runner.inference.flown import Flown
from runner.inference.held_out import Confirmed, confirm
from runner.inference.leap import leapt
from runner.inference.least_squares import NONE, Fit, Fitter
from runner.inference.multiple_shooting import carried_over, look, recut
from runner.inference.outside import with_outside
from runner.inference.search import Search, fitted_again, near_likeliest, resumed, search, weighed_again
from runner.inference.solver_choice import better_solved
from runner.inference.unseen import portions, start_states, unseen
from runner.inference.variable_projection import project
from runner.inference.warm_start import Beginning, Key, WarmStart, key_of
from runner.noise.measured import Measured, materially_different, materially_slower, measure, refine, without_outliers
from runner.numerics.arrays import spread_over
from runner.progress import UNOBSERVED, ProgressObserver, Step
from runner.recording import Span
from runner.settings import SETTINGS
from runner.systems.base import AbstractSystem
from runner.systems.recorded import longest_part_s
from runner.systems.simulator import AbstractSimulator

OTHERWISE = "again with joints solved otherwise"  # as somebody who waits is told why it begins anew
BY_MODEL = "again with noise as the model as believed leaves it"


@dataclass(frozen=True)
class Attempt:
    """What one split has led to.

    Args:
        fitted: Positions of the recorded episodes that were fitted.
        held_out: Of those that were not.
        fitter: Of all stretches; to it each is an episode.
        confirmed: The search of the fitted episodes, or of stretches spread over them, held against those of the
            episodes left out.
        flown: What flights until the first hit say by themselves; None: there are none.
        piles_up: Whether over longer stretches what the model lacks, or noise of what drives it, would pile up.
    """

    fitted: tuple[int, ...]
    held_out: tuple[int, ...]
    fitter: Fitter
    confirmed: Confirmed
    flown: Flown | None = None
    piles_up: bool = False

    @property
    def stretches(self) -> tuple[Span, ...]:
        """What was replayed."""
        return self.fitter.measured.spans

    @property
    def nominal_excess(self) -> float:
        """What the nominal model leaves of what was fitted, in squared noises."""
        nominal = self.confirmed.search.nominal
        return self.fitter.measured.excess(nominal.total, nominal.episodes)

    def of(self, episodes: Iterable[int]) -> tuple[int, ...]:
        """Return the positions of the stretches of some recorded episodes, in the order of those."""
        return stretches_of(self.fitter, episodes)

    @property
    def not_searched(self) -> tuple[int, ...]:
        """Positions of stretches that were neither searched nor held against what was found: others told enough."""
        used = {*self.confirmed.search.nominal.episodes, *self.confirmed.before.episodes}
        return tuple(i for i in (*self.of(self.fitted), *self.of(self.held_out)) if i not in used)

    @property
    def in_parts(self) -> bool:
        """Whether stretches are parts of episodes."""
        return self.stretch_s is not None

    @property
    def stretch_s(self) -> float | None:
        """How long the longest stretch is, in seconds; None: stretches are whole episodes."""
        return longest_part_s(self.fitter.system.recording, self.stretches)

    @property
    def said_of_stretches(self) -> tuple[str, ...]:
        """Over how long models were replayed, and why; nothing where that is whole episodes."""
        if self.stretch_s is None:
            return ()
        system = self.fitter.system
        if self.piles_up:
            noisy = system.has_noisy_drive
            what = "noise of the measured force, or what the model lacks," if noisy else "what the model lacks"
            why = f"over longer times {what} piles up"
        elif system.stretched_for_time and self.stretches == system.stretches():
            why = f"to save time, as about {system.searched_s:.2g} s are searched, which hold some of every episode"
        else:
            why = "over longer times small differences grow out of proportion"
        return (f"Models were replayed over {self.stretch_s:.2g} s at a time, each with a start of its own: {why}.",)


def attempt(
    system: AbstractSystem,
    simulator: AbstractSimulator,
    fitted: tuple[int, ...],
    held_out: tuple[int, ...],
    observer: ProgressObserver = UNOBSERVED,
    again: str = "",
) -> Attempt:
    """Search for the explanation of some episodes and hold what was found against the others.

    `again` tells somebody who waits why all of it begins anew, such as "again with ...".
    """
    as_believed = system.solved
    first = _begun(system, simulator, fitted, observer, again)
    hopeless = first.noise_of_samples and is_hopeless(first.nominal, first.seeds.values(), first.fitter)
    fitter, found = (first.fitter, None) if hopeless else _explained(first, held_out)
    if found is None or (first.noise_of_samples and not is_explained(found.best.fit, first.nominal, first.fitter)):
        simulator = _counted_on(system, fitter)
        first = _begun(system, simulator, fitted, observer, BY_MODEL, by_model=True)
        fitter, found = _explained(first, held_out)
    if other := _better_solved(fitter, found, as_believed):
        fitter = _solved_otherwise(fitter, other)
        first = replace(first, fitter=fitter, nominal=found.nominal, beginning=_open_again(found, fitter))
        observer.step(Step.SEARCHING, OTHERWISE)
        fitter, found = _explained(first, held_out)
    near = [f.explanation.make(f.x, fitter.context) for f in near_likeliest(found)]
    if finer := fitter.system.settled(found.best.evidence.dispersion, near):
        fitter = _solved_otherwise(fitter, finer)
        observer.step(Step.SEARCHING, "what is near the likeliest again in shorter steps")
        found = fitted_again(found, fitter)
    simulator = fitter.system.simulator()
    observer.step(Step.CHECKING)
    found, checked = with_outside(found, fitter), _to_search(fitter, held_out, 1.0)
    fitter = _without_outliers(fitter, found, checked)
    confirmed = confirm(found, fitter, checked)
    if fitter.simulator is not simulator:
        simulator.simulated_s += fitter.simulator.simulated_s
    return Attempt(fitted, held_out, fitter, confirmed, first.flown, first.piles_up)


def _begun(
    system: AbstractSystem,
    simulator: AbstractSimulator,
    fitted: Sequence[int],
    observer: ProgressObserver,
    again: str,
    *,
    by_model: bool = False,
) -> _FirstLook:
    """Return a first look, by the system solved so that what it suggests leaves less."""
    as_believed = system.solved
    first = _first_look(system, simulator, fitted, observer, as_believed, again, by_model=by_model)
    if as_believed and (other := better_solved(first.fitter, _nearest(first), as_believed)):
        # what pieces suggest of joints that creep makes up for that
        simulator = _counted_on(other, first.fitter)
        first = _first_look(other, simulator, fitted, observer, as_believed, OTHERWISE, by_model=by_model)
    return first


def stretches_of(fitter: Fitter, episodes: Iterable[int]) -> tuple[int, ...]:
    """Return the positions of the stretches of some recorded episodes, in the order of those."""
    spans = fitter.measured.spans
    return tuple(i for e in episodes for i, s in enumerate(spans) if s.episode == e)


def _to_search(fitter: Fitter, episodes: Iterable[int], share: float) -> tuple[int, ...]:
    """Return the positions of stretches that tell enough of some recorded episodes, spread over long ones.

    What acts for a moment alone, a stop that is hit once or a push, may fall between them. So stretches of which the
    model as believed misses far more than is usual take the place of the nearest, up to half of them.

    Args:
        fitter: Of all stretches.
        episodes: Positions of the recorded ones.
        share: Of `AbstractSystem.searched_s`: how much is enough.
    """
    of, enough_s = stretches_of(fitter, episodes), share * fitter.system.searched_s
    total_s = sum(fitter.seconds(i) for i in of)
    count = max(min(SETTINGS.pieces.min_stretches, len(of)), int(len(of) * min(enough_s / total_s, 1.0)))
    chosen = spread_over(len(of), count)
    # a hit lets small errors grow to large ones: how much is missed tells nothing there of where something is missing
    if len(chosen) < len(of) and fitter.measured.scatter is None:
        chosen = _with_surprises(chosen, _missed(fitter, of))
    return tuple(of[i] for i in chosen)


def _missed(fitter: Fitter, stretches: Sequence[int]) -> NDArray[np.float64]:
    """Return what the model as believed misses of each of some stretches, whatever their start states: (n,).

    A mean square in noises, infinite where the motion is. What a measured start is off by, its derivatives take out.
    """
    missed = []
    for some in portions(fitter, stretches):
        fit = fitter.fit(NONE, some, iterations=0)
        for e, residual, q in zip(some, fit.residual, fit.basis.q, strict=True):
            left = project(residual, q)
            missed.append(left @ left / max(fitter.measured.count([e]), 1))
    return np.nan_to_num(np.array(missed), nan=np.inf, posinf=np.inf)


def _with_surprises(chosen: NDArray[np.int64], missed: NDArray[np.float64]) -> NDArray[np.int64]:
    """Let those that are missed by far more than is usual take the place of the nearest of the chosen ones.

    Args:
        chosen: Positions, ascending, (k,).
        missed: Mean square of what is missed of each, (n,).
    """
    places = list(chosen)
    surprises = [i for i in np.argsort(-missed) if missed[i] > SETTINGS.pieces.surprise_ratio * np.median(missed)]
    for i in (i for i in surprises[: len(chosen) // 2] if i not in chosen):
        nearest = min((p for p in places if p not in surprises), key=lambda p: abs(p - i))
        places[places.index(nearest)] = i
    return np.sort(np.array(places))


def unseen_only(found: Attempt) -> bool:
    """Whether the episodes left out show something that those which were fitted do not, or hardly."""
    confirmed, gap = found.confirmed, found.nominal_excess
    surprise = SETTINGS.held_out.surprise_ratio
    if confirmed.fails and confirmed.gap_unseen > surprise * max(gap, 0.0):
        return True
    seen, unseen = unknown_by_episodes(confirmed, gap, found.fitter)
    return seen < 0.5 < unseen and confirmed.excess_unseen > surprise * max(confirmed.excess_fitted, 0.0)


@dataclass(frozen=True)
class _FirstLook:
    """What is replayed in which stretches, the nominal model's fit to what is fitted, and where a search begins.

    `resting` has the noise as it shows where nothing moves, or in how samples differ: before any model was looked at.
    `as_believed` says how the model has it, see `AbstractSystem.solved`; `piles_up`, whether stretches are as short as
    they are as what the model lacks, or noise of what drives it, piles up over longer ones.
    """

    fitter: Fitter
    nominal: Fit
    beginning: Beginning | None
    resting: Measured
    as_believed: str
    flown: Flown | None = None
    piles_up: bool = False

    @property
    def noise_of_samples(self) -> bool:
        """Whether the noise is as samples differ, with nothing told of it by what a model leaves."""
        return self.fitter.measured.noise_model is self.resting.noise_model

    @property
    def seeds(self) -> Mapping[Key, WarmStart]:
        """What the look at pieces suggests to begin with."""
        return self.beginning.seeds if self.beginning else {}


def _first_look(
    system: AbstractSystem,
    simulator: AbstractSimulator,
    fitted: Sequence[int],
    observer: ProgressObserver,
    as_believed: str,
    again: str,
    *,
    by_model: bool,
) -> _FirstLook:
    """Fit the nominal model, tell the noise from what it leaves, and look at pieces where it goes astray.

    `by_model` says that the noise is told so however much that is, see `noise_account`.
    """
    observer.step(Step.MEASURING, again)
    root = Fitter(system, simulator, measure(system, scatter=system.scatter()), observer=observer)
    noisy = told_apart_from_noise(root)
    fitter = root.stretched(noisy or system.stretches())
    fitter, nominal = fit_nominal(fitter, _to_search(fitter, fitted, 1.0), by_model=by_model)
    observer.step(Step.SEARCHING, again)
    seen = look(fitter, nominal)
    first = _FirstLook(fitter, nominal, None, root.measured, as_believed, piles_up=bool(noisy))
    if seen is None:
        return first
    first = replace(first, beginning=seen.beginning, flown=seen.flown)
    spans: Sequence[Span] = root.pieces(seen.cut_s or np.inf, range(len(root.measured.values)))
    piles_up = seen.cut_s is not None and {s.episode for s in spans} == set(range(len(root.measured.values)))
    if not piles_up:
        first = replace(first, fitter=replace(fitter, measured=fitter.measured.without(seen.hung)))
        # what gets farther than the model as believed comes to turns that bend, or to what lets noise grow
        suggested = _suggested(first)
        noisy = told_apart_from_noise(replace(root, held=suggested)) if noisy else None
        spans = noisy or system.stretches(suggested)
        if len(spans) <= len(fitter.measured.spans):
            return first
    if fitter.simulator is not simulator:
        simulator.simulated_s += fitter.simulator.simulated_s
    fitter = root.stretched(spans)
    fitter, nominal = fit_nominal(
        fitter, _to_search(fitter, fitted, SETTINGS.pieces.unexplained_share if piles_up else 1.0), by_model=by_model
    )
    if piles_up:
        beginning = recut(seen.beginning, fitter, nominal)
    else:
        beginning = carried_over(seen.beginning, fitter, nominal.episodes)
    return replace(first, fitter=fitter, nominal=nominal, beginning=beginning, piles_up=piles_up)


def _suggested(first: _FirstLook) -> Effects:
    """Return the effects that are likeliest by what was looked at in pieces."""
    likeliest = next(iter(first.seeds.values()), None)
    return () if likeliest is None else likeliest.explanation.make(likeliest.x, first.fitter.context)


def _nearest(first: _FirstLook) -> Fit:
    """Return what leaves least so far: the nominal model, or what the look at pieces suggests to begin with."""
    seed = min(first.seeds.values(), key=lambda s: s.total, default=None)
    if seed is None or not seed.total < first.nominal.total:
        return first.nominal
    return first.fitter.fit(seed.explanation, first.nominal.episodes, x=seed.x, starts=seed.starts)


def _better_solved(fitter: Fitter, found: Search, as_believed: str) -> AbstractSystem | None:
    """Return the system solved so that what a search names leaves less, if any.

    Whether anything is to be named is not told yet.
    """
    named = next((c for c in found.contenders if c.fit.explanation.candidates), None)
    return None if named is None else better_solved(fitter, named.fit, as_believed)


def _solved_otherwise(fitter: Fitter, system: AbstractSystem) -> Fitter:
    """Return a fitter of the same stretches and noise with the same beliefs solved otherwise."""
    _counted_on(system, fitter)
    return fitter.with_system(system)


def _counted_on(system: AbstractSystem, fitter: Fitter) -> AbstractSimulator:
    """Return the simulator of a system; what was simulated before it counts, too."""
    simulator, before = system.simulator(), fitter.system.simulator()
    simulator.simulated_s += before.simulated_s
    if fitter.simulator is not before:
        simulator.simulated_s += fitter.simulator.simulated_s
    return simulator


def _open_again(found: Search, fitter: Fitter) -> Beginning:
    """Return where a search begins that tries again what was tried: solved otherwise it may lead elsewhere."""
    return replace(resumed(found, fitter), ruled_out=frozenset())


def _explained(first: _FirstLook, held_out: Sequence[int]) -> tuple[Fitter, Search]:
    """Search for the explanation; what noise there is shows in what the best one leaves, so look twice."""
    fitter, found = _searched(first)
    if materially_slower(fitter.measured, first.resting) and (other := _less_noise(first, fitter, found)):
        fitter.observer.step(Step.SEARCHING, "again with less slow noise")
        accounts = [(fitter, found), _searched(other)]
        fitter, found = accounts[int(np.argmax(account_densities([(f, s.best.fit) for f, s in accounts])))]
    if not found.best.fit.explanation.discontinuous:
        return fitter, found
    there = hanging(fitter, unseen(found.best, fitter, stretches_of(fitter, held_out), None))
    return replace(fitter, measured=fitter.measured.without(there)), found


def _less_noise(first: _FirstLook, fitter: Fitter, found: Search) -> _FirstLook | None:
    """Return where to search with less slow noise, if that accounts for more; None: it does not.

    What nothing explains yet passes for slow noise, beside which no explanation counts for much. So leaps are made from
    the likeliest beside the noise as it shows at rest, too: what is left where they lead is another account of the
    noise. Not where even the least own errors that a simulator may have beside any effect would be more, in every
    channel, than shows at rest: no leap leads to so little.
    """
    best, episodes = found.best.fit, found.best.fit.episodes
    if fitter.measured.hits(episodes):  # through a hit no linear model holds
        return None
    resting = replace(
        first.fitter.measured,
        sensor=first.resting.sensor,
        noise_model=first.resting.noise_model,
        odd_from=first.resting.odd_from,
    )
    still = replace(fitter, measured=resting)
    fit = still.fit(best.explanation, episodes, x=best.x, starts=best.starts)
    around = sensitivities(still, fit, directions(still.system))
    if (least_errors(fit, around, still) > 1.0).all():
        return None
    starts, steps = found.nominal.starts, SETTINGS.fit.nominal_steps
    fit = leapt(still, fit, still.fit(NONE, episodes, starts=starts, iterations=steps))
    left = left_by(fit, fit.explanation.make(fit.x, still.context), still)
    whiter = replace(still, measured=refine(resting, still.system, left))
    if not materially_slower(fitter.measured, whiter.measured):
        return None
    fit = whiter.fit(fit.explanation, episodes, x=fit.x, starts=fit.starts)
    before, after = account_densities([(fitter, best), (whiter, fit)])
    if after <= before:
        return None
    # beside more noise most single effects were not tried: they are open
    seeds = resumed(found, whiter).seeds
    if fit.explanation.candidates:
        seeds[key_of(fit.explanation)] = WarmStart(fit.explanation, fit.x, fit.starts, fit.total)
    nominal = whiter.fit(NONE, episodes, starts=starts, iterations=steps)
    return replace(first, fitter=whiter, nominal=nominal, beginning=Beginning(seeds, answered=True))


def _searched(first: _FirstLook) -> tuple[Fitter, Search]:
    """Search, and once more where what the best explanation leaves shows other noise, by then solved as it tells."""
    fitter, nominal = first.fitter, first.nominal
    # what hangs on a breakaway, by what the pieces suggested, is not forgotten by the noise
    measured = replace(fitter.measured, hung={})
    episodes = nominal.episodes
    found = search(fitter, episodes, starts=nominal.starts, beginning=first.beginning)
    best = found.best.fit
    if best.explanation.discontinuous:
        measured = fitter.measured.without(hanging(fitter, best))
    # without static friction nothing hangs on a breakaway, whatever the pieces suggested
    effects = best.explanation.make(best.x, fitter.context)
    again = refine(measured, fitter.system, left_by(best, effects, fitter))
    left = fitter.measured.excess(best.total, best.episodes)
    # where much is left that nothing explains, it is not noise
    if left < fitter.system.cut_from and (again.hung != fitter.measured.hung or materially_different(measured, again)):
        was, fitter = fitter.measured, replace(fitter, measured=again)
        fitter.observer.step(Step.SEARCHING, "again with the noise that the best so far leaves")
        other = _better_solved(fitter, found, first.as_believed)
        if other is None and again.hung == was.hung and not has_hidden(best, was, again):
            return fitter, weighed_again(found, fitter)
        beginning = resumed(found, fitter, first.beginning)
        if other:
            fitter = _solved_otherwise(fitter, other)
            beginning = _open_again(found, fitter)
        found = search(fitter, episodes, starts=found.nominal.starts, beginning=beginning)
    return fitter, found


def _without_outliers(fitter: Fitter, found: Search, held_out: Sequence[int]) -> Fitter:
    """Leave out of what was not fitted what sticks out of its neighbours by the likeliest explanation."""
    best = found.best
    effects, starts = best.fit.explanation.make(best.fit.x, fitter.context), start_states(best, fitter, held_out)
    left = {e: residual_of(fitter, e, effects, start) for e, start in starts.items()}
    return replace(fitter, measured=without_outliers(fitter.measured, left))
