"""Running a command, in a folder that no other process writes to; a sweep of it is in `_multirun`."""

from __future__ import annotations

import dataclasses
import functools
import shlex
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf

from runner import commands, config
from runner.commands import Command, Job
from runner.commands._arguments import take
from runner.commands._belonging import belongs_to, provenance
from runner.commands._compose import Composer, composer, without_hydra
from runner.commands._explain import built, explain
from runner.commands._jobs import overridden, write_config
from runner.commands._launch import is_alone, literal, spread
from runner.commands._results import results_folder, say
from runner.commands._trust import SOURCE, of_launcher
from runner.processes.interruption import going_on
from runner.storage.run_status import check_belongs, running

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
        if resume is None and not multirun:
            composed = composed_for(hydra, overrides)
            if composed.hydra.mode is not RunMode.MULTIRUN:
                return _once(name, command, hydra, composed, out, overrides)
        from runner.commands import _multirun  # and pandas with it, for the table of all runs

        if resume is not None:
            return _multirun.resume(name, command, hydra, Path(resume), overrides, chunk)
        return _multirun.begin(name, command, hydra, overrides, out, chunk)


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
    with results_folder(out, job.experiment or command.keeps) as folder:
        check_belongs(folder, belongs)
        again = _again(command, name, [*settings, *of_launcher(overrides), f"out={folder}"])
        with running(folder, belongs, say) as note, going_on(again, note.interrupted):
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
