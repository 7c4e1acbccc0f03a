"""What a recording of a mechanism can't be, told from its channels alone; see `runner.recording.plausible`."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from runner.numerics.arrays import FloatArray
from runner.recording.data import WARNING
from runner.recording.kinematics import APART, Follows, follows, lone_samples
from runner.recording.model_form_mapping import ChannelSource, ModelMapping
from runner.recording.table import Table

# less motion than this, of a position in its unit, says nothing; a lone sample has to be off by a part of it
MOVED = {"rad": 0.1, "m": 0.02}
SPIKE = 0.5
OPPOSITE = -0.9


def note_channels(table: Table, spans: Sequence[slice], mapping: ModelMapping) -> list[str]:
    """Return what is odd: channels that are dead, do not follow their velocities, or are far off for one sample.

    Raises:
        RecordingError: If a position never changes while its velocity says that it moves, or the other way round.
    """
    notes = []
    for position, velocity in _pairs(mapping):
        enough, found = MOVED[position.unit], _follows(table, spans, position.name, velocity.name)
        for still, other, moves in (
            (position, velocity, found.due > enough),
            (velocity, position, found.moved > enough),
        ):
            if moves and _never_changes(table[still.name]):
                raise table.error(
                    f"channel '{still.name}' never changes, while '{other.name}' says that '{still.target}' moves: a "
                    "dead channel? Take it out of nominal.yaml."
                )
        if found.moved > enough and found.correlation < OPPOSITE:
            notes.append(f"{WARNING}'{position.name}' and '{velocity.name}' have opposite signs")
        elif max(found.moved, found.due) > enough and found.unexplained > APART and found.correlation < 1 - APART:
            notes.append(
                f"{WARNING}'{position.name}' does not follow '{velocity.name}': of its change "
                f"{min(found.unexplained, 9.99):.0%} is not the integral of that"
            )
    for source in mapping.sources:
        if source.quantity == "position" and source.unit in MOVED:
            notes += _spikes(table, spans, source)
    return notes


def _pairs(mapping: ModelMapping) -> list[tuple[ChannelSource, ChannelSource]]:
    """Return the channels that are position and velocity of one thing."""
    velocities = {(s.kind, s.target, s.index): s for s in mapping.sources if s.quantity == "velocity"}
    positions = [s for s in mapping.sources if s.quantity == "position" and s.unit in MOVED]
    keys = [(s.kind, s.target, s.index) for s in positions]
    return [(s, velocities[key]) for s, key in zip(positions, keys, strict=True) if key in velocities]


def _never_changes(values: FloatArray) -> bool:
    finite = values[np.isfinite(values)]
    return len(finite) > 0 and float(np.ptp(finite)) == 0.0


def _follows(table: Table, spans: Iterable[slice], position: str, velocity: str) -> Follows:
    """Compare where both are measured; each stretch without a gap is one of its own."""
    parts = [
        (t, p, v)
        for span in spans
        for t, p, v in _whole(table["t"][span], table[position][span], table[velocity][span])
    ]
    return follows(*zip(*parts, strict=True)) if parts else Follows(0.0, 0.0, 0.0, 0.0, 0.0)


def _whole(
    t: FloatArray, position: FloatArray, velocity: FloatArray
) -> list[tuple[FloatArray, FloatArray, FloatArray]]:
    return [(t[s], position[s], velocity[s]) for s in _stretches(np.isfinite(position) & np.isfinite(velocity))]


def _stretches(there: np.ndarray) -> list[slice]:
    """Return the stretches without a gap, of three samples and more."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], there, [False]]).astype(int)))
    return [slice(int(a), int(b)) for a, b in edges.reshape(-1, 2) if b - a >= 3]


def _spikes(table: Table, spans: Iterable[slice], source: ChannelSource) -> list[str]:
    least, rows = SPIKE * MOVED[source.unit], []
    for span in spans:
        values = table[source.name][span]
        for part in _stretches(np.isfinite(values)):
            for k in (part.start + k for k in lone_samples(values[part])):
                off = float(values[k] - (values[k - 1] + values[k + 1]) / 2)
                if abs(off) > least:
                    rows.append((k + int(span.start), off))
    if not rows:
        return []
    row, off = max(rows, key=lambda found: abs(found[1]))
    place = f"data row {row + 1} (episode {table['episode'][row]:g}, t = {table['t'][row]:.6g} s)"
    more = f", and {len(rows) - 1} more" if len(rows) > 1 else ""
    return [f"{WARNING}'{source.name}' is off by {off:.4g} {source.unit} for one sample at {place}{more}"]
