"""Tables: CSV, TSV and what PlotJuggler exports (columns with a header), Parquet, arrays of NumPy's `.npz`."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv

from runner.errors import RecordingError
from runner.importing.readers.arrow import WIDEST, signals_of
from runner.importing.signals import Clock, Log, Part, ReadOptions, Signal, file_error, part_of
from runner.storage.limits import check_size
from runner.storage.parquet_file import UNREADABLE, ParquetError, read_whole

DELIMITERS = (",", "\t", ";", "|")
# cells that hold no number, as programs write them
MISSING = (
    "",
    "nan",
    "NaN",
    "NAN",
    "-nan",
    "null",
    "NULL",
    "None",
    "none",
    "n/a",
    "N/A",
    "NA",
    "#N/A",
    "<NA>",
    "-",
    "--",
)
TABLE = "table"  # the stream of all columns of a table
SHOWN_CELL, SHOWN_LINE = 20, 60  # characters in a message
SAMPLE = "sample"  # the clock that is made of `log.rate_hz` where data have no time


def read_text(path: Path, options: ReadOptions) -> Log:
    """Read a text table; the first line names the columns, the separator is the one that parts it best.

    Raises:
        RecordingError: If it is no table.
    """
    try:
        with path.open(encoding="utf-8-sig", errors="replace") as file:
            header = file.readline().rstrip("\r\n")
    except OSError as error:
        raise file_error(path, "a text table", error) from None
    if not header.strip():
        raise RecordingError(f"{path}: the first line is empty; it must name the columns.")
    delimiter = max(DELIMITERS, key=lambda d: (header.count(d), d == ","))
    if options.decimal == delimiter:
        raise RecordingError(f"{path}: log.decimal: {delimiter!r} separates the columns of this file.")
    check_size(path)
    decimal = options.decimal or "."
    table = _text_table(path, delimiter, decimal)
    part, texts = table_part(path.name, table)
    commas = [name for name in texts if _decimal_commas(table.column(texts[name]))]
    if commas and options.decimal == ".":
        raise RecordingError(f"{path}: column '{commas[0]}' has decimal commas: `log: {{decimal: ','}}` in the map.")
    if commas and options.decimal is None:
        decimal = ","
        table = _text_table(path, delimiter, decimal)
        part, texts = table_part(path.name, table)
    notes = [f"{path.name}: columns parted by {delimiter!r}"] if delimiter not in (",", "\t") else []
    part = replace(part, words={name: _first_word(table.column(i), decimal) for name, i in texts.items()})
    if part.words:
        each = (f"'{name}' ({said})" for name, said in part.words.items())
        notes.append(f"{path.name}: columns of text are not read: {', '.join(each)}")
    return Log("text table", [part], notes, decimal)


def _first_word(column: pa.ChunkedArray, decimal: str) -> str:
    """Return what of a column of text is no number, and in which row, such as "'ERR' in row 499"."""
    for i, cell in enumerate(column.to_pylist()):
        try:
            float(cell.replace(decimal, ".") if cell is not None else 0.0)
        except ValueError:
            shown = cell if len(cell) <= SHOWN_CELL else f"{cell[:SHOWN_CELL]}..."
            return f"{shown!r} in row {i + 1}"
    return "text"


def _text_table(path: Path, delimiter: str, decimal: str) -> pa.Table:
    convert = pa_csv.ConvertOptions(decimal_point=decimal, strings_can_be_null=True, null_values=list(MISSING))
    try:
        table = pa_csv.read_csv(path, parse_options=pa_csv.ParseOptions(delimiter=delimiter), convert_options=convert)
        names = table.column_names
    except UNREADABLE as error:  # cells as they are read, names of columns when they are asked for
        _check_lines(path, delimiter)
        raise file_error(path, "a text table", error) from None
    # a line of separators alone holds nothing, as an empty line does
    empty = np.logical_and.reduce([table.column(i).is_null().to_numpy() for i in range(table.num_columns)])
    table = table.filter(pa.array(~empty)) if empty.any() else table
    return table.rename_columns([c.strip().lstrip("%\ufeff") for c in names])


def _check_lines(path: Path, delimiter: str) -> None:
    """Refuse a table of which a line has other cells than the first, which names the columns.

    Raises:
        RecordingError: Naming that line.
    """
    odd: list[pa_csv.InvalidRow] = []

    def note(row: pa_csv.InvalidRow) -> str:
        odd.append(row)
        return "skip"

    options = pa_csv.ParseOptions(delimiter=delimiter, invalid_row_handler=note)
    with contextlib.suppress(*UNREADABLE):
        # line by line: only so are lines counted
        pa_csv.read_csv(path, parse_options=options, read_options=pa_csv.ReadOptions(use_threads=False))
    if odd:
        first = odd[0]
        more = f" (and {len(odd) - 1} more such lines)" if len(odd) > 1 else ""
        raise RecordingError(
            f"{path}: line {first.number} has {first.actual_columns} cells, the first line, which names the columns, "
            f"{first.expected_columns}{more}: {first.text[:SHOWN_LINE]!r}."
        )


def _decimal_commas(column: pa.ChunkedArray) -> bool:
    some = column.drop_null().slice(0, 20).to_pylist()
    return bool(some) and all(v.strip().lstrip("+-").replace(",", "", 1).isdigit() for v in some)


def read_parquet(path: Path, options: ReadOptions) -> Log:
    """Read a Parquet file; nested columns are taken apart.

    Raises:
        RecordingError: If it is none.
    """
    part, texts = table_part(path.name, parquet_table(path))
    notes = [f"{path.name}: columns of text are not read: {', '.join(map(repr, texts))}"] if texts else []
    return Log("Parquet", [part], notes)


def parquet_table(path: Path) -> pa.Table:
    """Return the table of a Parquet file, without the index that pandas may have left in it.

    Raises:
        RecordingError: If it can't be read.
    """
    try:
        table = read_whole(path)
    except ParquetError as error:
        raise file_error(path, "Parquet", error) from None
    return table.select([i for i, n in enumerate(table.column_names) if not n.startswith("__index_level_")])


def table_part(name: str, table: pa.Table, names: Mapping[str, list[str]] | None = None) -> tuple[Part, dict[str, int]]:
    """Return the numbers of a table, and which columns hold text.

    Columns of points in time are clocks, and signals in seconds since the first row as well.

    Args:
        name: Of the part.
        table: With named columns.
        names: Of the elements of columns that hold lists.
    """
    signals, texts = [], {}
    clocks: dict[str, Clock] = {}
    for i, column_name in enumerate(table.column_names):
        column = table.column(i).combine_chunks()
        if isinstance(column, pa.ChunkedArray):
            column = pa.concat_arrays(column.chunks) if column.num_chunks else pa.array([], column.type)
        if pa.types.is_dictionary(column.type):
            column = column.cast(column.type.value_type)
        if pa.types.is_decimal(column.type):
            column = column.cast(pa.float64())
        if pa.types.is_timestamp(column.type) and not column.null_count:
            stamps = column.cast(pa.timestamp("ns")).cast(pa.int64()).to_numpy(zero_copy_only=False)
            clocks[column_name] = Clock(stamps, in_ns=True)
            continue
        found = signals_of(TABLE, column, {}, root=column_name, names=(names or {}).get(column_name))
        if not found and (pa.types.is_string(column.type) or pa.types.is_large_string(column.type)):
            texts[column_name] = i
        signals += found
    return part_of(name, [Signal(s.name, s.stream, s.values, clocks) for s in signals]), texts


def read_npz(path: Path, options: ReadOptions) -> Log:
    """Read the arrays of an `.npz` file; arrays of Python objects, which are pickles, are refused.

    Raises:
        RecordingError: If it is none, or holds objects.
    """
    try:
        # opened here: of a file that is none, NumPy leaves its handle open
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except ValueError as error:
        if "allow_pickle" in str(error):
            raise RecordingError(
                f"{path}: holds Python objects, which run code when they are read; allowed: arrays of numbers."
            ) from None
        raise file_error(path, ".npz", error) from None
    except Exception as error:  # zipfile and NumPy raise many kinds
        raise file_error(path, ".npz", error) from None
    return Log("NumPy archive", [arrays_part(path.name, arrays, options)])


def arrays_part(name: str, arrays: Mapping[str, np.ndarray], options: ReadOptions) -> Part:
    """Return the series in arrays whose first axis is time: (T,) by itself, (T, K) column by column.

    Arrays in the same folder (`observations/qpos`) and of one length are a stream.
    """
    signals = []
    for key, array in arrays.items():
        if array.dtype.kind not in "iufb" or array.ndim not in (1, 2) or array.shape[0] < 2:
            continue
        columns = {key: array} if array.ndim == 1 else {f"{key}[{k}]": array[:, k] for k in range(array.shape[1])}
        if len(columns) > WIDEST:
            continue
        clocks = {}
        if options.rate_hz is not None:
            stamps = np.arange(len(array)) / options.rate_hz
            clocks = {SAMPLE: Clock(np.round(stamps * 1e9).astype(np.int64), in_ns=True)}
        stream = f"{len(array)} samples"
        signals += [Signal(n, stream, np.array(v, dtype=np.float64), clocks) for n, v in columns.items()]
    return part_of(name, signals)
