"""What a position and its velocity say of each other, and what stands out of either, in a line each."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence

import numpy as np

from runner.recording.data import WARNING
from runner.recording.kinematics import Follows, follows, is_noise, jumps, lone_samples, steps_alone, stuck
from runner.recording.table import Table
from runner.settings import SETTINGS

MOTION = SETTINGS.motion

SCALES = {
    1000.0: "is one of them in thousandths?",
    0.001: "is one of them in thousandths?",
    180 / np.pi: "is the first in degrees?",
    np.pi / 180: "is the second in degrees/s?",
}


def follows_of(table: Table, spans: Iterable[slice], position: str, velocity: str) -> Follows:
    """Compare two columns where both are measured; each stretch without a gap is one of its own."""
    parts = [
        (table["t"][part], table[position][part], table[velocity][part])
        for part in _whole(table, spans, position, velocity)
    ]
    return follows(*zip(*parts, strict=True)) if parts else Follows(0.0, 0.0, 0.0, 0.0, 0.0)


def apart(found: Follows, enough: float) -> bool:
    """Whether a position plainly moves, or its velocity says so, and one is not the integral of the other."""
    return (
        max(found.moved, found.due) > enough
        and found.unexplained > MOTION.apart_share
        and found.correlation < 1 - MOTION.apart_share
    )


def lone_notes(table: Table, spans: Iterable[slice], name: str, unit: str, least: float) -> list[str]:
    """Return a note on samples of a column that are off their neighbours by more than `least`."""
    rows = [
        (part.start + k, float(values[k] - (values[k - 1] + values[k + 1]) / 2))
        for part in _whole(table, spans, name)
        for values in [table[name][part]]
        for k in lone_samples(values)
    ]
    return _most(
        [found for found in rows if abs(found[1]) > least],
        lambda row, off: f"'{name}' is off by {off:.4g} {unit} for one sample at {place(table, row)}",
    )


def alone_notes(
    table: Table, spans: Iterable[slice], position: str, unit: str, *, least: float, enough: float
) -> list[str]:
    """Return notes on a position whose velocity is not measured: steps that no motion belongs to, noise.

    Args:
        table: Of which.
        spans: Rows of each episode.
        position: Column, in `unit`.
        unit: m or rad.
        least: Smaller steps than this are not told.
        enough: Less motion than this says nothing.
    """
    leaps: list[tuple[int, float]] = []
    restless, moved = [], 0.0
    for part in _whole(table, spans, position):
        values = table[position][part]
        leaps += [(part.start + k, off) for k, off in steps_alone(table["t"][part], values) if abs(off) > least]
        restless.append(is_noise(values))
        moved = max(moved, float(np.std(values)))
    if restless and all(restless) and moved > enough:
        return [f"{WARNING}'{position}' is another one at each sample, as noise is and no motion"]
    return _most(leaps, lambda row, off: f"'{position}' jumps by {off:.4g} {unit} to {place(table, row)}")


def pair_notes(
    table: Table, spans: Sequence[slice], position: str, velocity: str, unit: str, *, least: float, enough: float
) -> list[str]:
    """Return notes on where a position and its velocity contradict each other: jumps, values that stick, a drift.

    Args:
        table: Of which.
        spans: Rows of each episode.
        position: Column, in `unit`.
        velocity: Column, in `unit` per second.
        unit: m or rad.
        least: Smaller jumps than this are not told.
        enough: Less motion than this says nothing.
    """
    leaps: list[tuple[int, float]] = []
    held: dict[str, list[tuple[int, int, float]]] = {position: [], velocity: []}
    for part in _whole(table, spans, position, velocity):
        t, p, v = table["t"][part], table[position][part], table[velocity][part]
        alone = {k + side for k in lone_samples(p) for side in (0, 1)}
        leaps += [(part.start + k, off) for k, off in jumps(t, p, v) if k not in alone and abs(off) > least]
        for name, values in ((position, p), (velocity, v)):
            held[name] += [(part.start + a, part.start + b, by) for a, b, by in stuck(t, values, p, v, enough)]
    notes = _most(
        leaps, lambda row, off: f"'{position}' jumps by {off:.4g} {unit} to {place(table, row)}; '{velocity}' does not"
    )
    for name, other in ((position, velocity), (velocity, position)):
        lasting = {a: b for a, b, _ in held[name]}
        notes += _most(
            [(a, by) for a, _, by in held[name]],
            lambda row, by, name=name, other=other, lasting=lasting: (
                f"'{name}' keeps one value for {table['t'][lasting[row]] - table['t'][row]:.3g} s from "
                f"{place(table, row)} on, while '{other}' says otherwise, by {abs(by):.3g} {unit}"
            ),
        )
    found = follows_of(table, spans, position, velocity)
    if not notes and apart(found, enough):
        notes.append(
            f"{WARNING}'{position}' does not follow '{velocity}': of its change {min(found.unexplained, 9.99):.0%} is "
            "not the integral of that"
        )
    if found.scaled and max(found.moved, found.due) > enough:
        notes.append(
            f"{WARNING}'{position}' changes {found.gain:.3g} times as much as '{velocity}' says{scale_hint(found.gain)}"
        )
    if found.drifts and max(found.moved, found.due) > enough:
        notes.append(
            f"{WARNING}'{position}' drifts by {found.drift:.3g} {unit}/s from the integral of '{velocity}', in all "
            "episodes: one of them has an offset"
        )
    return notes


def scale_hint(gain: float) -> str:
    """Return what another scale of a position or a velocity probably is, in brackets; "" if none is known."""
    known = (text for factor, text in SCALES.items() if abs(gain / factor - 1) < MOTION.scale_share)
    return f" ({text})" if (text := next(known, "")) else ""


def _whole(table: Table, spans: Iterable[slice], *names: str) -> Iterator[slice]:
    """Yield the stretches in which all of these columns are measured, of three samples and more."""
    for span in spans:
        there = np.isfinite(table.stack(names)[span]).all(axis=1)
        edges = np.flatnonzero(np.diff(np.concatenate([[False], there, [False]]).astype(int)))
        for a, b in edges.reshape(-1, 2):
            if b - a >= 3:
                yield slice(int(span.start + a), int(span.start + b))


def _most(rows: Sequence[tuple[int, float]], text: Callable[[int, float], str]) -> list[str]:
    """Return a warning of what is off most, and how many more there are."""
    if not rows:
        return []
    more = f", and {len(rows) - 1} more" if len(rows) > 1 else ""
    return [f"{WARNING}{text(*max(rows, key=lambda found: abs(found[1])))}{more}"]


def place(table: Table, row: int) -> str:
    """Return where a row is, in words."""
    return f"data row {row + 1} (episode {table['episode'][row]:g}, t = {table['t'][row]:.6g} s)"
