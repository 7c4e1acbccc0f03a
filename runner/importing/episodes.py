"""Where the episodes of a part begin: which samples of a series belong to which."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from runner.errors import RecordingError
from runner.importing.clocks import NS
from runner.importing.entries import Entry, Role
from runner.importing.map_file import By, EpisodeKeys
from runner.importing.signals import Integers, Part, Signal
from runner.numerics.arrays import FloatArray

PAUSE_S, PAUSE_STEPS = 1.0, 50  # a log that is silent for longer than both has likely been stopped between two runs
BACK = 0.1  # of the length of a part: stamps that fall back by more are a new start, not samples out of order


@dataclass(frozen=True, eq=False)
class Series:
    """What one entry reads: stamps and values in order of arrival.

    Args:
        entry: The column.
        signal: That it comes from.
        at: Which samples of the signal have a stamp, (T,).
        t_ns: Stamps, (T,).
        values: SI, (T,).
    """

    entry: Entry
    signal: Signal
    at: Integers
    t_ns: Integers
    values: FloatArray

    def where(self, mask: NDArray[np.bool_]) -> Series:
        """Return some of the samples."""
        return Series(self.entry, self.signal, self.at[mask], self.t_ns[mask], self.values[mask])


@dataclass(frozen=True, eq=False)
class Cut:
    """One episode of a part: its series, and a number if the log gives it one."""

    number: int | None
    series: tuple[Series, ...]


def cut(part: Part, series: list[Series], by: EpisodeKeys, stamps: Callable[[Signal], Integers | None]) -> list[Cut]:
    """Return the episodes of a part.

    Args:
        part: Of the log.
        series: All that is read of it.
        by: What the map says.
        stamps: Of a signal that counts the episodes, ns, if it has any.

    Raises:
        RecordingError: If stamps fall back far without a word of it in the map, or streams can't be cut alike.
    """
    if by.by is By.COLUMN:
        return _by_column(part, series, part.signal("episodes.signal", by.signal or ""), stamps)
    if by.by is By.RESTART:
        return _by_restart(part, series)
    for one in series:
        fall = _falls(one.t_ns)
        if len(fall):
            raise RecordingError(
                f"{part.name}: the stamps of signal '{one.signal.name}' fall back by "
                f"{(one.t_ns[fall[0] - 1] - one.t_ns[fall[0]]) / NS:.4g} s at sample {fall[0] + 1}; if an episode "
                "begins there, write `episodes: {by: restart}` in the map, or name the column that counts them."
            )
    return _by_gap(series, by.longer_than_s) if by.longer_than_s is not None else [Cut(None, tuple(series))]


def pauses(one: Cut) -> str | None:
    """Return a sentence on long times within an episode in which no channel is measured; None: there are none."""
    times = np.unique(np.concatenate([s.t_ns for s in one.series if s.entry.role is Role.CHANNEL]))
    steps = np.diff(times) / NS
    long = steps[steps > max(PAUSE_S, PAUSE_STEPS * float(np.median(steps)))] if len(steps) else steps
    if not len(long):
        return None
    return (
        f"nothing is measured for {long.min():.3g} s or longer {len(long)} time{'s' * (len(long) > 1)} within an "
        "episode; if a run ends there and another begins, write "
        f"`episodes: {{by: gap, longer_than_s: {long.min() / 2:.2g}}}` in the map"
    )


def _falls(t_ns: Integers) -> Integers:
    """Return the samples at which time falls back by much."""
    if len(t_ns) < 2:
        return np.empty(0, dtype=np.int64)
    return np.flatnonzero(np.diff(t_ns) < -BACK * (t_ns.max() - t_ns.min())) + 1


def _by_column(
    part: Part, series: list[Series], counter: Signal, stamps: Callable[[Signal], Integers | None]
) -> list[Cut]:
    """Cut where a signal says so: sample by sample in its own stream, by time in others."""
    numbers = counter.values
    broken = ~np.isfinite(numbers) | (numbers != np.round(numbers))
    if broken.any():
        raise RecordingError(
            f"episodes.signal: '{counter.name}' must count in whole numbers, got {numbers[np.argmax(broken)]:g} in "
            f"{part.name}, sample {int(np.argmax(broken)) + 1}."
        )
    times = stamps(counter)
    out = []
    for number in np.unique(numbers):
        mine = numbers == number
        own = []
        for one in series:
            if one.signal.stream == counter.stream and len(one.signal) == len(counter):
                own.append(one.where(mine[one.at]))
            elif times is not None:
                first, last = times[mine].min(), times[mine].max()
                own.append(one.where((one.t_ns >= first) & (one.t_ns <= last)))
            else:
                raise RecordingError(f"episodes.signal: '{counter.name}' has no time to cut '{one.signal.name}' by.")
        out.append(Cut(int(number), tuple(own)))
    return out


def _by_restart(part: Part, series: list[Series]) -> list[Cut]:
    """Cut where stamps fall back; every stream must do so equally often."""
    edges: Mapping[str, Integers] = {one.entry.column: _falls(one.t_ns) for one in series}
    counts = {name: len(e) + 1 for name, e in edges.items()}
    if len(set(counts.values())) > 1:
        few, many = min(counts, key=lambda n: counts[n]), max(counts, key=lambda n: counts[n])
        raise RecordingError(
            f"episodes: by restart, '{few}' has {counts[few]} in {part.name} and '{many}' {counts[many]}; their clocks "
            "do not start anew together."
        )
    pieces = []
    for one in series:
        bounds = np.searchsorted(edges[one.entry.column], np.arange(len(one.t_ns)), side="right")
        pieces.append([one.where(bounds == k) for k in range(counts[one.entry.column])])
    return [Cut(None, own) for own in zip(*pieces, strict=True)]


def _by_gap(series: list[Series], longer_than_s: float) -> list[Cut]:
    """Cut where no channel is measured for long; commands of before hold on into an episode."""
    times = np.unique(np.concatenate([one.t_ns for one in series if one.entry.role is Role.CHANNEL]))
    edges = np.flatnonzero(np.diff(times) > longer_than_s * NS)
    starts, ends = times[np.concatenate([[0], edges + 1])], times[np.concatenate([edges, [len(times) - 1]])]
    out = []
    for start, end in zip(starts, ends, strict=True):
        own = []
        for one in series:
            inside = (one.t_ns >= start) & (one.t_ns <= end)
            if one.entry.role is Role.COMMAND:
                before = np.flatnonzero(one.t_ns < start)
                if len(before):
                    inside[before[np.argmax(one.t_ns[before])]] = True
            own.append(one.where(inside))
        out.append(Cut(None, tuple(own)))
    return out
