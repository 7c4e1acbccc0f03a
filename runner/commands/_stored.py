"""A run as it was stored: its settings, its row, and what made it. Nothing of it is executed."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException

from runner import config
from runner.commands import Command, Job
from runner.commands._belonging import belongs_to
from runner.commands._jobs import CONFIG, overridden
from runner.errors import ConfigError, ResultError
from runner.storage import run_status
from runner.storage.yaml_text import YamlError, read_yaml
from runner.teleop import tables


@dataclass(frozen=True)
class StoredRun:
    """A run that was stored.

    Attributes:
        value: Its config, built and checked.
        job: What its command was told of it, without a folder.
        rows: Of its summary; a study has many.
        program: What made it, as far as that was noted: versions, commit.
    """

    value: Any
    job: Job
    rows: list[dict[str, Any]]
    program: Mapping[str, Any]


def stored_run(folder: Path, name: str, command: Command[Any]) -> StoredRun:
    """Read what a run left in its folder, which may be one of a sweep's.

    Args:
        folder: Of the run.
        name: Of the command that it must be of.
        command: The command.

    Raises:
        ConfigError: If the folder holds no such run that went to its end, or its settings or inputs have changed.
        ResultError: If a file of it can't be read.
    """
    where = f"folder: '{folder}'"
    if not folder.is_dir():
        raise ConfigError(f"{where} is no folder.")
    if (folder / tables.SWEEP).is_file():
        raise ConfigError(f"{where} is a sweep; name one of its runs, as in {folder / '0'}.")
    of_sweep = (folder.absolute().parent / tables.SWEEP).is_file() and not (folder / run_status.FILE).is_file()
    noted = run_status.begun(folder.absolute().parent if of_sweep else folder)
    made = noted.get("command")
    if made is None or not (folder / CONFIG).is_file():
        raise ConfigError(f"{where} holds no run: there is no {CONFIG if made else run_status.FILE} in it.")
    if made != name:
        raise ConfigError(f"{where} holds the results of 'runner {made}'; what 'runner {name}' left can be repeated.")
    rows = _rows(folder, of_sweep=of_sweep)
    if not rows:
        raise ConfigError(f"{where} holds no result: the run is {run_status.status_of(folder) or 'not done'}.")
    plain, words = _settings(folder / CONFIG)
    value = config.build(config.restored(plain, command.config), command.config)
    job = Job(None, plain, _overrides(words), int(folder.name) if of_sweep else None, rows[0].get("experiment"))
    _check_unchanged(name, command, value, plain, rows[0])
    sessions = [s for s in noted.get("sessions") or [{}] if isinstance(s, dict)]
    return StoredRun(value, job, rows, sessions[-1] if sessions else {})


def _rows(folder: Path, *, of_sweep: bool) -> list[dict[str, Any]]:
    if of_sweep:
        rows = tables.sweep_rows(folder.absolute().parent)
        return [row for row in rows if str(row.get("job")) == folder.name and row.get("status") != "failed"]
    file = folder / tables.SUMMARY
    return tables.read_summary(file) if file.is_file() else []


def _settings(file: Path) -> tuple[dict[str, Any], list[str]]:
    """Return the settings of a `config.yaml`, and the words of the command in its first line."""
    try:
        plain = read_yaml(file)
        first = file.read_text(encoding="utf-8").partition("\n")[0]
        words = shlex.split(first.removeprefix("#")) if first.startswith("# runner ") else []
    except YamlError as error:
        raise ResultError(f"{file}:{error}") from None
    except (OSError, ValueError) as error:
        raise ResultError(f"{file}: can't be read: {error}.") from None
    if not isinstance(plain, dict):
        raise ResultError(f"{file}: must hold the settings of a run.")
    return {str(key): section for key, section in plain.items()}, words


def _overrides(words: list[str]) -> dict[str, Any]:
    """Return what was set on the command line, for the title of a recording and the row."""
    try:
        return overridden(OverridesParser.create().parse_overrides([w for w in words if "=" in w or w[:1] == "~"]))
    except HydraException as error:
        raise ResultError(f"{CONFIG}: its first line is no command: {str(error).splitlines()[0]}") from None


def _check_unchanged(
    name: str, command: Command[Any], value: Any, plain: Mapping[str, Any], row: Mapping[str, Any]
) -> None:
    """Refuse to repeat with other settings, or other inputs, than those that the row says it was made from."""
    belongs = belongs_to(name, command, value, plain)
    if row.get("config_hash") not in (None, belongs.config_hash):
        raise ConfigError(f"folder: {CONFIG} is not what the run was made with, it has been changed since.")
    for key, now in belongs.input_hashes.items():
        if row.get(f"{key}_hash") not in (None, now):
            raise ConfigError(f"folder: the run was made with other {key}, their file has been changed since.")
