"""Which signals look like commands of actuators, positions and velocities of joints, forces of actuators."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field

import mujoco
import numpy as np

from runner.importing.guess.names import (
    BY_NAME,
    LAST_INDEX,
    NUMBER,
    Quantity,
    Said,
    contains,
    own_words,
    said_by,
    shared_words,
    short_for,
    without,
    words_of,
)
from runner.importing.signals import Signal
from runner.recording.model_form_mapping import AT_JOINT, HINGE, SCALAR_JOINTS, gives_its_command, is_servo

FEWEST_TO_FOLLOW = 20  # samples
FOLLOWS, AS_FAR = 0.8, 3.0  # correlation of a position with its target, and how many times as far it may go
QUANTITIES = ("command", "position", "velocity", "force")  # in this order in a map
BOX = "box"
COUNTERS = frozenset(["index", "frame_index", "episode_index", "task_index", "episode", "step", "seq"])


@dataclass(frozen=True)
class Element:
    """Something of a model that a signal may be.

    Args:
        kind: actuator | joint | box.
        target: Its name.
        quantity: command | position | velocity | force; of a box command | measured.
        names: Words that it may be called by: of its own name, and of its joint's.
        si_unit: Of its numbers; "": the model does not tell.
        limits: Range that the numbers should be in, if the model has one.
        takes: Of a command, which quantity it commands.
    """

    kind: str
    target: str
    quantity: str
    names: tuple[tuple[str, ...], ...]
    si_unit: str
    limits: tuple[float, float] | None
    takes: Quantity = Quantity.UNKNOWN

    @property
    def is_command(self) -> bool:
        """Whether it is a command."""
        return self.quantity == "command"

    @property
    def column(self) -> str:
        """Name of its column."""
        if self.kind == BOX:
            return self.target
        return {"command": "u", "position": "q", "velocity": "dq", "force": "tau"}[self.quantity] + f"_{self.target}"

    @property
    def keys(self) -> dict[str, str]:
        """What stands in the map."""
        if self.kind == BOX:
            return {}
        own = {self.kind: self.target}
        return own if self.is_command else own | {"quantity": self.quantity}

    @property
    def words(self) -> str:
        """What is said to the user."""
        if self.kind == BOX:
            return f"{self.target} of the box"
        return f"{self.quantity} of {self.kind} {self.target}" if not self.is_command else f"command of {self.target}"


@dataclass(eq=False)
class Matches:
    """Elements with their signals and how they were recognised, and what is to be said."""

    pairs: list[tuple[Element, Signal, str]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    unsigned: list[str] = field(default_factory=list)

    def has(self, element: Element) -> bool:
        """Whether an element has its signal."""
        return any(e is element for e, _, _ in self.pairs)


def elements_of(model: mujoco.MjModel) -> list[Element]:
    """Return what signals may be, in the order of the model."""
    out = []
    of_actuators = shared_words([model.actuator(i).name for i in range(model.nu)])
    of_joints = shared_words([model.joint(j).name for j in range(model.njnt)])
    for i in range(model.nu):
        actuator = model.actuator(i)
        at_joint = int(model.actuator_trntype[i]) in AT_JOINT
        joint = model.joint(int(model.actuator_trnid[i, 0])) if at_joint else None
        names = own_words(actuator.name, of_actuators) + (own_words(joint.name, of_joints) if joint is not None else ())
        hinge = joint is not None and int(joint.type[0]) == HINGE
        limits = _range(actuator.ctrlrange) if actuator.ctrllimited[0] else None
        servo = is_servo(model, i)
        if servo:
            si_unit, takes = ("rad" if hinge else "m"), Quantity.POSITION
            if limits is None and joint is not None and joint.limited[0]:
                limits = _range(joint.range)
        else:
            plain = gives_its_command(model, i)
            si_unit, takes = ("N m" if hinge else "N") if plain and joint is not None else "", Quantity.FORCE
            takes = takes if plain else Quantity.UNKNOWN
        out.append(Element("actuator", actuator.name, "command", names, si_unit, limits, takes))
        out.append(Element("actuator", actuator.name, "force", names, "N m" if hinge else "N", None))
    for j in range(model.njnt):
        joint = model.joint(j)
        unit = SCALAR_JOINTS.get(int(joint.type[0]))
        if unit is not None:
            limits = _range(joint.range) if joint.limited[0] else None
            names = own_words(joint.name, of_joints)
            out.append(Element("joint", joint.name, "position", names, unit, limits))
            out.append(Element("joint", joint.name, "velocity", names, f"{unit}/s", None))
    return out


def _range(pair: Sequence[float]) -> tuple[float, float]:
    return float(pair[0]), float(pair[1])


def match(signals: Sequence[Signal], elements: Sequence[Element], *, besides: Collection[str]) -> Matches:
    """Return which signals are which elements: by names, then lists without names in the order of the model.

    Args:
        signals: Of a part.
        elements: Of the model.
        besides: Names of signals that are something else, such as clocks.
    """
    free = [s for s in signals if s.name not in besides and s.name not in COUNTERS]
    matches = Matches()
    for signal in sorted(free, key=lambda s: len(words_of(s.name))):  # the plainest name first
        _by_name(signal, elements, matches)
    taken = {s.name for _, s, _ in matches.pairs}
    _by_order([s for s in free if s.name not in taken], elements, matches)
    order = {id(e): (QUANTITIES.index(e.quantity), k) for k, e in enumerate(elements)}
    matches.pairs.sort(key=lambda pair: order[id(pair[0])])
    forces = [f"'{s.name}'" for e, s, _ in matches.pairs if e.quantity == "force"]
    if matches.unsigned:
        names = ", ".join(f"'{n}'" for n in matches.unsigned)
        matches.notes.append(f"left out, as they are never negative, and no forces without a direction: {names}")
    if forces:
        matches.notes.append(f"taken for measured forces: {', '.join(forces)}; what was commanded belongs to commands")
    return matches


def match_followers(
    matches: Matches,
    signals: Sequence[Signal],
    elements: Sequence[Element],
    model: mujoco.MjModel,
    besides: Collection[str],
) -> None:
    """Add positions of joints that no name tells: the one signal that follows what the joint's servo is told.

    Args:
        matches: So far; positions are added to them.
        signals: Of a part.
        elements: Of the model.
        model: The compiled MJCF.
        besides: Names of signals that are something else, such as clocks.
    """
    for command, told, _ in list(matches.pairs):
        if command.takes is not Quantity.POSITION or not command.is_command:
            continue
        joint = model.joint(int(model.actuator(command.target).trnid[0])).name
        position = next(e for e in elements if (e.kind, e.target, e.quantity) == ("joint", joint, "position"))
        taken = {s.name for _, s, _ in matches.pairs} | set(besides) | COUNTERS
        left = [s for s in signals if s.name not in taken and _follows(s, told)]
        if not matches.has(position) and len(left) == 1:
            matches.pairs.append((position, left[0], f"follows '{told.name}'"))


def _follows(signal: Signal, told: Signal) -> bool:
    """Whether a signal goes along with another, and about as far."""
    if len(signal.values) != len(told.values):
        return False
    both = np.isfinite(signal.values) & np.isfinite(told.values)
    own, other = signal.values[both], told.values[both]
    if both.sum() < FEWEST_TO_FOLLOW or not np.ptp(own) or not np.ptp(other):
        return False
    alike = float(np.corrcoef(own, other)[0, 1])
    return alike > FOLLOWS and 1 / AS_FAR < float(np.std(own) / np.std(other)) < AS_FAR


def _by_name(signal: Signal, elements: Sequence[Element], matches: Matches) -> None:
    words = words_of(signal.name)
    named = [(name, e) for e in elements for name in e.names if contains(words, name)]
    alone = len({e.target for e in elements if e.kind == "joint"}) == 1
    if not named and alone:
        named = [((), e) for e in elements]
    short = "" if named else _short(words, elements)
    if short:
        named = [((short,), e) for e in elements if short_for(short, e.names)]
    if not named:
        return
    longest = max(len(name) for name, _ in named)
    named = [(name, e) for name, e in named if len(name) == longest]
    said = said_by(without(words, named[0][0]), signal.name, named=bool(named[0][0]))
    vague = said.quantity is Quantity.UNKNOWN and not said.command
    if said.other or (vague and (short or not named[0][0])):
        return
    wanted = [e for _, e in named if _fits(e, said)]
    if not wanted:
        if said.command:
            matches.notes.append(f"'{signal.name}' looks like a command, but of nothing that the actuator takes")
        return
    element = wanted[0]
    if element.quantity == "force" and not (signal.values < 0).any():
        matches.unsigned.append(signal.name)
        return
    if matches.has(element):
        matches.notes.append(f"'{signal.name}' may be the {element.words} as well")
        return
    why = f"'{short}' as short for it" if short else BY_NAME if named[0][0] else "the only joint"
    if vague:
        why += ", no word says of which quantity"
    matches.pairs.append((element, signal, why))


def _short(words: Sequence[str], elements: Sequence[Element]) -> str:
    """Return the word that is short for a joint or its actuator and for no other, as `sh` for shoulder; "": none is."""
    for word in words:
        joints = {e.target for e in elements if e.kind == "joint" and short_for(word, e.names)}
        driven = {e.target for e in elements if e.is_command and short_for(word, e.names)}
        if len(joints) < 2 and len(driven) < 2 and (joints or driven):
            return word
    return ""


def _fits(element: Element, said: Said) -> bool:
    if element.is_command != said.command:
        return False
    if element.is_command:
        unknown = Quantity.UNKNOWN in (said.quantity, element.takes)
        return unknown or said.quantity is element.takes
    quantity = Quantity.POSITION if said.quantity is Quantity.UNKNOWN else said.quantity
    return element.quantity == quantity.value


def _by_order(signals: Sequence[Signal], elements: Sequence[Element], matches: Matches) -> None:
    """Match lists of numbers without names, as long as there are joints or actuators, in the order of the model.

    So are signals whose names differ in a number alone, as `j1_target` and `j2_target`.
    """
    lists: dict[str, list[tuple[int, Signal]]] = {}
    for signal in signals:
        indexed, numbers = LAST_INDEX.match(signal.name), NUMBER.findall(signal.name)
        if indexed:
            lists.setdefault(indexed[1], []).append((int(indexed[2]), signal))
        elif len(numbers) == 1:
            lists.setdefault(NUMBER.sub("#", signal.name), []).append((int(numbers[0]), signal))
    for base, members in lists.items():
        said = said_by(words_of(base), base)
        if said.other or (said.quantity is Quantity.UNKNOWN and not said.command):
            continue
        wanted = [e for e in elements if _fits(e, said)]
        indices = [i for i, _ in sorted(members, key=lambda m: m[0])]
        counted = [list(range(begin, begin + len(wanted))) for begin in (0, 1)]
        if not wanted or indices not in counted or any(matches.has(e) for e in wanted):
            continue
        for element, (i, signal) in zip(wanted, sorted(members, key=lambda m: m[0]), strict=True):
            matches.pairs.append((element, signal, f"number {i} of {len(wanted)}, in the order of the model"))
        kind = wanted[0].kind
        matches.notes.append(f"'{base}' has no names: assumed to be the {kind}s in the order of the model")
