"""Names taken apart into words, and what the words say of a quantity."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from enum import Enum

GENERIC = {"joint", "motor", "actuator", "act", "servo", "drive", "jnt"}
COMMAND = {
    "cmd", "command", "commands", "commanded", "target", "targets", "action", "actions", "ref", "reference", "goal",
    "desired", "des", "setpoint", "set", "sp", "tgt", "u", "ctrl", "control", "controls", "qref", "qdes", "qcmd",
}  # fmt: skip
POSITION = {
    "position", "positions", "pos", "q", "qpos", "angle", "angles", "theta", "state", "qref", "qdes", "qcmd", "encoder",
    "enc",
}  # fmt: skip
VELOCITY = {"velocity", "velocities", "vel", "dq", "qd", "qvel", "dqpos", "speed", "speeds", "omega"}
RATE = {"rate", "rates"}
FORCE = {"effort", "efforts", "torque", "torques", "tau", "force", "forces", "trq"}
OTHER = {
    "error", "err", "temperature", "temp", "current", "currents", "volt", "volts", "voltage", "pwm", "accel",
    "acceleration", "ddq", "gain", "gains", "min", "max", "limit", "lower", "upper", "id", "status", "mode", "std",
    "covariance",
}  # fmt: skip
SAYS = COMMAND | POSITION | VELOCITY | RATE | FORCE | OTHER  # words of quantities, which are short for nothing
FEWEST_LETTERS = 2  # that are short for a name
# of what is no motion and no force, where nothing else in a name that ends on it says what it is; symbols of units are
# capital: a small letter is a part of a name
OTHER_UNITS = {"amp", "amps", "volts", "watt", "watts", "celsius"}
OTHER_SYMBOLS = re.compile(r"(?<![A-Za-z])(m?[AVW]|(deg)?C)$")
BY_NAME = "by its name"  # why a signal is what it is taken for
LAST_INDEX = re.compile(r"(.*)\[(\d+)\]$")
NUMBER = re.compile(r"\d+")


class Quantity(Enum):
    """What a name says that a signal is."""

    POSITION = "position"
    VELOCITY = "velocity"
    FORCE = "force"
    UNKNOWN = "unknown"


@dataclass(frozen=True)
class Said:
    """What a name says: whether it is a command, of which quantity, and whether it is something else altogether."""

    command: bool
    quantity: Quantity
    other: bool


def words_of(name: str) -> tuple[str, ...]:
    """Return the words of a name in small letters, digits apart: `/jointStates/q1` is joint, states, q, 1."""
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name)
    return tuple(w.lower() for w in re.findall(r"[A-Za-z]+|\d+", spaced))


def contains(words: Sequence[str], wanted: Sequence[str]) -> bool:
    """Whether some words stand in others, one after another."""
    return bool(wanted) and f" {' '.join(wanted)} " in f" {' '.join(words)} "


def own_words(name: str, shared: Collection[str] = ()) -> tuple[tuple[str, ...], ...]:
    """Return by which words an element may be called: all of its name, or without words that tell it from no other.

    Args:
        name: Of the element.
        shared: Words that all elements of its kind have in their names, as `j` in `shoulder_j` and `elbow_j`; words
            such as `joint` go anyway.
    """
    whole = words_of(name)
    bare = tuple(w for w in whole if w not in GENERIC and w not in shared)
    return (whole, bare) if bare and bare != whole and not all(w.isdigit() for w in bare) else (whole,)


def short_for(word: str, names: Iterable[Sequence[str]]) -> bool:
    """Whether a word of two letters or more begins one of some names, and is less than its first word."""
    return len(word) >= FEWEST_LETTERS and any(
        len(word) < len(name[0]) and name[0].startswith(word) for name in names if word not in SAYS
    )


def shared_words(names: Sequence[str]) -> frozenset[str]:
    """Return the words that stand in each of several names."""
    every = [frozenset(words_of(n)) for n in names]
    return frozenset.intersection(*every) if len(every) > 1 else frozenset()


def said_by(words: Sequence[str], name: str, *, named: bool = False) -> Said:
    """Return what the words of a signal's name, without those of its element, say of it.

    Where the element is `named`, a rate is a velocity: `pivot_rate`, but not `sample_rate`.
    """
    have = set(words)
    if have & VELOCITY or (named and have & RATE):
        quantity = Quantity.VELOCITY
    elif have & FORCE:
        quantity = Quantity.FORCE
    elif have & POSITION:
        quantity = Quantity.POSITION
    else:
        quantity = Quantity.UNKNOWN
    ends_on_unit = bool(words) and (words[-1] in OTHER_UNITS or OTHER_SYMBOLS.search(name) is not None)
    unit = quantity is Quantity.UNKNOWN and not have & COMMAND and ends_on_unit
    return Said(bool(have & COMMAND), quantity, unit or bool(have & OTHER))


def without(words: Sequence[str], taken: Sequence[str]) -> tuple[str, ...]:
    """Return words without a run of others, once."""
    n = len(taken)
    for i in range(len(words) - n + 1):
        if tuple(words[i : i + n]) == tuple(taken):
            return (*words[:i], *words[i + n :])
    return tuple(words)
