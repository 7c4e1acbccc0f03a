"""Repeat a stored run from its own folder, and compare what it leaves bit for bit.

`runner reproduce FOLDER` takes the folder of a run, or of one run of a sweep (`SWEEP/3`), does the same once more with
the settings that stand in its `config.yaml`, and compares all frames, the summary and what the `.rrd` holds. What took
how long on which machine is not compared. Where the run was made by other versions than these, that is said. Nothing
is written; the exit code is 0 where all is the same, 1 where something differs.
"""

from __future__ import annotations

import dataclasses
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from runner.commands import Command, Job, run
from runner.commands._stored import stored_run
from runner.errors import ResultError
from runner.storage.parquet_file import ParquetError, read_whole
from runner.storage.provenance import differences, program
from runner.teleop.sinks import RrdSink
from runner.teleop.tables import SUMMARY

# how long it took and where; what made it is said apart
ASIDE = {"wall_s", "steps_per_s", "log_s", "host", "versions", "commit"}


@dataclass(frozen=True)
class ReproduceConfig:
    """`folder` is that of a run, or of one run of a sweep."""

    folder: Path


def main(config: ReproduceConfig, job: Job) -> int:
    """Repeat and compare."""
    folder = config.folder.expanduser()
    stored = stored_run(folder, "run", run.COMMAND)
    if other := differences(stored.program, program()):
        print(f"{folder}: made with another program than this ({'; '.join(other)}).")
    with tempfile.TemporaryDirectory(prefix="runner-reproduce-") as name:
        again = Path(name) / (folder.resolve().name or "run")  # the title of a recording begins with it
        again.mkdir()
        rows = run.rows(stored.value, dataclasses.replace(stored.job, folder=again))
        found = {SUMMARY: _different_rows(stored.rows, rows)} | _different_files(folder, again)
    for file, different in found.items():
        if different:
            print(f"{folder / file}: {different}")
    if any(found.values()):
        print(f"{folder}: not reproduced.")
        return 1
    print(f"{folder}: reproduced bit for bit: {', '.join(found)}.")
    return 0


def _different_rows(before: Sequence[Mapping[str, Any]], now: Sequence[Mapping[str, Any]]) -> str:
    """Return what differs between the rows of two summaries, "" if nothing does."""
    if len(before) != len(now):
        return f"has {len(before)} rows, now {len(now)}."
    for k, (old, new) in enumerate(zip(before, now, strict=True)):
        # what a sweep's table adds to a row says where it is from, not what came of it
        for name in [n for n in new if n not in ASIDE]:
            if name not in old:
                return f"has no column '{name}'."
            if not _same(old[name], new[name]):
                return f"'{name}' of row {k + 1} is {old[name]!r}, now {new[name]!r}."
    return ""


def _same(old: Any, new: Any) -> bool:
    """Tell whether two cells are the same; those of a table of many runs may have become texts."""
    new = new.item() if isinstance(new, np.generic) else new
    both_nan = old != old and new != new
    return both_nan or (old is None and new != new) or old == new or str(old) == str(new)


def _different_files(folder: Path, again: Path) -> dict[str, str]:
    """Return what differs between the files of two runs, by name; "" where nothing does."""
    found = {}
    for file in sorted(again.iterdir()):
        if file.name in (SUMMARY, RrdSink.PART) or file.suffix not in (".parquet", ".rrd"):
            continue
        if not (folder / file.name).is_file():
            found[file.name] = "is not there."
        elif file.suffix == ".rrd":
            found[file.name] = _different_recordings(folder / file.name, file)
        else:
            found[file.name] = _different_frames(folder / file.name, file)
    return found


def _different_frames(old: Path, new: Path) -> str:
    """Return the first column in which two Parquet files differ, bit for bit."""
    before, now = _table(old), _table(new)
    if before.column_names != now.column_names:
        changed = sorted({*before.column_names} ^ {*now.column_names})
        return f"has other columns: {', '.join(changed[:3]) or 'in another order'}."
    if len(before) != len(now):
        return f"has {len(before)} rows, now {len(now)}."
    for name in now.column_names:
        one, other = (t[name].to_numpy(zero_copy_only=False) for t in (before, now))
        if one.dtype != other.dtype:
            return f"'{name}' holds {one.dtype}, now {other.dtype}."
        if one.tobytes() != other.tobytes() and not (one.dtype == object and one.tolist() == other.tolist()):
            row = int(np.flatnonzero(one != other)[0]) if (one != other).any() else 0
            return f"'{name}' is {one[row]!s} in row {row + 1}, now {other[row]!s}."
    return ""


def _table(file: Path) -> pa.Table:
    try:
        return read_whole(file)
    except ParquetError as error:
        raise ResultError(f"{file}: can't be read: {error}") from None


def _different_recordings(old: Path, new: Path) -> str:
    """Return whether two recordings hold different things, when they were written aside; Rerun itself compares."""
    # absolute: a name that begins with '-' would be an option
    files = [str(path.absolute()) for path in (old, new)]
    command = [sys.executable, "-m", "rerun", "rrd", "compare", "--unordered", *files]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return "" if done.returncode == 0 else "holds something else (rerun rrd compare says what)."


COMMAND = Command(config=ReproduceConfig, main=main, positional="folder", again="Begin again with")
