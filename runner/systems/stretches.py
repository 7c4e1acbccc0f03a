"""Over how long a model can be replayed so that a comparison with the recording means something.

An inverted or a double pendulum amplifies every small difference until it is as large as the motion itself; so does
what is pushed off its middle, and turns one way or the other by a hair's breadth. A fit over longer than that
descends a landscape of hollows, and what it ends in says nothing: any two numbers that happen to steer through a turn
win over the one that is right. So recordings are cut where the response to a small force ceases to be in proportion to
it, or leads too far away: linear sensitivities hold within such stretches, which is what fits, evidence and standard
errors rest on (multiple shooting, Bock 1983).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Generic, TypeVar

import numpy as np

from runner.effects.base import Effects
from runner.numerics.arrays import FloatArray
from runner.recording import Span
from runner.settings import SETTINGS
from runner.systems.channels import Signals
from runner.systems.initial import AbstractInitialState
from runner.systems.recorded import Recorded
from runner.systems.simulator import AbstractSimulator
from runner.systems.windows import Windows

S_co = TypeVar("S_co", bound=AbstractSimulator, covariant=True)


@dataclass(frozen=True)
class Sensitive(Generic[S_co]):
    """What responds, more or less in proportion, to a small force.

    Args:
        recording: All of it.
        simulator: Of the recording.
        initial: Its start states.
        usual: Usual generalised force of each degree of freedom, (D,).
        signals: What was measured.
        effects: What is in the model.
    """

    recording: Recorded
    simulator: S_co
    initial: AbstractInitialState
    usual: FloatArray
    signals: Signals
    effects: Effects = ()


@dataclass(frozen=True)
class Cut:
    """The parts of a recording that models are replayed over.

    `bends`: whether over longer ones the response to a small force is out of proportion; otherwise it is for the sake
    of time alone that they are no longer.
    """

    spans: tuple[Span, ...]
    bends: bool


def cut(known: Sensitive[AbstractSimulator], at_most_s: float = np.inf) -> Cut:
    """Return the parts of a recording over which a model responds in proportion: episodes cut evenly.

    Args:
        known: The recording and the model.
        at_most_s: They are no longer.
    """
    signals = known.signals
    lengths = [len(v) for v in signals.values]
    periods_s = np.array([e.step_s for e in known.recording.episodes])
    whole = tuple(Span(e, 0, n) for e, n in enumerate(lengths))
    longest_s = float(max((n - 1) * p for n, p in zip(lengths, periods_s, strict=True)))
    length_s = longest_s / max(1, int(np.ceil(longest_s / at_most_s - 1e-6)))
    by_episode = np.full(len(lengths), length_s)
    for alike in _of_one_clock(periods_s):
        by_episode[alike] = _lengths_s(known, alike, length_s)
    parts = []
    for e, n in enumerate(lengths):
        edges = np.linspace(0, n, max(1, round((n - 1) * periods_s[e] / by_episode[e])) + 1).round().astype(int)
        parts += [Span(e, int(a), int(b)) for a, b in pairwise(edges)]
    told = _told(parts, signals)
    return Cut(told or whole, bends=bool(told) and bool((by_episode < length_s).any()))


def halved(known: Sensitive[AbstractSimulator]) -> tuple[Span, ...]:
    """Return the parts of a recording over which a model responds in proportion: what does not is halved.

    Each is looked at by itself, so that those before and after a turn that bends stay long; for that all of the
    recording is simulated several times, which is little where there are a few minutes of one body.
    """
    episodes, shortest_s = known.recording.episodes, SETTINGS.pieces.min_length_s
    whole = [Span(e, 0, len(v)) for e, v in enumerate(known.signals.values)]
    settled, unsure = list[Span](), whole
    while unsure:
        halves = list[Span]()
        for span, share in zip(unsure, _each(known, unsure), strict=True):
            middle = (span.begin + span.end) // 2
            longer = (middle - span.begin) * episodes[span.episode].step_s >= shortest_s
            if share > SETTINGS.stretches.max_bent_of_one and longer:
                halves += [Span(span.episode, span.begin, middle), Span(span.episode, middle, span.end)]
            else:
                settled.append(span)
        unsure = halves
    parts = sorted(settled, key=lambda s: (s.episode, s.begin))
    return _told(parts, known.signals) or tuple(whole)


def _each(known: Sensitive[AbstractSimulator], spans: Sequence[Span]) -> FloatArray:
    """Return which share of the response to a force is out of proportion in each part of a recording, (n,)."""
    out, samples = np.zeros(len(spans)), np.array([s.end - s.begin for s in spans])
    for count in np.unique(samples):
        alike = np.flatnonzero(samples == count)
        begins = np.array([(spans[i].episode, spans[i].begin) for i in alike])
        for some, windows in Windows(begins[:, 0], begins[:, 1], int(count)).chunks(SETTINGS.stretches.probed_windows):
            out[alike[some]] = [median(share) for share in bent(known, windows)]
    return out


def _told(parts: Sequence[Span], signals: Signals) -> tuple[Span, ...]:
    """Return those parts of a recording that a start can be told in; none if that leaves nothing of an episode."""
    there = np.any([v.any(axis=0) for v in signals.valid], axis=0)
    least = SETTINGS.fit.min_start_samples
    told = [s for s in parts if (signals.valid[s.episode][s.begin : s.end, there].sum(axis=0) >= least).all()]
    return tuple(told) if {s.episode for s in told} == set(range(len(signals.values))) else ()


def _of_one_clock(periods_s: FloatArray) -> list[list[int]]:
    """Return the positions of episodes in groups whose sample periods are about the same."""
    groups: list[list[int]] = []
    for e in np.argsort(periods_s, kind="stable"):
        if groups and periods_s[e] < SETTINGS.stretches.same_clock * periods_s[groups[-1][0]]:
            groups[-1].append(int(e))
        else:
            groups.append([int(e)])
    return groups


def _lengths_s(known: Sensitive[AbstractSimulator], episodes: Sequence[int], length_s: float) -> FloatArray:
    """Return how long stretches of each of some episodes of one clock are, (E,): so long at most.

    One episode may swing about rest, another one over the top.
    """
    out, limits = dict.fromkeys(episodes, length_s), SETTINGS.stretches
    unsure, shortest_s = list(episodes), SETTINGS.pieces.min_length_s
    while length_s > shortest_s and unsure:
        windows = _windows(known.recording, length_s, unsure)
        share = bent(known, windows)
        # an episode that is shorter than a window is like the others
        over = {e: median(share[windows.episode == e]) for e in set(windows.episode.tolist())}
        others = median(share)
        length_s = max(length_s / 2, shortest_s)
        unsure = [e for e in unsure if over.get(e, others) > limits.max_bent]
        out |= dict.fromkeys(unsure, length_s)
    return np.array([out[e] for e in episodes])


def bent(known: Sensitive[AbstractSimulator], windows: Windows) -> FloatArray:
    """Return which share of the response to a force is out of proportion in windows, (W, D); NaN: none is seen."""
    signals, usual, limits = known.signals, known.usual, SETTINGS.stretches
    starts = known.initial.guess_windows(signals, windows, smooth=True)
    d = len(usual)
    sizes = (limits.small_force, limits.large_force)
    forces = np.vstack([np.zeros(d), *(np.diag(size * usual) for size in sizes)])
    with np.errstate(invalid="ignore", over="ignore"):
        shown = known.simulator.predict_windows(
            known.effects, windows, np.repeat(starts[:, None], len(forces), axis=1), forces
        )
        change = (shown[:, 1:] - shown[:, :1]) / signals.sigma
        small, large = change[:, :d] * (sizes[1] / sizes[0]), change[:, d:]
        off, size = (norm(x) for x in (large - small, np.where(np.isfinite(large), large, small)))
    size = np.maximum(size, norm(small))
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


def median(share: FloatArray) -> float:
    """Return the median of what is seen; 0.0 where nothing is."""
    return float(np.nanmedian(share)) if np.isfinite(share).any() else 0.0


def norm(change: FloatArray) -> FloatArray:
    """Return the length of changes (W, D, n, C), where there are values: (W, D)."""
    return np.sqrt((change**2).sum(axis=(2, 3)))


def _windows(recording: Recorded, length_s: float, chosen: Sequence[int]) -> Windows:
    """Return windows of one length, spread over some episodes of one clock."""
    lengths = {k: len(recording.episodes[k]) for k in chosen}
    period_s = min(recording.episodes[k].step_s for k in chosen)
    samples = min(round(length_s / period_s) + 1, max(lengths.values()))
    fits = [(k, f) for k, n in lengths.items() for f in range(0, n - samples + 1, samples)]
    return spread(np.array(fits, dtype=int).reshape(-1, 2), samples)


def spread(index: FloatArray, samples: int) -> Windows:
    """Return some windows of those with these episodes and first samples, (W, 2), spread over all."""
    return Windows(index[:, 0], index[:, 1], samples).some(SETTINGS.stretches.probed_windows)
