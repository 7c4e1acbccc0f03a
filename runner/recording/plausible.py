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

from runner.numerics.arrays import FloatArray
from runner.recording.data import WARNING, Form, Nominal
from runner.recording.kinematics import APART, TOGETHER, Follows, follows, lone_samples
from runner.recording.table import POSE, TWIST, Table

PAIRS = tuple(zip(POSE[Form.PLANAR], TWIST[Form.PLANAR], strict=True))
UNITS = {"x": "m", "y": "m", "yaw": "rad", "vx": "m/s", "vy": "m/s", "wz": "rad/s"}
MOVED_HALF_SIZES, MOVED_RAD = 0.05, 0.1  # less than this says nothing
SPIKE_HALF_SIZES, SPIKE_RAD = 0.02, 0.02  # and per sample for velocities
GAIN = 5.0  # believed masses and frictions are off by less
TURNED_DEG = 45.0
BLOCK_S, LEAST_BLOCKS = 0.1, 20
SLIDES_M_S = 0.05
EXPLAINED = 0.3  # of the needed force, by the commanded one: below it says nothing
MANY = 50  # fewer samples may all be the same by rounding
CERTAIN = 5.0  # standard deviations


def check_motion(table: Table, spans: Sequence[slice], nominal: Nominal) -> None:
    """Refuse channels that are dead, exchanged or mirrored; to be called before units are looked at.

    Raises:
        RecordingError: Naming the columns and what they seem to be.
    """
    measured = [name for pair in PAIRS for name in pair]
    still = [name for name in measured if np.ptp(table[name]) == 0]
    if len(still) == len(measured) and len(table) >= MANY:
        raise table.error(f"nothing was measured: {_named(measured)} never change.")
    enough = {"x": _metres(nominal), "y": _metres(nominal), "yaw": MOVED_RAD}
    found = {pair: _follows(table, spans, *pair) for pair in PAIRS}
    for (pose, twist), found_of in found.items():
        if pose in still and found_of.due > enough[pose]:
            raise table.error(f"column '{pose}' never changes, while '{twist}' says that it moves: a dead channel?")
        # a body that glides on has a velocity that never changes, too: the slope of its position
        if twist in still and found_of.moved > enough[pose] and found_of.unexplained > APART:
            raise table.error(f"column '{twist}' never changes, while '{pose}' does: a dead channel?")
    if not any(_apart(found[pair], enough[pair[0]]) for pair in PAIRS[:2]):
        return
    if _would(table, spans, [(twist, pose) for pose, twist in PAIRS[:2]], 0.0):
        raise table.error("'x', 'y' and 'vx', 'vy' seem to be exchanged: the first are the rates of the second.")
    if _would(table, spans, [("y", "vx"), ("x", "vy")], enough["x"]):
        raise table.error("'x' follows 'vy' and 'y' follows 'vx': two of these columns are exchanged.")
    for pair, other in (PAIRS[:2], PAIRS[1::-1]):
        mirrored = found[pair].correlation < -0.9 and found[pair].moved > enough["x"]
        if mirrored and not _apart(found[other], enough["x"]):
            raise table.error(f"'{pair[0]}' and '{pair[1]}' have opposite signs: one of them is mirrored.")


def note_motion(table: Table, spans: Sequence[slice], nominal: Nominal) -> None:
    """Note positions that do not follow their velocities, samples that stand alone, and forces that do not fit."""
    limits = {"x": _metres(nominal), "y": _metres(nominal), "yaw": MOVED_RAD}
    for pose, twist in PAIRS:
        found = _follows(table, spans, pose, twist)
        if _apart(found, limits[pose]):
            table.notes.append(
                f"{WARNING}'{pose}' does not follow '{twist}': of its change {min(found.unexplained, 9.99):.0%} is not "
                "the integral of that"
            )
    size = SPIKE_HALF_SIZES * max(nominal.half_size_m)
    least = dict.fromkeys(UNITS, size) | {"yaw": SPIKE_RAD}
    for name in ("vx", "vy"):
        least[name] = size * nominal.rate_hz
    least["wz"] = SPIKE_RAD * nominal.rate_hz
    for name, limit in least.items():
        _note_spikes(table, spans, name, limit)
    if nominal.pin is None:  # what a pin does with a body does not follow from its force
        _note_forces(table, spans, nominal)


def _note_spikes(table: Table, spans: Iterable[slice], name: str, least: float) -> None:
    rows: list[tuple[int, float]] = []
    for span in spans:
        values = table[name][span]
        for k in lone_samples(values):
            off = float(values[k] - (values[k - 1] + values[k + 1]) / 2)
            if abs(off) > least:
                rows.append((k + int(span.start), off))
    if rows:
        row, off = max(rows, key=lambda found: abs(found[1]))
        where = f"data row {row + 1} (episode {table['episode'][row]:g}, t = {table['t'][row]:.6g} s)"
        more = f", and {len(rows) - 1} more" if len(rows) > 1 else ""
        table.notes.append(f"{WARNING}'{name}' is off by {off:.4g} {UNITS[name]} for one sample at {where}{more}")


def _note_forces(table: Table, spans: Sequence[slice], nominal: Nominal) -> None:
    """Note commanded forces that do not fit the motion: in size, in direction, in the energy that they give."""
    if len(table) >= MANY and not any(table[name].any() for name in ("fx", "fy")):
        table.notes.append(f"{WARNING}nothing is pushed: 'fx', 'fy' are zero in every row")
        return
    needed, commanded, gained, given = _blocks(table, spans, nominal)
    if len(commanded) >= LEAST_BLOCKS:
        design = np.hstack([commanded, np.ones((len(commanded), 1))])  # a constant: wind, a slope
        solution = np.linalg.lstsq(design, needed, rcond=None)[0]
        left = float(np.sum((needed - design @ solution) ** 2) / np.sum((needed - needed.mean(axis=0)) ** 2))
        matrix = solution[:2].T
        sizes = np.linalg.svd(matrix, compute_uv=False)
        if 1 - left > EXPLAINED and sizes[1] > EXPLAINED * sizes[0]:
            gain = float(np.sqrt(sizes[0] * sizes[1]))
            turned = float(np.degrees(np.arctan2(matrix[1, 0] - matrix[0, 1], matrix[0, 0] + matrix[1, 1])))
            if np.linalg.det(matrix) < 0:
                table.notes.append(
                    f"{WARNING}the motion mirrors the forces: one axis of 'fx', 'fy' has the wrong sign, or they are "
                    "exchanged"
                )
            elif abs(turned) > TURNED_DEG:
                what = "against" if abs(turned) > 180 - TURNED_DEG else f"at {turned:+.0f} degrees to"
                table.notes.append(f"{WARNING}the body accelerates {what} the forces 'fx', 'fy'")
            if not 1 / GAIN < gain < GAIN:
                table.notes.append(
                    f"{WARNING}the motion needs {gain:.3g} times the forces 'fx', 'fy' with the believed mass and "
                    f"friction; allowed: {1 / GAIN:g} to {GAIN:g}"
                )
            return
    if gained > GAIN * given and gained > 0:
        table.notes.append(
            f"{WARNING}the body gains {gained:.3g} J of motion, the forces 'fx', 'fy' give at most {given:.3g} J"
        )


def _blocks(table: Table, spans: Iterable[slice], nominal: Nominal) -> tuple[FloatArray, FloatArray, float, float]:
    """Return needed and commanded forces between blocks that slide, both (N, 2), N, and energy gained and given, J.

    The needed force is mass times acceleration, and friction against the motion. Velocities are averaged over blocks,
    against noise; gains of energy that noise may make are not counted.
    """
    block = max(1, round(BLOCK_S * nominal.rate_hz))
    block_s, mass = block / nominal.rate_hz, nominal.mass_kg
    needed, commanded = [np.zeros((0, 2))], [np.zeros((0, 2))]
    gained = given = 0.0
    for span in spans:
        count = (span.stop - span.start) // block
        if count < 3:
            continue
        raw = table.stack(("vx", "vy"))[span]
        velocity = _mean(raw, count, block)
        force = _mean(table.stack(("fx", "fy"))[span], count, block)
        between, pushed = (velocity[1:] + velocity[:-1]) / 2, (force[1:] + force[:-1]) / 2
        speed = np.linalg.norm(between, axis=1)
        ahead = between / np.maximum(speed, 1e-12)[:, None]
        need = mass * (np.diff(velocity, axis=0) / block_s + nominal.friction * nominal.gravity_m_s2 * ahead)
        used = (speed > SLIDES_M_S) & pushed.any(axis=1)
        needed.append(need[used])
        commanded.append(pushed[used])
        sd = float(np.std(np.diff(raw, 2, axis=0))) / np.sqrt(6 * block) if len(raw) > 2 else 0.0
        energy = 0.5 * mass * np.sum(velocity**2, axis=1)
        rise = np.diff(energy)
        gained += float(rise[rise > CERTAIN * mass * (speed + sd) * sd * np.sqrt(2)].sum())
        given += float(np.maximum(np.sum(pushed * between, axis=1) * block_s, 0.0).sum())
    return np.concatenate(needed), np.concatenate(commanded), gained, given


def _mean(values: FloatArray, count: int, block: int) -> FloatArray:
    return values[: count * block].reshape(count, block, -1).mean(axis=1)


def _follows(table: Table, spans: Iterable[slice], pose: str, twist: str) -> Follows:
    parts = [(table["t"][s], table[pose][s], table[twist][s]) for s in spans]
    return follows(*zip(*parts, strict=True))


def _apart(found: Follows, enough: float) -> bool:
    """Whether a position plainly moves, or its velocity says so, and one is not the integral of the other."""
    return max(found.moved, found.due) > enough and found.unexplained > APART and found.correlation < 1 - APART


def _would(table: Table, spans: Sequence[slice], pairs: Iterable[tuple[str, str]], enough: float) -> bool:
    """Whether columns would follow one another if they were paired like this."""
    found = [_follows(table, spans, *pair) for pair in pairs]
    return all(f.unexplained < TOGETHER and f.moved > enough for f in found)


def _metres(nominal: Nominal) -> float:
    return MOVED_HALF_SIZES * max(nominal.half_size_m)


def _named(names: Iterable[str]) -> str:
    return ", ".join(f"'{name}'" for name in names)
