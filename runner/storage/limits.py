"""How much of a stranger's file is read, asked before it is: a small file can stand for more than any memory holds."""

from __future__ import annotations

from pathlib import Path

from runner.errors import LimitError

MB = 1_000_000
# bytes of a file, by its ending; more than any recording, model or result that this program can work with
BYTES = {
    ".yaml": 1 * MB,
    ".txt": 1 * MB,
    ".xml": 16 * MB,
    ".mjcf": 16 * MB,
    ".csv": 128 * MB,
    ".json": 256 * MB,
    ".jsonl": 256 * MB,
    ".parquet": 1000 * MB,
}
OTHER_BYTES = 256 * MB  # meshes, textures
ROWS, CELLS = 5_000_000, 100_000_000  # of a table: an hour and more at 1 kHz; 0.8 GB as numbers


def check_size(path: Path) -> None:
    """Refuse a file that is too large to be read; one that is not there is none of this function's business.

    Raises:
        LimitError: Naming the size and the limit.
    """
    try:
        size = path.stat().st_size
    except OSError:
        return
    most = BYTES.get(path.suffix.lower(), OTHER_BYTES)
    if size > most:
        raise LimitError(f"{path}: has {size / MB:,.0f} MB, at most {most / MB:,.0f} MB of such a file are read.")


def check_shape(path: Path, rows: int, columns: int) -> None:
    """Refuse a table that is too large to be held in memory.

    Raises:
        LimitError: Naming the rows and the limit.
    """
    if rows > ROWS:
        raise LimitError(f"{path}: has {rows:,} rows, at most {ROWS:,} are read; split the recording.")
    if rows * columns > CELLS:
        raise LimitError(
            f"{path}: has {rows:,} rows of {columns:,} columns, at most {CELLS:,} numbers are read; split it."
        )


def check_bytes(path: Path, held: int) -> None:
    """Refuse a file that is small because it is compressed, and holds too much to be read.

    Raises:
        LimitError: Naming the size and the limit.
    """
    most = BYTES[".parquet"]
    if held > most:
        raise LimitError(f"{path}: holds {held / MB:,.0f} MB once unpacked, at most {most / MB:,.0f} MB are read.")
