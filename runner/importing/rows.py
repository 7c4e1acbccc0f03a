"""One episode as rows of a table: series put in order, then on common times.

Commands are held until their next sample, or are the mean of the line or curve to it; where samples are lost see
`runner.importing.lost`. Channels keep their own samples where rows stand at all times of all series, or go to the
nearest of even rows, or are interpolated where the map puts rows elsewhere, but not over gaps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import PPoly

from runner.errors import RecordingError
from runner.importing.clocks import NS
from runner.importing.entries import Role
from runner.importing.episodes import Cut, Series
from runner.importing.lost import through, with_lost
from runner.importing.map_file import ALL, EVEN, NEAREST, RowKeys
from runner.importing.points import with_points
from runner.importing.signals import Integers
from runner.importing.told import Told
from runner.numerics.arrays import FloatArray

GAP_STEPS = 2.5  # of a channel's own median steps: over longer gaps nothing is interpolated
HELD_STEPS = 5.0  # a command that is held for more of its own steps is worth a note
MOVED = 0.02  # of a row: stamps that are rounded to milliseconds move by as much, which need not be said
NEAR = 0.1  # rows nearer than this share of the usual step are worth a note
FEWEST_ROWS = 3  # of an episode
MOST_LOST = 0.1  # of the samples of a command: with more of them no numbers, the log may leave out what has not changed
MOST_ROWS = 30.0  # per sample: more than a log is made finer by on purpose, less than units of a clock differ by


@dataclass(frozen=True, eq=False)
class Rows:
    """An episode: its number if the log gives one, times since its start, and a column for each entry."""

    number: int | None
    t_s: FloatArray
    columns: dict[str, FloatArray]


def in_order(one: Series, told: Told) -> Series:
    """Return a series in the order of its stamps, one sample each: of several the one that arrived last."""
    name = one.signal.name
    order = np.argsort(one.t_ns, kind="stable")
    fell = int(np.sum(np.diff(one.t_ns) < 0))
    told.add("{names}: {n} samples were out of order and put into it", fell, column=name)
    t = one.t_ns[order]
    last = np.append(np.diff(t) > 0, True) if len(t) else np.empty(0, dtype=bool)
    again = "{names}: {n} samples have the stamp of another; the one that arrived last was kept"
    told.add(again, int(np.sum(~last)), column=name)
    return Series(one.entry, one.signal, one.at[order][last], t[last], one.values[order][last])


def _stated(one: Series, told: Told, *, sparse: bool) -> Series:
    """Return a command with the samples that are numbers: of a few that are none, each was lost.

    Raises:
        RecordingError: If many are none: then nothing tells what was commanded.
    """
    bad = ~np.isfinite(one.values)
    if bad.any() and not sparse and bad.mean() <= MOST_LOST:
        told.add("{names}: no number in {n} samples, which count as lost", int(bad.sum()), column=one.entry.column)
        return one.where(~bad)
    if bad.any():
        first = int(np.argmax(bad))
        many = f" ({int(bad.sum())} of {len(bad)} samples)" if bad.sum() > 1 else ""
        raise RecordingError(
            f"{one.entry.key}: signal '{one.signal.name}' is no number in sample {int(one.at[first]) + 1}{many}; a "
            "command must be known at nearly all times. If empty cells mean no new value: `log: {sparse: true}` in the "
            "map."
        )
    return one


def _known(series: Sequence[Series], keys: RowKeys, told: Told, *, sparse: bool) -> list[Series]:
    """Return all series, checked: a command is a number, or in rows that may be lost one that was not written down."""
    if keys.at == NEAREST:
        return [one.where(np.isfinite(one.values)) if one.entry.role is Role.COMMAND else one for one in series]
    return [_stated(one, told, sparse=sparse) if one.entry.role is Role.COMMAND else one for one in series]


def rows(episode: Cut, keys: RowKeys, told: Told, *, sparse: bool) -> Rows | None:
    """Return an episode as rows; None if too little is left of it, which is noted.

    Args:
        episode: Its series.
        keys: How rows are made of them.
        told: What was done.
        sparse: Whether a command without a sample holds: then none was lost.

    Raises:
        RecordingError: If a command is not a number, or a series has no samples.
    """
    moving = [one.entry for one in episode.series if one.entry.between.moves_on]
    if sparse and moving:
        key = f"{moving[0].key}.between: {moving[0].between.value}"
        raise RecordingError(f"{key}: in a sparse log an empty cell means that nothing has changed.")
    pointed = episode.series if sparse else with_points(episode.series, told)
    series = [in_order(one, told) for one in _known(pointed, keys, told, sparse=sparse)]
    if not sparse:
        series = [with_lost(one, told) if one.entry.role is Role.COMMAND else one for one in series]
    if any(not len(one.t_ns) for one in series if one.entry.role is Role.COMMAND) or not any(
        len(one.t_ns) for one in series if one.entry.role is Role.CHANNEL
    ):
        told.add("{n} episodes are left out: a command, or all channels, have no samples in them", 1)
        return None
    times = _times(series, keys)
    commands = [one for one in series if one.entry.role is Role.COMMAND]
    measured = [one for one in series if one.entry.role is Role.CHANNEL and len(one.t_ns)]
    samples = np.unique(np.concatenate([one.t_ns for one in measured]))
    known = max((int(one.t_ns[0]) for one in commands), default=int(samples[0]))
    if known > samples[-1]:
        told.add("{n} episodes are left out: a command comes after the last measurement", 1)
        return None
    first, last = int(samples[np.searchsorted(samples, known)]), int(samples[-1])
    beyond = NS / keys.rate_hz / 2 if keys.at == NEAREST and keys.rate_hz is not None else 0.0
    kept = times[(times >= first) & (times <= last + beyond)]
    late = (first - int(samples[0])) / NS
    late_said = "{n} episodes begin later, when every command has come once, and count their times from there: by up to"
    told.add(f"{late_said} {{largest}} s", late > 0, late)
    if len(kept) < FEWEST_ROWS:
        told.add(
            f"{{n}} episodes are left out: they have fewer than {FEWEST_ROWS} rows (has `clock` the right unit, are "
            "`episodes` told the right way?)",
            1,
        )
        return None
    steps = np.diff(kept)
    if keys.at == ALL:
        near = int(np.sum(steps < NEAR * np.median(steps)))
        told.add(
            "{n} rows follow the one before by less than a tenth of the usual step, as streams are stamped apart", near
        )
    columns = {}
    for one in series:
        if one.entry.role is Role.COMMAND:
            of = _means if one.entry.between.moves_on else _held
            columns[one.entry.column] = of(_moved(one, kept) if keys.at == NEAREST else one, kept, told)
        else:
            columns[one.entry.column] = CHANNELS.get(keys.at, _interpolated)(one, kept, told)
    return Rows(episode.number, (kept - kept[0]) / NS, columns)


def _times(series: list[Series], keys: RowKeys) -> Integers:
    if keys.at == ALL:
        return np.unique(np.concatenate([one.t_ns for one in series]))
    if keys.at in (EVEN, NEAREST):
        assert keys.rate_hz is not None
        measured = [one.t_ns for one in series if one.entry.role is Role.CHANNEL and len(one.t_ns)]
        _check_rate(series, keys.rate_hz)
        first, last = min(t[0] for t in measured), max(t[-1] for t in measured)
        beyond = 0.5 if keys.at == NEAREST else 1e-6  # the last sample may be nearest to a row after it
        count = int((last - first) / NS * keys.rate_hz + beyond) + 1
        return first + np.round(np.arange(count) * NS / keys.rate_hz).astype(np.int64)
    (own,) = [one for one in series if one.entry.column == keys.at]
    return own.t_ns if len(own.t_ns) else np.zeros(1, dtype=np.int64)


def _check_rate(series: list[Series], rate_hz: float) -> None:
    """Refuse to make hardly anything but empty rows."""
    channels = [one for one in series if one.entry.role is Role.CHANNEL and len(one.t_ns) > 1]
    steps_s = [float(np.median(np.diff(one.t_ns))) / NS for one in channels]
    if steps_s and min(steps_s) * rate_hz > MOST_ROWS:
        often = channels[int(np.argmin(steps_s))]
        raise RecordingError(
            f"rows.rate_hz: {rate_hz:g} makes rows {1 / rate_hz:.3g} s apart, samples of '{often.signal.name}' "
            f"({often.entry.key}) are {min(steps_s):.3g} s apart: nearly all rows would be empty. Does `clock` have "
            "the right unit? Otherwise give a rate up to "
            f"{MOST_ROWS:g} times that of the samples."
        )


def _moved(one: Series, times: Integers) -> Series:
    """Return a command that comes as often as rows do with its samples at the rows that are nearest to them.

    A stamp that is rounded up is past its row by less than a millisecond, and held it would only come a row later.
    """
    step = _row_step_ns(times)
    if len(one.t_ns) < 2 or np.median(np.diff(one.t_ns)) <= step / 2:
        return one
    at = np.round((one.t_ns - times[0]) / step).astype(np.int64)
    # a row's own stamp where there is one: made anew it may be rounded up, past its row
    stamps = times[0] + np.round(at * step).astype(np.int64)
    inside = (at >= 0) & (at < len(times))
    stamps[inside] = times[at[inside]]
    return replace(one, t_ns=stamps)


def _row_step_ns(times: Integers) -> float:
    """Return the step of even rows: over all of them, as each stamp is rounded to a nanosecond."""
    return float(times[-1] - times[0]) / (len(times) - 1)


def _held(one: Series, times: Integers, told: Told) -> FloatArray:
    at = np.searchsorted(one.t_ns, times, side="right") - 1
    if len(one.t_ns) > FEWEST_ROWS:
        steps = np.diff(one.t_ns)
        age = (times - one.t_ns[at]) / NS
        usual = float(np.median(steps)) / NS
        long = age > HELD_STEPS * usual
        told.add(
            f"{{names}}: no new command for more than {HELD_STEPS:g} of its usual steps before {{n}} rows; "
            "held for up to {largest} s",
            int(long.sum()),
            float(age.max(initial=0.0)),
            column=one.entry.column,
        )
    return one.values[at]


def _means(one: Series, times: Integers, told: Told) -> FloatArray:
    """Return the mean of what goes through samples from each row to the next; in the last row its value.

    Over gaps of several of its steps nothing says how it went on: there it is held.
    """
    held, between = _held(one, times, told), one.entry.between
    if len(one.t_ns) < 2 or len(times) < 2:
        return held
    t, at, values = (one.t_ns - times[0]) / NS, (times - times[0]) / NS, one.values
    ends = np.append(np.flatnonzero(np.diff(t) > GAP_STEPS * np.median(np.diff(t))), len(t) - 1)
    pieces = np.zeros((4, len(t)))  # of degree 3 and below from each sample on: held, until it is known better
    pieces[-1] = values
    for first, last in zip([0, *ends[:-1] + 1], ends, strict=True):
        if last > first:
            c = through(t[first : last + 1], values[first : last + 1], between).c
            pieces[-len(c) :, first:last] = c
    whole = PPoly(pieces, np.append(t, max(at[-1], t[-1]) + 1.0))
    out = np.append(np.diff(whole.antiderivative()(at)) / np.diff(at), whole(at[-1]))
    moved = float(np.abs(out - held).max())
    unit = f" {one.entry.si_unit}" if one.entry.si_unit else ""
    said = f"{{names}}: means of the {between.value} between samples, up to {{largest}}{unit} from what would be held"
    told.add(said, moved > 0.0, moved, column=one.entry.column)
    return out


def _nearest(one: Series, times: Integers, told: Told) -> FloatArray:
    """Return in each row the sample that is nearest to it, NaN where none is within half a row."""
    out = np.full(len(times), np.nan)
    step = _row_step_ns(times)
    at = np.round((one.t_ns - times[0]) / step).astype(np.int64)
    off = np.abs(one.t_ns - times[0] - at * step)
    inside = np.flatnonzero((at >= 0) & (at < len(times)) & (2 * off <= step))
    inside = inside[np.argsort(-off[inside], kind="stable")]  # of two at one row the nearer one comes last and stays
    out[at[inside]] = one.values[inside]
    moved = float(off[inside].max(initial=0.0)) / NS
    said = "{names}: samples moved to even rows by up to {largest} s"
    told.add(said, moved > MOVED * step / NS, moved, column=one.entry.column)
    return out


def _own(one: Series, times: Integers, told: Told) -> FloatArray:
    """Return the samples at their own times, NaN between them."""
    out = np.full(len(times), np.nan)
    at = np.searchsorted(times, one.t_ns)
    inside = (at < len(times)) & (times[np.minimum(at, len(times) - 1)] == one.t_ns)
    out[at[inside]] = one.values[inside]
    return out


def _interpolated(one: Series, times: Integers, told: Told) -> FloatArray:
    """Return values between samples, NaN over gaps and beyond the ends."""
    has = np.isfinite(one.values)
    t, values = one.t_ns[has], one.values[has]
    if len(t) < 2:
        return np.full(len(times), np.nan)
    after = np.clip(np.searchsorted(t, times, side="left"), 1, len(t) - 1)
    gap = (t[after] - t[after - 1]).astype(float)
    exact = (times == t[after]) | (times == t[after - 1])
    out = np.interp(times.astype(float), t.astype(float), values)
    lost = ~exact & ((gap > GAP_STEPS * np.median(np.diff(t))) | (times < t[0]) | (times > t[-1]))
    between = ~exact & ~lost
    name = one.entry.column
    told.add("{names}: interpolated between samples in {n} rows", int(between.sum()), column=name)
    told.add("{names}: not measured near {n} rows, NaN there", int(lost.sum()), column=name)
    out[lost] = np.nan
    return out


CHANNELS = {ALL: _own, NEAREST: _nearest}  # how channels come to the rows; interpolated to all others
