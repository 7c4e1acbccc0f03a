"""Running a command, once or as a sweep, in a folder that no other process writes to."""

from __future__ import annotations

import dataclasses
import functools
import shlex
import sys
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import Any

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf

from runner import commands, config
from runner.commands import Command, Job
from runner.commands._arguments import take
from runner.commands._belonging import belongs_to, provenance, sweep_belongs
from runner.commands._compose import Composer, composer, without_hydra
from runner.commands._explain import built, explain
from runner.commands._jobs import overridden, write_config
from runner.commands._launch import is_alone, literal, spread
from runner.commands._sweep import explain_sweep, sweep, whole_chunk
from runner.commands._trust import SOURCE, check_kept, of_launcher
from runner.errors import ConfigError, LauncherError
from runner.processes.interruption import going_on
from runner.storage.holding import holding
from runner.storage.limits import check_size
from runner.storage.run_status import check_belongs, only_begun, running
from runner.storage.writing import write_text
from runner.teleop.tables import SWEEP, still_held

RESULTS = Path("results")
Spread = Callable[[Sequence[Callable[[], object]]], None]


def execute(name: str, overrides: Sequence[str], *, multirun: bool) -> int:
    """Run a command with these settings and return its exit code.

    Raises:
        RunnerError: If a setting is wrong, or if the command finds something that a user can put right.
    """
    command = commands.load(name)
    if command.keeps is None:
        out, resume, chunk = None, None, None
    else:
        out, overrides = take("out", overrides)
        own = {f.name for f in dataclasses.fields(command.config)}
        resume, overrides = (None, overrides) if "resume" in own else take("resume", overrides)
        chunk, overrides = (None, overrides) if "chunk" in own else take("chunk", overrides)
    with composer(name, command) as hydra:
        if resume is not None:
            return _resume(name, command, hydra, Path(resume), overrides, whole_chunk(chunk))
        composed = None if multirun else composed_for(hydra, overrides)
        if composed is not None and composed.hydra.mode is not RunMode.MULTIRUN:
            return _once(name, command, hydra, composed, out, overrides)
        if command.keeps is None:
            raise ConfigError(f"runner {name}: keeps no results, so it can't be swept with -m.")
        experiment = _swept_name(hydra, overrides) or command.keeps
        with _folder(out, experiment, empty=True) as folder:
            _remember(folder, name, overrides)
            return _swept(name, command, hydra, folder, overrides, whole_chunk(chunk))


def shown(name: str, overrides: Sequence[str]) -> str:
    """Return the YAML of the config that these settings make, after all checks.

    Raises:
        ConfigError: If a setting is wrong.
    """
    command = commands.load(name)
    if command.keeps is not None:
        _, overrides = take("out", overrides)  # says where, not what
    with composer(name, command) as hydra:
        composed = composed_for(hydra, overrides)
        built(command, without_hydra(composed), hydra.groups)
        return OmegaConf.to_yaml(OmegaConf.create(_untargeted(without_hydra(composed))))


def _untargeted(node: Any) -> Any:
    plain = OmegaConf.to_container(node, resolve=True, enum_to_str=True) if OmegaConf.is_config(node) else node
    if isinstance(plain, dict):
        return {k: _untargeted(v) for k, v in plain.items() if k != config.TARGET}
    return plain


def composed_for(hydra: Composer, overrides: Sequence[str]) -> DictConfig:
    """Return the composed config, types checked.

    Raises:
        ConfigError: If a setting is wrong.
    """
    try:
        return hydra.compose(overrides)
    except Exception as error:
        raise explain(error, overrides, hydra) from error


def _once(
    name: str, command: Command[Any], hydra: Composer, composed: DictConfig, out: str | None, overrides: Sequence[str]
) -> int:
    value = built(command, without_hydra(composed), hydra.groups)
    settings = list(composed.hydra.overrides.task)
    if command.keeps is None:
        with going_on(_again(command, name, settings), lambda: None):
            return command.main(value, _job(None, composed)) or 0
    job = _job(None, composed)
    belongs = belongs_to(name, command, value, job.config)
    with _folder(out, job.experiment or command.keeps) as folder:
        check_belongs(folder, belongs)
        again = _again(command, name, [*settings, *of_launcher(overrides), f"out={folder}"])
        with running(folder, belongs, _say) as note, going_on(again, note.interrupted):
            write_config(folder, name, settings, job.config)
            job = dataclasses.replace(
                job, folder=folder, provenance=provenance(belongs), spread=_spread(hydra, folder, overrides)
            )
            code = command.main(value, job) or 0
            if code:
                note.fails(f"exit code {code}")
            return code


def _spread(hydra: Composer, folder: Path, overrides: Sequence[str]) -> Spread | None:
    """Return what makes calls by the launcher of the command line; None: there is none."""
    if not of_launcher(overrides):
        return None
    own = hydra.bare(overrides, place=literal(folder.absolute()))
    return None if is_alone(own) else functools.partial(spread, own, hydra)


def _again(command: Command[Any], name: str, settings: Sequence[str]) -> str:
    """Return what to do after an interruption."""
    return f"{command.again}: {shlex.join(['runner', *name.split(), *settings])}" if command.again else ""


def _swept(
    name: str, command: Command[Any], hydra: Composer, folder: Path, overrides: Sequence[str], chunk: int | None
) -> int:
    again = f"Go on with: {shlex.join(['runner', *name.split(), f'resume={folder}'])}"
    with running(folder, sweep_belongs(name, overrides), _say) as note, going_on(again, note.interrupted):
        try:
            code = sweep(name, command, hydra, folder, overrides, chunk)
        except LauncherError as error:
            raise LauncherError(f"{error} {again}") from error
        if code:
            note.fails("some of its runs failed")
        return code


def _say(line: str) -> None:
    print(line, file=sys.stderr)


def _swept_name(hydra: Composer, overrides: Sequence[str]) -> str | None:
    try:
        return hydra.compose(overrides, mode=RunMode.MULTIRUN).hydra.runtime.choices.get("experiment")
    except Exception as error:
        raise explain_sweep(error, hydra, overrides) from error


def _remember(folder: Path, name: str, overrides: Sequence[str]) -> None:
    write_text(folder / SWEEP, shlex.join([name, *overrides]) + "\n")


def _remembered(memory: Path) -> list[str]:
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


def _resume(
    name: str, command: Command[Any], hydra: Composer, folder: Path, overrides: Sequence[str], chunk: int | None
) -> int:
    """Go on with a sweep that was stopped: the same settings, only the jobs that have not ended."""
    memory = folder / SWEEP
    if not memory.is_file():
        raise ConfigError(f"resume: '{folder}' is no sweep: there is no {memory.name} in it.")
    before, *settings = _remembered(memory)
    if before != name:
        raise ConfigError(f"resume: '{folder}' is a sweep of 'runner {before}', not of 'runner {name}'.")
    own = [o for o in overrides if not o.lstrip("+~").startswith("hydra")]
    if own:
        raise ConfigError(f"resume: goes on with the settings of before, so '{own[0]}' can't be changed.")
    check_kept(name, memory, settings, overrides)
    with _folder(str(folder), ""):
        if still_held(folder):
            raise ConfigError(f"resume: a process of the sweep in '{folder}' is still doing runs; end it, or wait.")
        settings = [*(s for s in settings if s not in overrides), *overrides]
        return _swept(name, command, hydra, folder, settings, chunk)


@contextmanager
def _folder(out: str | None, experiment: str, *, empty: bool = False) -> Generator[Path]:
    """Make a results folder and hold it, so that no other process writes to it meanwhile.

    Raises:
        ConfigError: If the folder is in use, can't be made, or has to be empty and is not.
    """
    try:
        folder = Path(out).expanduser() if out else _new_folder(RESULTS / experiment.replace("/", "-"))
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"out: can't make the folder '{out or RESULTS}': {error.strerror}.") from error
    with holding(folder) as held:
        if not held:
            raise ConfigError(f"out: another run is writing to '{folder}'; name another folder.")
        if empty and not only_begun(folder):  # looked at once it is held: another may just have been at work here
            raise ConfigError(f"out: '{folder}' is not empty; name a new folder, or go on with resume={folder}.")
        yield folder


def _new_folder(parent: Path) -> Path:
    """Make a folder named after the time, with a number behind it where two begin in the same second."""
    parent.mkdir(parents=True, exist_ok=True)
    stamp = datetime.now().strftime("%Y-%m-%d_%H-%M-%S")
    for number in range(1, 1000):
        folder = parent / (stamp if number == 1 else f"{stamp}_{number}")
        try:
            folder.mkdir()
            return folder
        except FileExistsError:
            continue
    raise ConfigError(f"out: no free name below '{parent}'.")


def _job(folder: Path | None, composed: DictConfig) -> Job:
    own = without_hydra(composed)
    plain = OmegaConf.to_container(own, resolve=True, enum_to_str=True)
    assert isinstance(plain, dict)
    parsed = OverridesParser.create().parse_overrides(list(composed.hydra.overrides.task))
    return Job(
        folder=folder,
        config={str(k): v for k, v in plain.items()},
        overrides=overridden(parsed),
        experiment=composed.hydra.runtime.choices.get("experiment"),
        config_dirs=tuple(Path(place.removeprefix(SOURCE)) for place in composed.hydra.searchpath),
    )
