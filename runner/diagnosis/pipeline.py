"""From a recording to a verdict: where the gap lies, which effect explains it, how far it shrinks."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from runner.diagnosis.abstention import abstention
from runner.diagnosis.advice import found_rivals, next_push
from runner.diagnosis.attempt import attempt, unseen_only
from runner.diagnosis.closure import close, left_by_episode
from runner.diagnosis.engine_steps import said_of_engine_steps
from runner.diagnosis.flights import flights_alone
from runner.diagnosis.known import contradicted
from runner.diagnosis.notes import doubts, notes
from runner.diagnosis.ranking import contender_of, ranking, with_equals
from runner.diagnosis.result import Diagnosis
from runner.diagnosis.split import split
from runner.inference.contender import nominal_of
from runner.inference.doubts import needed, unsure_effects
from runner.inference.least_squares import Fit
from runner.inference.outside import said_of_outside
from runner.inference.unseen import start_states, unseen
from runner.localise.dated import dated_disturbances
from runner.localise.regimes import closure_by_regime
from runner.localise.where import localise
from runner.localise.windows import check_length
from runner.noise.measured import measure
from runner.progress import UNOBSERVED, ProgressObserver, Step
from runner.systems.base import AbstractSystem
from runner.systems.recorded import Recorded


def _starts(*fits: Fit) -> dict[int, np.ndarray]:
    """Return the start state of each stretch that was fitted, by its position."""
    return {e: start for fit in fits for e, start in zip(fit.episodes, fit.starts, strict=True)}


def diagnose(
    system: AbstractSystem, *, threads: int | None = None, advise: bool = True, observer: ProgressObserver = UNOBSERVED
) -> Diagnosis:
    """Diagnose a recording.

    Args:
        system: What was commanded and measured, and what the owner believes.
        threads: For the simulations; None: one per core.
        advise: Whether to try what could be taken for the answer, and which push would tell; neither has a say in it.
        observer: Is told what the diagnosis is at.

    Raises:
        RecordingError: If it has fewer than two episodes, or too little in them.
    """
    began, began_cpu = time.perf_counter(), time.process_time()
    system = system.roughly()
    simulator = system.simulator(threads=threads)
    recording: Recorded = system.recording
    as_believed = system.solved
    fitted, held_out = split([e.index for e in recording.episodes])
    check_length(system)
    found = attempt(system, simulator, fitted, held_out, observer)
    if turned := unseen_only(found) and len(fitted) > len(held_out):
        fitted, held_out = (*fitted[len(held_out) :], *held_out), fitted[: len(held_out)]
        before_s = found.fitter.system.simulator().simulated_s
        system = found.fitter.system.roughly()
        simulator = system.simulator(threads=threads)
        simulator.simulated_s = before_s
        again = "again with the first episodes held out"
        found = attempt(system, simulator, fitted, held_out, observer, again)
    fitter, confirmed = found.fitter, found.confirmed
    system = fitter.system
    simulator = system.simulator(threads=threads)
    searched, before = confirmed.search, confirmed.before
    ranked = ranking(confirmed, found.nominal_excess, fitter)
    # what is named is what is put into the corrected model
    top = contender_of(searched, next(r for r in ranked if r.effects != ("unknown",)), fitter.context)
    after = confirmed.after.get(id(top.fit)) or unseen(top, fitter, before.episodes, before)
    effects = top.fit.explanation.make(top.fit.x, fitter.context)
    nominal_starts = _starts(searched.nominal, before)
    corrected_starts = _starts(top.fit, after)
    if rest := found.not_searched:
        nominal_starts |= start_states(nominal_of(searched.contenders), fitter, rest)
        corrected_starts |= start_states(top, fitter, rest)
    flights = flights_alone(found.flown, ranked, simulator)
    observer.step(Step.LOCATING)
    measured = fitter.measured.joined(measure(system, scatter=system.scatter())) if found.in_parts else fitter.measured
    where = localise(system, measured, nominal_starts, stretches=found.stretches)
    regimes = closure_by_regime(system, measured, found.held_out, effects, where.window_s)
    foretold = [e for e in found.of(found.held_out) if e not in confirmed.astray]
    replayed = {e: (nominal_starts[e], corrected_starts[e]) for e in foretold}
    closure = close(replayed, fitter.measured, fitter, effects, regimes)
    errors = next((r.errors for r in ranked if r.values == effects), {})
    ranked = tuple(replace(r, gap_closed=closure.gap_closed) if r.values == effects else r for r in ranked)
    disturbances = dated_disturbances(system, simulator, effects, measured) if system.dates_disturbances else ()
    corrected = effects, measured, corrected_starts, found.stretches
    helps = abstention(ranked, confirmed, fitter, where, corrected)
    if advise:
        observer.step(Step.TRYING)
    near = found_rivals(top, searched, fitter) if advise else ()
    false = contradicted(searched, fitter) if advise else ""
    ranked = with_equals(ranked, top, near, system.context)
    return Diagnosis(
        case=recording.path.name,
        system=system,
        ranked=ranked,
        abstain=ranked[0].effects == ("unknown",),
        gap_closed=closure.gap_closed,
        effects=system.as_told(effects, errors),
        fitted=found.fitted,
        held_out=found.held_out,
        stretches=found.stretches,
        measured=measured,
        nominal_starts=nominal_starts,
        corrected_starts=corrected_starts,
        where=where,
        closure=closure,
        excess=confirmed.excess,
        nominal_excess=found.nominal_excess,
        drive_excess=confirmed.by_drive.most,
        left_by_episode=left_by_episode((top.fit, after), fitter),
        wall_s=time.perf_counter() - began,
        cpu_s=time.process_time() - began_cpu,
        simulated_s=simulator.simulated_s,
        next_push=next_push(ranked, searched, near, fitter, threads) if advise else None,
        rivals=near,
        abstention=helps,
        flights=flights,
        disturbances=disturbances,
        doubts=(
            *doubts(
                system,
                measured,
                top,
                unsure_effects(top, searched.contenders, system.context),
                {c.name for c in needed(top, searched.contenders, fitter.measured.count(top.fit.episodes))},
            ),
            *([false] if false else []),
        ),
        notes=notes(
            system,
            measured,
            found.held_out,
            stretched=found.said_of_stretches,
            turned=turned,
            astray=[found.stretches[e] for e in confirmed.astray],
            outside=[
                *(() if system.solved == as_believed else (f"Simulated with {system.solved}.",)),
                *said_of_engine_steps(system, measured, effects, corrected_starts, found.stretches),
                *said_of_outside(searched, system),
                *(d.sentence for d in disturbances),
            ],
        ),
    )
