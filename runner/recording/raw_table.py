"""What stands in the file of a recording, `.parquet` or `.csv`, before anything is known of its columns."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from runner.errors import RecordingError
from runner.recording.data import Float


@dataclass(frozen=True)
class RawTable:
    """What stands in a file: the names of its columns, the columns, how many rows, and (text) the line of each."""

    header: list[str]
    columns: list[pa.ChunkedArray | tuple[str, ...]]
    count: int
    lines: list[int] | None


def read_raw(path: Path) -> RawTable:
    """Return what stands in a `.parquet` or `.csv` file.

    Raises:
        RecordingError: If the file can't be read, or a line of it has more or fewer values than there are columns.
    """
    return _csv(path) if path.suffix == ".csv" else _parquet(path)


def numbers(path: Path, name: str, raw: RawTable, unit: str = "") -> Float:
    """Return a column as numbers; what is empty or null is NaN.

    Args:
        path: The file, for messages.
        name: The column, which is there.
        raw: What stands in the file.
        unit: For messages; "": none is named.

    Raises:
        RecordingError: If a value is no number: file, row, column, value.
    """
    column = raw.columns[raw.header.index(name)]
    within = f" in {unit}" if unit else ""
    if isinstance(column, tuple):
        return _from_text(path, name, column, raw.lines, within)
    return _from_arrow(path, name, column, within)


def row_place(row: int, lines: list[int] | None) -> str:
    """Return where a row, counted from 0, is found in the file."""
    return f"data row {row + 1}" + (f", line {lines[row]}" if lines is not None else "")


def _parquet(path: Path) -> RawTable:
    try:
        with pq.ParquetFile(path) as file:
            content = file.read()
    except (pa.ArrowException, OSError) as error:
        raise RecordingError(f"{path}: can't be read as Parquet: {' '.join(str(error).split())}") from None
    return RawTable(list(content.column_names), list(content.columns), content.num_rows, None)


def _csv(path: Path) -> RawTable:
    """Blank lines are skipped."""
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.reader(file, strict=True)
            header = [name.strip() for name in next(reader, [])]
            numbered = [(reader.line_num, row) for row in reader if row]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise RecordingError(f"{path}: can't be read as CSV: {error}.") from None
    if not header:
        raise RecordingError(f"{path}: is empty; the first line must name the columns.")
    if len(header) == 1 and re.search(r"[;\t|]", header[0]):
        raise RecordingError(f"{path}: columns must be separated by commas, got {header[0][:40]!r}.")
    lines = [line for line, _ in numbered]
    for k, (_, row) in enumerate(numbered):
        if len(row) != len(header):
            text = f"has {len(row)} values, the header names {len(header)} columns"
            raise RecordingError(f"{path}: {row_place(k, lines)}: {text}.")
    return RawTable(header, list(zip(*(row for _, row in numbered), strict=True)), len(lines), lines)


def _from_text(path: Path, name: str, values: Sequence[str], lines: list[int] | None, within: str) -> Float:
    """Return numbers; an empty cell is NaN."""
    try:
        return np.array([value.strip() or "nan" for value in values], dtype=np.float64)
    except ValueError:
        pass
    for row, value in enumerate(values):
        try:
            float(value.strip() or "nan")
        except ValueError:
            raise RecordingError(
                f"{path}: {row_place(row, lines)}: column '{name}' must be a number{within}, got {value!r}."
            ) from None
    raise AssertionError("NumPy and Python disagree on what a number is")


def _from_arrow(path: Path, name: str, column: pa.ChunkedArray, within: str) -> Float:
    """Return numbers; null is NaN. Text is taken if all of it is numbers."""
    if pa.types.is_dictionary(column.type):
        column = column.cast(column.type.value_type)
    kind = column.type
    if pa.types.is_string(kind) or pa.types.is_large_string(kind) or pa.types.is_string_view(kind):
        return _from_text(path, name, [value or "" for value in column.to_pylist()], None, within)
    if pa.types.is_null(kind):
        return np.full(len(column), np.nan)
    if not (pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_decimal(kind)):
        raise RecordingError(f"{path}: column '{name}' must be numbers{within}, it holds {kind}.")
    return np.array(column.cast(pa.float64(), safe=False).to_numpy(), dtype=np.float64)
