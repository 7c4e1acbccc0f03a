"""Parquet of strangers: its own description is looked at first, and whatever a spoilt file raises is one error."""

from __future__ import annotations

from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from runner.storage.limits import check_bytes, check_shape, check_size

UNREADABLE = (pa.ArrowException, OSError, ValueError, TypeError)  # what pyarrow raises where a file is spoilt


class ParquetError(ValueError):
    """What is wrong with a file as Parquet: in words, without the file's name."""


def columns_and_rows(path: Path) -> tuple[list[str], int]:
    """Return the names of the columns and the number of rows, without reading any.

    Raises:
        ParquetError: If it is none, or can't be read.
        LimitError: If it is too large, or holds too much.
    """
    check_size(path)
    try:
        with pq.ParquetFile(path) as file:
            names, rows = list(file.schema_arrow.names), file.metadata.num_rows
            groups = range(file.metadata.num_row_groups)
            held = sum(file.metadata.row_group(g).total_byte_size for g in groups)
    except UNREADABLE as error:
        raise ParquetError(_said(error)) from None
    check_shape(path, rows, 1)
    check_bytes(path, held)
    return names, rows


def read_whole(path: Path) -> pa.Table:
    """Return all of a table.

    Raises:
        ParquetError: If it is none, or can't be read.
        LimitError: If it is too large, or holds too much.
    """
    names, rows = columns_and_rows(path)
    check_shape(path, rows, len(names))
    try:
        with pq.ParquetFile(path) as file:
            return file.read()
    except UNREADABLE as error:
        raise ParquetError(_said(error)) from None


def _said(error: BaseException) -> str:
    return " ".join(str(error).split())[:300] or type(error).__name__
