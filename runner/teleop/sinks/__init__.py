"""Sinks: what is left of a run on disk. They read a finished run and never take part in it.

Figures and tables are made from Parquet; the `.rrd` is for looking at.
"""

from __future__ import annotations

from runner.teleop.sinks.config import FrameKind, LogConfig, RrdDetail, RrdFiles
from runner.teleop.sinks.parquet import ParquetSink
from runner.teleop.sinks.rrd import RrdSink, combine

__all__ = ["FrameKind", "LogConfig", "ParquetSink", "RrdDetail", "RrdFiles", "RrdSink", "combine"]
