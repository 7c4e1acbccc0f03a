"""Readers by format: a path in, a `Log` of named signals out. None of them runs anything that stands in a file."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from runner.errors import RecordingError, nearest
from runner.importing.readers.hdf5 import read_hdf5
from runner.importing.readers.lerobot import is_lerobot, read_lerobot
from runner.importing.readers.rerun_files import read_mcap, read_rrd
from runner.importing.readers.rosbag import is_bag_folder, read_bag_folder, read_ros1, read_ros2
from runner.importing.readers.tables import read_npz, read_parquet, read_text
from runner.importing.signals import Log, ReadOptions

Reader = Callable[[Path, ReadOptions], Log]
READERS: Mapping[str, Reader] = {
    ".csv": read_text,
    ".tsv": read_text,
    ".txt": read_text,
    ".parquet": read_parquet,
    ".mcap": read_mcap,
    ".bag": read_ros1,
    ".db3": read_ros2,
    ".h5": read_hdf5,
    ".hdf5": read_hdf5,
    ".npz": read_npz,
    ".rrd": read_rrd,
}
PICKLES = (".pkl", ".pickle", ".npy", ".pt", ".pth", ".joblib")


def read_log(paths: Sequence[Path], options: ReadOptions) -> Log:
    """Read one log, or several files of one, each of which is a part of its own.

    Args:
        paths: Files, or folders: of a LeRobot data set, of a ROS 2 bag, of files of one format.
        options: What readers may need to be told.

    Raises:
        RecordingError: If there is nothing that is read, or something is broken.
    """
    logs = [log for path in paths for log in _read(path, options)]
    formats = dict.fromkeys(log.format for log in logs)
    parts = [part for log in logs for part in log.parts]
    empty = next((part.name for part in parts if not part.signals), None)
    if empty is not None:
        raise RecordingError(f"{paths[0]}: there are no numbers over time in '{empty}'.")
    if not parts:
        raise RecordingError(f"{paths[0]}: there is nothing in it.")
    decimal = next((log.decimal for log in logs if log.decimal != "."), ".")
    return Log(", ".join(formats), parts, list(dict.fromkeys(note for log in logs for note in log.notes)), decimal)


def _read(path: Path, options: ReadOptions) -> list[Log]:
    if not path.exists():
        raise RecordingError(f"logs: '{path}' does not exist.")
    if path.is_dir():
        if is_lerobot(path):
            return [read_lerobot(path, options)]
        if is_bag_folder(path):
            return [read_bag_folder(path, options)]
        inside = sorted(f for f in path.iterdir() if f.suffix.lower() in READERS and not f.name.startswith("."))
        kinds = {f.suffix.lower() for f in inside}
        if len(kinds) == 1:
            return [READERS[f.suffix.lower()](f, options) for f in inside]
        several = f"files of several formats ({', '.join(sorted(kinds))}): name those that belong together"
        found = several if kinds else f"none of {', '.join(READERS)}, no LeRobot data set, no ROS 2 bag"
        raise RecordingError(f"{path}: in this folder are {found}.")
    suffix = path.suffix.lower()
    if suffix in PICKLES:
        raise RecordingError(f"{path}: such files run code when they are read; export as CSV, Parquet or .npz instead.")
    if suffix not in READERS:
        raise RecordingError(f"{path}: unknown ending '{suffix}'. {nearest(suffix, READERS)}")
    return [READERS[suffix](path, options)]
