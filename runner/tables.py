"""Tables: one row per run, from `summary.parquet` of any number of run folders."""

from __future__ import annotations

import socket
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from runner.errors import ResultError
from runner.frames import RunResult, Truth

SUMMARY = "summary.parquet"
WITHIN = {"1pct": 1e-2, "0p1pct": 1e-3, "0p01pct": 1e-4}


def summary_row(result: RunResult, about: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Return the row of a run: for every estimator and parameter its true, start and final value, and its errors.

    Columns begin with the estimator's name where there are several. `*_error` columns are relative to the true value:
    final (signed), median and peak (absolute, over all updates). `*_to_1pct_s` is the time of the update from which on
    the error stays within 1 %; NaN: it does not.

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
    return row


def _errors(result: RunResult, name: str, parameter: str, truth: Truth, prefix: str) -> dict[str, Any]:
    stem, _, unit = parameter.rpartition("_")
    values = result.updates.column(f"{name}_{parameter}")
    error = (values - truth.true) / truth.true
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
    return {**(about or {}), "status": "failed", "reason": " ".join(f"{type(error).__name__}: {error}".split())}


def write_summary(rows: Sequence[Mapping[str, Any]], folder: Path) -> None:
    """Write rows as the summary of a folder."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    table = pa.table({name: [row.get(name) for row in rows] for name in names})
    pq.write_table(table, folder / SUMMARY)


def collect(paths: Iterable[Path]) -> pd.DataFrame:
    """Return one table of all runs in these folders, and in the folders within them, in the order of their names.

    A column `run` says which folder a row is from.

    Raises:
        ResultError: If a path does not exist or holds no summary.
    """
    tables = []
    for path in paths:
        if not path.exists():
            raise ResultError(f"paths: no folder '{path}'.")
        found = [path] if path.name == SUMMARY else sorted(path.rglob(SUMMARY), key=_natural)
        if not found:
            raise ResultError(f"paths: no '{SUMMARY}' in '{path}' nor in a folder within it: no run has ended there.")
        tables += [_read(file) for file in found]
    return pd.concat(tables, ignore_index=True)


def _natural(path: Path) -> list[tuple[bool, int, str]]:
    """Sort 2 before 10."""
    return [(not part.isdigit(), int(part) if part.isdigit() else 0, part) for part in path.parts]


def _read(file: Path) -> pd.DataFrame:
    try:
        table = pd.read_parquet(file)
    except (OSError, ValueError) as error:
        raise ResultError(f"paths: '{file}' can't be read: {str(error).splitlines()[0]}") from error
    table.insert(0, "run", str(file.parent))
    return table
