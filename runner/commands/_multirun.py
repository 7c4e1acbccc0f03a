"""A sweep from the command line: begun in a folder that remembers its settings, or gone on with."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hydra.types import RunMode

from runner.commands import Command
from runner.commands._belonging import sweep_belongs
from runner.commands._compose import Composer
from runner.commands._results import results_folder, say
from runner.commands._sweep import explain_sweep, sweep, whole_chunk
from runner.commands._trust import check_kept
from runner.errors import ConfigError, LauncherError
from runner.processes.interruption import going_on
from runner.storage.limits import check_size
from runner.storage.run_status import running
from runner.storage.writing import write_text
from runner.teleop.tables import SWEEP, still_held


def begin(
    name: str, command: Command[Any], hydra: Composer, overrides: Sequence[str], out: str | None, chunk: str | None
) -> int:
    """Do the jobs of a sweep in a folder of its own, and return the exit code.

    Raises:
        ConfigError: If a setting is wrong, or the folder can't be had.
    """
    if command.keeps is None:
        raise ConfigError(f"runner {name}: keeps no results, so it can't be swept with -m.")
    experiment = _experiment(hydra, overrides) or command.keeps
    with results_folder(out, experiment, empty=True) as folder:
        write_text(folder / SWEEP, shlex.join([name, *overrides]) + "\n")
        return _swept(name, command, hydra, folder, overrides, whole_chunk(chunk))


def resume(
    name: str, command: Command[Any], hydra: Composer, folder: Path, overrides: Sequence[str], chunk: str | None
) -> int:
    """Go on with a sweep that was stopped: the same settings, only the jobs that have not ended."""
    runs = whole_chunk(chunk)
    memory = folder / SWEEP
    if not memory.is_file():
        raise ConfigError(f"resume: '{folder}' is no sweep: there is no {memory.name} in it.")
    before, *settings = remembered(memory)
    if before != name:
        raise ConfigError(f"resume: '{folder}' is a sweep of 'runner {before}', not of 'runner {name}'.")
    own = [o for o in overrides if not o.lstrip("+~").startswith("hydra")]
    if own:
        raise ConfigError(f"resume: goes on with the settings of before, so '{own[0]}' can't be changed.")
    check_kept(name, memory, settings, overrides)
    with results_folder(str(folder), ""):
        if still_held(folder):
            raise ConfigError(f"resume: a process of the sweep in '{folder}' is still doing runs; end it, or wait.")
        settings = [*(s for s in settings if s not in overrides), *overrides]
        return _swept(name, command, hydra, folder, settings, runs)


def _swept(
    name: str, command: Command[Any], hydra: Composer, folder: Path, overrides: Sequence[str], chunk: int | None
) -> int:
    again = f"Go on with: {shlex.join(['runner', *name.split(), f'resume={folder}'])}"
    with running(folder, sweep_belongs(name, overrides), say) as note, going_on(again, note.interrupted):
        try:
            code = sweep(name, command, hydra, folder, overrides, chunk)
        except LauncherError as error:
            raise LauncherError(f"{error} {again}") from error
        if code:
            note.fails("some of its runs failed")
        return code


def _experiment(hydra: Composer, overrides: Sequence[str]) -> str | None:
    try:
        return hydra.compose(overrides, mode=RunMode.MULTIRUN).hydra.runtime.choices.get("experiment")
    except Exception as error:
        raise explain_sweep(error, hydra, overrides) from error


def remembered(memory: Path) -> list[str]:
    """Return the command of a sweep and its settings.

    Raises:
        ConfigError: If the file holds no command line.
    """
    check_size(memory)
    try:
        words = shlex.split(memory.read_text(encoding="utf-8"))
    except (ValueError, OSError) as error:
        raise ConfigError(f"resume: '{memory}' holds no settings of a sweep ({error}).") from None
    if not words or "\0" in "".join(words):
        raise ConfigError(
            f"resume: '{memory}' holds no settings of a sweep, it is {'empty' if not words else 'binary'}."
        )
    return words
