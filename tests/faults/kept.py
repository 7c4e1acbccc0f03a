"""Keeps a diagnosis in a file, so that a process that is forked has it without the threads that found it."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

from mujoco import rollout


class _Pickler(pickle.Pickler):
    def persistent_id(self, value: Any) -> int | None:
        """Return the number of threads in place of those who simulate in parallel, which can't be pickled."""
        return value.nthread if isinstance(value, rollout.Rollout) else None


class _Unpickler(pickle.Unpickler):
    def persistent_load(self, threads: int) -> rollout.Rollout:
        """Return others, as many."""
        return rollout.Rollout(nthread=threads)


def keep(value: Any, path: Path) -> None:
    """Write a value into a file."""
    with path.open("wb") as file:
        _Pickler(file).dump(value)


def kept(path: Path) -> Any:
    """Return the value that a file keeps."""
    with path.open("rb") as file:
        return _Unpickler(file).load()
