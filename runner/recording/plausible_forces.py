"""What the commanded forces of a pushed box say of its motion, and the motion of them, in a line each.

The force that the motion needs (mass times acceleration, and friction against the motion) is compared with the one
that was commanded, and so are moments: size, direction, sign, what either explains of the other. The motion may
answer late, as an actuator's delay makes it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from runner.numerics.arrays import FloatArray
from runner.recording.data import WARNING, Nominal
from runner.recording.force_noise import pushing_noise
from runner.recording.plausible_pairs import place
from runner.recording.table import Table
from runner.settings import SETTINGS

MOTION, FORCES = SETTINGS.motion, SETTINGS.forces


@dataclass(frozen=True)
class _Blocks:
    """Forces and motion between blocks of 0.1 s, N of them.

    Args:
        needed: Forces, (N, 2), N.
        commanded: The same, (N, 2).
        turning: Moments that the turning needs, (N,), N m.
        moments: Commanded about the believed centre of mass; the same if px and py were exchanged, and if yaw had the
            other sign, (N, 3).
        pushes: Commanded forces in axes of the body, (N, 2), N.
        spin: Turning against sliding, -1 to 1, by which friction goes, (N,).
        slides: Whether it moves, (N,).
        noise_n_m: What noise of the rates makes of `turning`, one standard deviation.
    """

    needed: FloatArray
    commanded: FloatArray
    turning: FloatArray
    moments: FloatArray
    pushes: FloatArray
    spin: FloatArray
    slides: np.ndarray
    noise_n_m: float


def force_notes(table: Table, spans: Sequence[slice], nominal: Nominal) -> list[str]:
    """Return notes on commanded forces that do not fit the motion: size, direction, place, energy.

    Args:
        table: Of a planar box, without gaps.
        spans: Rows of each episode.
        nominal: What is believed of it.
    """
    if len(table) >= MOTION.min_samples and not any(table[name].any() for name in ("fx", "fy")):
        return [f"{WARNING}nothing is pushed: 'fx', 'fy' are zero in every row"]
    if outside := _outside(table, nominal):
        return outside
    episodes, gained_j, given_j = _episodes(table, spans, nominal)
    beyond = _beyond(table, nominal, episodes)
    if beyond:
        return beyond
    used = max((_late(episodes, late) for late in range(round(FORCES.latest_s / FORCES.block_s) + 1)), key=_explained)
    enough = len(used.needed) >= FORCES.min_blocks
    notes = [*_unexplained(used), *_sizes(used), *_offset(used, nominal)] if enough else []
    if not notes and _explained(used) <= FORCES.explained_share and gained_j > FORCES.max_gain * given_j:
        notes.append(
            f"{WARNING}the body gains {gained_j:.3g} J of motion, the forces 'fx', 'fy' give at most {given_j:.3g} J"
        )
    return notes if notes or not enough else _places(used, nominal)


def measured_notes(table: Table, spans: Sequence[slice]) -> list[str]:
    """Return a note on forces that a sensor has measured: a replay of them says little where the motion is imposed."""
    noise_n = float(pushing_noise(table.stack(("fx", "fy"))[s] for s in spans).max())
    if not noise_n:
        return []
    return [
        f"the force 'fx', 'fy' was measured, with noise of about {noise_n:.2g} N: what that makes counts as noise "
        "(where an arm or a hand decides the motion, its path as a `pin` tells more)"
    ]


def _outside(table: Table, nominal: Nominal) -> list[str]:
    """Note a place of a force that is far off the body."""
    off = np.hypot(table["px"], table["py"])
    row = int(np.argmax(off))
    if off[row] <= FORCES.max_reach * float(np.hypot(*nominal.half_size_m[:2])):
        return []
    return [
        f"{WARNING}the place 'px', 'py' of the force is {off[row]:.4g} m off the body's middle at {place(table, row)}"
    ]


def _beyond(table: Table, nominal: Nominal, episodes: Sequence[_Blocks]) -> list[str]:
    """Note forces that nothing in the motion answers: far more than is needed anywhere, and holds the body back."""
    if not episodes:
        return []
    sizes = np.linalg.norm(table.stack(("fx", "fy")), axis=1)
    needed = max(float(np.linalg.norm(e.needed, axis=1).max()) for e in episodes)
    most = needed + nominal.mass_kg * nominal.friction * nominal.gravity_m_s2
    commanded = max(float(np.linalg.norm(e.commanded, axis=1).max()) for e in episodes)
    usual = float(np.median(sizes[sizes > 0])) if sizes.any() else 0.0  # all of them too large is told as their size
    if commanded <= FORCES.max_gain * max(most, usual):
        return []
    row = int(np.argmax(sizes))
    return [
        f"{WARNING}'fx', 'fy' are {sizes[row]:.3g} N at {place(table, row)}, and the motion does not answer: it needs "
        f"{needed:.3g} N at most"
    ]


def _unexplained(used: _Blocks) -> list[str]:
    """Note axes of which the commanded forces explain next to nothing."""
    left, whole = _left(used)
    needed = whole > FORCES.axis_share**2 * whole.max()
    low = [k for k in (0, 1) if needed[k] and 1 - left[k] / whole[k] < FORCES.unexplained_share]
    if not low:
        return []
    share = 1 - left[low].sum() / whole[low].sum()
    where = "" if len(low) == 2 else f" along {'xy'[low[0]]}"
    return [f"{WARNING}the forces 'fx', 'fy' explain {share:.0%} of what the motion needs{where}"]


def _sizes(used: _Blocks) -> list[str]:
    """Note forces of another size, direction or hand, where they explain enough of the motion to tell."""
    matrix = _fitted(used.commanded, used.needed)[:2].T
    sizes = np.linalg.svd(matrix, compute_uv=False)
    if _explained(used) <= FORCES.explained_share or sizes[1] <= FORCES.explained_share * sizes[0]:
        return []
    notes, gain = [], float(np.sqrt(sizes[0] * sizes[1]))
    turned = float(np.degrees(np.arctan2(matrix[1, 0] - matrix[0, 1], matrix[0, 0] + matrix[1, 1])))
    if np.linalg.det(matrix) < 0:
        notes.append(
            f"{WARNING}the motion mirrors the forces: one axis of 'fx', 'fy' has the wrong sign, or they are exchanged"
        )
    elif abs(turned) > FORCES.turned_deg:
        what = "against" if abs(turned) > 180 - FORCES.turned_deg else f"at {turned:+.0f} degrees to"
        notes.append(f"{WARNING}the body accelerates {what} the forces 'fx', 'fy'")
    if not 1 / FORCES.max_gain < gain < FORCES.max_gain:
        notes.append(
            f"{WARNING}the motion needs {gain:.3g} times the forces 'fx', 'fy' with the believed mass and friction; "
            f"usual: {1 / FORCES.max_gain:g} to {FORCES.max_gain:g}"
        )
    return notes


def _offset(used: _Blocks, nominal: Nominal) -> list[str]:
    """Note a force that the motion needs all the time beside the commanded ones, larger than of any slope or wind."""
    constant = _fitted(used.commanded, used.needed)[2]
    size, weight_n = float(np.hypot(*constant)), nominal.mass_kg * nominal.gravity_m_s2
    if _explained(used) <= FORCES.explained_share or size < FORCES.max_constant * weight_n:
        return []
    name = ("fx", "fy")[int(np.argmax(np.abs(constant)))]
    return [
        f"{WARNING}the motion needs {size:.3g} N less or more than 'fx', 'fy' all the time: has '{name}' an offset?"
    ]


def _places(used: _Blocks, nominal: Nominal) -> list[str]:
    """Note places of forces that do not make the body turn as it does; where its centre of mass is, is left open."""
    pushed = float(np.sqrt(np.mean(np.sum(used.commanded**2, axis=1)))) * max(nominal.half_size_m[:2])
    turning = float(np.std(used.turning))
    if turning < max(FORCES.turning_share * pushed, FORCES.certain_errors * used.noise_n_m):
        return []

    def left(*columns: FloatArray) -> float:
        design = np.column_stack([used.spin, *columns])
        return float(np.sum(_residual(design, used.turning) ** 2))

    base, alone = left(), left(used.pushes)
    given, exchanged, mirrored = (left(used.pushes, used.moments[:, k]) for k in range(3))
    signs = [np.sign(_fitted(np.column_stack([used.spin, used.pushes, m]), used.turning)[3]) for m in used.moments.T]
    explained = 1 - given / base
    if 1 - given / alone > FORCES.plain_share and signs[0] < 0:
        what = "the body turns against the forces: 'px', 'py', or 'yaw' and the forces, have the other sign"
    elif explained > FORCES.explained_share:
        return []
    elif 1 - exchanged / alone > FORCES.plain_share and signs[1] > 0:
        what = "the body turns as if 'px' and 'py' were exchanged"
    elif 1 - mirrored / alone > FORCES.plain_share and signs[2] < 0:
        what = "the body turns as if 'yaw' and 'wz' had the other sign"
    elif explained < FORCES.unexplained_share:
        what = f"the places 'px', 'py' of the forces explain {explained:.0%} of how the body turns"
    else:
        return []
    return [f"{WARNING}{what}"]


def _explained(used: _Blocks) -> float:
    """Return the share of the needed forces that the commanded ones explain, -1 where there are too few."""
    if len(used.needed) < FORCES.min_blocks:
        return -1.0
    left, whole = _left(used)
    return 1 - float(left.sum() / whole.sum()) if whole.any() else 0.0


def _left(used: _Blocks) -> tuple[FloatArray, FloatArray]:
    """Return the squares of the needed forces that the commanded ones leave, and all, (2,) each."""
    left = np.sum(_residual(used.commanded, used.needed) ** 2, axis=0)
    return left, np.sum((used.needed - used.needed.mean(axis=0)) ** 2, axis=0)


def _fitted(columns: FloatArray, values: FloatArray) -> FloatArray:
    """Return the coefficients of columns and, last, of a constant: wind, a slope."""
    design = np.column_stack([columns, np.ones(len(columns))])
    return np.asarray(np.linalg.lstsq(design, values, rcond=None)[0], dtype=np.float64)


def _residual(columns: FloatArray, values: FloatArray) -> FloatArray:
    return values - np.column_stack([columns, np.ones(len(columns))]) @ _fitted(columns, values)


def _late(episodes: Iterable[_Blocks], late: int) -> _Blocks:
    """Return what slides while it is pushed, of all episodes, with the motion so many blocks behind the forces."""
    parts = []
    for e in episodes:
        count = max(len(e.needed) - late, 0)
        ahead, behind = slice(0, count), slice(late, late + count)
        used = e.slides[behind] & e.commanded[ahead].any(axis=1)
        forces = {name: getattr(e, name)[ahead][used] for name in ("commanded", "moments", "pushes")}
        motion = {name: getattr(e, name)[behind][used] for name in ("needed", "turning", "spin", "slides")}
        parts.append({**forces, **motion})
    noise = max((e.noise_n_m for e in episodes), default=0.0)
    if not parts:
        none, two = np.zeros(0), np.zeros((0, 2))
        return _Blocks(two, two, none, np.zeros((0, 3)), two, none, none.astype(bool), noise)
    return _Blocks(**{name: np.concatenate([part[name] for part in parts]) for name in parts[0]}, noise_n_m=noise)


def _episodes(table: Table, spans: Iterable[slice], nominal: Nominal) -> tuple[list[_Blocks], float, float]:
    """Return the episodes between blocks, and energy gained and given, J.

    The needed force is mass times acceleration, and friction against the motion. Velocities are averaged over blocks,
    against noise; gains of energy that noise may make are not counted.
    """
    block = max(1, round(FORCES.block_s * nominal.rate_hz))
    block_s, mass, inertia = block / nominal.rate_hz, nominal.mass_kg, nominal.yaw_inertia_kg_m2
    radius = float(np.linalg.norm(nominal.half_size_m[:2]))
    episodes, gained, given = [], 0.0, 0.0
    for span in spans:
        count = (span.stop - span.start) // block
        if count < 3:
            continue
        raw, force = table.stack(("vx", "vy", "wz"))[span], table.stack(("fx", "fy"))[span]
        velocity = _mean(raw, count, block)
        between = (velocity[1:] + velocity[:-1]) / 2
        speed = np.linalg.norm(between[:, :2], axis=1)
        ahead = between[:, :2] / np.maximum(speed, 1e-12)[:, None]
        change = np.diff(velocity, axis=0) / block_s
        pushes = turned(force, -table["yaw"][span])
        arm = table.stack(("px", "py"))[span] - nominal.centre_of_mass_m[:2]
        mirrored = turned(force, table["yaw"][span])
        moments = [_moment(arm, pushes), _moment(arm[:, ::-1], pushes), _moment(arm, mirrored)]
        means = _mean(np.column_stack([force, *moments, pushes]), count, block)
        pushed = (means[1:] + means[:-1]) / 2
        sd = np.std(np.diff(raw, 2, axis=0), axis=0) / np.sqrt(6 * block) if len(raw) > 2 else np.zeros(3)
        episodes.append(
            _Blocks(
                needed=mass * (change[:, :2] + nominal.friction * nominal.gravity_m_s2 * ahead),
                commanded=pushed[:, :2],
                turning=inertia * change[:, 2],
                moments=pushed[:, 2:5],
                pushes=pushed[:, 5:],
                spin=between[:, 2] * radius / np.maximum(np.hypot(speed, between[:, 2] * radius), 1e-12),
                slides=speed > FORCES.sliding_m_s,
                noise_n_m=float(inertia * sd[2] * np.sqrt(2) / block_s),
            )
        )
        rise, noise = np.diff(0.5 * mass * np.sum(velocity[:, :2] ** 2, axis=1)), float(np.hypot(*sd[:2]) / np.sqrt(2))
        gained += float(rise[rise > FORCES.certain_errors * mass * (speed + noise) * noise * np.sqrt(2)].sum())
        given += float(np.maximum(np.sum(pushed[:, :2] * between[:, :2], axis=1) * block_s, 0.0).sum())
    return episodes, gained, given


def turned(vectors: FloatArray, angles: FloatArray) -> FloatArray:
    """Return vectors (T, 2) turned by angles (T,)."""
    c, s = np.cos(angles), np.sin(angles)
    return np.column_stack([c * vectors[:, 0] - s * vectors[:, 1], s * vectors[:, 0] + c * vectors[:, 1]])


def _moment(place: FloatArray, force: FloatArray) -> FloatArray:
    return place[:, 0] * force[:, 1] - place[:, 1] * force[:, 0]


def _mean(values: FloatArray, count: int, block: int) -> FloatArray:
    return values[: count * block].reshape(count, block, -1).mean(axis=1)
