"""JSON as it was written, in one line what is wrong with a file that holds none, and which file a path means."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from runner.errors import ResultError
from runner.storage.limits import check_size


def file_of(path: str | Path, name: str) -> Path:
    """Return the file that is meant by a path: that itself, or where it is a folder what has this name in it."""
    path = Path(path)
    return path / name if path.is_dir() else path


def read_json(path: Path, *, otherwise: str | None = None) -> Any:
    """Read JSON; `otherwise` says what to do where there is no such file.

    Raises:
        ResultError: If it can't be read.
        LimitError: If it is too large.
    """
    check_size(path)
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise ResultError(f"{path}: no such file{'' if otherwise is None else f'; {otherwise}'}.") from None
    except OSError as error:
        raise ResultError(f"{path}: can't be read: {error.strerror}.") from None
    except ValueError as error:
        raise ResultError(f"{path}: not JSON ({error}).") from None
    except RecursionError:
        raise ResultError(f"{path}: not JSON that can be read: it is nested too deep.") from None
