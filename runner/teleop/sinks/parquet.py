"""Frames as Parquet, which figures and tables are made from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import pyarrow as pa
import pyarrow.parquet as pq

from runner.storage.writing import replacing
from runner.teleop.frames import Frames, RunResult
from runner.teleop.sinks.base import NOTHING, AbstractSink


@dataclass(frozen=True)
class ParquetSink(AbstractSink):
    """`frames.parquet` with every update, and if asked for `steps.parquet` with every physics step; full precision."""

    FRAMES: ClassVar[str] = "frames.parquet"
    STEPS: ClassVar[str] = "steps.parquet"
    steps: bool = False

    def write(
        self, result: RunResult, folder: Path, config: Mapping[str, Any], overrides: Mapping[str, Any] = NOTHING
    ) -> None:
        _write_frames(result.updates, folder / self.FRAMES)
        if self.steps:
            _write_frames(result.steps, folder / self.STEPS)


def _write_frames(frames: Frames, path: Path) -> None:
    fields = [pa.field(name, pa.from_numpy_dtype(c.dtype), nullable=False) for name, c in frames.columns.items()]
    table = pa.Table.from_arrays([pa.array(c) for c in frames.columns.values()], schema=pa.schema(fields))
    # plain pages: dictionaries and statistics of measured numbers cost more time than they save space
    with replacing(path) as part:
        pq.write_table(table, part, compression="lz4", use_dictionary=False, write_statistics=False)
