"""What an import leaves beside a case of how that was made, and what of it is told of episodes afterwards."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path

from runner.errors import LimitError
from runner.storage.yaml_text import read_yaml

RECORD = "import.yaml"  # beside the case: what it was made of, and how its clocks ran


def read_record(case: Path) -> Mapping[str, object]:
    """Return what an import has left in the folder of a case; nothing where it left nothing that can be read."""
    file = case / RECORD
    try:
        stat = file.stat()
        return _read(file, stat.st_mtime_ns, stat.st_size)
    except (OSError, ValueError, LimitError):
        return {}


@lru_cache(maxsize=8)
def _read(file: Path, changed_ns: int, size: int) -> Mapping[str, object]:
    """Read a record once, as long as its file is the same: a report asks of every episode."""
    record = read_yaml(file)
    return record if isinstance(record, dict) else {}


def episode_sources(case: Path) -> dict[int, str]:
    """Return which file, or part of a log, each episode of a case is from, by its number in the column `episode`.

    Nothing where the case was not imported, or all of it is from one file.
    """
    found = read_record(case).get("episodes")
    sources = {k: str(v) for k, v in found.items() if isinstance(k, int)} if isinstance(found, dict) else {}
    return sources if len(set(sources.values())) > 1 else {}


def called(case: Path, episode: int) -> str:
    """Return how an episode is told to a reader: its number in the column `episode`, with its file where that is known.

    Such as "4 (run_05.csv)".
    """
    source = episode_sources(case).get(episode)
    return f"{episode}" if source is None else f"{episode} ({source})"


def has_turned_axes(case: Path) -> bool:
    """Whether a case was made of a log in whose world y points up: its axes, and those of bodies, are others."""
    made = read_record(case).get("map")
    return isinstance(made, dict) and made.get("up") == "y"
