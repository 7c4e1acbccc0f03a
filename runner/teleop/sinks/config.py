"""What of a run is written, as configuration."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from runner.errors import check_range
from runner.teleop.sinks.base import AbstractSink
from runner.teleop.sinks.parquet import ParquetSink
from runner.teleop.sinks.rrd import RrdSink


class RrdDetail(Enum):
    """How much of a run the `.rrd` holds."""

    full = "full"  # every frame
    every_n = "every_n"  # every n-th frame
    off = "off"


class FrameKind(Enum):
    """Which frames are written."""

    updates = "updates"  # one for every update
    steps = "steps"  # one for every update, and one for every physics step
    off = "off"


class RrdFiles(Enum):
    """How the runs of a sweep share `.rrd` files."""

    each = "each"  # one in the folder of each run
    one = "one"  # one for the sweep, with a recording for each run


@dataclass(frozen=True)
class LogConfig:
    """What is written.

    `frames` is the kind of frames that are kept, in `frames.parquet` (updates) and `steps.parquet`, and shown in the
    `.rrd`. `rrd` says how many of them the `.rrd` shows, `every_n` which with `rrd=every_n`. `rrd_files` is for sweeps.
    """

    rrd: RrdDetail = RrdDetail.full
    every_n: int = 8
    frames: FrameKind = FrameKind.updates
    rrd_files: RrdFiles = RrdFiles.each

    def __post_init__(self) -> None:
        check_range("every_n", self.every_n, 1, 1_000_000)

    def sinks(self, *, sweep: bool = False) -> list[AbstractSink]:
        """Return the sinks that this asks for; `sweep`: for a run that is part of one."""
        steps = self.frames is FrameKind.steps
        out: list[AbstractSink] = []
        if self.frames is not FrameKind.off:
            out.append(ParquetSink(steps=steps))
        if self.rrd is not RrdDetail.off:
            every = 1 if self.rrd is RrdDetail.full else self.every_n
            part = sweep and self.rrd_files is RrdFiles.one
            out.append(RrdSink(every=every, steps=steps, name=RrdSink.PART if part else RrdSink.FILE))
        return out
