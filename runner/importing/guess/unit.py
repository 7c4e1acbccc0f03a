"""In which unit a signal is: by its name, or by which unit puts its numbers into the range of its joint."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from runner.importing.guess.elements import Element
from runner.importing.guess.names import BY_NAME
from runner.importing.map_file import TO_FILL
from runner.importing.signals import Log, Signal
from runner.importing.units import allowed, spelled
from runner.numerics.arrays import FloatArray

SLACK = 0.1  # widths of the range
COARSE = ("ticks", "tick", "counts", "count", "steps", "raw")
COMMON = {"rad": ("rad", "deg"), "m": ("m", "mm"), "N m": ("N m",), "N": ("N",)}  # tried in this order
FEWEST_COUNTS = 256  # in a turn: of fewer a power of two says little
MUCH_RAD = 20.0  # a hinge without a range that goes further is in degrees, or turns round and round
MUCH_M = 10.0  # positions beyond it are hardly in m
REACH = 5  # samples to either side, over which a slope is told
LEAP = 0.1  # of a span: where a clock leaps there is no slope
UNIT_BY_NAME = "unit by its name"
COUNTS = "counts of an encoder"
ALIKE, NEAR = 0.9, 0.2  # correlation of velocity and slope; how far off a unit may be: deg/s and rpm differ by 6


@dataclass(frozen=True)
class UnitGuess:
    """A unit as it is written in a map, None where nothing need be written, and why."""

    name: str | None
    why: str


def guess_unit(signal: Signal, element: Element, log: Log) -> UnitGuess:
    """Return the unit of a signal that is taken for an element.

    Args:
        signal: Of the first part.
        element: What it is taken for.
        log: All parts, for the sizes.
    """
    named = unit_by_name(signal.name, element.si_unit)
    if named is not None:
        return named
    values = np.concatenate([p.signals[signal.name].values for p in log.parts if signal.name in p.signals])
    values = values[np.isfinite(values)]
    if not len(values):
        return UnitGuess(element.si_unit or None, "no numbers")
    low, high = float(values.min()), float(values.max())
    goes = f"{low:.3g} to {high:.3g}"
    if element.limits is not None and element.si_unit in COMMON:
        return _by_range(low, high, element, goes, "LeRobot" in log.format)
    largest = max(abs(low), abs(high))
    if (element.si_unit == "rad" and largest > MUCH_RAD) or (element.si_unit == "m" and largest > MUCH_M):
        other = "deg" if element.si_unit == "rad" else "mm"
        return UnitGuess(TO_FILL, f"{goes}: {other}, or {element.si_unit}? the model has no range to hold that against")
    if element.si_unit == "rad/s" and largest > 5 * MUCH_RAD:
        return UnitGuess(TO_FILL, f"{goes}: rad/s, deg/s or rpm?")
    if not element.si_unit:
        return UnitGuess(None, f"{goes}, taken as it is: the model does not tell its unit")
    return UnitGuess(element.si_unit, f"{goes}, assumed")


def vector_of(signal: Signal) -> str:
    """Return what a signal is an element of, such as `action` of `action[elbow.pos]`; "" of one that stands alone."""
    return signal.name.rpartition("[")[0] if signal.name.endswith("]") else ""


def units_of_vectors(pairs: Sequence[tuple[Element, Signal]], log: Log) -> dict[tuple[str, str], UnitGuess]:
    """Return in which unit vectors are, by name and SI unit: that which ranges in the model tell of some elements.

    Only a unit that is not SI is told, and by all of them: small numbers fit a range in rad, whatever they are in.

    Args:
        pairs: What is taken for what.
        log: All parts, for the sizes.
    """
    told: dict[tuple[str, str], dict[str, str | None]] = {}
    for element, signal in pairs:
        if vector_of(signal) and element.limits is not None:
            own = told.setdefault((vector_of(signal), element.si_unit), {})
            own[element.target] = guess_unit(signal, element, log).name
    out = {}
    for (vector, si_unit), units in told.items():
        name = next(iter(units.values()))
        if len({*units.values()}) == 1 and name not in (si_unit, TO_FILL):
            out[vector, si_unit] = UnitGuess(name, f"assumed in the unit of {', '.join(units)}, whose range tells it")
    return out


def unit_by_slope(times_s: FloatArray, position_si: FloatArray, values: FloatArray, si_unit: str) -> UnitGuess | None:
    """Return the unit in which a velocity is the slope of its position, or None where it is in none.

    Args:
        times_s: (T,), s.
        position_si: (T,), NaN where not measured.
        values: The velocity in its unit, (T,).
        si_unit: Of velocities.
    """
    if len(times_s) <= 2 * REACH:
        return None
    span = times_s[2 * REACH :] - times_s[: -2 * REACH]
    usual = float(np.nanmedian(span))
    kernel = np.full(2 * REACH + 1, 1 / (2 * REACH + 1))  # as smooth as the slope
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = (position_si[2 * REACH :] - position_si[: -2 * REACH]) / span
        rate = np.convolve(values, kernel, "valid")
    kept = np.isfinite(slope) & np.isfinite(rate) & (np.abs(span - usual) < LEAP * usual)
    slope, rate = slope[kept], rate[kept]
    power = float(np.sum(slope**2) * np.sum(rate**2)) ** 0.5
    if power == 0 or abs(float(slope @ rate)) < ALIKE * power:
        return None
    ratio = abs(float(slope @ rate)) / float(rate @ rate)  # SI units in one of the signal's
    name = min(allowed(si_unit), key=lambda n: abs(np.log(allowed(si_unit)[n] / ratio)))
    near = abs(np.log(allowed(si_unit)[name] / ratio)) < np.log(1 + NEAR)
    return UnitGuess(name, "unit by the slope of its position") if near else None


def with_unit(why: str, of_unit: str) -> str:
    """Return why a signal is what it is and why its unit is, in one where its name says both."""
    if why == BY_NAME and of_unit == UNIT_BY_NAME:
        return f"{BY_NAME}, and so its unit"
    return f"{why}; {of_unit}" if of_unit else why


def unit_by_name(name: str, si_unit: str) -> UnitGuess | None:
    """Return the unit that stands at the end of a name, or in brackets: `q_deg`, `angle [deg]`, `speed(rpm)`."""
    pieces = [p for p in re.split(r"[\[\]()/_.\s]+", name) if p]
    candidates = [*re.findall(r"[\[(]\s*([A-Za-z/°%]+)\s*[\])]", name), *(pieces[-1:])]
    joined = "/".join(pieces[-2:])  # deg_s, rad_s
    for text in [joined, *candidates]:
        unit = spelled(text)
        if unit in allowed(si_unit) and (len(unit) > 1 or name.endswith((f"[{text}]", f"({text})", f"_{text}"))):
            return UnitGuess(unit, UNIT_BY_NAME)
    if any(p.lower() in COARSE for p in pieces):
        return UnitGuess(TO_FILL, f"{COUNTS}: unit: turn with scale and offset, or rad")
    return None


def of_counts(unit: UnitGuess, signal: Signal, element: Element, log: Log) -> UnitGuess:
    """Return the same with what counts of an angle may be, as a turn is a power of two of them as a rule.

    Where all runs begin at one power of two, that is the middle of a turn, which is set to where a mechanism hangs or
    stands; else the least power of two that holds them all may be a turn.
    """
    values = [v for p in log.parts if signal.name in p.signals and len(v := _numbers(p.signals[signal.name]))]
    if not unit.why.startswith(COUNTS) or element.si_unit != "rad" or not values:
        return unit
    every, first = np.concatenate(values), {float(v[0]) for v in values}
    low, high = float(every.min()), float(every.max())
    if (every % 1).any() or low < 0 or high < FEWEST_COUNTS:
        return unit
    begin = min(first)
    middle = len(first) == 1 and 2 * begin >= FEWEST_COUNTS and np.log2(begin) % 1 == 0
    turn = 2 * begin if middle else 2.0 ** np.ceil(np.log2(high + 1))
    zero = begin if middle else 0.0
    scale, offset = f"{1 / turn:.12g}", f"{0.0 - zero / turn:g}"
    return UnitGuess(
        unit.name,
        f"{COUNTS}, {low:.0f} to {high:.0f}, first {begin:.0f}: if {turn:.0f} of them are a turn and its zero is at "
        f"{zero:.0f}, `unit: turn, scale: {scale}, offset: {offset}` (scale * count + offset, in turns)",
    )


def _numbers(signal: Signal) -> FloatArray:
    return signal.values[np.isfinite(signal.values)]


def _by_range(low: float, high: float, element: Element, goes: str, lerobot: bool) -> UnitGuess:
    assert element.limits is not None
    least, most = element.limits
    slack = SLACK * (most - least)
    for unit in COMMON[element.si_unit]:
        size = allowed(element.si_unit)[unit]
        if low * size >= least - slack and high * size <= most + slack:
            why = f"{goes} {unit} fits the range"
            if lerobot and unit == "deg":
                why += "; LeRobot also records -100 to 100 of a calibrated range: check"
            return UnitGuess(unit, why)
    return UnitGuess(TO_FILL, f"{goes}, the model's range is {least:.4g} to {most:.4g} {element.si_unit}")
