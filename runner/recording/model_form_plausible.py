"""What a recording of a mechanism can't be, told from its channels alone; see `runner.recording.plausible`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from runner.numerics.arrays import FloatArray
from runner.recording.data import WARNING
from runner.recording.model_form_mapping import ChannelSource, ModelMapping
from runner.recording.plausible_pairs import alone_notes, follows_of, lone_notes, pair_notes
from runner.recording.table import Table
from runner.settings import SETTINGS

MOTION = SETTINGS.motion

# less motion than this, of a position in its unit, says nothing; a lone sample has to be off by a part of it
MOVED = {"rad": MOTION.moved_rad, "m": MOTION.moved_m}


def note_channels(table: Table, spans: Sequence[slice], mapping: ModelMapping) -> list[str]:
    """Return what is odd: channels that are dead, do not follow their velocities, or are far off for one sample.

    Raises:
        RecordingError: If a position never changes while its velocity says that it moves, or the other way round.
    """
    notes = []
    for position, velocity in _pairs(mapping):
        enough, found = MOVED[position.unit], follows_of(table, spans, position.name, velocity.name)
        for still, other, moves in (
            (position, velocity, found.due > enough),
            (velocity, position, found.moved > enough),
        ):
            if moves and _never_changes(table[still.name]):
                raise table.error(
                    f"channel '{still.name}' never changes, while '{other.name}' says that '{still.target}' moves: a "
                    "dead channel? Take it out of nominal.yaml."
                )
        if found.moved > enough and found.correlation < -MOTION.min_correlation:
            notes.append(f"{WARNING}'{position.name}' and '{velocity.name}' have opposite signs")
        else:
            least, unit = MOTION.spike_share * enough, position.unit
            notes += pair_notes(table, spans, position.name, velocity.name, unit, least=least, enough=enough)
    paired = {position.name for position, _ in _pairs(mapping)}
    for source in mapping.sources:
        if source.quantity == "position" and source.unit in MOVED and source.name not in paired:
            least, enough = MOTION.spike_share * MOVED[source.unit], MOVED[source.unit]
            notes += alone_notes(table, spans, source.name, source.unit, least=least, enough=enough)
    rate_hz = 1 / float(np.median(np.concatenate([np.diff(table["t"][span]) for span in spans])))
    for source in mapping.sources:
        per_s = source.quantity == "velocity"
        unit = source.unit.removesuffix("/s")
        if source.quantity in ("position", "velocity") and unit in MOVED:
            least = MOTION.spike_share * MOVED[unit] * (rate_hz if per_s else 1.0)
            notes += lone_notes(table, spans, source.name, source.unit, least)
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
