"""A run as `.rrd`, for looking at in the Rerun viewer; what that takes is imported where one is written."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from runner.errors import ResultError
from runner.storage.writing import replacing
from runner.teleop.frames import RunResult
from runner.teleop.sinks.base import NOTHING, AbstractSink


@dataclass(frozen=True)
class RrdSink(AbstractSink):
    """`run.rrd` for the Rerun viewer, with its layout inside; sent as whole columns.

    `every` is the number of frames from one that is shown to the next. `steps` shows the physics steps; otherwise the
    updates are shown. Estimates and errors, which change at updates only, are shown at every update.
    """

    FILE: ClassVar[str] = "run.rrd"
    PART: ClassVar[str] = "part.rrd"  # of the file of a whole sweep, see `combine`
    every: int = 1
    steps: bool = False
    name: str = FILE

    def write(
        self, result: RunResult, folder: Path, config: Mapping[str, Any], overrides: Mapping[str, Any] = NOTHING
    ) -> None:
        from runner.teleop.sinks.run_log import write_run  # and Rerun, which takes a moment

        write_run(folder / self.name, result, config, overrides, every=self.every, steps=self.steps)


def combine(parts: Sequence[Path], out: Path) -> None:
    """Make one `.rrd` of several, in which each stays a recording of its own, with the layout of the last.

    Raises:
        ResultError: If Rerun can't.
    """
    with replacing(out) as made:
        command = [sys.executable, "-m", "rerun", "rrd", "merge", *map(str, parts), "-o", str(made)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            raise ResultError(f"log.rrd_files: Rerun can't make '{out}': {done.stderr.strip().splitlines()[-1]}")
