"""Write the folder of a case: table, `nominal.yaml`, the MJCF with the files that it names, and how it was made."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path

import yaml

from runner.errors import ConfigError, RecordingError, WriteError
from runner.importing.build import Built
from runner.importing.record import RECORD, read_record
from runner.recording.case import TABLES, read_case
from runner.recording.model_form import read_model_case
from runner.recording.model_form_mjcf import referenced_files
from runner.recording.nominal import FILE, outline_file
from runner.storage.provenance import files_digest
from runner.storage.writing import write_parquet, write_yaml

MODEL = "model.xml"


def model_name(model: Path) -> str:
    """Return how the MJCF is called in the case: `model.xml`, unless a file that it names is called so."""
    return MODEL if MODEL not in referenced_files(model) else model.name


def copy_model(model: Path, folder: Path) -> str:
    """Copy an MJCF and the files that it names into a folder, and return what it is called there.

    Raises:
        RecordingError: If it can't be read, or refers to a file outside of its folder.
        OSError: If the folder can't be written to.
    """
    for inner in (Path(f) for f in referenced_files(model)):
        (folder / inner).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(model.parent / inner, folder / inner)
    shutil.copyfile(model, folder / model_name(model))
    return model_name(model)


def check_out(out: Path, log: Sequence[Path]) -> None:
    """Refuse a folder that holds something other than a case that was imported from a log.

    Raises:
        ConfigError: Naming the folder.
    """
    if out.exists() and not out.is_dir():
        raise ConfigError(f"out: '{out}' is a file; name a folder.")
    if out.is_dir() and any(out.iterdir()) and not (out / RECORD).is_file():
        raise ConfigError(f"out: '{out}' is not empty and was not written by an import; name a new folder.")
    of = read_record(out).get("log")
    names = [Path(str(p)).name for p in of] if isinstance(of, list) else []
    if names and names != [p.name for p in log]:
        raise ConfigError(f"out: '{out}' was imported from another log, {', '.join(names)}; name a new folder.")


def _check_unedited(made: Path, out: Path) -> None:
    """Refuse to write over a file that somebody has edited since it was imported, unless it is what would be written.

    Raises:
        ConfigError: Naming the file.
    """
    for name, found in _written(out).items():
        old, new = out / name, made / name
        if old.is_file() and new.is_file() and _hash(old) not in (found, _hash(new)):
            raise ConfigError(f"out: '{old}' was edited since it was imported; name a new folder.")


def _hash(file: Path) -> str:
    return files_digest([(file.name, file)])


def _written(out: Path) -> dict[str, str]:
    """Return the hashes of what an import wrote, by name; none where it kept no such record."""
    written = read_record(out).get("written")
    return {str(k): str(v) for k, v in written.items()} if isinstance(written, dict) else {}


def write_case(built: Built, out: Path, *, model: Path, log: Sequence[Path], map_file: Path) -> tuple[str, ...]:
    """Write a case once it has been read as `runner gap` will read it; return what is odd about it then.

    Raises:
        WriteError: If the folder can't be written to.
        RecordingError: If what was made is no case; nothing is written then.
        ConfigError: If somebody has edited what is there.
    """
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=f".{out.name}.", dir=out.parent) as made:
            try:
                notes = _make(built, Path(made), model=model, log=log, map_file=map_file)
            except RecordingError as error:
                of_case = str(error).replace(f"{Path(made)}/", "").replace(str(Path(made)), str(out))
                so_is = f"By '{map_file}' the case would be so; it was not written."
                raise RecordingError(f"{of_case} {so_is}") from None
            _check_unedited(Path(made), out)
            _put(Path(made), out)
    except OSError as error:
        raise WriteError(f"{out}: can't be written: {error.strerror or error}.") from error
    return notes


def _make(built: Built, folder: Path, *, model: Path, log: Sequence[Path], map_file: Path) -> tuple[str, ...]:
    """Write all files of a case into a new folder and read it."""
    write_parquet(folder / TABLES[0], built.table)
    write_yaml(folder / FILE, dict(built.plan.nominal))
    if built.plan.mapping is None:
        outline = outline_file(folder)
        if outline is not None:
            shutil.copyfile(model.parent / outline.name, outline)
        recording = read_case(folder)
    else:
        copy_model(model, folder)
        recording = read_model_case(folder)
    write_yaml(
        folder / RECORD,
        {
            "log": [str(p) for p in log],
            "model": str(model),
            "episodes": dict(built.sources),
            "clocks": [report.row() for report in built.clocks],
            "notes": [*built.notes, *recording.notes],
            "map": yaml.safe_load(map_file.read_text(encoding="utf-8-sig")),
            "written": {f.relative_to(folder).as_posix(): _hash(f) for f in _editable(folder)},
        },
    )
    return recording.notes


def _editable(folder: Path) -> list[Path]:
    """Return the files of a new case that its owner may come to edit: all but the table."""
    return sorted(f for f in folder.rglob("*") if f.is_file() and f.name not in (*TABLES, RECORD))


def _put(made: Path, out: Path) -> None:
    """Put the files of a folder into another one, the record last: what has one was put there as a whole."""
    files = sorted((f for f in made.rglob("*") if f.is_file()), key=lambda f: f.name == RECORD)
    out.mkdir(exist_ok=True)
    (out / TABLES[1]).unlink(missing_ok=True)  # a table beside ours would be another recording
    for file in files:
        target = out / file.relative_to(made)
        target.parent.mkdir(parents=True, exist_ok=True)
        file.replace(target)
