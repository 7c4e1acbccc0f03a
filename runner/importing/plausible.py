"""Whether the numbers of a case can be what the map says: inside of ranges, and rates that fit to positions.

What can't be is refused; what is only odd is a note.
"""

from __future__ import annotations

from collections.abc import Mapping

import mujoco
import numpy as np
import pandas as pd

from runner.errors import RecordingError
from runner.importing.entries import Entry, Plan
from runner.importing.guess.fall import falls_otherwise
from runner.importing.units import allowed
from runner.numerics.arrays import FloatArray
from runner.recording.model_form_mapping import ChannelSource, ModelMapping

FAR = 2.0  # widths of the range beyond it: in another unit
OUTSIDE = 0.1  # widths of the range beyond it: worth a note
STILL = 0.01  # of the range: a joint that moves less may be in another unit, worth a note
LONGEST_M = 100.0  # of a slide without a range, and how far a body is from where the world begins
MOST_TURNS = 50  # of a hinge without a range
WRONG_RATE = 15.0  # times the slope of the position, or a share of it as small: rad/s and deg/s differ by 57
ODD_RATE = 1.5
CORRELATED = 0.8


def coarse_step(values: FloatArray) -> float | None:
    """Return the step in which a signal was recorded, if it stays on one step so long that its noise does not show.

    Noise is estimated from differences of samples. Where most of those vanish it would come out as zero; then the
    uniform error of rounding is what is known of it, step / sqrt(12).

    Args:
        values: In order of time, (T,), NaN where not measured.
    """
    values = values[np.isfinite(values)]
    if len(values) < 8:
        return None
    tiny = 1e-6 * float(values.max() - values.min())
    third = np.abs(np.diff(values, n=3))
    steps = np.abs(np.diff(values))
    steps = steps[steps > tiny]
    return float(np.percentile(steps, 5)) if len(steps) and np.median(third) <= tiny else None


def check_plausible(table: pd.DataFrame, planned: Plan, mapping: ModelMapping, model: mujoco.MjModel) -> list[str]:
    """Return what is odd.

    Raises:
        RecordingError: If a joint is far outside of its range, a target outside of its actuator's, a velocity is
            many times the slope of its position, or a body falls as no gravity of the model makes it.
    """
    entries = {e.column: e for e in planned.entries}
    notes: list[str] = []
    _check_falls(table, mapping, model, entries)
    for source in mapping.sources:
        if source.kind == "body" and source.quantity == "position":
            _check_place(table, source, entries[source.name])
        if source.kind == "joint" and source.quantity == "position":
            notes += _position(table, source, entries[source.name], model)
    for name, command in mapping.commands.items():
        if command.limits is not None:
            notes += within(table[name].to_numpy(), command.limits, entries[name], f"actuator '{command.actuator}'")
    return notes + _rates(table, mapping, entries) + _coarse(table, mapping)


def _coarse(table: pd.DataFrame, mapping: ModelMapping) -> list[str]:
    """Say which channels are recorded too coarsely for their noise to show, and have none stated."""
    found = {}
    for source in mapping.sources:
        if source.name not in mapping.noise and source.quantity != "orientation":
            step = coarse_step(table[source.name].to_numpy())
            if step is not None:
                found[source.name] = step / np.sqrt(12)
    if not found:
        return []
    stated = ", ".join(f"{name}: {level:.2g}" for name, level in found.items())
    return [
        f"{len(found)} channels were recorded in steps so coarse that their noise can't be estimated; state it in "
        f"the map, by rounding alone noise: {{{stated}}}"
    ]


def _position(table: pd.DataFrame, source: ChannelSource, entry: Entry, model: mujoco.MjModel) -> list[str]:
    joint = model.joint(source.target)
    values = table[source.name].to_numpy()
    if not np.isfinite(values).any():
        raise RecordingError(f"{entry.key}: signal '{entry.signal}' has no numbers.")
    if joint.limited[0]:
        limits = float(joint.range[0]), float(joint.range[1])
        # a little beyond its range is told when the case is read, where its stop is known
        _outside(values, limits, entry, f"joint '{source.target}'")
        span = float(np.nanmax(values) - np.nanmin(values))
        notes = []
        if 0 < span < STILL * (limits[1] - limits[0]):
            notes.append(
                f"'{source.name}' moves over {span:.3g} {source.unit}, a small part of the range of joint "
                f"'{source.target}' ({limits[0]:.4g} to {limits[1]:.4g}); it may not be in {entry.unit}"
            )
        return notes
    largest = float(np.nanmax(np.abs(values)))
    most = LONGEST_M if source.unit == "m" else 2 * np.pi * MOST_TURNS
    if largest > most:
        kind = "slide" if source.unit == "m" else "hinge"
        if source.unit == "m":
            raise RecordingError(
                f"{entry.key}: goes up to {largest:.4g} m, allowed for a {kind} without a range: {most:g} m; "
                f"is its unit {entry.unit}?"
            )
        return [f"'{source.name}' goes up to {largest / 2 / np.pi:.0f} turns; it may not be in {entry.unit}"]
    return []


def _check_place(table: pd.DataFrame, source: ChannelSource, entry: Entry) -> None:
    largest = float(np.nanmax(np.abs(table[source.name].to_numpy()), initial=0.0))
    if largest > LONGEST_M:
        raise RecordingError(
            f"{entry.key}: goes up to {largest:.4g} m, allowed for a body: {LONGEST_M:g} m; is its unit {entry.unit}?"
        )


def _check_falls(
    table: pd.DataFrame, mapping: ModelMapping, model: mujoco.MjModel, entries: Mapping[str, Entry]
) -> None:
    """Hold how free bodies fall against the model's gravity: it tells units and axes."""
    bodies = dict.fromkeys(s.target for s in mapping.sources if s.kind == "body" and s.quantity == "position")
    for body in bodies:
        own = {s.index: s for s in mapping.sources if (s.kind, s.quantity, s.target) == ("body", "position", body)}
        first = int(model.body(body).jntadr[0])
        if set(own) != {0, 1, 2} or first < 0 or model.jnt_type[first] != mujoco.mjtJoint.mjJNT_FREE:
            continue
        places = table[[own[axis].name for axis in range(3)]].to_numpy()
        said = falls_otherwise(table["t"].to_numpy(), places, np.array(model.opt.gravity))
        if said:
            units = dict.fromkeys(entries[s.name].unit for s in own.values())
            raise RecordingError(
                f"channels: '{body}' {said}: is the unit of its positions {' or '.join(units)}, does the right axis of "
                "the log point up (`up`), and is the clock right?"
            )


def within(values: FloatArray, limits: tuple[float, float], entry: Entry, whose: str) -> list[str]:
    """Say how far values, SI, (T,), are outside of the limits of an actuator.

    Raises:
        RecordingError: If they are far outside, with the units in which they would not be.
    """
    beyond = _outside(values, limits, entry, whose)
    if beyond > OUTSIDE * (limits[1] - limits[0]):
        return [f"'{entry.column}' is up to {beyond:.3g} {entry.si_unit} outside of the range of {whose}"]
    return []


def _outside(values: FloatArray, limits: tuple[float, float], entry: Entry, whose: str) -> float:
    """Return how far values, SI, (T,), are outside of the limits of a joint or an actuator.

    Raises:
        RecordingError: If they are far outside, with the units in which they would not be.
    """
    low, high = limits
    width = high - low
    least, largest = float(np.nanmin(values)), float(np.nanmax(values))
    beyond = max(low - least, largest - high)
    if beyond > FAR * width:
        fits = _fitting(entry, least, largest, limits)
        hint = f"in {fits} they would fit" if fits else "no unit makes them fit: wrong signal, scale, offset?"
        degrees = np.pi / 180
        turned = max(abs(least), abs(largest)) < 2 * np.pi
        if entry.si_unit == "rad" and turned and max(low / degrees - least, largest - high / degrees) <= 0:
            hint += '; or the range is meant in radians, and the MJCF lacks <compiler angle="radian"/>'
        raise RecordingError(
            f"{entry.key}: goes from {least:.4g} to {largest:.4g} {entry.si_unit}, the range of {whose} is {low:.4g} "
            f"to {high:.4g}; read in {entry.unit or 'its unit'}; {hint}."
        )
    return beyond


def _fitting(entry: Entry, least: float, largest: float, limits: tuple[float, float]) -> str:
    """Return the units in which numbers would be within limits and fill a good part of them."""
    width = limits[1] - limits[0]
    found = []
    for name, size in allowed(entry.si_unit).items():
        low, high = (v * size / abs(entry.size) for v in (least, largest))
        inside = low > limits[0] - OUTSIDE * width and high < limits[1] + OUTSIDE * width
        if inside and max(abs(low), abs(high)) > STILL * width and size != abs(entry.size):
            found.append(name)
    return " or ".join(found)


def _rates(table: pd.DataFrame, mapping: ModelMapping, entries: Mapping[str, Entry]) -> list[str]:
    """Hold each velocity against the slope of its position."""
    notes = []
    positions = {s.target: s for s in mapping.sources if s.kind == "joint" and s.quantity == "position"}
    for source in mapping.sources:
        if source.kind != "joint" or source.quantity != "velocity" or source.target not in positions:
            continue
        ratio, correlation = _slope_ratio(table, positions[source.target].name, source.name)
        if abs(correlation) < CORRELATED:
            continue
        entry = entries[source.name]
        if not 1 / WRONG_RATE < abs(ratio) < WRONG_RATE:
            raise RecordingError(
                f"{entry.key}: is {abs(ratio):.3g} times the slope of '{positions[source.target].name}'; read in "
                f"{entry.unit}, one of the two, or the clock, is in another unit."
            )
        if not 1 / ODD_RATE < ratio < ODD_RATE:
            notes.append(f"'{source.name}' is {ratio:.3g} times the slope of '{positions[source.target].name}'")
    return notes


def _slope_ratio(table: pd.DataFrame, position: str, velocity: str) -> tuple[float, float]:
    """Return how large a velocity is against differences of the position, and how alike they are (correlation)."""
    slopes, rates = [], []
    for _, own in table.groupby("episode", sort=False):
        part = own[["t", position, velocity]].dropna().to_numpy()
        reach = 5
        if len(part) > 4 * reach:
            t, q, v = part.T
            slopes.append((q[2 * reach :] - q[: -2 * reach]) / (t[2 * reach :] - t[: -2 * reach]))
            rates.append(np.convolve(v, np.full(2 * reach + 1, 1 / (2 * reach + 1)), "valid"))
    if not slopes:
        return 1.0, 0.0
    slope, rate = np.concatenate(slopes), np.concatenate(rates)
    size = float(np.sqrt(np.mean(slope**2) * np.mean(rate**2)))
    if size == 0.0:
        return 1.0, 0.0
    cross = float(np.mean(slope * rate))
    return cross / float(np.mean(slope**2)), cross / size
