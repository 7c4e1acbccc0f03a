"""Numbers as they are read: with their standard errors, in the unit that suits them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

DEGREES = 180.0 / math.pi
UNITS = {
    "_kg": "kg",
    "_rad": "rad",
    "_s": "s",
    "_m": "m",
    "_n": "N",
    "_m_s": "m/s",
    "_per_s": "1/s",
    "_n_per_m": "N/m",
    "_n_s_per_m": "N s/m",
    "_n_m_s": "N m s",
    "_n_s2_per_m2": "N s2/m2",
}


# the unit that a small amount is shown in, and what one SI unit is of it; any other unit is shown as it is
SMALL_UNITS = {"m": ("mm", 1e3), "rad": ("°", DEGREES), "m/s": ("mm/s", 1e3), "rad/s": ("°/s", DEGREES)}


def small_unit(unit: str) -> tuple[str, float]:
    """Return the unit that a small amount is shown in, and what one SI unit is of it."""
    return SMALL_UNITS.get(unit, (unit, 1.0))


def unit_of(name: str) -> str:
    """Return the unit that the name of a number ends on, "" for a pure number."""
    endings = [ending for ending in UNITS if name.endswith(ending)]
    return UNITS[max(endings, key=len)] if endings else ""


def number(value: float, digits: int = 3) -> str:
    """Return a number with so many significant digits, without an exponent where it is of usual size."""
    if not math.isfinite(value):
        return "?"
    if value == 0:
        return "0"
    place = digits - 1 - math.floor(math.log10(abs(value)))
    if abs(value) >= 1e6 or abs(value) < 1e-5:
        return f"{value:.{digits - 1}e}".replace("-", "−")
    return f"{round(value, place):.{max(place, 0)}f}".replace("-", "−")


def counted(count: int, noun: str) -> str:
    """Return how many of something there are in words: "1 run", "4 runs"; the noun in the singular."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def plus_minus(value: float, error: float | None = None, unit: str = "") -> str:
    """Return `0.277 ± 0.001 kg`: the error with one digit (two below 2), the value to the same place."""
    tail = f" {unit}" if unit and unit not in ("°", "%") else {"%": " %"}.get(unit, unit)
    if error is None or not math.isfinite(error) or error <= 0 or not math.isfinite(value):
        return number(value) + tail
    place = -math.floor(math.log10(error))
    if error * 10**place < 1.95:
        place += 1
    decimals, rounded = max(place, 0), round(value, place)
    shown = f"{rounded:.{decimals}f}" if rounded else "0"  # no "−0.00", and no digits of what is none
    return f"{shown} ± {round(error, place):.{decimals}f}".replace("-", "−") + tail


FINEST_PERCENT = 1e-3  # nobody asks for less


def percent(share: float) -> str:
    """Return a share of 1 in percent: whole numbers; above 99 and below 1 what is lacking, or there, has a digit.

    So nearly all is not all, which may still be fifty times the noise, and next to nothing is not nothing.
    """
    p = 100 * share
    return f"{p:.{_decimals(p)}f} %".replace("-", "−") if math.isfinite(p) else "?"


def _decimals(p: float) -> int:
    small = round(min(abs(p), 100.0 - p), 9)  # 100 - 99.9 is not quite 0.1
    return math.ceil(-math.log10(small)) if FINEST_PERCENT <= small < 1.0 else 0


def percent_between(share: float, low: float, high: float) -> str:
    """Return a share of 1 with its interval in percent, all to the decimals that the ends need to differ.

    An interval that takes more than one beyond those of the share says no more than that does, and is left out.
    """
    p, ends = 100 * share, (100 * low, 100 * high)
    for decimals in range(_decimals(p), _decimals(p) + 2):
        first, last = (f"{end:.{decimals}f}" for end in ends)
        if first != last:
            return f"{p:.{decimals}f} % ({first}–{last} %)".replace("-", "−")
    return percent(share)


def probability(p: float) -> str:
    """Return a probability as text; certainty is not claimed."""
    if p > 0.99:
        return "> 0.99"
    return "< 0.01" if p < 0.01 else f"{p:.2f}"


LENGTHS = ((1e3, "mm", 0.02), (1e2, "cm", 1.0), (1.0, "m", math.inf))  # factor, unit, up to how many m


def length(value_m: float, error_m: float | None = None) -> str:
    """Return a length in m, cm or mm, whichever reads best."""
    factor, unit = _unit_of(max(abs(value_m), error_m or 0.0))
    return plus_minus(value_m * factor, None if error_m is None else error_m * factor, unit)


def change(before_m: float, after_m: float) -> str:
    """Return `6.8 → 0.81 cm`: two lengths in the unit that suits the first."""
    factor, unit = _unit_of(before_m)
    return f"{number(factor * before_m, 2)} → {number(factor * after_m, 2)} {unit}"


def _unit_of(length_m: float) -> tuple[float, str]:
    return next((factor, unit) for factor, unit, top in LENGTHS if length_m < top or top == math.inf)


def listed(words: Sequence[str], last: str = "and") -> str:
    """Return `a, b and c`."""
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} {last} {words[-1]}" if words else ""


class Values:
    """The values of one effect with their standard errors, both by parameter, and how they read."""

    def __init__(self, values: Mapping[str, float], errors: Mapping[str, float]) -> None:
        self.values, self.errors = values, errors

    def __contains__(self, name: str) -> bool:
        return name in self.values

    def __getitem__(self, name: str) -> float:
        return float(self.values.get(name, math.nan))

    def error(self, name: str) -> float | None:
        e = self.errors.get(name)
        return None if e is None else float(e)

    def show(self, name: str, unit: str = "", factor: float = 1.0, *, magnitude: bool = False) -> str:
        error, value = self.error(name), factor * self[name]
        return plus_minus(abs(value) if magnitude else value, None if error is None else abs(factor) * error, unit)

    def scale(self, name: str, unit: str) -> str:
        """Return a number that is never zero, such as a speed at which a law bends; what is not told has no error."""
        error, value = self.error(name), abs(self[name])
        told = error is None or error < value
        return self.show(name, unit) if told else f"{number(value)} {unit} (the data hardly tell at which)"

    def angle(self, name: str) -> str:
        return self.show(name, "°", DEGREES)

    def long(self, name: str, *others: str) -> str:
        """Return a length, in the unit that suits the largest of it and others that are told beside it."""
        factor, unit = _unit_of(max(max(abs(self[n]), self.error(n) or 0.0) for n in (name, *others)))
        return self.show(name, unit, factor)

    def longs(self, *names: str) -> str:
        """Return lengths in one unit, as in `(2.50 ± 0.02, −1.01 ± 0.02) cm`."""
        shown = [self.long(name, *names).rpartition(" ") for name in names]
        return f"({', '.join(value for value, _, _ in shown)}) {shown[0][2]}"

    def place(self) -> str:
        return f"({number(self['x_m'])}, {number(self['y_m'])}) m"
