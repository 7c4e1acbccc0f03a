"""Tables: one row per run, from `summary.parquet` of any number of run folders.

A sweep has one `summary.parquet` with the rows of all its runs. While it is under way each of its processes notes the
rows of the runs that have ended in a file of its own in `rows/`, a line of JSON for each run, which keeps every digit.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import socket
from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from runner.errors import ResultError, RunnerError, WriteError
from runner.storage import run_status
from runner.storage.holding import holding, is_held
from runner.storage.parquet_file import UNREADABLE, ParquetError, read_whole
from runner.storage.writing import own_folder, replacing
from runner.teleop.frames import ENDED, RunResult, Truth

SUMMARY = "summary.parquet"
SWEEP = "sweep.txt"  # marks the folder of a sweep, and says what it was made with
ROWS = "rows"
OF_RUN = "run"  # the command whose results are rows
WITHIN = {"1pct": 1e-2, "0p1pct": 1e-3, "0p01pct": 1e-4}


def summary_row(result: RunResult, about: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Return the row of a run: for every estimator and parameter its true, start and final value, and its errors.

    Columns begin with the estimator's name where there are several. `*_error` columns are relative to the true value
    (those of the CoM: to the half size): final (signed), median and peak (absolute, over all updates).
    `*_to_1pct_s` is the time of the update from which on the error stays within 1 %; NaN: it does not.

    Args:
        result: The run.
        about: What else the row should say, in front: run, seed, swept values.
    """
    row: dict[str, Any] = dict(about or {})
    row["status"], row["reason"] = result.status.value, result.reason
    for name in result.estimators:
        prefix = f"{name}_" if len(result.estimators) > 1 else ""
        for parameter, truth in result.parameters[name].items():
            row |= _errors(result, name, parameter, truth, prefix)
    row["updates"], row["steps"] = result.update_count, result.step_count
    row["simulated_s"] = result.step_count * result.timestep_s
    row["wall_s"] = result.wall_s
    row["steps_per_s"] = result.step_count / result.wall_s if result.wall_s > 0 else np.nan
    row["host"] = socket.gethostname()
    row["motion"] = fingerprint(result)
    return row


def fingerprint(result: RunResult) -> str:
    """Return a text that two runs share if all columns of their updates are the same, bit for bit."""
    digest = hashlib.blake2b(digest_size=8)
    for name, column in result.updates.columns.items():
        digest.update(name.encode())
        digest.update(np.ascontiguousarray(column).tobytes())
    return digest.hexdigest()


def _errors(result: RunResult, name: str, parameter: str, truth: Truth, prefix: str) -> dict[str, Any]:
    stem, _, unit = parameter.rpartition("_")
    values = result.updates.column(f"{name}_{parameter}")
    error = truth.error(values)
    size, time_s = np.abs(error), result.updates.column("time_s")
    out = {
        f"{prefix}{stem}_true_{unit}": truth.true,
        f"{prefix}{stem}_start_{unit}": truth.start,
        f"{prefix}{stem}_final_{unit}": values[-1] if len(values) else np.nan,
        f"{prefix}{stem}_final_error": error[-1] if len(values) else np.nan,
        f"{prefix}{stem}_median_error": np.median(size) if len(values) else np.nan,
        f"{prefix}{stem}_peak_error": size.max() if len(values) else np.nan,
    }
    for label, limit in WITHIN.items():
        out[f"{prefix}{stem}_to_{label}_s"] = time_within(time_s, size, limit)
    return {key: float(value) for key, value in out.items()}


def time_within(time_s: np.ndarray, error: np.ndarray, limit: float) -> float:
    """Return the time from which on the error stays at or below the limit, NaN if it does not."""
    outside = np.flatnonzero(~(error <= limit))
    first = int(outside[-1]) + 1 if len(outside) else 0
    return float(time_s[first]) if first < len(time_s) else float("nan")


def failure_row(error: Exception, about: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Return the row of a run that could not be done."""
    reason = str(error) if isinstance(error, RunnerError) else f"{type(error).__name__}: {error}"
    return {**(about or {}), "status": "failed", "reason": " ".join(reason.split())}


def write_summary(rows: Sequence[Mapping[str, Any]], folder: Path) -> None:
    """Write rows as the summary of a folder."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    table = pa.table({name: _column([row.get(name) for row in rows]) for name in names})
    with replacing(folder / SUMMARY) as part:
        pq.write_table(table, part)


def _column(values: list[Any]) -> pa.Array:
    """Return a typed column; values that share no type become texts."""
    try:
        return pa.array(values)
    except (pa.ArrowInvalid, pa.ArrowTypeError, OverflowError):
        return pa.array([None if v is None else str(v) for v in values])


def read_summary(file: Path) -> list[dict[str, Any]]:
    """Return the rows of a summary.

    Raises:
        ResultError: If it can't be read.
    """
    try:
        return _table(file).to_pylist()
    except UNREADABLE as error:  # texts that are none are found only now
        raise ResultError(f"paths: '{file}' can't be read: {str(error)[:300]}") from None


def _table(file: Path) -> pa.Table:
    try:
        return read_whole(file)
    except ParquetError as error:
        raise ResultError(f"paths: '{file}' can't be read: {error}") from None


def append_line(file: Path, item: Any) -> None:
    """Add a line of JSON to a file; a line is there whole or not at all, see `whole_lines`.

    A link is not followed: in a sweep of somebody else's it may lead to any file of the user.

    Raises:
        WriteError: If it can't be written, or not whole.
    """
    # begins with a line break: the line before may have been cut off by a kill
    line = ("\n" + json.dumps(item, default=lambda scalar: scalar.item()) + "\n").encode()
    try:
        handle = os.open(file, os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_NOFOLLOW, 0o644)
        try:
            written = os.write(handle, line)
        finally:
            os.close(handle)
    except OSError as error:
        raise WriteError(f"{file}: can't be written: {error.strerror}.") from error
    if written < len(line):
        raise WriteError(f"{file}: can't be written: the disk took a part of a line only.")


def whole_lines(file: Path) -> Iterator[Any]:
    """Yield the lines of JSON of a file, save for those that are empty or were cut off."""
    for line in file.read_text(encoding="utf-8", errors="replace").splitlines():
        try:
            yield json.loads(line)
        except (ValueError, RecursionError):
            continue


class Ledger:
    """Where one task of a sweep notes the rows of its runs as they end; a line is there whole or not at all.

    Args:
        folder: Of the sweep.
        first: Number of the task's first run, which names the file.

    Raises:
        WriteError: If the folder of the notes is a link to somewhere else.
    """

    def __init__(self, folder: Path, first: int) -> None:
        self._path = own_folder(folder, ROWS) / f"{first:06d}.jsonl"

    @contextmanager
    def held(self) -> Generator[Ledger]:
        """Hold the file while the task is done: a worker can outlive the sweep that was killed, see `still_held`."""
        with suppress(FileExistsError):  # where the task goes on
            os.close(os.open(self._path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o644))
        with holding(self._path, wait=True):
            yield self

    def write(self, job: int, rows: Sequence[Mapping[str, Any]]) -> None:
        """Note the rows of a run, most often one."""
        append_line(self._path, {"job": job, "rows": list(rows)})

    def noted(self) -> dict[int, list[dict[str, Any]]]:
        """Return the rows that are noted here, by run."""
        return _noted(self._path) if self._path.is_file() else {}


def still_held(folder: Path) -> bool:
    """Tell whether a process is still doing a task of a sweep."""
    return any(is_held(file) for file in (folder / ROWS).glob("*.jsonl"))


def _noted(file: Path) -> dict[int, list[dict[str, Any]]]:
    found: dict[int, list[dict[str, Any]]] = {}
    for noted in whole_lines(file):
        job, rows = (noted.get("job"), noted.get("rows")) if isinstance(noted, dict) else (None, None)
        if isinstance(job, int) and isinstance(rows, list) and all(isinstance(row, dict) for row in rows):
            found[job] = [{**row, "job": job} for row in rows]
    return found


def sweep_rows(folder: Path) -> list[dict[str, Any]]:
    """Return the rows of the runs of a sweep that have ended so far, in the order of their numbers."""
    found: dict[int, list[dict[str, Any]]] = {}
    if (folder / SUMMARY).is_file():
        for row in read_summary(folder / SUMMARY):
            if not isinstance(row.get("job"), int):
                raise ResultError(f"paths: '{folder / SUMMARY}' is not of a sweep: a row has no number in 'job'.")
            found.setdefault(row["job"], []).append(row)
    for file in sorted((folder / ROWS).glob("*.jsonl")):
        found |= _noted(file)
    return [row for job in sorted(found) for row in found[job]]


def count_rows(folder: Path) -> int:
    """Return how many lines a sweep has noted, without reading them."""
    return sum(file.read_bytes().count(b"\n{") for file in (folder / ROWS).glob("*.jsonl"))


def finish_sweep(folder: Path) -> list[dict[str, Any]]:
    """Make one `summary.parquet` of what the runs of a sweep have noted, and return its rows."""
    rows = sweep_rows(folder)
    if rows:
        write_summary(rows, folder)
    shutil.rmtree(folder / ROWS, ignore_errors=True)
    return rows


def collect(paths: Iterable[Path]) -> pd.DataFrame:
    """Return one table of all runs in these folders, and in the folders within them, in the order of their names.

    A column `run` says which folder a row is from. A sweep that is under way, or was stopped, gives the rows of the
    runs that have ended; a run by itself that has left no row gives one with its status, `running` or `killed`.

    Raises:
        ResultError: If a path does not exist or no run has ended there.
    """
    tables = []
    for path in paths:
        if not path.exists():
            raise ResultError(f"paths: no folder '{path}'.")
        found = [_read(folder) for folder in _folders(path)]
        if not any(len(table) for table in found):
            how = "".join(f": {status.value}; {goes_on_with(folder)}" for folder, status in unfinished([path])[:1])
            raise ResultError(
                f"paths: no '{SUMMARY}' in '{path}' nor in a folder within it: no run has ended there{how}."
            )
        tables += found
    return pd.concat([table for table in tables if len(table)], ignore_index=True)


def unfinished(paths: Iterable[Path]) -> list[tuple[Path, run_status.Status]]:
    """Return the sweeps in these folders that were stopped before their end, and how."""
    stopped = (run_status.Status.killed, run_status.Status.interrupted)
    sweeps = dict.fromkeys(f for path in paths for f in _folders(path) if (f / SWEEP).is_file())
    found = ((folder, run_status.status_of(folder)) for folder in sweeps)
    return [(folder, status) for folder, status in found if status and status in stopped and not still_held(folder)]


def goes_on_with(sweep: Path) -> str:
    """Return in words which command goes on with a sweep that was stopped."""
    return f"go on with: runner run resume={sweep}"


def _folders(path: Path) -> list[Path]:
    """Return the folders of single runs and of sweeps; what lies within a sweep is part of its table."""
    if path.name == SUMMARY:
        return [path.parent]
    if path.name.isdigit() and (path.parent / SWEEP).is_file() and not (path / SUMMARY).is_file():
        return [path]
    sweeps = {file.parent for file in path.rglob(SWEEP)}
    alone = {file.parent for file in path.rglob(SUMMARY)}
    alone |= {file.parent for file in path.rglob(run_status.FILE) if _begun(file.parent) is not None}
    outer = {folder for folder in sweeps | alone if not sweeps.intersection(folder.parents)}
    return sorted(outer, key=_natural)


def _begun(folder: Path) -> dict[str, Any] | None:
    """Return the row of a run that has not come to its end: how far it has come; None for what is not such a run."""
    noted = run_status.begun(folder)
    status = run_status.status_of(folder)
    if noted.get("command") != OF_RUN or status in (None, run_status.Status.done):
        return None
    return {"status": status.value, "reason": str(noted.get("reason") or "")}


def _natural(path: Path) -> list[tuple[bool, int, str]]:
    """Sort 2 before 10."""
    return [(not part.isdigit(), int(part) if part.isdigit() else 0, part) for part in path.parts]


def _read(folder: Path) -> pd.DataFrame:
    """Return the rows of a run, of a sweep, or of one run of a sweep."""
    sweep = folder if (folder / SWEEP).is_file() else folder.parent
    if (sweep / SWEEP).is_file() and (sweep == folder or not (folder / SUMMARY).is_file()):
        rows = [row for row in sweep_rows(sweep) if sweep == folder or str(row["job"]) == folder.name]
        names = list(dict.fromkeys(name for row in rows for name in row))
        table = _whole(pa.table({name: _column([row.get(name) for row in rows]) for name in names}))
        table.insert(0, "run", [str(sweep / str(row["job"])) for row in rows])
        return table
    row, rowless = _begun(folder), not (folder / SUMMARY).is_file()
    begun = pd.DataFrame([{"run": str(folder), **(row or {})}])
    if row is not None and (rowless or row["status"] != run_status.Status.failed.value):
        return begun  # what a row says that is there is of an earlier run
    try:
        table = _whole(_table(folder / SUMMARY))
    except UNREADABLE as error:
        raise ResultError(f"paths: '{folder / SUMMARY}' can't be read: {str(error)[:300]}") from None
    if "run" in table:
        raise ResultError(f"paths: '{folder / SUMMARY}' is no summary of runs: it has a column 'run'.")
    table.insert(0, "run", str(folder))
    ended = "status" in table and bool(table["status"].isin(ENDED).any())
    return begun if row is not None and ended else table  # one that failed has a row that says so


def _whole(table: pa.Table) -> pd.DataFrame:
    """Return a table as pandas has it, but whole numbers stay so where some rows, those of failed runs, have none."""
    # what the file says of how pandas had it need not be true
    out = table.to_pandas(ignore_metadata=True)
    for name, column in zip(table.column_names, table.columns, strict=True):
        if pa.types.is_integer(column.type) and column.null_count:
            out[name] = pd.array(column.to_pylist(), dtype="Int64")
    return out
