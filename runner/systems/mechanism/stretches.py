"""Over which parts of its recording a mechanism's model is replayed, see `runner.systems.stretches`; and how finely.

They are so short, too, that some of every episode can be searched.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from runner.numerics.arrays import FloatArray, spread_over
from runner.recording import Span
from runner.settings import SETTINGS
from runner.systems.mechanism.flights import into_impacts
from runner.systems.mechanism.settings import MECHANISM
from runner.systems.mechanism.simulator import MechanismSimulator
from runner.systems.stretches import Cut, Sensitive, bent, cut, median, norm, spread
from runner.systems.windows import Windows


def replayed(known: Sensitive[MechanismSimulator], searched_s: float) -> Cut:
    """Return the parts of a recording that models are replayed over.

    Args:
        known: The recording.
        searched_s: So much of it is searched: they are so short that this holds some of every episode.
    """
    limits = MECHANISM.replay
    share_s = searched_s / len(known.signals.values)
    return cut(known, float(np.clip(share_s, limits.shared_length_s, limits.max_length_s)))


def survey_step_s(known: Sensitive[MechanismSimulator], spans: Sequence[Span]) -> float:
    """Return the longest physics step with which these parts of a recording answer a small force as they do in fits."""
    simulator, period_s = known.simulator, known.simulator.recording.step_s
    chosen = [spans[i] for i in spread_over(len(spans), SETTINGS.stretches.probed_windows)]
    samples = min(len(range(s.begin, s.end)) for s in chosen)
    windows = Windows(np.array([s.episode for s in chosen]), np.array([s.begin for s in chosen]), samples)
    if samples < SETTINGS.fit.min_start_samples:
        return simulator.step_s
    exact = _responses(known, windows, simulator)
    for step_s in _longer_steps(period_s, simulator.step_s):
        off = norm(_responses(known, windows, simulator.stepping(step_s)) - exact)
        if median(np.nan_to_num(off / np.maximum(norm(exact), 1e-9), nan=np.inf)) < MECHANISM.replay.survey_change:
            return step_s
    return simulator.step_s


def _longer_steps(period_s: float, than_s: float) -> list[float]:
    """Return steps that are longer than another, each about half of the one before: some or parts of a period."""
    steps, longest_s = [], MECHANISM.replay.max_survey_step_s
    while longest_s > than_s * (1 + 1e-9):
        some, parts = int(longest_s / period_s + 1e-9), int(np.ceil(period_s / longest_s - 1e-9))
        steps.append(some * period_s if some else period_s / parts)
        longest_s = 0.5 * steps[-1]
    return [s for s in steps if s > than_s * (1 + 1e-9)]


def _responses(known: Sensitive[MechanismSimulator], windows: Windows, simulator: MechanismSimulator) -> FloatArray:
    """Return how a small force on each degree of freedom changes what is shown, in noises, (W, D, n, C)."""
    starts = known.initial.guess_windows(known.signals, windows, smooth=True)
    forces = np.vstack([np.zeros(len(known.usual)), np.diag(SETTINGS.stretches.large_force * known.usual)])
    with np.errstate(invalid="ignore", over="ignore"):
        shown = simulator.predict_windows((), windows, np.repeat(starts[:, None], len(forces), axis=1), forces)
        return (shown[:, 1:] - shown[:, :1]) / known.signals.sigma


def impact_stretches(
    known: Sensitive[MechanismSimulator], found: Sequence[Sequence[Span]], lying: Sequence[Span]
) -> tuple[Span, ...]:
    """Return the parts of a recording from flights over as much of what follows as the model responds in proportion.

    Args:
        known: The recording.
        found: Flights of each episode.
        lying: When bodies lie still: that is told too.
    """
    limits = MECHANISM.replay
    after_s = limits.max_impact_s
    while after_s > limits.min_impact_s:
        windows = _from_flights(known.simulator, found, after_s)
        if len(windows) and median(bent(known, windows)) <= limits.max_bent_by_impacts:
            break
        after_s = max(after_s / 2, limits.min_impact_s)
    hits = into_impacts(known.simulator.recording, found, after_s)
    ends = {e: max(s.end for s in hits if s.episode == e) for e in {s.episode for s in hits}}
    still = [s for s in lying if s.begin >= ends.get(s.episode, 0)]
    return tuple(sorted((*hits, *still), key=lambda s: (s.episode, s.begin)))


def _from_flights(simulator: MechanismSimulator, found: Sequence[Sequence[Span]], after_s: float) -> Windows:
    """Return windows of one length from the last samples of flights until so long after them, spread over all."""
    episodes = simulator.recording.episodes
    after, before = max(1, round(after_s / simulator.recording.step_s)), SETTINGS.fit.min_start_samples
    fits = [(s.episode, s.end - before) for own in found for s in own if s.end + after <= len(episodes[s.episode])]
    return spread(np.array(fits, dtype=int).reshape(-1, 2), after + before)
