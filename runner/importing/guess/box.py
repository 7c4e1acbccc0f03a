"""Which signals of a log are the pose of a box that is pushed over a floor, its velocity, the force, and where it acts.

The unit that a name ends in says what may be meant, its words what is: `push_x_mm` is a place and `push_x_N` a force.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Sequence

import numpy as np

from runner.importing.box import COMMANDED, MEASURED, OF_PIN
from runner.importing.guess.elements import BOX, Element, Matches
from runner.importing.guess.names import BY_NAME, words_of
from runner.importing.guess.unit import unit_by_name
from runner.importing.signals import Signal
from runner.importing.units import UNITS, spelled
from runner.recording import Nominal
from runner.recording.table import PIN, POINT
from runner.recording.table import UNITS as SI_UNITS

WIDER = 1.1  # of the box: a force that acts on its skin is measured a little outside of it
TURNS = 2  # that a box is pushed round at most: what goes further is in degrees
COMPACT = re.compile(r"(f|v|w|p|pos|force|vel|tip)([xyz])$")
ONE_OF_TWO = re.compile(r"(.*)([xyuv])((?:[ _.]*[\[(]?[a-z]+[\])]?)?)$", re.IGNORECASE)
PUSH = frozenset(["push", "load", "thrust", "pull", "pushed", "press"])
STRONG = frozenset(["f", "force", "forces"])
PLACE = frozenset(["p", "point", "contact", "at", "application", "applied", "hit", "cop", "lever", "where"])
TOUCH = frozenset(["tip", "pin", "pusher", "probe", "finger"])
TURNING = frozenset(["omega", "yawrate"])
SPEED = TURNING | {"v", "vel", "velocity", "speed", "rate", "w", "spin"}
TURN = TURNING | {"yaw", "theta", "heading", "angle", "rot", "rotation", "psi", "phi", "orientation"}
BODY_AXES = {"u": "x", "v": "y", "x": "x", "y": "y", "z": "z"}
FAMILIES = ("m", "rad", "N", "m/s", "rad/s")


def box_elements(nominal: Nominal) -> dict[str, Element]:
    """Return what signals may be, by column of the case."""
    sizes = dict(zip(POINT, nominal.half_size_m, strict=True))
    out = {}
    commanded = [c for c in COMMANDED if c not in PIN or nominal.pin is not None]  # a path pushes only where a pin is
    for column in (*commanded, *MEASURED):
        limits = (-WIDER * sizes[column], WIDER * sizes[column]) if column in sizes else None
        limits = (-2 * math.pi * TURNS, 2 * math.pi * TURNS) if column == "yaw" else limits
        measured = column in MEASURED or (column in OF_PIN and nominal.pin is not None)
        quantity = "measured" if measured else "command"
        out[column] = Element(BOX, column, quantity, (), SI_UNITS[column], limits)
    return out


def match_box(signals: Sequence[Signal], elements: dict[str, Element], *, besides: Collection[str]) -> Matches:
    """Return which signals are which columns, the plainest name first; what is no other's is left out."""
    matches = Matches()
    free = [s for s in signals if s.name not in besides]
    further: dict[str, list[Signal]] = {}
    for signal in sorted(free, key=lambda s: len(words_of(s.name))):
        column = column_of(signal.name)
        element = elements.get(column or "")
        if column is None or element is None:
            continue
        if matches.has(element):
            further.setdefault(column, []).append(signal)
        else:
            matches.pairs.append((element, signal, BY_NAME))
    points = {axis: elements.get(f"p{axis}") for axis in ("x", "y")}
    if all(e is not None and not matches.has(e) for e in points.values()):
        # two places are told, and it takes two: of the box, and of the force
        others = {a: further[a] for a in points if a in further} or _pairs(free, further, matches)
        if all(len(others.get(a, ())) == 1 for a in points):
            pairs = [(e, others[a][0], "the only other place") for a, e in points.items() if e is not None]
            further = {c: those for c, those in further.items() if c not in points}
            far = [signal.name for element, signal, _ in pairs if _reaches_beyond(signal, element)]
            if far:
                names = ", ".join(f"'{name}'" for name in far)
                matches.notes.append(
                    f"{names}: goes beyond the box, so it is not where the force acts from the box's middle, along its "
                    "axes. A place (X, Y) in the world is that after px = cos(yaw) (X - x) + sin(yaw) (Y - y) and "
                    "py = cos(yaw) (Y - y) - sin(yaw) (X - x); the path of a pusher in the world is tip_x, tip_y, and "
                    "what is believed then has a `pin`"
                )
            else:
                matches.pairs += pairs
    matches.notes += [f"'{s.name}' may be {column} as well" for column, those in further.items() for s in those]
    order = {name: k for k, name in enumerate(elements)}
    matches.pairs.sort(key=lambda pair: order[pair[0].target])
    return matches


def _reaches_beyond(signal: Signal, element: Element) -> bool:
    """Whether numbers whose unit the name tells are outside of what an element can be."""
    unit = unit_by_name(signal.name, element.si_unit)
    if unit is None or unit.name is None or element.limits is None:
        return False
    seen = signal.values[np.isfinite(signal.values)] * UNITS[element.si_unit][unit.name]
    return bool(len(seen)) and not element.limits[0] <= seen.min() <= seen.max() <= element.limits[1]


def _pairs(signals: Sequence[Signal], further: dict[str, list[Signal]], matches: Matches) -> dict[str, list[Signal]]:
    """Return signals that are nothing else, by x or y, where their names differ by that alone: `Cx (mm)`, `Cy (mm)`."""
    known = {s.name for _, s, _ in matches.pairs} | {s.name for those in further.values() for s in those}
    by_stem: dict[tuple[str, str], dict[str, Signal]] = {}
    for signal in signals:
        found = ONE_OF_TWO.match(signal.name)
        if found and signal.name not in known and (not found[3] or unit_by_name(signal.name, "m") is not None):
            by_stem.setdefault((found[1], found[3]), {}).setdefault(BODY_AXES[found[2].lower()], signal)
    both = [axes for axes in by_stem.values() if {*axes} == {"x", "y"}]
    return {a: [axes[a] for axes in both] for a in ("x", "y")}


def column_of(name: str) -> str | None:
    """Return the column of a case that a signal is by its name; None: nothing says so."""
    family = next((si for si in FAMILIES if unit_by_name(name, si) is not None), None)
    words: set[str] = set()
    for word in words_of(name):
        compact = COMPACT.match(word)
        words |= set(compact.groups()) if compact else {word}
    words -= {w for w in words if any(spelled(w) in units for units in UNITS.values()) and w not in BODY_AXES}
    placed = bool(words & (PLACE | PUSH | STRONG)) and (family == "m" or (family is None and not words & STRONG))
    own_axes = family == "m" and bool(words) and words <= {"u", "v"}  # lengths along axes that are not the world's
    if own_axes or (placed and (words & PLACE or family == "m")):
        return _axis("p", words, BODY_AXES)
    if family == "N" or (family is None and words & (STRONG | PUSH)):
        return _axis("f", words - {"v"}, BODY_AXES)
    if family in ("rad", "rad/s") or (family is None and words & TURN) or (family is None and words & {"w"}):
        return "wz" if family == "rad/s" or words & SPEED else "yaw"
    if words & TOUCH:
        return _axis("tip_", words, BODY_AXES)
    quick = family == "m/s" or (family is None and bool(words & SPEED))
    return _axis("v" if quick else "", words - {"v"}, {"x": "x", "y": "y"})


def _axis(prefix: str, words: Collection[str], axes: dict[str, str]) -> str | None:
    """Return a column of the axis that is named; of two letters that may be one, the later in the alphabet."""
    named = sorted(set(words) & set(axes))
    return prefix + axes[named[-1]] if named else None
