"""What is done of a long job, a line for each item, so that an interrupted one can be taken up again."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from runner.errors import ResultError
from runner.storage.writing import write_text
from runner.teleop.tables import append_line, whole_lines


class Checkpoint:
    """A file of JSON lines: in the first what the items belong to, then one item each.

    Args:
        path: The file; made where it is missing.
        belongs: What the items are of; plain data.

    Attributes:
        done: Items by name.

    Raises:
        ResultError: If the file is of something else, is no checkpoint, or can't be written.
    """

    def __init__(self, path: Path, belongs: Mapping[str, Any]) -> None:
        self.path = path
        self.done: dict[str, Any] = {}
        belongs = json.loads(json.dumps(belongs))  # as it comes back: tuples are lists
        there = header(path)
        if there is not None and there != belongs:
            other = [f"{k} {there.get(k)} instead of {v}" for k, v in belongs.items() if there.get(k) != v]
            raise ResultError(f"{path}: is what another run left, with {', '.join(other)}; move it away.")
        try:
            if there is None:
                write_text(self.path, json.dumps(belongs) + "\n")
            else:
                self.done = dict(self._kept())
        except OSError as error:
            raise ResultError(f"{path}: can't be written: {error.strerror}.") from None

    def _kept(self) -> list[tuple[str, Any]]:
        """Return the items; one that is not whole, as a killed process leaves it, is not done."""
        _, *items = whole_lines(self.path)
        try:
            return [(name, item) for name, item in items]
        except (TypeError, ValueError) as error:
            raise ResultError(f"{self.path}: is spoilt ({error}); move it away.") from None

    def add(self, name: str, item: Any) -> None:
        """Set an item down as done."""
        append_line(self.path, [name, item])
        self.done[name] = item


def header(path: Path) -> dict[str, Any] | None:
    """Return what the items of a checkpoint belong to; None where there is none.

    Raises:
        ResultError: If the file is no checkpoint.
    """
    if not path.exists():
        return None
    try:
        with path.open(encoding="utf-8") as file:
            line = file.readline()
        found = json.loads(line) if line.endswith("\n") else None
    except (OSError, ValueError) as error:
        raise ResultError(f"{path}: can't be read ({error}).") from None
    if found is not None and not isinstance(found, dict):
        raise ResultError(f"{path}: holds something else; move it away.")
    return found
