"""The one way to write a file: beside its place under another name, through to the disk, and only then into its place.

A reader never sees half a file, and where the disk is full or the power goes, the file that was there before is there
still. What is noted line by line while it happens, as the rows of a sweep, is appended instead, see `teleop.tables`.
"""

from __future__ import annotations

import errno
import json
import math
import os
import secrets
from collections.abc import Generator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from runner.errors import WriteError

if TYPE_CHECKING:
    import pandas as pd

NO_SYNC = (errno.EINVAL, errno.ENOTSUP, errno.EBADF)  # of file systems that can't do it for folders
STEM = 200  # characters of a name that are kept beside its place: the whole may have 255 bytes


@contextmanager
def replacing(path: Path) -> Generator[Path]:
    """Give a name to write a file to, of the same folder and ending, which takes the file's place at the end.

    Whatever is raised meanwhile, the file is as before and nothing is left beside it.

    Raises:
        WriteError: If it can't be written: the disk is full, the folder is not there or may not be written to.
    """
    part = path.with_name(f".{path.stem[:STEM]}.{secrets.token_hex(4)}{path.suffix}")
    try:
        _check_replaceable(path)
        yield part
        with part.open("rb") as file:
            os.fsync(file.fileno())
        part.replace(path)
        _sync_folder(path.parent)
    except OSError as error:
        raise WriteError(f"{path}: can't be written: {error.strerror or error}.") from error
    finally:
        with suppress(OSError):
            part.unlink()


def _sync_folder(folder: Path) -> None:
    """Take the new name through to the disk: else a folder may hold the old file again once the power was gone."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    except OSError as error:
        if error.errno not in NO_SYNC:
            raise
    finally:
        os.close(handle)


def own_folder(results: Path, name: str) -> Path:
    """Make a folder within results, if it is not there, and return it.

    Raises:
        WriteError: If it, or what it lies in there, is a link; or if it can't be made.
    """
    check_own(results, name)
    folder = results / name
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise WriteError(f"{folder}: can't be made: {error.strerror}.") from error
    return folder


def check_own(results: Path, name: str) -> None:
    """Refuse a link in the place of a folder within results, which are maybe somebody else's: it may lead anywhere.

    Raises:
        WriteError: Naming the link.
    """
    folder = results / name
    for path in (folder, *folder.parents):
        if path == results:
            return
        if path.is_symlink():
            raise WriteError(f"{path}: can't be written: is a link, which would lead out of the results.")


def _check_replaceable(path: Path) -> None:
    """Refuse to put a file into the place of something else, of a device above all."""
    if path.is_dir():
        raise WriteError(f"{path}: can't be written: is a folder; name a file in it.")
    if path.exists() and not path.is_file():
        raise WriteError(f"{path}: can't be written: is no regular file.")


def write_text(path: Path, text: str) -> None:
    """Write a text, as UTF-8.

    Raises:
        WriteError: If it can't be written.
    """
    with replacing(path) as part:
        part.write_text(text, encoding="utf-8")


def write_bytes(path: Path, content: bytes) -> None:
    """Write bytes.

    Raises:
        WriteError: If they can't be written.
    """
    with replacing(path) as part:
        part.write_bytes(content)


def write_yaml(path: Path, content: Any) -> None:
    """Write plain data as YAML, keys in their own order.

    Raises:
        WriteError: If it can't be written.
    """
    write_text(path, yaml.safe_dump(content, sort_keys=False))


def write_json(path: Path, content: Any) -> None:
    """Write plain data as JSON, numbers that don't exist as null.

    Raises:
        WriteError: If it can't be written.
    """
    write_text(path, json.dumps(_finite(content), indent=1) + "\n")


def write_parquet(path: Path, table: pd.DataFrame) -> None:
    """Write a table without its index.

    Raises:
        WriteError: If it can't be written.
    """
    with replacing(path) as part:
        table.to_parquet(part, index=False)


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _finite(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(v) for v in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
