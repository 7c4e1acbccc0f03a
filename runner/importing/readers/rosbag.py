"""Bags of ROS 1 (`.bag`) and of ROS 2 (folders with `.db3` or `.mcap`), the former and `.db3` by rosbags.

rosbags turns message definitions, which stand in the bag, into Python code. So that a bag can't bring code along, every
name in its definitions is checked to be a name, and every constant a plain value, before rosbags sees them.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from runner.errors import RecordingError
from runner.importing.readers.arrow import signals_of
from runner.importing.readers.extra import needed
from runner.importing.readers.rerun_files import nested, read_mcap
from runner.importing.signals import BULKY, Clock, Log, ReadOptions, Signal, bulky_notes, file_error, part_of

METADATA = "metadata.yaml"
IDENTIFIER = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
TYPE = re.compile(r"[A-Za-z][A-Za-z0-9_]*(/[A-Za-z][A-Za-z0-9_]*){1,2}")
LARGEST = 4096  # elements of an array of a message that is kept; images and point clouds are larger


def is_bag_folder(path: Path) -> bool:
    """Whether a folder is a bag of ROS 2."""
    return path.is_dir() and (path / METADATA).is_file() and bool(_files(path, ".db3") or _files(path, ".mcap"))


def read_bag_folder(path: Path, options: ReadOptions) -> Log:
    """Read a folder of ROS 2; what was split over several files is one part.

    Raises:
        RecordingError: If a file in it can't be read.
    """
    mcap = _files(path, ".mcap")
    logs = [read_mcap(f, options) for f in mcap] if mcap else [read_ros2(f, options) for f in _files(path, ".db3")]
    joined: dict[str, list[Signal]] = {}
    for log in logs:
        for signal in log.parts[0].signals.values():
            joined.setdefault(signal.name, []).append(signal)
    notes = [note for log in logs for note in log.notes]
    return Log("ROS 2 bag", [part_of(path.name, [_joined(pieces) for pieces in joined.values()])], notes)


def _files(path: Path, suffix: str) -> list[Path]:
    """Return the files of a bag in the order of the numbers at their ends."""
    numbers = {f: re.findall(r"\d+", f.stem) for f in path.glob(f"*{suffix}")}
    return sorted(numbers, key=lambda f: (int(numbers[f][-1]) if numbers[f] else 0, f.name))


def _joined(pieces: list[Signal]) -> Signal:
    first = pieces[0]
    if len(pieces) == 1:
        return first
    clocks = {
        name: Clock(np.concatenate([p.clocks[name].stamps for p in pieces]), clock.in_ns)
        for name, clock in first.clocks.items()
        if all(name in p.clocks for p in pieces)
    }
    return Signal(first.name, first.stream, np.concatenate([p.values for p in pieces]), clocks)


def read_ros1(path: Path, options: ReadOptions) -> Log:
    """Read a `.bag` of ROS 1.

    Raises:
        RecordingError: If it is none, or its message definitions hold more than names and values.
    """
    needed("rosbags", path)
    from rosbags.rosbag1 import Reader
    from rosbags.typesys import Stores, get_typestore

    return _read(path, Reader, get_typestore(Stores.EMPTY), "deserialize_ros1", "ROS 1 bag")


def read_ros2(path: Path, options: ReadOptions) -> Log:
    """Read a `.db3` of ROS 2; one without message definitions, as older ones are, by the types of ROS itself.

    Raises:
        RecordingError: If it is none, or its message definitions hold more than names and values.
    """
    needed("rosbags", path)
    from rosbags.rosbag2 import Reader
    from rosbags.typesys import Stores, get_typestore

    return _read(path, Reader, get_typestore(Stores.ROS2_HUMBLE), "deserialize_cdr", "ROS 2 bag")


def _read(path: Path, reader: type, types: Any, deserialize: str, name: str) -> Log:
    topics: dict[str, tuple[list[dict], list[int]]] = {}
    unread: dict[str, str] = {}
    try:
        with reader(path) as bag:
            bulky = sorted({c.topic for c in bag.connections if BULKY.search(c.msgtype)})
            wanted = [c for c in bag.connections if c.topic not in bulky]
            for connection in wanted:
                _register(path, types, connection)
            for connection, stamp, raw in bag.messages(wanted) if wanted else ():
                if connection.topic in unread:
                    continue
                if connection.msgtype not in types.fielddefs:
                    unread[connection.topic] = connection.msgtype
                    continue
                messages, stamps = topics.setdefault(connection.topic, ([], []))
                messages.append(plain(getattr(types, deserialize)(raw, connection.msgtype)))
                stamps.append(stamp)
    except RecordingError:
        raise
    except Exception as error:  # rosbags, sqlite and struct raise many kinds on a broken file
        raise file_error(path, name, error) from None
    signals: list[Signal] = []
    for topic, (messages, stamps) in topics.items():
        clocks = {"log_time": Clock(np.array(stamps, dtype=np.int64), in_ns=True)}
        signals += signals_of(topic, nested(path, topic, messages), clocks)
    notes = [f"{path.name}: topic '{t}' is not read, the bag does not define {m}" for t, m in unread.items()]
    notes += bulky_notes(path, bulky)
    return Log(name, [part_of(path.name, signals)], notes)


def _register(path: Path, types: Any, connection: Any) -> None:
    """Make the type of a topic known, if the bag defines it, after a look at every name in it."""
    from rosbags.interfaces import MessageDefinitionFormat
    from rosbags.typesys import get_types_from_msg

    definition = connection.msgdef
    if connection.msgtype in types.fielddefs or definition.format is not MessageDefinitionFormat.MSG:
        return
    if not TYPE.fullmatch(connection.msgtype):
        raise RecordingError(f"{path}: the type of topic '{connection.topic}' is no name: {connection.msgtype[:60]!r}.")
    found = get_types_from_msg(definition.data, connection.msgtype)
    check_definitions(path, found)
    types.register({name: of for name, of in found.items() if name not in types.fielddefs})


def check_definitions(path: Path, definitions: Mapping[str, Any]) -> None:
    """Refuse message definitions that hold anything but names, lengths and plain constants.

    Raises:
        RecordingError: Naming the type.
    """
    for name, (constants, fields) in definitions.items():
        names = [*(c[0] for c in constants), *(c[1] for c in constants), *(f[0] for f in fields)]
        named = TYPE.fullmatch(name) and all(isinstance(n, str) and IDENTIFIER.fullmatch(n) for n in names)
        values = all(type(c[2]) in (bool, int, float, str) for c in constants)
        if not (named and values and all(_kind(f[1]) for f in fields)):
            raise RecordingError(f"{path}: the definition of message {name[:60]!r} holds more than names and values.")


def _kind(described: Any) -> bool:
    """Whether a field's type is made of names and lengths alone."""
    from rosbags.interfaces import Nodetype

    node, of = described
    if node == Nodetype.BASE:
        return bool(IDENTIFIER.fullmatch(of[0])) and type(of[1]) is int
    if node == Nodetype.NAME:
        return bool(TYPE.fullmatch(of))
    return type(of[1]) is int and _kind(of[0])


def plain(message: Any) -> Any:
    """Return a message as plain data, without what is too large to be a measurement."""
    if isinstance(message, np.ndarray):
        return message if message.size <= LARGEST else None
    if isinstance(message, list):
        return [plain(m) for m in message] if len(message) <= LARGEST else None
    fields: Iterable[str] = getattr(message, "__dataclass_fields__", ())
    own = {f: plain(getattr(message, f)) for f in fields if not f.startswith("__")}
    return own if own else message
