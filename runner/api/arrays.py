"""One's own arrays as a case: an MJCF, and what was commanded and measured, in the model form of a recording."""

from __future__ import annotations

import re
import shutil
import tempfile
import uuid
import weakref
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from runner.api.case import Case, read
from runner.errors import RecordingError, RunnerError, WriteError, nearest
from runner.importing.case import copy_model
from runner.recording.case import TABLES
from runner.recording.model_form_mjcf import read_mjcf
from runner.recording.nominal import FILE
from runner.storage.writing import write_parquet, write_yaml

AXES = {"force": ("fx", "fy", "fz"), "point": ("px", "py", "pz"), "orientation": ("w", "x", "y", "z")}
# what the beginning of a channel's name says that it measures; the rest of it names the joint or the actuator
PREFIXES = {"dq_": ("joint", "velocity"), "q_": ("joint", "position"), "tau_": ("actuator", "force")}
Source = Mapping[str, Any]


def case_from_arrays(
    model: str | Path,
    *,
    t: ArrayLike,
    channels: Mapping[str, ArrayLike],
    commands: Mapping[str, ArrayLike] | None = None,
    episodes: ArrayLike | None = None,
    sources: Mapping[str, Source] | None = None,
    forces: Sequence[Mapping[str, Any]] = (),
    noise: Mapping[str, float] | None = None,
    start: str = "free",
    folder: str | Path | None = None,
    overwrite: bool = False,
) -> Case:
    """Return a case of arrays that are already there.

    Channels are called `q_JOINT` (its position), `dq_JOINT` (its velocity), `tau_ACTUATOR` (what it exerts), or as a
    sensor of the model; commands as their actuator, or `u_ACTUATOR`. Whatever is called otherwise stands in `sources`.

    Args:
        model: The MJCF that is believed in. It and the files that it names are copied.
        t: Times, s, rising within each episode, (T,).
        channels: What was measured, SI units, (T,) each, NaN where not; an orientation (T, 4), w, x, y, z.
        commands: What was commanded, in the units of the actuators, held until the next sample, (T,) each.
        episodes: Number of the episode that each sample belongs to, (T,); None: all are one.
        sources: What a command drives or a channel measures, as in `nominal.yaml`: `{"actuator": "elbow"}`,
            `{"joint": "elbow", "quantity": "position"}`, `{"body": "cup", "quantity": "position", "axis": "x"}`.
        forces: Recorded forces on bodies: `{"body": "cup", "force": (T, 3), "point": (T, 3)}`, N in world axes, and m
            in the body's; without `point` they act at its origin.
        noise: Standard deviations of channels; what is missing is estimated.
        start: `rest` where every episode begins at rest, else `free`.
        folder: Where to keep the case, for `runner diagnose` as well; None: it is kept as long as it is used.
        overwrite: Whether a case that is in that folder already may be written over. Other files in there stay, such
            as the MJCF and the meshes of another model.

    Raises:
        RunnerError: Naming the array, or the sample, what was wrong, and what is allowed.
    """
    model = Path(model)
    if not model.is_file():
        raise RecordingError(f"model: no file '{model}'.")
    compiled = read_mjcf(model).compile()
    nominal, table = _layout(compiled, t, channels, commands or {}, episodes, sources or {}, forces)
    nominal |= {"noise": {k: float(v) for k, v in (noise or {}).items()}, "start": start}
    target = None if folder is None else _free(Path(folder), overwrite)
    kept = Path(tempfile.mkdtemp(prefix="runner_"))
    try:
        case = _written(model, nominal, table, kept / model.stem)
        if target is not None:
            _put(kept / model.stem, target)
            shutil.rmtree(kept, ignore_errors=True)
            return read(target)
    except Exception as error:
        shutil.rmtree(kept, ignore_errors=True)
        if isinstance(error, RunnerError):
            # of files that nobody has named, and that are gone, the name helps nobody
            said = re.sub(rf"^{re.escape(str(kept / model.stem))}/[^:]*: ", "", str(error))
            raise type(error)(said.replace(f"{kept}/", "")) from None
        raise
    weakref.finalize(case, shutil.rmtree, kept, ignore_errors=True)
    return case


def _layout(
    model: mujoco.MjModel,
    t: ArrayLike,
    channels: Mapping[str, ArrayLike],
    commands: Mapping[str, ArrayLike],
    episodes: ArrayLike | None,
    sources: Mapping[str, Source],
    forces: Sequence[Mapping[str, Any]],
) -> tuple[dict[str, Any], pd.DataFrame]:
    """Return what `nominal.yaml` says, and the table."""
    time_s = np.asarray(t, float)
    if time_s.ndim != 1:
        raise RecordingError(f"t: must be one number for each sample, shape (T,), got {time_s.shape}.")
    for name in sources:
        if name not in channels and name not in commands:
            raise RecordingError(
                f"sources: '{name}' is neither a channel nor a command. {nearest(name, [*channels, *commands])}"
            )
    columns = _Columns(len(time_s))
    columns.add("episode", _whole(np.zeros(len(time_s)) if episodes is None else np.asarray(episodes)))
    columns.add("t", time_s)
    said: dict[str, Any] = {"commands": {}, "channels": {}, "forces": []}
    for name, values in commands.items():
        said["commands"][name] = dict(sources[name]) if name in sources else _drives(name, model)
        columns.add(name, values)
    for name, values in channels.items():
        source = dict(sources[name]) if name in sources else _measures(name, model)
        if source.get("quantity") == "orientation":
            source["columns"] = columns.add_several(name, values, AXES["orientation"])
        else:
            columns.add(name, values)
        said["channels"][name] = source
    for i, force in enumerate(forces):
        of: dict[str, Any] = {k: v for k, v in force.items() if k not in ("force", "point")}
        of |= {k: columns.add_several(f"force{i}", force[k], AXES[k]) for k in ("force", "point") if k in force}
        said["forces"].append(of)
    return {k: v for k, v in said.items() if v}, pd.DataFrame(columns.found)


class _Columns:
    """Columns of one length, each there once."""

    def __init__(self, length: int) -> None:
        self.length, self.found = length, dict[str, np.ndarray]()

    def add(self, name: str, values: ArrayLike) -> None:
        """Add a column."""
        if name in self.found:
            raise RecordingError(f"'{name}': is there twice, as a command, a channel, or as 'episode' or 't'.")
        self.found[name] = self._checked(name, values, ())

    def add_several(self, name: str, values: ArrayLike, axes: Sequence[str]) -> list[str]:
        """Add the columns of an array (T, n) and return what they are called."""
        array = self._checked(name, values, (len(axes),))
        names = [f"{name}_{axis}" for axis in axes]
        for column, one in zip(names, array.T, strict=True):
            self.add(column, one)
        return names

    def _checked(self, name: str, values: ArrayLike, more: tuple[int, ...]) -> np.ndarray:
        try:
            array = np.asarray(values)
            array = array if array.dtype.kind in "iu" else array.astype(float)
        except (TypeError, ValueError):
            raise RecordingError(f"'{name}': must be numbers.") from None
        if array.shape != (self.length, *more):
            raise RecordingError(f"'{name}': must have shape {(self.length, *more)}, as long as t, got {array.shape}.")
        return array


def _whole(numbers: np.ndarray) -> np.ndarray:
    """Return numbers of episodes as whole ones, if they are; else as they are, to be refused."""
    if numbers.dtype.kind == "f" and np.isfinite(numbers).all() and (numbers == np.round(numbers)).all():
        return numbers.astype(np.int64)
    return numbers


def _names(model: mujoco.MjModel, kind: str) -> list[str]:
    count = {"joint": model.njnt, "actuator": model.nu, "sensor": model.nsensor}[kind]
    return [getattr(model, kind)(i).name for i in range(count)]


def _drives(name: str, model: mujoco.MjModel) -> dict[str, Any]:
    actuators = _names(model, "actuator")
    for actuator in (name, name.removeprefix("u_")):
        if actuator in actuators:
            return {"actuator": actuator}
    raise RecordingError(
        f"commands: '{name}' is no actuator. {nearest(name, actuators)} Or say what it drives, as in "
        f"sources={{'{name}': {{'actuator': NAME}}}}."
    )


def _measures(name: str, model: mujoco.MjModel) -> dict[str, Any]:
    if name in _names(model, "sensor"):
        return {"sensor": name}
    for prefix, (kind, quantity) in PREFIXES.items():
        if name.startswith(prefix) and name.removeprefix(prefix) in _names(model, kind):
            return {kind: name.removeprefix(prefix), "quantity": quantity}
    known = [p + n for p, (kind, _) in PREFIXES.items() for n in _names(model, kind)]
    raise RecordingError(
        f"channels: '{name}' does not say what it measures. {nearest(name, [*known, *_names(model, 'sensor')])} Or say "
        f"it, as in sources={{'{name}': {{'joint': NAME, 'quantity': 'position'}}}}."
    )


def _free(folder: Path, overwrite: bool) -> Path:
    """Return a folder that holds nothing yet, or, if that may be written over, a case.

    Raises:
        WriteError: If it is a file, holds something else, or can't be looked into.
    """
    try:
        if folder.exists() and not folder.is_dir():
            raise WriteError(f"folder: '{folder}' is a file; name a folder.")
        held = any(folder.iterdir()) if folder.is_dir() else False
    except OSError as error:
        raise WriteError(f"folder: '{folder}' can't be looked into: {error.strerror or error}.") from None
    if held and not overwrite:
        raise WriteError(f"folder: '{folder}' is not empty; name a new one, or write over it with overwrite=True.")
    if held and not ((folder / FILE).is_file() and any((folder / table).is_file() for table in TABLES)):
        raise WriteError(f"folder: '{folder}' holds something other than a case; name a new one.")
    return folder


def _put(made: Path, folder: Path) -> None:
    """Put a case that was read into a folder; what else is in there stays, but for another table.

    All of it is copied before any of it takes the place of what is there: a disk that is full leaves the case before.
    """
    fresh, beside = not folder.exists(), folder / f".{uuid.uuid4().hex}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        shutil.copytree(made, beside)
        files = sorted(path.relative_to(beside) for path in beside.rglob("*") if path.is_file())
        for file in files:
            (folder / file).parent.mkdir(parents=True, exist_ok=True)
            (beside / file).replace(folder / file)
        for table in TABLES:
            if Path(table) not in files:  # beside the new one it would be another recording
                (folder / table).unlink(missing_ok=True)
    except OSError as error:
        shutil.rmtree(folder if fresh else beside, ignore_errors=True)
        why = error.args[0][0][2] if isinstance(error, shutil.Error) else error.strerror or error  # of the first file
        raise WriteError(f"folder: '{folder}' can't be written: {why}.") from None
    shutil.rmtree(beside, ignore_errors=True)


def _written(model: Path, nominal: Mapping[str, Any], table: pd.DataFrame, folder: Path) -> Case:
    try:
        folder.mkdir()
        name = copy_model(model, folder)
    except OSError as error:
        raise WriteError(f"{folder}: can't be written: {error.strerror or error}.") from None
    write_parquet(folder / TABLES[0], table)
    write_yaml(folder / FILE, {"model": name, **nominal})
    return read(folder)
