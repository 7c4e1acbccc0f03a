"""What readers yield: named series of numbers, each with the clocks that its samples were stamped by."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from runner.errors import RecordingError, nearest
from runner.numerics.arrays import FloatArray

Integers = NDArray[np.int64]

# messages that hold no measurements of a mechanism, and much of everything else; their topics are not even decoded
BULKY = re.compile(r"Image|Video|PointCloud|LaserScan|OccupancyGrid|Costmap|Marker|Octomap|Mesh")
LISTED = 12  # names in a message: more are counted
TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}


@dataclass(frozen=True, eq=False)
class Clock:
    """Stamps of samples.

    Args:
        stamps: In the order of arrival, (T,): whole nanoseconds, or numbers in a unit that only the map knows.
        in_ns: Whether they are nanoseconds; whole numbers since 1970 don't fit into a double without loss.
    """

    stamps: NDArray[np.int64 | np.float64]
    in_ns: bool


@dataclass(frozen=True, eq=False)
class Signal:
    """One series of numbers.

    Args:
        name: In the log, such as `/joint_states/position[elbow]`.
        stream: The topic, table or group that it is a part of; signals of one stream and length share their samples.
        values: (T,), NaN where the log has no number.
        clocks: By name; all (T,).
    """

    name: str
    stream: str
    values: FloatArray
    clocks: Mapping[str, Clock] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.values)


@dataclass(frozen=True, eq=False)
class Part:
    """What was recorded in one go: a file, an episode of a data set, a recording of several in a file.

    `words` are columns that hold words where numbers should be: by name what stands in the first such row.
    """

    name: str
    signals: Mapping[str, Signal]
    words: Mapping[str, str] = field(default_factory=dict)

    def signal(self, key: str, name: str) -> Signal:
        """Return a signal.

        Raises:
            RecordingError: If there is none of that name; `key` is the place in the map that asked for it.
        """
        if name in self.signals:
            return self.signals[name]
        if name in self.words:
            raise RecordingError(
                f"{key}: '{name}' of {self.name} is no column of numbers: {self.words[name]}. Where nothing was read a "
                "cell is empty, or nan, n/a, null."
            )
        raise RecordingError(f"{key}: no signal '{name}' in {self.name}. {nearest_of(name, self.signals)}")


@dataclass(frozen=True, eq=False)
class Log:
    """A log: parts that hold the same signals, the format's name, and what was odd about it, one sentence each.

    `decimal` is the decimal mark of a text table.
    """

    format: str
    parts: Sequence[Part]
    notes: Sequence[str] = ()
    decimal: str = "."


@dataclass(frozen=True)
class ReadOptions:
    """What a reader may need to be told.

    Args:
        decimal: Decimal mark of a text table; None: what its cells show.
        rate_hz: Samples per second of data that have no time, such as arrays of HDF5.
    """

    decimal: str | None = None
    rate_hz: float | None = None


def nearest_of(name: str, names: Mapping[str, object]) -> str:
    """Return what is there instead of a name; of many names the nearest ones."""
    if not names:
        return "There are none."
    if len(names) <= LISTED:
        return nearest(name, names)
    import difflib

    close = difflib.get_close_matches(name, names, n=3, cutoff=0.4) or sorted(names)[:3]
    return f"There are {len(names)}, near it: {', '.join(map(repr, close))}."


def part_of(name: str, signals: Sequence[Signal]) -> Part:
    """Return a part of signals in their order; of two of one name the second gets a number."""
    named: dict[str, Signal] = {}
    for signal in signals:
        free, number = signal.name, 2
        while free in named:
            free, number = f"{signal.name}#{number}", number + 1
        named[free] = signal
    return Part(name, named)


def bulky_notes(path: Path, topics: Sequence[str]) -> list[str]:
    """Return what is said of topics that were left out for what they hold."""
    return [f"{path.name}: images, clouds and the like are not read: {', '.join(map(repr, topics))}"] if topics else []


def file_error(path: Path, what: str, error: BaseException) -> RecordingError:
    """Return the error for a file that a library can't read, in one line."""
    said = " ".join(str(error).split()) or type(error).__name__
    return RecordingError(f"{path}: can't be read as {what}: {said[:300].rstrip('.')}.")
