"""The table of a recording: its columns by name, as numbers, and where in the file each of them stands.

| column | planar form | form in space |
| --- | --- | --- |
| `episode`, `t` | integer; s | the same |
| pose of the geometric centre, world | `x`, `y` m, `yaw` rad | `x`, `y`, `z` m, `qw`, `qx`, `qy`, `qz` body to world |
| its velocity, rate, world axes | optional `vx`, `vy` m/s, `wz` rad/s | `vx`, `vy`, `vz` m/s, `wx`, `wy`, `wz` rad/s |
| force, world axes, N | `fx`, `fy` | `fx`, `fy`, `fz`, all or none |
| point, body axes, m | `px`, `py`, optional `pz` | `px`, `py`, optional `pz`, where there is a force |
| centre of a pin that pushes, world, m | `tip_x`, `tip_y`; force and point are then as measured, if at all | |
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from runner.errors import RecordingError
from runner.numerics.arrays import FloatArray
from runner.recording.data import Form
from runner.recording.raw_table import numbers, read_raw, row_place
from runner.storage.limits import check_shape

METRES, SPEEDS, RATES = ("x", "y", "z"), ("vx", "vy", "vz"), ("wx", "wy", "wz")
QUATERNION, FORCE, POINT = ("qw", "qx", "qy", "qz"), ("fx", "fy", "fz"), ("px", "py", "pz")
PIN = ("tip_x", "tip_y")
POSE = {Form.PLANAR: ("x", "y", "yaw"), Form.SPATIAL: (*METRES, *QUATERNION)}
TWIST = {Form.PLANAR: ("vx", "vy", "wz"), Form.SPATIAL: (*SPEEDS, *RATES)}
REQUIRED = {
    Form.PLANAR: ("episode", "t", *POSE[Form.PLANAR], "fx", "fy", "px", "py"),
    Form.SPATIAL: ("episode", "t", *POSE[Form.SPATIAL], *TWIST[Form.SPATIAL]),
}
OPTIONAL = {Form.PLANAR: (*TWIST[Form.PLANAR], "pz"), Form.SPATIAL: (*FORCE, *POINT)}
UNITS = {"t": "s", "yaw": "rad"}
UNITS |= dict.fromkeys((*METRES, *POINT, *PIN), "m") | dict.fromkeys(SPEEDS, "m/s") | dict.fromkeys(RATES, "rad/s")
UNITS |= dict.fromkeys(FORCE, "N")
KNOWN = {name for form in Form for name in (*REQUIRED[form], *OPTIONAL[form])}
WORDS = {"pos": "", "position": "", "vel": "v", "velocity": "v", "force": "f", "point": "p", "quat": "q"}
SYNONYMS = {word + axis: short + axis for axis in "wxyz" for word, short in WORDS.items()}
SYNONYMS |= dict.fromkeys(("time", "timestamp"), "t") | dict.fromkeys(("run", "trial", "episodeid"), "episode")
SYNONYMS |= dict.fromkeys(("theta", "psi", "heading"), "yaw") | dict.fromkeys(("omega", "omegaz", "yawrate"), "wz")


@dataclass(frozen=True)
class Table:
    """Columns of numbers, all of one length, that know their file.

    Args:
        path: The file.
        columns: By name, each of shape (N,).
        lines: Line of each row in a text file, shape (N,); None for Parquet.
        extra: Columns that are not part of the format; they are not read.
        notes: What was odd, one sentence each.
    """

    path: Path
    columns: Mapping[str, FloatArray]
    lines: list[int] | None = None
    extra: tuple[str, ...] = ()
    notes: list[str] = field(default_factory=list)

    def __len__(self) -> int:
        return len(self.columns["t"])

    def __contains__(self, name: object) -> bool:
        return name in self.columns

    def __getitem__(self, name: str) -> FloatArray:
        return self.columns[name]

    def stack(self, names: Iterable[str]) -> FloatArray:
        """Return the named columns side by side, shape (N, K)."""
        return np.stack([self.columns[name] for name in names], axis=1)

    def error(self, text: str, row: int | None = None) -> RecordingError:
        """Return an error that names the file and, for a row from 0, its number from 1, its episode and its time."""
        if row is None:
            return RecordingError(f"{self.path}: {text}")
        place = row_place(row, self.lines)
        if {"episode", "t"} <= self.columns.keys():
            place += f" (episode {self['episode'][row]:g}, t = {self['t'][row]:.6g} s)"
        return RecordingError(f"{self.path}: {place}: {text}")


def required(form: Form, *, pin: bool) -> tuple[str, ...]:
    """Return the columns that must be there: where a pin pushes, its path in place of the force."""
    if form is Form.PLANAR and pin:
        return (*(name for name in REQUIRED[form] if name not in (*FORCE, *POINT)), *PIN)
    return REQUIRED[form]


def read_table(path: Path, *, pin: bool = False) -> tuple[Table, Form]:
    """Return the columns of a `.parquet` or `.csv` file, and which form they are.

    Args:
        path: The file.
        pin: Whether a pin pushes, so that its path must be there, and its force need not.

    Raises:
        RecordingError: If the file can't be read, has no rows, a column is missing or there twice or seems to be
            misspelt, or a value is no number.
    """
    raw = read_raw(path)
    header = raw.header
    form = _form(header)
    _check_header(path, header, form, pin=pin)
    if not raw.count:
        raise RecordingError(f"{path}: has no rows; at least three samples of one episode are needed.")
    names = [
        name for name in dict.fromkeys((*required(form, pin=pin), *REQUIRED[form], *OPTIONAL[form])) if name in header
    ]
    check_shape(path, raw.count, len(names))
    columns = {name: numbers(path, name, raw, UNITS.get(name, "")) for name in names}
    lacking = [name for name in TWIST[form] if name not in columns]  # not measured at all
    columns |= {name: np.full(raw.count, np.nan) for name in lacking}
    if pin and form is Form.PLANAR:
        unseen = [name for name in (*FORCE[:2], *POINT[:2]) if name not in columns]  # of a pin's force
        columns |= {name: np.full(raw.count, np.nan) for name in unseen}
    extra = tuple(name for name in header if name not in names and not name.startswith("__index_level_"))
    notes = [f"not part of the {form} form and not used: {', '.join(map(repr, extra))}"] if extra else []
    return Table(path, columns, raw.lines, extra, notes), form


def _form(header: list[str]) -> Form:
    """Return the form that the names are nearest to: a quaternion decides, then `yaw`, then how many are there."""
    plain = {_plain(name) for name in header}
    if plain & set(QUATERNION):
        return Form.SPATIAL
    share = {form: len(plain & set(REQUIRED[form])) / len(REQUIRED[form]) for form in Form}
    return Form.PLANAR if "yaw" in plain or share[Form.PLANAR] >= share[Form.SPATIAL] else Form.SPATIAL


def _check_header(path: Path, header: list[str], form: Form, *, pin: bool) -> None:
    for name in header:
        if header.count(name) > 1:
            raise RecordingError(f"{path}: column '{name}' is there {header.count(name)} times, allowed: once.")
    needed = list(required(form, pin=pin))
    if form is Form.SPATIAL and set(header) & {*FORCE, *POINT}:
        needed += [*FORCE, "px", "py"]
    unknown = [name for name in header if name not in KNOWN]
    missing = [name for name in needed if name not in header]
    if missing:
        near = {name: _lookalike(name, unknown) for name in missing}
        renames = ", ".join(f"'{found}' -> '{name}'" for name, found in near.items() if found)
        hint = f" Rename {renames}?" if renames else f" Found: {', '.join(map(repr, header))}."
        names = ", ".join(f"'{name}'{_bracket(name)}" for name in missing)
        optional = [name for name in TWIST[form] if name not in needed]
        needs = f"the {form} form needs {', '.join(needed)}"
        needs += f" ({', '.join(optional)} where they were measured)" if optional else ""
        raise RecordingError(f"{path}: missing column{'s' * (len(missing) > 1)} {names}; {needs}.{hint}")
    for name in OPTIONAL[form]:
        found = None if name in header else _lookalike(name, unknown)
        if found:
            raise RecordingError(
                f"{path}: unknown column '{found}'. Did you mean '{name}'{_bracket(name)}? Rename it, or take it out."
            )


def _lookalike(name: str, unknown: Iterable[str]) -> str | None:
    """Return the unknown column that is probably meant to be `name`."""
    for other in unknown:
        plain = _plain(other)
        close = len(name) > 2 and difflib.SequenceMatcher(None, name, plain).ratio() >= 0.75
        if plain == name or SYNONYMS.get(plain) == name or close:
            return other
    return None


def _plain(name: str) -> str:
    """Return a column name without case, unit and punctuation: `Vx [m/s]`, `v_x` and `vx_m_s` are `vx`."""
    name = re.sub(r"[\[(].*$", "", name.strip().lower()).strip()
    name = re.sub(r"[ _.](mm|cm|m|ms|s|rad|deg|n)([ _/](s|sec))?$", "", name)
    return re.sub(r"[^a-z0-9]", "", name)


def _bracket(name: str) -> str:
    return f" [{UNITS[name]}]" if name in UNITS else ""
