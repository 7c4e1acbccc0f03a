"""CSV as text, read strictly: every row has as many values as the header has names, and each row knows its line.

Python's own reader and not pandas: where rows have one value more than the header, pandas takes the first for an index
and moves every column by one, in silence.
"""

from __future__ import annotations

import csv
import io
import re
from dataclasses import dataclass
from pathlib import Path

from runner.storage.limits import check_size


class CsvError(ValueError):
    """What is wrong with a file as CSV: in words, without the file's name."""


@dataclass(frozen=True)
class CsvText:
    """What stands in a file: the names of the columns, the columns as texts, and the line of each row."""

    header: list[str]
    columns: list[tuple[str, ...]]
    lines: list[int]


def read_csv(path: Path) -> CsvText:
    """Return what stands in a CSV file; blank lines are skipped, spaces around names are none of them.

    Raises:
        CsvError: If it can't be read, is empty, is separated by something else than commas, or a row has more or
            fewer values than there are columns.
        LimitError: If it is too large.
    """
    check_size(path)
    try:
        text = path.read_text(encoding="utf-8-sig")
        reader = csv.reader(io.StringIO(text, newline=""), strict=True)
        header = [name.strip() for name in next(reader, [])]
        numbered = [(reader.line_num, row) for row in reader if row]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise CsvError(f"can't be read as CSV: {error}.") from None
    if not header:
        raise CsvError("is empty; the first line must name the columns.")
    if len(header) == 1 and re.search(r"[;\t|]", header[0]):
        raise CsvError(f"columns must be separated by commas, got {header[0][:40]!r}.")
    for k, (line, row) in enumerate(numbered):
        if len(row) != len(header):
            raise CsvError(
                f"data row {k + 1}, line {line}: has {len(row)} values, the header names {len(header)} columns."
            )
    columns = list(zip(*(row for _, row in numbered), strict=True))
    return CsvText(header, columns, [line for line, _ in numbered])


def number(text: str) -> float:
    """Return a cell as a number, an empty one as NaN; what Python alone takes for a number (`1_000`) is none.

    Raises:
        ValueError: If it is no number.
    """
    if "_" in text:
        raise ValueError(text)
    return float(text.strip() or "nan")
