"""What a recording of a box can't be, told from its motion and its forces alone.

Positions are the integral of velocities, axis by axis; the force that the motion needs lies along the force that was
commanded, and is about as large; a body gains no more energy than it is given; a channel that never changes measures
nothing; a sample far off both its neighbours is none. Where nothing sensible can follow the recording is refused;
everything else is said in one line each. On sound recordings (24 practice cases) the gains are 0.75 to 1.2, the
directions agree within 10 degrees, and at most 3 % of a displacement is unexplained.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from runner.recording.data import Form, Nominal
from runner.recording.plausible_forces import force_notes, measured_notes
from runner.recording.plausible_pairs import apart, follows_of, lone_notes, pair_notes
from runner.recording.plausible_pin import pin_force_notes, pin_notes
from runner.recording.table import POSE, TWIST, Table
from runner.settings import SETTINGS

MOTION = SETTINGS.motion

PAIRS = tuple(zip(POSE[Form.PLANAR], TWIST[Form.PLANAR], strict=True))
UNITS = {"x": "m", "y": "m", "yaw": "rad", "vx": "m/s", "vy": "m/s", "wz": "rad/s"}


def _in_one_step(table: Table, spans: Sequence[slice], twist: str) -> float:
    """Return the longest way, or turn, from one sample to the next by a velocity."""
    steps = [np.abs(table[twist][s][:-1] * np.diff(table["t"][s])).max(initial=0.0) for s in spans]
    return float(max(steps, default=0.0))


def check_motion(table: Table, spans: Sequence[slice], nominal: Nominal) -> None:
    """Refuse channels that are dead, exchanged or mirrored; to be called before units are looked at.

    Raises:
        RecordingError: Naming the columns and what they seem to be.
    """
    measured = [name for pair in PAIRS for name in pair]
    still = [name for name in measured if np.ptp(table[name]) == 0]
    if len(still) == len(measured) and len(table) >= MOTION.min_samples:
        raise table.error(f"nothing was measured: {_named(measured)} never change.")
    enough = {"x": _metres(nominal), "y": _metres(nominal), "yaw": MOTION.moved_rad}
    found = {pair: follows_of(table, spans, *pair) for pair in PAIRS}
    for (pose, twist), found_of in found.items():
        # between two samples it may have stopped
        if pose in still and found_of.due > enough[pose] + _in_one_step(table, spans, twist):
            raise table.error(f"column '{pose}' never changes, while '{twist}' says that it moves: a dead channel?")
        # a body that glides on has a velocity that never changes, too: the slope of its position
        if twist in still and found_of.moved > enough[pose] and found_of.unexplained > MOTION.apart_share:
            raise table.error(f"column '{twist}' never changes, while '{pose}' does: a dead channel?")
    if not any(apart(found[pair], enough[pair[0]]) for pair in PAIRS[:2]):
        return
    if _would(table, spans, [(twist, pose) for pose, twist in PAIRS[:2]], 0.0):
        raise table.error("'x', 'y' and 'vx', 'vy' seem to be exchanged: the first are the rates of the second.")
    if _would(table, spans, [("y", "vx"), ("x", "vy")], enough["x"]):
        raise table.error("'x' follows 'vy' and 'y' follows 'vx': two of these columns are exchanged.")
    for pair, other in (PAIRS[:2], PAIRS[1::-1]):
        mirrored = found[pair].correlation < -MOTION.min_correlation and found[pair].moved > enough["x"]
        if mirrored and not apart(found[other], enough["x"]):
            raise table.error(f"'{pair[0]}' and '{pair[1]}' have opposite signs: one of them is mirrored.")


def note_motion(table: Table, spans: Sequence[slice], nominal: Nominal) -> None:
    """Note samples that stand alone, positions that do not follow their velocities, and forces that do not fit."""
    limits = {"x": _metres(nominal), "y": _metres(nominal), "yaw": MOTION.moved_rad}
    size = MOTION.spike_half_sizes * max(nominal.half_size_m)
    least = dict.fromkeys(UNITS, size) | {"yaw": MOTION.spike_rad}
    for name in ("vx", "vy"):
        least[name] = size * nominal.rate_hz
    least["wz"] = MOTION.spike_rad * nominal.rate_hz
    for name, limit in least.items():
        table.notes.extend(lone_notes(table, spans, name, UNITS[name], limit))
    for pose, twist in PAIRS:
        enough, limit = limits[pose], least[pose]
        table.notes.extend(pair_notes(table, spans, pose, twist, UNITS[pose], least=limit, enough=enough))
    moves = not any(apart(follows_of(table, spans, *pair), limits[pair[0]]) for pair in PAIRS)
    if nominal.pin is not None:  # what a pin does with a body does not follow from its force
        table.notes.extend(pin_notes(table, nominal.pin, nominal) + pin_force_notes(table, spans))
    elif moves:
        table.notes.extend(force_notes(table, spans, nominal) or measured_notes(table, spans))


def _would(table: Table, spans: Sequence[slice], pairs: Iterable[tuple[str, str]], enough: float) -> bool:
    """Whether columns would follow one another if they were paired like this."""
    found = [follows_of(table, spans, *pair) for pair in pairs]
    return all(f.unexplained < MOTION.together_share and f.moved > enough for f in found)


def _metres(nominal: Nominal) -> float:
    return MOTION.moved_half_sizes * max(nominal.half_size_m)


def _named(names: Iterable[str]) -> str:
    return ", ".join(f"'{name}'" for name in names)
