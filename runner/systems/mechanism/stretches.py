"""Over how long a mechanism's model can be replayed so that a comparison with the recording means something.

An inverted or a double pendulum amplifies every small difference until it is as large as the motion itself. A fit over
longer than that descends a landscape of hollows, and what it ends in says nothing. So recordings are cut where the
response to a small force ceases to be in proportion to it, or leads too far away: linear sensitivities hold within such
stretches, which is what fits, evidence and standard errors rest on. Beyond that they are so short that some of every
episode can be searched.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from runner.numerics.arrays import FloatArray, spread_over
from runner.recording import Span
from runner.settings import SETTINGS
from runner.systems.channels import Signals
from runner.systems.initial import AbstractInitialState
from runner.systems.mechanism.flights import into_impacts
from runner.systems.mechanism.settings import MECHANISM
from runner.systems.mechanism.simulator import MechanismSimulator
from runner.systems.windows import Windows


@dataclass(frozen=True)
class Sensitive:
    """What responds, more or less in proportion, to a small force.

    Args:
        simulator: Of the recording.
        initial: Its start states.
        usual: Usual generalised force of each degree of freedom, (nv,).
        signals: What was measured.
    """

    simulator: MechanismSimulator
    initial: AbstractInitialState
    usual: FloatArray
    signals: Signals


@dataclass(frozen=True)
class Cut:
    """The parts of a recording that models are replayed over.

    `bends`: whether over longer ones the response to a small force is out of proportion; otherwise it is for the sake
    of time alone that they are no longer.
    """

    spans: tuple[Span, ...]
    bends: bool


def stretches(known: Sensitive, searched_s: float) -> Cut:
    """Return the parts of a recording over which the believed model responds in proportion: episodes cut evenly.

    Args:
        known: The recording.
        searched_s: So much of it is searched: they are so short that this holds some of every episode.
    """
    signals, limits = known.signals, MECHANISM.replay
    lengths = [len(v) for v in signals.values]
    periods_s = np.array([e.step_s for e in known.simulator.recording.episodes])
    whole = tuple(Span(e, 0, n) for e, n in enumerate(lengths))
    longest_s = float(max((n - 1) * p for n, p in zip(lengths, periods_s, strict=True)))
    at_most_s = float(np.clip(searched_s / len(lengths), limits.shared_length_s, limits.max_length_s))
    length_s = longest_s / max(1, int(np.ceil(longest_s / at_most_s - 1e-6)))
    by_episode = np.full(len(lengths), length_s)
    for alike in _of_one_clock(periods_s):
        by_episode[alike] = _lengths_s(known, alike, length_s)
    parts = []
    for e, n in enumerate(lengths):
        edges = np.linspace(0, n, max(1, round((n - 1) * periods_s[e] / by_episode[e])) + 1).round().astype(int)
        parts += [Span(e, int(a), int(b)) for a, b in pairwise(edges)]
    there = np.any([v.any(axis=0) for v in signals.valid], axis=0)
    least = SETTINGS.fit.min_start_samples
    told = [s for s in parts if (signals.valid[s.episode][s.begin : s.end, there].sum(axis=0) >= least).all()]
    if {s.episode for s in told} != set(range(len(lengths))):
        return Cut(whole, bends=False)
    return Cut(tuple(told), bends=bool((by_episode < length_s).any()))


def _of_one_clock(periods_s: FloatArray) -> list[list[int]]:
    """Return the positions of episodes in groups whose sample periods are about the same."""
    groups: list[list[int]] = []
    for e in np.argsort(periods_s, kind="stable"):
        if groups and periods_s[e] < MECHANISM.replay.same_clock * periods_s[groups[-1][0]]:
            groups[-1].append(int(e))
        else:
            groups.append([int(e)])
    return groups


def _lengths_s(known: Sensitive, episodes: Sequence[int], length_s: float) -> FloatArray:
    """Return how long stretches of each of some episodes of one clock are, (E,): so long at most.

    One episode may swing about rest, another one over the top.
    """
    out, limits = dict.fromkeys(episodes, length_s), MECHANISM.replay
    unsure, shortest_s = list(episodes), SETTINGS.pieces.min_length_s
    while length_s > shortest_s and unsure:
        windows = _windows(known.simulator, length_s, unsure)
        share = _bent(known, windows)
        # an episode that is shorter than a window is like the others
        over = {e: _median(share[windows.episode == e]) for e in set(windows.episode.tolist())}
        others = _median(share)
        length_s = max(length_s / 2, shortest_s)
        unsure = [e for e in unsure if over.get(e, others) > limits.max_bent]
        out |= dict.fromkeys(unsure, length_s)
    return np.array([out[e] for e in episodes])


def survey_step_s(known: Sensitive, spans: Sequence[Span]) -> float:
    """Return the longest physics step with which these parts of a recording answer a small force as they do in fits."""
    simulator, period_s = known.simulator, known.simulator.recording.step_s
    chosen = [spans[i] for i in spread_over(len(spans), MECHANISM.replay.probed_windows)]
    samples = min(len(range(s.begin, s.end)) for s in chosen)
    windows = Windows(np.array([s.episode for s in chosen]), np.array([s.begin for s in chosen]), samples)
    if samples < SETTINGS.fit.min_start_samples:
        return simulator.step_s
    exact = _responses(known, windows, simulator)
    for step_s in _longer_steps(period_s, simulator.step_s):
        off = _norm(_responses(known, windows, simulator.stepping(step_s)) - exact)
        if _median(np.nan_to_num(off / np.maximum(_norm(exact), 1e-9), nan=np.inf)) < MECHANISM.replay.survey_change:
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


def _responses(known: Sensitive, windows: Windows, simulator: MechanismSimulator) -> FloatArray:
    """Return how a small force on each degree of freedom changes what is shown, in noises, (W, D, n, C)."""
    starts = known.initial.guess_windows(known.signals, windows, smooth=True)
    forces = np.vstack([np.zeros(len(known.usual)), np.diag(MECHANISM.replay.large_force * known.usual)])
    with np.errstate(invalid="ignore", over="ignore"):
        shown = simulator.predict_windows((), windows, np.repeat(starts[:, None], len(forces), axis=1), forces)
        return (shown[:, 1:] - shown[:, :1]) / known.signals.sigma


def impact_stretches(known: Sensitive, found: Sequence[Sequence[Span]], lying: Sequence[Span]) -> tuple[Span, ...]:
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
        if len(windows) and _median(_bent(known, windows)) <= limits.max_bent_by_impacts:
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
    return _spread(np.array(fits, dtype=int).reshape(-1, 2), after + before)


def _bent(known: Sensitive, windows: Windows) -> FloatArray:
    """Return which share of the response to a force is out of proportion in windows, (W, D); NaN: none is seen."""
    signals, usual, limits = known.signals, known.usual, MECHANISM.replay
    starts = known.initial.guess_windows(signals, windows, smooth=True)
    d = len(usual)
    sizes = (limits.small_force, limits.large_force)
    forces = np.vstack([np.zeros(d), *(np.diag(size * usual) for size in sizes)])
    with np.errstate(invalid="ignore", over="ignore"):
        shown = known.simulator.predict_windows((), windows, np.repeat(starts[:, None], len(forces), axis=1), forces)
        change = (shown[:, 1:] - shown[:, :1]) / signals.sigma
        small, large = change[:, :d] * (sizes[1] / sizes[0]), change[:, d:]
        off, size = (_norm(x) for x in (large - small, np.where(np.isfinite(large), large, small)))
    size = np.maximum(size, _norm(small))
    share = np.where(np.isfinite(off) & np.isfinite(size), off / np.maximum(size, 1e-9), 1.0)
    share = np.maximum(share, limits.max_bent / limits.max_strayed * _strayed(large, signals, windows))
    # what cannot be seen in the noise is out of no proportion
    return np.where(size < np.sqrt(windows.samples), np.nan, share)


def _strayed(change: FloatArray, signals: Signals, windows: Windows) -> FloatArray:
    """Return how far changes (W, D, n, C), in noises, lead away: of how much the farthest channel moved at all, (W, D).

    A slide that nothing holds, or a pendulum that is balanced on its head, answers a force in proportion for long, and
    is elsewhere by then.
    """
    moved = np.nanstd(
        np.concatenate([np.where(v, x, np.nan) for x, v in zip(signals.values, signals.valid, strict=True)]), axis=0
    )
    valid = np.array(
        [signals.valid[e][f : f + windows.samples] for e, f in zip(windows.episode, windows.first, strict=True)]
    )
    moved = np.where(moved > 0, moved / signals.sigma, np.inf)
    squares = np.where(valid[:, None], change**2, 0.0).sum(axis=2) / np.maximum(valid.sum(axis=1), 1)[:, None]
    return np.nan_to_num(np.sqrt(squares) / moved, nan=np.inf).max(axis=2)


def _median(share: FloatArray) -> float:
    """Return the median of what is seen; 0.0 where nothing is."""
    return float(np.nanmedian(share)) if np.isfinite(share).any() else 0.0


def _norm(change: FloatArray) -> FloatArray:
    """Return the length of changes (W, D, n, C), where there are values: (W, D)."""
    return np.sqrt((change**2).sum(axis=(2, 3)))


def _windows(simulator: MechanismSimulator, length_s: float, chosen: Sequence[int]) -> Windows:
    """Return windows of one length, spread over some episodes of one clock."""
    lengths = {k: len(simulator.recording.episodes[k]) for k in chosen}
    period_s = min(simulator.recording.episodes[k].step_s for k in chosen)
    samples = min(round(length_s / period_s) + 1, max(lengths.values()))
    fits = [(k, f) for k, n in lengths.items() for f in range(0, n - samples + 1, samples)]
    return _spread(np.array(fits, dtype=int).reshape(-1, 2), samples)


def _spread(index: FloatArray, samples: int) -> Windows:
    """Return some windows of those with these episodes and first samples, (W, 2), spread over all."""
    return Windows(index[:, 0], index[:, 1], samples).some(MECHANISM.replay.probed_windows)


__all__ = ["Cut", "Sensitive", "impact_stretches", "stretches"]
