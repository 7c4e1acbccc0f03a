"""What a map asks for, checked against the model: one entry for each column of the case, with its conversion to SI."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from runner.errors import RecordingError, nearest
from runner.importing import units
from runner.importing.map_file import Between, ChannelKeys, Commanded, Converted, Map, Order, Up
from runner.numerics.arrays import FloatArray
from runner.recording.model_form_mapping import ModelMapping, read_mapping

# x, y, z of a world whose y points up are x, -z, y of one whose z does
Z_UP_AXIS = {"x": ("x", 1.0), "y": ("z", 1.0), "z": ("y", -1.0)}
PARTS = ("w", "x", "y", "z")


class Role(Enum):
    """What a column is for."""

    COMMAND = "command"
    CHANNEL = "channel"


@dataclass(frozen=True)
class Entry:
    """One column of the case.

    Args:
        key: Its place in the map.
        column: Its name in the case.
        signal: That it comes from.
        role: Commands are held, channels are not.
        size: How much of the SI unit one of the log's is, with the sign of its axis.
        scale, offset: Applied before, in the log's unit.
        clock: Other than the map's.
        unit, si_unit: For messages.
        between: What a command does between its samples.
        value: That it has all the time, in the log's unit; None: what the signal says.
        acts: Of where a force acts: the columns of that force.
    """

    key: str
    column: str
    signal: str
    role: Role
    size: float = 1.0
    scale: float = 1.0
    offset: float = 0.0
    clock: str | None = None
    unit: str = ""
    si_unit: str = ""
    between: Between = Between.HELD
    value: float | None = None
    acts: tuple[str, ...] = ()

    def si(self, values: FloatArray) -> FloatArray:
        """Return values of the log in SI."""
        if self.value is not None:
            return np.full(len(values), self.value * self.size)
        return (self.scale * values + self.offset) * self.size

    @property
    def formula(self) -> str:
        """What of the log it is, before its unit is changed: `-0.5 z`, or `3 always`."""
        if self.value is not None:
            return f"{self.value:g} always"
        scale = "" if self.scale == 1.0 else f"{self.scale:g} "
        offset = f" {'-' if self.offset < 0 else '+'} {abs(self.offset):g}" if self.offset else ""
        taken = f"{scale}{self.signal}{offset}"
        if self.size > 0:
            return taken
        return f"-{taken}" if taken == self.signal else f"-({taken})"


@dataclass(frozen=True)
class Plan:
    """What is to be made.

    Args:
        entries: The columns.
        nominal: Content of the case's `nominal.yaml`.
        mapping: What that says of the model; of a box, None.
        model: The compiled MJCF; of a box, which is checked as a whole when the case is read, None.
    """

    entries: tuple[Entry, ...]
    nominal: Mapping[str, Any]
    mapping: ModelMapping | None
    model: mujoco.MjModel | None


def plan(path: Path, wanted: Map, model: mujoco.MjModel, model_name: str) -> Plan:
    """Return what a map asks for.

    Args:
        path: The map, for messages.
        wanted: What it says.
        model: The compiled MJCF.
        model_name: How the MJCF is called in the case.

    Raises:
        RecordingError: If an element is not in the model, or a unit measures something else.
    """
    nominal = _nominal(wanted, model_name)
    mapping = read_mapping(path, nominal, model)
    entries, beside = list[Entry](), beside_of(wanted.commands)
    try:
        for name, command in wanted.commands.items():
            unit = mapping.units.get(name, "")
            entries.append(entry_of(f"commands.{name}", name, command, unit, Role.COMMAND, beside=beside))
        for name, channel in wanted.channels.items():
            entries += _channel(name, channel, wanted.up, mapping.units.get(name, ""))
        entries += _forces(wanted)
    except RecordingError as error:
        raise RecordingError(f"{path}: {error}") from None
    taken = [e.column for e in entries]
    twice = next((e for e in entries if taken.count(e.column) > 1), None)
    if twice is not None:
        raise RecordingError(f"{path}: {twice.key}: its column '{twice.column}' is there twice; name the others so.")
    return Plan(tuple(entries), nominal, mapping, model)


def _nominal(wanted: Map, model_name: str) -> dict[str, Any]:
    """Return the content of `nominal.yaml`."""
    content: dict[str, Any] = {"model": model_name}
    if wanted.commands:
        content["commands"] = {name: {"actuator": c.actuator} for name, c in wanted.commands.items()}
    if wanted.forces:
        content["forces"] = [_force(i, f.point is not None) | {"body": f.body} for i, f in enumerate(wanted.forces)]
    content["channels"] = {name: _measured(name, c, wanted.up) for name, c in wanted.channels.items()}
    if wanted.noise:
        content["noise"] = dict(wanted.noise)
    content["start"] = wanted.start
    if wanted.known:
        content["known"] = wanted.known
    return content


def _measured(name: str, channel: ChannelKeys, up: Up) -> dict[str, Any]:
    keys = ("joint", "actuator", "body", "sensor", "quantity", "axis", "index")
    own = {k: v for k in keys if (v := getattr(channel, k)) is not None}
    if up is Up.Y and channel.body is not None and own.get("axis") in Z_UP_AXIS:
        own["axis"] = Z_UP_AXIS[own["axis"]][0]
    if channel.quantity == "orientation":
        own["columns"] = [f"{name}_{p}" for p in PARTS]
    return own


def _force(number: int, has_point: bool) -> dict[str, list[str]]:
    columns = {"force": [f"force{number}_{a}" for a in "xyz"]}
    return columns | ({"point": [f"point{number}_{a}" for a in "xyz"]} if has_point else {})


def beside_of(commands: Mapping[str, Converted]) -> str | None:
    """Return the signal of the first command that has one: at its times a command has its value that has no other."""
    return next((c.signal for c in commands.values() if c.signal is not None), None)


def entry_of(
    key: str, column: str, of: Converted, si_unit: str, role: Role, sign: float = 1.0, *, beside: str | None = None
) -> Entry:
    """Return the entry of a column that is one signal, or one value at the times of another, with its conversion."""
    value = of.value if isinstance(of, Commanded) else None
    if value is not None and (of.signal is not None or beside is None):
        why = "stands in the place of `signal`" if of.signal is not None else "needs another command that has a signal"
        raise RecordingError(f"{key}.value: {why}.")
    signal = of.signal if value is None else beside
    if signal is None:
        raise RecordingError(f"{key}: missing 'signal'.")
    unit = si_unit if of.unit is None else of.unit
    return Entry(
        key=key,
        column=column,
        signal=signal,
        role=role,
        size=sign * size_of(f"{key}.unit", unit, si_unit),
        scale=of.scale,
        offset=of.offset,
        clock=of.clock,
        unit=unit,
        si_unit=si_unit,
        between=of.between if isinstance(of, Commanded) else Between.HELD,
        value=value,
    )


def size_of(key: str, unit: str, si_unit: str) -> float:
    """Return how much of an SI unit another unit is.

    Raises:
        RecordingError: If it measures something else.
    """
    if unit == si_unit:
        return 1.0
    family = units.allowed(si_unit)
    if unit not in family:
        other = unit in units.ELECTRIC and unit != "1"
        hint = f" Without `unit`, and with `scale: S`, where S is how many {si_unit} one {unit} gives." if other else ""
        raise RecordingError(f"{key}: '{unit}' is none of what is measured in {si_unit}. {nearest(unit, family)}{hint}")
    return family[unit]


def _channel(name: str, channel: ChannelKeys, up: Up, si_unit: str) -> list[Entry]:
    key = f"channels.{name}"
    if channel.quantity != "orientation":
        turned = up is Up.Y and channel.body is not None and channel.axis in Z_UP_AXIS
        sign = Z_UP_AXIS[str(channel.axis)][1] if turned else 1.0
        return [entry_of(key, name, channel, si_unit, Role.CHANNEL, sign)]
    assert channel.signals is not None
    order = "wxyz" if channel.order is Order.WXYZ else "xyzw"
    by_part = dict(zip(order, channel.signals, strict=True))
    # turning world and body alike: x, y, z of the axis turn as any vector does, the angle stays
    source = {"w": ("w", 1.0)} | ({to: (a, s) for a, (to, s) in Z_UP_AXIS.items()} if up is Up.Y else {})
    out = []
    for part in PARTS:
        of, sign = source.get(part, (part, 1.0))
        out.append(Entry(key, f"{name}_{part}", by_part[of], Role.CHANNEL, size=sign, clock=channel.clock))
    return out


def _forces(wanted: Map) -> list[Entry]:
    """Return the columns of recorded forces: world axes turn with the world, axes of the body with the body."""
    out = []
    for i, force in enumerate(wanted.forces):
        triples = [("force", force.force, force.unit, "N")]
        if force.point is not None:
            triples.append(("point", force.point, force.point_unit, "m"))
        acts = tuple(f"force{i}_{a}" for a in "xyz")
        for what, names, unit, si_unit in triples:
            size = size_of(f"forces[{i}].{'unit' if what == 'force' else 'point_unit'}", unit, si_unit)
            for axis, name in zip("xyz", names, strict=True):
                to, sign = Z_UP_AXIS[axis] if wanted.up is Up.Y else (axis, 1.0)
                key = f"forces[{i}].{what}"
                out.append(
                    Entry(
                        key, f"{what}{i}_{to}", name, Role.COMMAND, size=sign * size, clock=force.clock,
                        unit=unit, si_unit=si_unit, between=force.between if what == "force" else Between.HELD,
                        acts=acts if what == "point" else (),
                    )
                )  # fmt: skip
    return out


__all__ = ["Entry", "Plan", "Role", "beside_of", "entry_of", "plan", "size_of"]
