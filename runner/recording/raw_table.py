"""What stands in the file of a recording, `.parquet` or `.csv`, before anything is known of its columns."""

from __future__ import annotations

import reprlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from runner.errors import RecordingError
from runner.numerics.arrays import FloatArray
from runner.storage.csv_text import CsvError, number, read_csv
from runner.storage.parquet_file import UNREADABLE, ParquetError, columns_and_rows


@dataclass(frozen=True)
class RawTable:
    """What stands in a file: the names of its columns, how many rows, and (text) the columns and the line of each row.

    The columns of a Parquet file are read when they are asked for: others may hold anything.
    """

    header: list[str]
    count: int
    columns: list[tuple[str, ...]] | None
    lines: list[int] | None


def read_raw(path: Path) -> RawTable:
    """Return what stands in a `.parquet` or `.csv` file.

    Raises:
        RecordingError: If the file can't be read, or a line of it has more or fewer values than there are columns.
        LimitError: If it holds more than is read.
    """
    return _csv(path) if path.suffix == ".csv" else _parquet(path)


def numbers(path: Path, name: str, raw: RawTable, unit: str = "") -> FloatArray:
    """Return a column as numbers; what is empty or null is NaN.

    Args:
        path: The file, for messages.
        name: The column, which is there.
        raw: What stands in the file.
        unit: For messages; "": none is named.

    Raises:
        RecordingError: If a value is no number: file, row, column, value.
    """
    within = f" in {unit}" if unit else ""
    if raw.columns is not None:
        column = raw.columns[raw.header.index(name)] if raw.columns else ()
        return _from_text(path, name, column, raw.lines, within)
    return _from_parquet(path, name, within)


def row_place(row: int, lines: list[int] | None) -> str:
    """Return where a row, counted from 0, is found in the file."""
    return f"data row {row + 1}" + (f", line {lines[row]}" if lines is not None else "")


def _parquet(path: Path) -> RawTable:
    try:
        names, rows = columns_and_rows(path)
    except ParquetError as error:
        raise RecordingError(f"{path}: can't be read as Parquet: {error}") from None
    return RawTable(names, rows, None, None)


def _csv(path: Path) -> RawTable:
    """Blank lines are skipped."""
    try:
        text = read_csv(path)
    except CsvError as error:
        raise RecordingError(f"{path}: {error}") from None
    return RawTable(text.header, len(text.lines), text.columns, text.lines)


def _from_text(path: Path, name: str, values: Sequence[str], lines: list[int] | None, within: str) -> FloatArray:
    """Return numbers; an empty cell is NaN."""
    try:
        if not any("_" in value for value in values):
            return np.array([value.strip() or "nan" for value in values], dtype=np.float64)
    except ValueError:
        pass
    for row, value in enumerate(values):
        try:
            number(value)
        except ValueError:
            raise RecordingError(
                f"{path}: {row_place(row, lines)}: column '{name}' must be a number{within}, got {value!r}."
            ) from None
    raise AssertionError("NumPy and Python disagree on what a number is")


def _from_parquet(path: Path, name: str, within: str) -> FloatArray:
    """Return numbers; null is NaN. Text is taken if all of it is numbers."""
    try:
        schema = pq.read_schema(path)
        kind = schema.field(schema.names.index(name)).type
        if not _may_be_numbers(kind):
            raise RecordingError(f"{path}: column '{name}' must be numbers{within}, it holds {kind}.")
        # text as a dictionary: a page of a few bytes can stand for a long text in every row
        with pq.ParquetFile(path, read_dictionary=[name]) as file:
            column = file.read([name], use_threads=False).column(0)
    except UNREADABLE as error:
        raise RecordingError(f"{path}: can't be read as Parquet: {' '.join(str(error).split())}") from None
    if pa.types.is_null(column.type):
        return np.full(len(column), np.nan)
    if pa.types.is_dictionary(column.type):
        parts, first = [], 0
        for part in column.chunks:
            parts.append(_from_dictionary(path, name, part, first, within))
            first += len(part)
        return np.concatenate(parts) if parts else np.empty(0)
    return np.array(column.cast(pa.float64(), safe=False).to_numpy(), dtype=np.float64)


def _from_dictionary(path: Path, name: str, part: pa.DictionaryArray, first: int, within: str) -> FloatArray:
    """Return numbers of an array that names each distinct value once; null is NaN."""
    places = np.asarray(part.indices.fill_null(-1), dtype=np.int64)
    values = np.full(len(part.dictionary) + 1, np.nan)  # the last is null's
    wrong: dict[int, object] = {}
    try:
        distinct = part.dictionary.to_pylist()
    except UnicodeDecodeError:
        raise RecordingError(
            f"{path}: column '{name}' must be a number{within}, it holds text that is no UTF-8."
        ) from None
    for k, value in enumerate(distinct):
        try:
            values[k] = number(value) if isinstance(value, str) else np.nan if value is None else float(value)
        except ValueError:
            wrong[k] = value
    for row, place in enumerate(places if wrong else ()):
        if place in wrong:
            where, got = row_place(first + row, None), reprlib.repr(wrong[place])
            raise RecordingError(f"{path}: {where}: column '{name}' must be a number{within}, got {got}.")
    return values[places]


def _may_be_numbers(kind: pa.DataType) -> bool:
    if pa.types.is_dictionary(kind):
        kind = kind.value_type
    plain = pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_decimal(kind)
    return plain or pa.types.is_null(kind) or _is_text(kind)


def _is_text(kind: pa.DataType) -> bool:
    return pa.types.is_string(kind) or pa.types.is_large_string(kind) or pa.types.is_string_view(kind)
