"""A log and a map in, the table of a case out, with everything that was done to the samples."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from runner.errors import RecordingError, nearest
from runner.importing.box import with_whole_turns
from runner.importing.clocks import ClockReport, clock_of, nanoseconds, report
from runner.importing.entries import Entry, Plan, Role
from runner.importing.episodes import Cut, Series, cut, pauses
from runner.importing.map_file import ALL, EVEN, NEAREST, AnyMap, By
from runner.importing.plausible import check_plausible
from runner.importing.rows import Rows, rows
from runner.importing.signals import Clock, Integers, Log, Part, Signal
from runner.importing.told import Told


@dataclass(frozen=True, eq=False)
class Built:
    """A case, not yet written.

    Args:
        plan: Columns and `nominal.yaml`.
        table: `episode`, `t` and a column for each entry.
        clocks: How each clock ran.
        notes: What was done and what is odd, one sentence each.
        sources: Of each episode, by its number: the part of the log that it is from.
    """

    plan: Plan
    table: pd.DataFrame
    clocks: tuple[ClockReport, ...]
    notes: tuple[str, ...]
    sources: Mapping[int, str]


def build(log: Log, path: Path, wanted: AnyMap, planned: Plan) -> Built:
    """Return the case that a map makes of a log.

    Args:
        log: What was read.
        path: The map, for messages.
        wanted: What it says.
        planned: What that makes.

    Raises:
        RecordingError: Naming the map's key, the signal, and what is there or allowed.
    """
    names = (ALL, EVEN, NEAREST, *(entry.column for entry in planned.entries))
    if wanted.rows.at not in names:
        raise RecordingError(f"{path}: rows.at: unknown '{wanted.rows.at}'. {nearest(wanted.rows.at, names)}")
    told = Told()
    cuts: list[Cut] = []
    parts: list[str] = []
    try:
        for part in log.parts:
            cuts += _episodes(part, planned.entries, wanted, told)
            parts += [part.name] * (len(cuts) - len(parts))
        clocks = _reports(cuts, log, wanted)
        each = [rows(_aligned(one), wanted.rows, told, sparse=wanted.log.sparse) for one in cuts]
        made = [r for r in each if r is not None]
        if not made:
            raise RecordingError(f"no episode is left: {'; '.join(told.sentences())}.")
        table = _table(made, planned, told)
        left = (name for name, r in zip(parts, each, strict=True) if r is not None)
        sources = dict(zip(pd.unique(table["episode"]).tolist(), left, strict=True))
        stopped = [note for one in cuts if wanted.episodes.by is By.PART and (note := pauses(one)) is not None]
        notes = [*log.notes, *told.sentences(), *stopped[:1], *_odd(table, planned)]
    except RecordingError as error:
        raise RecordingError(f"{path}: {error}") from None
    return Built(planned, table, clocks, tuple(notes), sources)


def _odd(table: pd.DataFrame, planned: Plan) -> list[str]:
    if planned.mapping is None or planned.model is None:
        return []
    return check_plausible(table, planned, planned.mapping, planned.model)


def _episodes(part: Part, entries: Sequence[Entry], wanted: AnyMap, told: Told) -> list[Cut]:
    """Return the episodes of a part, with stamps on one origin."""
    signals = [part.signal(entry.key, entry.signal) for entry in entries]
    chosen = [clock_of(e.key, part, s, wanted.clock, e.clock)[1] for e, s in zip(entries, signals, strict=True)]
    counter = part.signals.get(wanted.episodes.signal or "")
    counting = _optional_clock(part, counter, wanted)
    unit = wanted.clock.unit if wanted.clock is not None else "s"
    stamps, stamped = nanoseconds([*chosen, *([counting] if counting is not None else [])], unit)
    series = []
    for entry, signal, t_ns, has in zip(entries, signals, stamps, stamped, strict=False):
        told.add("{names}: {n} samples have no time and are left out", int(np.sum(~has)), column=signal.name)
        one = Series(entry, signal, np.flatnonzero(has), t_ns, entry.si(signal.values[has]))
        series.append(one.where(np.isfinite(one.values)) if wanted.log.sparse else one)
    times: Integers | None = stamps[-1] if counting is not None else None
    return cut(part, series, wanted.episodes, lambda _: times)


def _optional_clock(part: Part, counter: Signal | None, wanted: AnyMap) -> Clock | None:
    """Return the clock of the signal that counts episodes, if every sample of it has a time."""
    if counter is None:
        return None
    try:
        clock = clock_of("episodes.signal", part, counter, wanted.clock, None)[1]
    except RecordingError:
        return None
    return clock if bool(np.isfinite(clock.stamps).all()) else None


def _reports(cuts: Sequence[Cut], log: Log, wanted: AnyMap) -> tuple[ClockReport, ...]:
    """Return how the clock of each stream ran; of a table whose columns have samples of their own, of each of those."""
    runs: dict[str, dict[tuple[str, tuple[int, ...]], tuple[str, list[Integers]]]] = {}
    part = log.parts[0]
    for k, entry in enumerate(e.entry for e in cuts[0].series):
        name = clock_of(entry.key, part, part.signal(entry.key, entry.signal), wanted.clock, entry.clock)[0]
        stamps = [one.series[k].t_ns for one in cuts]
        stream = cuts[0].series[k].signal.stream
        runs.setdefault(stream, {}).setdefault((name, tuple(map(len, stamps))), (entry.column, stamps))
    found = []
    for stream, clocks in runs.items():
        for (name, lengths), (column, stamps) in clocks.items():
            if any(lengths):
                found.append(report(stream if len(clocks) == 1 else f"{stream}: {column}", name, stamps))
    return tuple(found)


def _aligned(one: Cut) -> Cut:
    """Return an episode in which quaternions do not flip their sign from sample to sample, so that they interpolate."""
    groups: dict[str, list[Series]] = {}
    for series in one.series:
        if _is_quaternion(series.entry):
            groups.setdefault(series.entry.key, []).append(series)
    turned: dict[str, Series] = {}
    for key, four in groups.items():
        if len({len(s.t_ns) for s in four}) > 1 or any(not np.array_equal(s.t_ns, four[0].t_ns) for s in four):
            raise RecordingError(f"{key}: the four signals of an orientation must be sampled together.")
        q = np.stack([s.values for s in four], axis=1)
        whole = np.flatnonzero(np.isfinite(q).all(axis=1))
        dots = np.sum(q[whole[1:]] * q[whole[:-1]], axis=1)
        q[whole[1:]] *= np.cumprod(np.where(dots < 0, -1.0, 1.0))[:, None]
        for k, s in enumerate(four):
            turned[s.entry.column] = Series(s.entry, s.signal, s.at, s.t_ns, q[:, k])
    return Cut(one.number, tuple(turned.get(s.entry.column, s) for s in one.series)) if turned else one


def _is_quaternion(entry: Entry) -> bool:
    return entry.role is Role.CHANNEL and entry.column.endswith(("_w", "_x", "_y", "_z")) and entry.si_unit == ""


def _table(made: Sequence[Rows], planned: Plan, told: Told) -> pd.DataFrame:
    """Return all episodes below each other; their numbers are the log's where those rise."""
    numbers = [r.number for r in made if r.number is not None]
    rising = len(numbers) == len(made) and sorted(set(numbers)) == numbers
    told.add("{n} episodes are numbered anew, in the order of the log", len(numbers) * (not rising))
    frames = []
    for k, r in enumerate(made):
        number = numbers[k] if rising else k
        frames.append(pd.DataFrame({"episode": np.full(len(r.t_s), number, dtype=np.int64), "t": r.t_s, **r.columns}))
    table = pd.concat(frames, ignore_index=True)
    if planned.mapping is None:
        return with_whole_turns(table)
    for group in planned.mapping.orientations:
        q = table[list(group.columns)].to_numpy()
        length = np.linalg.norm(q, axis=1)
        bad = (length < 0.9) | (length > 1.1)
        if bad.any():
            row = int(np.argmax(bad))
            raise RecordingError(
                f"channels.{group.name}: must be quaternions of unit length, got length {length[row]:.4g} "
                f"({int(bad.sum())} of {len(q)} rows); are these the right signals?"
            )
        table[list(group.columns)] = q / length[:, None]
    return table
