"""LeRobot data sets, versions 2 and 3: a folder with `meta/info.json` and Parquet files; every episode is a part.

Read by pyarrow instead of rerun's reader, which also decodes the videos of every episode.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from runner.errors import RecordingError
from runner.importing.readers.tables import parquet_table, table_part
from runner.importing.signals import Log, Part, ReadOptions, Signal, file_error, part_of

INFO = Path("meta") / "info.json"
EPISODE = "episode_index"


def is_lerobot(path: Path) -> bool:
    """Whether a folder is a LeRobot data set."""
    return (path / INFO).is_file()


def read_lerobot(path: Path, options: ReadOptions) -> Log:
    """Read all episodes of a data set.

    Raises:
        RecordingError: If its files are not those of version 2 or 3.
    """
    try:
        info = json.loads((path / INFO).read_text(encoding="utf-8"))
        features = {str(k): dict(v) for k, v in info["features"].items()}
        version = str(info["codebase_version"])
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise file_error(path / INFO, "LeRobot data set", error) from None
    if not version.lstrip("v").startswith(("2", "3")):
        raise RecordingError(f"{path / INFO}: codebase_version '{version}' is not read; allowed: 2 and 3.")
    files = sorted((path / "data").rglob("*.parquet"))
    if not files:
        raise RecordingError(f"{path}: no .parquet below 'data'; get the data set with its data files.")
    names = {key: labels for key, feature in features.items() if (labels := _labels(feature.get("names")))}
    tables = [parquet_table(f) for f in files]
    try:
        table = pa.concat_tables(tables, promote_options="default")
    except pa.ArrowException as error:
        raise file_error(path, "LeRobot data set", error) from None
    if EPISODE not in table.column_names:
        raise RecordingError(f"{path}: its data have no column '{EPISODE}'.")
    whole, _ = table_part(path.name, table, names)
    counted = whole.signals[EPISODE].values if EPISODE in whole.signals else np.empty(0)
    if not len(counted) or counted.ndim != 1 or counted.dtype.kind not in "iuf" or not np.isfinite(counted).all():
        raise RecordingError(f"{path}: '{EPISODE}' of its data must be a number in every row.")
    return Log(f"LeRobot {version}", _episodes(whole), _notes(info))


def _episodes(whole: Part) -> list[Part]:
    episodes = whole.signals[EPISODE].values
    order = np.argsort(episodes, kind="stable")
    numbers, firsts = np.unique(episodes[order], return_index=True)
    rows = np.split(order, firsts[1:])
    return [
        part_of(
            f"episode {int(number)}",
            [Signal(s.name, s.stream, s.values[at]) for s in whole.signals.values() if len(s) == len(episodes)],
        )
        for number, at in zip(numbers, rows, strict=True)
    ]


def _labels(names: Any) -> list[str] | None:
    """Return the names of a feature's elements, which stand as a list, or as a list below some word."""
    if isinstance(names, dict):
        inner = list(names.values())
        names = inner[0] if len(inner) == 1 and isinstance(inner[0], list) else None
    return [str(n) for n in names] if isinstance(names, list) else None


def _notes(info: dict) -> list[str]:
    kind = info.get("robot_type")
    return [f"the data set's robot is '{kind}', {info.get('fps')} frames a second"] if kind else []
