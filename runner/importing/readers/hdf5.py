"""HDF5 by h5py: plain arrays of numbers. Nothing is followed out of the file, no reference is resolved.

rerun's own HDF5 reader wants all arrays of a file in one length; files of robots seldom are that.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from runner.errors import RecordingError
from runner.importing.readers.tables import arrays_part
from runner.importing.signals import Log, ReadOptions, file_error

NUMBERED = re.compile(r"(.*?(?:demo|episode|ep|traj|trajectory|run|rollout|trial|take)[_-]?)(\d+)", re.IGNORECASE)
LARGEST = 128  # columns of an array that is read; images are wider


def read_hdf5(path: Path, options: ReadOptions) -> Log:
    """Read arrays of numbers. Groups that are numbered as episodes (`data/demo_0`, `data/demo_1`) are parts.

    Raises:
        RecordingError: If it is no HDF5 file, or leads to other files.
    """
    from runner.importing.readers.extra import needed

    h5py = needed("h5py", path)
    arrays: dict[str, np.ndarray] = {}
    skipped: list[str] = []
    try:
        with h5py.File(path, "r") as file:
            for name in _names(h5py, path, file, ""):
                dataset = file[name]
                if dataset.external or dataset.is_virtual:
                    raise RecordingError(f"{path}: '{name}' keeps its numbers in another file, which is not read.")
                plain = dataset.dtype.kind in "iufb" and dataset.ndim in (1, 2)
                if not plain or (dataset.ndim == 2 and dataset.shape[1] > LARGEST):
                    skipped.append(name)
                    continue
                arrays[name] = dataset[()]
    except (OSError, RuntimeError, KeyError, ValueError) as error:
        raise file_error(path, "HDF5", error) from None
    parts = _parts(arrays)
    notes = [f"{path.name}: not read, as they are no arrays of numbers: {_some(skipped)}"] if skipped else []
    if len(parts) > 1:
        notes.append(f"{path.name}: {len(parts)} numbered groups, from '{next(iter(parts))}' on, are read as episodes")
        beside = [n for n in arrays if not any(n.startswith(f"{group}/") for group in parts)]
        notes += [f"{path.name}: not read, as they stand beside the episodes: {_some(beside)}"] if beside else []
    return Log(
        "HDF5",
        [arrays_part(f"{path.name}:{group}" if group else path.name, own, options) for group, own in parts.items()],
        notes,
    )


def _names(h5py, path: Path, group, above: str) -> list[str]:
    """Return the data sets below a group; links to other files are refused, and links within the file left out."""
    found = []
    for key in group:
        name = f"{above}/{key}" if above else key
        link = group.get(key, getlink=True)
        if isinstance(link, h5py.ExternalLink):
            raise RecordingError(f"{path}: '{name}' leads to another file, which is not read.")
        if not isinstance(link, h5py.HardLink):
            continue
        item = group[key]
        if isinstance(item, h5py.Group):
            if above.count("/") < 16:  # a group may hold itself
                found += _names(h5py, path, item, name)
        elif isinstance(item, h5py.Dataset):
            found.append(name)
    return found


def _parts(arrays: dict[str, np.ndarray]) -> dict[str, dict[str, np.ndarray]]:
    """Return the arrays by numbered group, in the order of the numbers, or all in one."""
    groups: dict[tuple[str, int], dict[str, np.ndarray]] = {}
    for name, array in arrays.items():
        steps = name.split("/")
        for k, step in enumerate(steps[:-1]):
            numbered = NUMBERED.fullmatch(step)
            if numbered:
                at = "/".join([*steps[:k], numbered[1]]), int(numbered[2])
                groups.setdefault(at, {})["/".join(steps[k + 1 :])] = array
                break
    families = {family for family, _ in groups}
    if len(families) != 1 or len(groups) < 2:
        return {"": arrays}
    return {f"{family}{number}": groups[family, number] for family, number in sorted(groups)}


def _some(names: list[str]) -> str:
    return ", ".join(map(repr, names[:6])) + (f" and {len(names) - 6} more" if len(names) > 6 else "")
