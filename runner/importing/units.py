"""Units of logs, by what they measure; inside everything is SI and radians."""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

STANDARD_GRAVITY = 9.80665  # m/s2, of kgf and of g

# by SI unit: how much of it one of the log's is
UNITS: Mapping[str, Mapping[str, float]] = {
    "rad": {"rad": 1.0, "mrad": 1e-3, "deg": np.pi / 180, "turn": 2 * np.pi},
    "m": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": 0.0254},
    "rad/s": {"rad/s": 1.0, "deg/s": np.pi / 180, "turn/s": 2 * np.pi, "rpm": np.pi / 30},
    "m/s": {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3},
    "rad/s2": {"rad/s2": 1.0, "deg/s2": np.pi / 180},
    "m/s2": {"m/s2": 1.0, "mm/s2": 1e-3, "g": STANDARD_GRAVITY},
    "N m": {"N m": 1.0, "mN m": 1e-3, "N cm": 1e-2, "kgf cm": STANDARD_GRAVITY / 100},
    "N": {"N": 1.0, "mN": 1e-3, "kN": 1e3, "kgf": STANDARD_GRAVITY, "gf": STANDARD_GRAVITY / 1000},
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
}
# of commands whose unit the MJCF does not tell
ELECTRIC: Mapping[str, float] = {"V": 1.0, "mV": 1e-3, "A": 1.0, "mA": 1e-3, "1": 1.0, "%": 0.01}
SPELLED = {
    "°": "deg", "degree": "deg", "degrees": "deg", "degs": "deg", "radian": "rad", "radians": "rad", "rads": "rad/s",
    "rev": "turn", "turns": "turn", "revolutions": "turn", "rev/s": "turn/s", "rps": "turn/s", "dps": "deg/s",
    "rad/sec": "rad/s", "deg/sec": "deg/s", "meter": "m", "meters": "m", "metre": "m", "metres": "m", "µm": "um",
    "Nm": "N m", "N*m": "N m", "N·m": "N m", "N.m": "N m", "mNm": "mN m", "Ncm": "N cm", "kgcm": "kgf cm",
    "kg cm": "kgf cm", "kgf*cm": "kgf cm", "m/s^2": "m/s2", "m/s²": "m/s2", "rad/s^2": "rad/s2", "inch": "in",
}  # fmt: skip


def spelled(unit: str) -> str:
    """Return a unit as it is spelled here: `Nm` is `N m`."""
    text = re.sub(r"\s+", " ", unit.strip())
    return SPELLED.get(text, text)


def allowed(si_unit: str) -> Mapping[str, float]:
    """Return the units that measure the same as an SI unit, each with its size; of an unknown one, all of them."""
    if si_unit in UNITS:
        return UNITS[si_unit]
    return {name: size for family in UNITS.values() for name, size in family.items()} | dict(ELECTRIC)


def known(unit: str) -> bool:
    """Whether a unit is known at all."""
    return unit in allowed("")
