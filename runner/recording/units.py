"""Hints at other units and axes: what a body of this size and weight can't do, and poses that contradict velocities.

Two independent looks. Displacement must be the integral of velocity, and turning that of the rate: their ratio tells
millimetres and degrees, whatever the scene. If both are in the same wrong unit, the scene tells: a body on a floor
gains or loses speed by (|force| / mass + friction x gravity) at most, and likewise for turning.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from runner.numerics.arrays import FloatArray
from runner.recording.data import Form, Nominal
from runner.recording.table import METRES, POINT, POSE, QUATERNION, RATES, SPEEDS, TWIST, Table
from runner.settings import SETTINGS

MOTION, FORCES, UNITS = SETTINGS.motion, SETTINGS.forces, SETTINGS.units

DEGREE = np.rad2deg(1.0)
LENGTH_UNITS = {
    1000.0: "{pose} in mm (or {twist} in km/s)",
    100.0: "{pose} in cm",
    0.001: "{twist} in mm/s (or {pose} in km)",
    0.01: "{twist} in cm/s",
    1 / 3.6: "{twist} in km/h",
}
ANGLE_UNITS = {
    DEGREE: "{pose} in degrees",
    1 / DEGREE: "{twist} in degrees/s",
    2 * np.pi: "{twist} in turns/s",
    1 / (2 * np.pi): "{pose} in turns",
    np.pi / 30: "{twist} in turns per minute",
}


@dataclass(frozen=True)
class _Agreement:
    """Displacement against the integral of velocity, all episodes together."""

    correlation: float
    ratio: float  # displacement / integral, > 0
    unexplained: float  # share of the displacement that the integral leaves
    moved: float  # rms displacement, as given: m or rad


def check_units(table: Table, spans: list[slice], nominal: Nominal, form: Form) -> None:
    """Refuse numbers that are probably in other units or axes than the format's; doubts become notes.

    Raises:
        RecordingError: Naming file, row (where one stands out), column, value, and the probable unit.
    """
    _check_poses_against_velocities(table, spans, nominal, form)
    _check_sizes(table, spans, nominal, form)
    if form is Form.PLANAR and nominal.pin is None:
        _check_dynamics(table, spans, nominal)


def _check_sizes(table: Table, spans: list[slice], nominal: Nominal, form: Form) -> None:
    size = max(nominal.half_size_m)
    for name in (name for name in POSE[form] if name in METRES):
        for span in spans:
            values = table[name][span]
            row, travel = _peak(values - values[np.argmax(np.isfinite(values))])
            if travel > UNITS.max_travel_half_sizes * size:
                raise table.error(
                    f"column '{name}' is {values[row]:.6g} m, {travel / size:.3g} half sizes from the episode's start, "
                    f"allowed: {UNITS.max_travel_half_sizes:g}; probably in mm.",
                    row + int(span.start),
                )
    speed = UNITS.max_froude * float(np.sqrt(nominal.gravity_m_s2 * size))
    limits = [(name, speed, "m/s", "mm/s") for name in SPEEDS]
    limits += [(name, speed / size, "rad/s", "degrees/s") for name in RATES]
    limits += [(name, UNITS.max_reach_half_sizes * size, "m", "mm") for name in POINT]
    for name, most, unit, other in (limit for limit in limits if limit[0] in table):
        row, peak = _peak(table[name])
        if peak > most:
            raise table.error(
                f"column '{name}' is {table[name][row]:.6g} {unit}, allowed for a body of half size {size:g} m: up to "
                f"{most:.3g} {unit}; probably in {other}.",
                row,
            )


def _peak(values: FloatArray) -> tuple[int, float]:
    """Return where the largest magnitude is, and how large; NaN counts as 0."""
    sizes = np.nan_to_num(np.abs(values))
    row = int(np.argmax(sizes))
    return row, float(sizes[row])


def _check_poses_against_velocities(table: Table, spans: list[slice], nominal: Nominal, form: Form) -> None:
    used = (*POSE[form], *TWIST[form])
    parts = [{name: table[name][span] for name in used} for span in spans]
    parts = [part for part in parts if not np.isnan(list(part.values())).any()]
    if not parts:
        return
    paths = [_paths(part, form, 1 / nominal.rate_hz) for part in parts]
    moved, moved_body, speeds, turned, turned_body, rates = zip(*paths, strict=True)
    planar = form is Form.PLANAR
    if not planar:
        _check_quaternion_meaning(table, parts, 1 / nominal.rate_hz)
    names = ("'x', 'y'", "'vx', 'vy'") if planar else ("'x', 'y', 'z'", "'vx', 'vy', 'vz'")
    _judge(
        table,
        _agreement(moved, speeds),
        _agreement(moved_body, speeds),
        names,
        LENGTH_UNITS,
        MOTION.moved_half_sizes * max(nominal.half_size_m),
    )
    names = ("'yaw'", "'wz'") if planar else ("'qw', 'qx', 'qy', 'qz'", "'wx', 'wy', 'wz'")
    _judge(table, _agreement(turned, rates), _agreement(turned_body, rates), names, ANGLE_UNITS, MOTION.moved_rad)


def _check_quaternion_meaning(table: Table, parts: list[dict[str, FloatArray]], step_s: float) -> None:
    """Refuse quaternions that follow the rates only when read in another order or direction."""

    def unexplained(order: tuple[str, ...], sign: float) -> float:
        paths = []
        for part in parts:
            qw, qx, qy, qz = (part[name] for name in order)
            # -w: the conjugate, but for the sign of all four
            paths.append(_paths(part | {"qw": sign * qw, "qx": qx, "qy": qy, "qz": qz}, Form.SPATIAL, step_s))
        agreement = _agreement([path[3] for path in paths], [path[5] for path in paths])
        return 0.0 if agreement is None else agreement.unexplained

    given = unexplained(QUATERNION, 1.0)
    for order, sign, text in (
        (QUATERNION, -1.0, "turn world to body; allowed: body to world"),
        (("qz", "qw", "qx", "qy"), 1.0, "are stored as x, y, z, w; allowed: w, x, y, z"),
    ):
        if given > MOTION.apart_share and unexplained(order, sign) < UNITS.body_share * given:
            raise table.error(f"columns 'qw', 'qx', 'qy', 'qz' agree with 'wx', 'wy', 'wz' if they {text}.")


def _paths(
    part: dict[str, FloatArray], form: Form, step_s: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return way in world and body axes, integral of velocity, and the same of turning; each of shape (T - 1, 3)."""
    zero = np.zeros_like(part["x"])
    where, speeds, rates = (
        np.stack([part.get(name, zero) for name in names], axis=1) for names in (METRES, SPEEDS, RATES)
    )
    turn = _orientation(part, form)
    moves = np.diff(where, axis=0)
    turns = (
        np.diff(part["yaw"])[:, None] * [0.0, 0.0, 1.0]
        if form is Form.PLANAR
        else (turn[1:] * turn[:-1].inv()).as_rotvec()
    )
    back = turn[:-1].inv()
    steps = (moves, back.apply(moves), _means(speeds) * step_s, turns, back.apply(turns), _means(rates) * step_s)
    way, way_body, way_due, angle, angle_body, angle_due = (np.cumsum(step, axis=0) for step in steps)
    return way, way_body, way_due, angle, angle_body, angle_due


def _means(values: FloatArray) -> FloatArray:
    """Return the mean of each two neighbours (trapezoid rule)."""
    return (values[1:] + values[:-1]) / 2


def _orientation(part: dict[str, FloatArray], form: Form) -> scipy.spatial.transform.Rotation:
    if form is Form.PLANAR:
        return scipy.spatial.transform.Rotation.from_rotvec(part["yaw"][:, None] * [0.0, 0.0, 1.0])
    qw, qx, qy, qz = (part[name] for name in QUATERNION)
    return scipy.spatial.transform.Rotation.from_quat(np.stack([qx, qy, qz, qw], axis=1))


def _agreement(moved: Sequence[FloatArray], integrals: Sequence[FloatArray]) -> _Agreement | None:
    """Return how displacement follows the integral of velocity, each less its mean over the episode."""
    d = np.concatenate([(m - m.mean(axis=0)).ravel() for m in moved])
    i = np.concatenate([(m - m.mean(axis=0)).ravel() for m in integrals])
    dd, ii = float(d @ d), float(i @ i)
    if dd == 0 or ii == 0:
        return None
    return _Agreement(
        correlation=float(d @ i) / float(np.sqrt(dd) * np.sqrt(ii)),
        ratio=float(np.sqrt(dd / ii)),
        unexplained=float(np.sum((d - i) ** 2)) / dd,
        moved=float(np.sqrt(dd / len(d))),
    )


def _judge(
    table: Table,
    world: _Agreement | None,
    body: _Agreement | None,
    names: tuple[str, str],
    units: dict[float, str],
    least: float,
) -> None:
    """Refuse poses and velocities that contradict each other, in sign and axes only where more than `least` moved."""
    if world is None or body is None:
        return
    pose, twist = names
    in_body = body.correlation > MOTION.min_correlation and body.unexplained < UNITS.body_share * world.unexplained
    if in_body and world.unexplained > MOTION.together_share and world.moved > least:
        raise table.error(f"{twist} agree with {pose} in body axes, not in world axes; allowed: world axes.")
    if world.correlation < -MOTION.min_correlation and world.moved > least:
        raise table.error(f"{pose} and {twist} have opposite signs; allowed: right-handed axes, z up.")
    if world.correlation < MOTION.min_correlation:
        return
    ratio = f"{pose} change {world.ratio:.4g} times as much as {twist} say"
    for factor, text in units.items():
        if abs(world.ratio / factor - 1) < UNITS.ratio_share:
            raise table.error(f"{ratio}, allowed: about 1; probably {text.format(pose=pose, twist=twist)}.")
    if abs(np.log(world.ratio)) > np.log(UNITS.noted_ratio):
        table.notes.append(ratio)


def _check_dynamics(table: Table, spans: list[slice], nominal: Nominal) -> None:
    """Compare changes of speed and of rate with what force and friction can do."""
    mass, gravity = nominal.mass_kg, nominal.gravity_m_s2
    inertia = nominal.yaw_inertia_kg_m2
    grip = (nominal.friction + UNITS.spare_friction) * gravity  # m/s2
    lever = float(np.hypot(*nominal.half_size_m[:2]))
    x, y = table["fx"], table["fy"]
    c, s = np.cos(table["yaw"]), np.sin(table["yaw"])
    torque = table["px"] * (c * y - s * x) - table["py"] * (c * x + s * y)
    block = max(1, round(FORCES.block_s * nominal.rate_hz))
    block_s = block / nominal.rate_hz
    speed_up, spin_up = [np.zeros(1)], [np.zeros(1)]
    for span in spans:
        if span.stop - span.start < 2 * block:
            continue
        force = _pairs(np.hypot(x, y)[span], block)
        moment = _pairs(np.abs(torque[span]), block)
        speed = np.hypot(_changes(table["vx"][span], block), _changes(table["vy"][span], block))
        speed_up.append(speed / ((force / mass + grip) * block_s))
        spin = np.abs(_changes(table["wz"][span], block))
        spin_up.append(spin / ((moment + mass * grip * lever) / inertia * block_s))
    for ratios, most, names, unit in (
        (speed_up, UNITS.max_speed_up, "'vx', 'vy'", "'x', 'y' and 'vx', 'vy' are probably not in m and m/s"),
        (spin_up, UNITS.max_spin_up, "'wz'", "'yaw' and 'wz' are probably in degrees and degrees/s"),
    ):
        ratio = float(np.percentile(np.concatenate(ratios), MOTION.usual_percent))
        if ratio > most:
            text = f"{names} change {ratio:.3g} times as fast as force and friction can do it, allowed: {most:g}"
            raise table.error(f"{text}; {unit}.")


def _changes(values: FloatArray, block: int) -> FloatArray:
    """Return the changes between the means of successive blocks."""
    count = len(values) // block
    return np.diff(values[: count * block].reshape(count, block).mean(axis=1))


def _pairs(values: FloatArray, block: int) -> FloatArray:
    """Return the means over each two successive blocks."""
    count = len(values) // block
    means = values[: count * block].reshape(count, block).mean(axis=1)
    return (means[1:] + means[:-1]) / 2
