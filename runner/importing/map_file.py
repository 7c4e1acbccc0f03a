"""The keys of `map.yaml`: which signal of a log is which command or channel of a case.

log: {decimal: ".", rate_hz: null, sparse: false}
clock: {name: header_stamp, unit: s}             # which clock; its unit where the log does not tell
episodes: {by: part}                             # part | column (signal: NAME) | gap (longer_than_s: 1) | restart
rows: {at: all}                                  # all | even or nearest (rate_hz: 100) | a command or channel
up: z                                            # or y: which axis of the log's world points up
commands:
  u_elbow: {signal: "/command/data[1]", actuator: elbow, unit: deg, scale: 1, offset: 0}
channels:                                        # what is measured as in `nominal.yaml`, and the signal it comes from
  q_elbow: {signal: "/joint_states/position[elbow]", joint: elbow, quantity: position, unit: rad}
  x: {signal: "/pose/position/x", body: object, quantity: position, axis: x, unit: mm}
  quat: {signals: [a, b, c, d], order: xyzw, body: object, quantity: orientation}
forces:
  - {body: object, force: [a, b, c], point: [d, e, f], unit: N, point_unit: mm, between: line}   # curve, held
noise: {q_elbow: 0.001}                          # SI
start: free                                      # or rest
known: [gravity]                                 # optional: effects that are not the case
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from enum import Enum
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import AfterValidator, BaseModel, Field, ValidationError, model_validator

from runner.errors import RecordingError, nearest
from runner.importing import units
from runner.recording.nominal import load_mapping
from runner.storage.checked import dotted, must, refusal, refused

FILE = "map.yaml"
TO_FILL = "TODO"  # stands in a proposed map where somebody has to decide
ALL, EVEN, NEAREST = "all", "even", "nearest"
COLUMN = re.compile(r"[A-Za-z_]\w*")
TAKEN = ("episode", "t")


class By(Enum):
    """Where episodes begin."""

    PART = "part"
    COLUMN = "column"
    GAP = "gap"
    RESTART = "restart"


class Up(Enum):
    """Which axis of the log's world points up."""

    Y = "y"
    Z = "z"


class Between(Enum):
    """What a command does from one of its samples to the next.

    A case holds what stands in a row until the next one: of a line or a curve that is its mean over that time, so that
    it pushes as much as that does, and no half row late.
    """

    HELD = "held"
    LINE = "line"
    CURVE = "curve"

    @property
    def moves_on(self) -> bool:
        """Whether a sample is one of something that changes all the time."""
        return self is not Between.HELD


class Order(Enum):
    """Where the scalar of a quaternion stands."""

    WXYZ = "wxyz"
    XYZW = "xyzw"


def _unit(value: str) -> str:
    value = units.spelled(value)
    if not units.known(value):
        raise refused(f"unknown unit '{value}'. {nearest(value, units.allowed(''))}")
    return value


def _time_unit(value: str) -> str:
    if value not in units.UNITS["s"]:
        raise refused(f"unknown unit of time '{value}'. {nearest(value, units.UNITS['s'])}")
    return value


def _mark(value: str) -> str:
    if value not in (".", ","):
        raise refused(f"must be '.' or ',', got {value!r}.")
    return value


_Positive = Annotated[float, Field(gt=0, allow_inf_nan=False), must("be a finite number > 0")]
_Number = Annotated[float, Field(allow_inf_nan=False), must("be a finite number")]
_Text = Annotated[str, must("be a text")]
_Unit = Annotated[str, must("be a text such as 'deg'"), AfterValidator(_unit)]
_TimeUnit = Annotated[str, must("be a text such as 'ms'"), AfterValidator(_time_unit)]
_Triple = Annotated[list[str], Field(min_length=3, max_length=3), must("be the names of 3 signals")]
_Four = Annotated[list[str], Field(min_length=4, max_length=4), must("be the names of 4 signals")]


class _Section(BaseModel, extra="forbid"):
    """Keys of a section: no others than these."""


class LogKeys(_Section):
    """How the log is read."""

    decimal: Annotated[str, must("be '.' or ','"), AfterValidator(_mark)] = "."
    rate_hz: _Positive | None = None
    sparse: bool = False


class ClockKeys(_Section):
    """Which clock, and the unit of its numbers where the log does not tell."""

    name: _Text
    unit: _TimeUnit = "s"


class EpisodeKeys(_Section):
    """Where episodes begin."""

    by: By = By.PART
    signal: _Text | None = None
    longer_than_s: _Positive | None = None

    @model_validator(mode="after")
    def _complete(self) -> EpisodeKeys:
        if (self.signal is not None) != (self.by is By.COLUMN):
            raise refused("`by: column` needs `signal`, the signal that counts the episodes; others have none.")
        if (self.longer_than_s is not None) != (self.by is By.GAP):
            raise refused("`by: gap` needs `longer_than_s`, how long a gap parts two episodes; others have none.")
        return self


class RowKeys(_Section):
    """At which times the case has rows."""

    at: _Text = ALL
    rate_hz: _Positive | None = None

    @model_validator(mode="after")
    def _complete(self) -> RowKeys:
        if (self.rate_hz is not None) != (self.at in (EVEN, NEAREST)):
            raise refused("`at: even` and `at: nearest` need `rate_hz`, the rows per second; others have none.")
        return self


class Converted(_Section):
    """A signal, and how its numbers become SI: (scale * number + offset) in `unit`."""

    signal: _Text | None = None
    unit: _Unit | None = None
    scale: _Number = 1.0
    offset: _Number = 0.0
    clock: _Text | None = None


class Commanded(Converted):
    """A command of a box: from a signal, or one `value` all the time; `between` is for what was measured."""

    value: _Number | None = None
    between: Between = Between.HELD


class CommandKeys(Commanded):
    """A command: what it drives."""

    actuator: _Text


class ChannelKeys(Converted):
    """A channel: what it measures; exactly as in `nominal.yaml`, which is checked when the case is made."""

    signals: _Four | None = None
    order: Order | None = None
    joint: _Text | None = None
    actuator: _Text | None = None
    body: _Text | None = None
    sensor: _Text | None = None
    quantity: _Text | None = None
    axis: _Text | None = None
    index: int | None = None

    @model_validator(mode="after")
    def _complete(self) -> ChannelKeys:
        turned = self.quantity == "orientation"
        if turned and (self.signals is None or self.order is None):
            raise refused("an orientation needs `signals`, four names, and `order`: wxyz or xyzw.")
        if not turned and (self.signal is None or self.signals is not None or self.order is not None):
            raise refused("needs `signal`, one name; `signals` and `order` are for an orientation.")
        return self


class ForceKeys(_Section):
    """A recorded force on a body."""

    body: _Text
    force: _Triple
    point: _Triple | None = None
    unit: _Unit = "N"
    point_unit: _Unit = "m"
    clock: _Text | None = None
    between: Between = Between.HELD


class AnyMap(_Section):
    """What the map of every log says."""

    log: LogKeys = LogKeys()
    clock: ClockKeys | None = None
    episodes: EpisodeKeys = EpisodeKeys()
    rows: RowKeys = RowKeys()
    noise: dict[str, _Positive | None] = {}


class Map(AnyMap):
    """What stands in `map.yaml` of a mechanism."""

    up: Up = Up.Z
    commands: dict[str, CommandKeys] = {}
    channels: dict[str, ChannelKeys]
    forces: list[ForceKeys] = []
    start: _Text = "free"
    known: list[_Text] = []


class BoxMap(AnyMap):
    """What stands in `map.yaml` of a box that is pushed over a floor: columns of the case, each from its signal."""

    commands: dict[str, Commanded] = {}
    channels: dict[str, Converted]


M = TypeVar("M", Map, BoxMap)


def read_map(path: Path, kind: type[M]) -> M:
    """Return what a map says, checked by itself; whether signals and elements are there is seen when it is used.

    Args:
        path: The map.
        kind: Of what it is the map.

    Raises:
        RecordingError: Naming the file, the key, the value and what is allowed.
    """
    if not path.is_file():
        raise RecordingError(f"map: no file '{path}'; without map= one is proposed.")
    content = load_mapping(path, ("channels",))
    left = _left_open(content, ())
    if left is not None:
        raise RecordingError(f"{path}: {dotted(left)}: is left open ({TO_FILL}); fill it in.")
    try:
        found = kind.model_validate({str(k): v for k, v in content.items() if v is not None})
        for group, entries in (("commands", found.commands), ("channels", found.channels)):
            for name in entries:
                _check_column(f"{group}.{name}", name, found.commands if group == "channels" else {})
    except ValidationError as error:
        raise RecordingError(f"{path}: {_refused(error, kind)}") from None
    except RecordingError as error:
        raise RecordingError(f"{path}: {error}") from None
    return found


def _check_column(key: str, name: str, others: Mapping[str, object]) -> None:
    """Names become columns of the case."""
    if not COLUMN.fullmatch(name) or name in TAKEN:
        raise RecordingError(f"{key}: must be letters, digits and '_', and neither 'episode' nor 't'.")
    if name in others:
        raise RecordingError(f"{key}: is a command as well; columns have different names.")


def _left_open(content: Any, place: tuple[str | int, ...]) -> tuple[str | int, ...] | None:
    """Return the first place where a proposed map still waits for a decision."""
    if content == TO_FILL:
        return place
    items = content.items() if isinstance(content, Mapping) else enumerate(content) if isinstance(content, list) else ()
    return next((found for k, v in items if (found := _left_open(v, (*place, k))) is not None), None)


def _refused(error: ValidationError, kind: type[BaseModel]) -> str:
    """Return what is wrong: a key that is not known before one that is missing, as it may be meant for it."""
    sections: dict[str, type[BaseModel]] = {
        "log": LogKeys, "clock": ClockKeys, "episodes": EpisodeKeys, "rows": RowKeys, "forces": ForceKeys,
    }  # fmt: skip
    sections |= {"commands": CommandKeys, "channels": ChannelKeys} if kind is Map else {"commands": Commanded}
    unknown = [e["loc"] for e in error.errors() if e["type"] == "extra_forbidden"]
    for place in unknown[:1]:
        valid = kind if len(place) == 1 else sections.get(str(place[0]), Converted)
        return f"unknown key '{dotted(place)}'. {nearest(str(place[-1]), valid.model_fields)}"
    missing = [e["loc"] for e in error.errors() if e["type"] == "missing"]
    if missing:
        return f"missing '{dotted(missing[0])}'."
    place, text = refusal(error)
    return f"{dotted(place)}: {text}"
