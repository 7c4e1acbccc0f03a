"""Find, read and write cases: folders with a recording and what its owner believes."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from runner.errors import RecordingError
from runner.numerics.arrays import FloatArray
from runner.recording import nominal as nominal_file
from runner.recording.checks import (
    check_finite,
    check_times,
    check_tracked,
    check_yaw,
    episode_spans,
    unit_quaternions,
)
from runner.recording.data import Episode, Form, Nominal, Recording
from runner.recording.kinematics import without_gaps
from runner.recording.own_run import CONFIG, FRAMES, is_run, read_run
from runner.recording.plausible import check_motion, note_motion
from runner.recording.table import FORCE, PIN, POINT, POSE, TWIST, Table, read_table
from runner.recording.units import check_units
from runner.storage.provenance import files_digest
from runner.storage.writing import replacing

TABLES = ("recording.parquet", "recording.csv")
MODEL_FILES = (".xml", ".mjcf", ".obj", ".stl", ".msh", ".png", ".hf", ".bin", ".skn", ".ktx")


def find_cases(path: str | Path) -> list[Path]:
    """Return the cases at or below a path: the path itself if it is a case, else every one below it, sorted.

    A case is a folder that holds `recording.parquet` or `recording.csv`, or one that an experiment left; or a table, by
    whatever name. Hidden folders are left out, and below a folder experiments.

    Raises:
        RecordingError: If the path does not exist or there is no case.
    """
    path = Path(path)
    if not path.is_dir():
        return [table_file(path)[0]]
    if any((path / name).is_file() for name in TABLES) or is_run(path):
        return [path]
    found = {file.parent for name in TABLES for file in path.rglob(name)}
    cases = sorted(case for case in found if not any(p.startswith(".") for p in case.relative_to(path).parts))
    if not cases:
        raise RecordingError(f"{path}: no case in it or below it; {_lacking(path)}")
    return cases


def _lacking(path: Path) -> str:
    """Return what a folder without a case has not got, in a sentence."""
    tables = sorted(f.name for f in path.iterdir() if f.suffix in (".parquet", ".csv"))
    needed = " or ".join(TABLES)
    if not tables:
        return f"a case is a folder with {needed}."
    lacks = "" if (path / nominal_file.FILE).is_file() else f", and a {nominal_file.FILE} with what is believed"
    return (
        f"it has {', '.join(map(repr, tables[:4]))}, a case needs a table named {needed}{lacks}; "
        "`runner import` makes a case of a log."
    )


def content_hash(path: str | Path) -> str:
    """Return a hash of what a case holds: its table, `nominal.yaml`, a table of outlines, and the files of a model.

    Args:
        path: The folder, or a table in it.

    Raises:
        RecordingError: If there is no table, or a file can't be read.
    """
    table, _ = table_file(Path(path))
    folder = table.parent
    models = (f for f in folder.rglob("*") if f.suffix.lower() in MODEL_FILES and f.is_file())
    outline = nominal_file.outline_file(folder)
    others = (folder / (CONFIG if table.name == FRAMES else nominal_file.FILE), *([outline] if outline else []))
    files = [table, *(f for f in others if f.is_file()), *sorted(models)]
    return files_digest((f.relative_to(folder).as_posix(), f) for f in files)


def read_case(path: str | Path, *, nominal: Nominal | None = None) -> Recording:
    """Return a case, checked: columns, numbers, order, times, rates, angles, quaternions, units.

    Quaternions come out at unit length and without sign flips. A planar force has fz = 0, and a point without `pz`
    is at the height of the geometric centre.

    Args:
        path: The folder, or a table in it (`.parquet` or `.csv`), or a folder that `runner run` left.
        nominal: What the owner believes; None: it is read from `nominal.yaml` beside the table.

    Raises:
        RecordingError: With the file, the data row (the first below the header is 1; for CSV also its line), the
            episode and time there, the column, the value and what is allowed.
    """
    path = Path(path)
    file, notes = table_file(path)
    if file.name == FRAMES and is_run(file.parent):
        (table, started), form = read_run(file.parent), Form.PLANAR
        nominal = started if nominal is None else nominal
    else:
        nominal = nominal_file.read_nominal(file.parent) if nominal is None else nominal
        table, form = read_table(file, pin=nominal.pin is not None)
        if nominal.outline is not None and form is Form.SPATIAL:
            raise RecordingError(f"{file.parent}: `outline` belongs to the planar form; this recording is in space.")
        if nominal.pin is not None and form is Form.SPATIAL:
            raise RecordingError(f"{file.parent}: `pin` belongs to the planar form; this recording is in space.")
    check_finite(table, form)
    spans = episode_spans(table)
    check_times(table, spans, nominal)
    if form is Form.PLANAR:
        check_yaw(table, spans)
        check_tracked(table, spans, form)
        pose = table.stack(POSE[form])
    else:
        pose = np.hstack([table.stack(POSE[form][:3]), unit_quaternions(table, spans)])
    whole = _without_gaps(table, spans) if form is Form.PLANAR else table
    if form is Form.PLANAR:
        check_motion(whole, spans, nominal)
    check_units(whole, spans, nominal, form)
    if form is Form.PLANAR:
        note_motion(whole, spans, nominal)
    twist, force, point = table.stack(TWIST[form]), _force(table, form), _point(table)
    pin = table.stack(PIN) if nominal.pin is not None else None
    episodes = tuple(
        Episode(
            int(table["episode"][s.start]),
            table["t"][s],
            pose[s],
            twist[s],
            force[s],
            point[s],
            None if pin is None else pin[s],
        )
        for s in spans
    )
    return Recording(path, form, nominal, episodes, (*notes, *table.notes))


def _without_gaps(table: Table, spans: Sequence[slice]) -> Table:
    """Return a planar table whose motion has no gaps, to be looked at; its notes are those of the table."""
    names = (POSE[Form.PLANAR], TWIST[Form.PLANAR])
    filled = [np.hstack(without_gaps(table["t"][s], *(table.stack(n)[s] for n in names))) for s in spans]
    columns = dict(zip(names[0] + names[1], np.concatenate(filled).T, strict=True))
    return replace(table, columns={**table.columns, **columns})


def write_case(recording: Recording, path: str | Path, *, table: str = TABLES[0]) -> None:
    """Write a case so that reading it gives the same values. Notes are not written.

    Args:
        recording: What to write.
        path: The folder; it is made if it does not exist, and the files of a case in it are replaced.
        table: `recording.parquet` or `recording.csv`.

    Raises:
        RecordingError: If `table` is another name.
    """
    writers: dict[str, Callable[[pd.DataFrame, Path], object]] = {
        TABLES[0]: lambda frame, file: frame.to_parquet(file, index=False),
        TABLES[1]: lambda frame, file: frame.to_csv(file, index=False),
    }
    if table not in writers:
        raise RecordingError(f"table: must be {' or '.join(TABLES)}, got {table!r}.")
    path = Path(path)
    path.mkdir(parents=True, exist_ok=True)
    with replacing(path / table) as part:
        writers[table](_frame(recording), part)
    for name in TABLES:
        if name != table:
            (path / name).unlink(missing_ok=True)
    nominal_file.write_nominal(recording.nominal, path / nominal_file.FILE)


def _frame(recording: Recording) -> pd.DataFrame:
    form = recording.form
    frames = [
        pd.DataFrame({"episode": np.full(len(episode), episode.index, dtype=np.int64), "t": episode.t_s})
        .join(pd.DataFrame(episode.pose, columns=list(POSE[form])))
        .join(pd.DataFrame(episode.twist, columns=list(TWIST[form])))
        .join(pd.DataFrame(episode.force_n, columns=list(FORCE)))
        .join(pd.DataFrame(episode.point_m, columns=list(POINT)))
        for episode in recording.episodes
    ]
    frame = pd.concat(frames, ignore_index=True)
    if form is Form.PLANAR:
        lacking = [name for name in TWIST[form] if np.isnan(frame[name].to_numpy()).all()]
        flat = [] if any(np.nan_to_num(e.point_m[:, 2]).any() for e in recording.episodes) else ["pz"]
        pins = [e.pin_m for e in recording.episodes if e.pin_m is not None]
        if pins:
            frame[list(PIN)] = np.concatenate(pins)
        return frame.drop(columns=["fz", *flat, *lacking])
    unmeasured = all(np.isnan([e.force_n, e.point_m]).all() for e in recording.episodes)
    return frame.drop(columns=[*FORCE, *POINT]) if unmeasured else frame


def table_file(path: Path) -> tuple[Path, list[str]]:
    """Return the file that holds the recording, and what is to be said about it."""
    if path.is_file():
        if path.suffix not in (".parquet", ".csv"):
            raise RecordingError(f"{path}: must be a folder, a .parquet or a .csv file.")
        return path, []
    if not path.is_dir():
        raise RecordingError(f"{path}: no such file or folder.{_near_folder(path)}")
    present = [path / name for name in TABLES if (path / name).is_file()]
    if not present and is_run(path):
        return path / FRAMES, []
    if not present:
        names = ", ".join(repr(p.name) for p in sorted(path.iterdir())[:8]) or "nothing"
        raise RecordingError(f"{path}: neither {TABLES[0]} nor {TABLES[1]} in it, found: {names}.")
    return present[0], [f"{present[1].name} beside {present[0].name} is not read"] if len(present) > 1 else []


def _near_folder(path: Path) -> str:
    folder = path.parent
    tables = (".parquet", ".csv")
    names = [p.name for p in folder.iterdir() if p.is_dir() or p.suffix in tables] if folder.is_dir() else []
    close = difflib.get_close_matches(path.name, names, n=1)
    return f" Did you mean '{folder / close[0]}'?" if close else ""


def _force(table: Table, form: Form) -> FloatArray:
    """Return forces (N, 3); of a pin, an axis that is 0 throughout was not measured."""
    if form is Form.PLANAR:
        force = table.stack(FORCE[:2])
        if PIN[0] in table:
            force[:, ~np.nan_to_num(force).any(axis=0)] = np.nan
        return np.column_stack([force, np.zeros(len(table))])
    return table.stack(FORCE) if "fx" in table else np.full((len(table), 3), np.nan)


def _point(table: Table) -> FloatArray:
    if "px" not in table:
        return np.full((len(table), 3), np.nan)
    height = table["pz"] if "pz" in table else np.where(np.isnan(table["px"]), np.nan, 0.0)
    return np.stack([table["px"], table["py"], height], axis=1)
