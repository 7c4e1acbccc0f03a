"""Running a command: once, or as a sweep through Hydra's sweepers and launchers, each job in a folder of its own."""

from __future__ import annotations

import dataclasses
import fcntl
import functools
import os
import shlex
import sys
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.utils import JobReturn
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from runner import commands, config
from runner.commands import Command, Job
from runner.commands._arguments import take
from runner.commands._compose import QUIET, Composer, composer, without_hydra
from runner.commands._explain import explain, explain_value
from runner.errors import ConfigError, RunnerError

RESULTS = Path("results")
STATUS = "status"  # a job's folder holds this file once the job has ended, well or not


def execute(name: str, overrides: Sequence[str], *, multirun: bool) -> int:
    """Run a command with these settings and return its exit code.

    Raises:
        RunnerError: If a setting is wrong, or if the command finds something that a user can put right.
    """
    command = commands.load(name)
    if command.keeps is None:
        out, resume = None, None
    else:
        out, overrides = take("out", overrides)
        own = {f.name for f in dataclasses.fields(command.config)}
        resume, overrides = (None, overrides) if "resume" in own else take("resume", overrides)
    with composer(name, command) as hydra:
        if resume is not None:
            return _resume(name, command, hydra, Path(resume), overrides)
        composed = None if multirun else composed_for(hydra, overrides)
        if composed is not None and composed.hydra.mode is not RunMode.MULTIRUN:
            return _once(name, command, hydra, composed, out, overrides)
        if command.keeps is None:
            raise ConfigError(f"runner {name}: keeps no results, so it can't be swept with -m.")
        experiment = _swept_name(hydra, overrides) or command.keeps
        with _folder(out, experiment, empty=True) as folder:
            _remember(folder, name, overrides)
            return _sweep(name, hydra, folder, overrides)


def shown(name: str, overrides: Sequence[str]) -> str:
    """Return the YAML of the config that these settings make, after all checks.

    Raises:
        ConfigError: If a setting is wrong.
    """
    command = commands.load(name)
    with composer(name, command) as hydra:
        composed = composed_for(hydra, overrides)
        built(command, without_hydra(composed), hydra.groups())
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


def built(command: Command[Any], own: DictConfig, groups: dict[str, tuple[str, ...]]) -> Any:
    """Return the dataclass of a composed config.

    Raises:
        ConfigError: If a value is missing or out of its range.
    """
    try:
        return config.build(own, command.config)
    except (RunnerError, OmegaConfBaseException) as error:
        raise explain_value(error, own, groups) from error


def _once(
    name: str, command: Command[Any], hydra: Composer, composed: DictConfig, out: str | None, overrides: Sequence[str]
) -> int:
    value = built(command, without_hydra(composed), hydra.groups())
    if command.keeps is None:
        HydraConfig.instance().set_config(composed)
        return command.main(value, _job(None, composed, number=None)) or 0
    experiment = composed.hydra.runtime.choices.get("experiment") or command.keeps
    with _folder(out, experiment) as folder:
        returned = hydra.hydra.run(
            config_name=hydra.config_name,
            task_function=functools.partial(_task, name, value),
            overrides=[*QUIET, *overrides, f"hydra.run.dir={_literal(folder)}"],
        )
        if isinstance(returned.return_value, Exception):
            raise returned.return_value
        return returned.return_value


def _task(name: str, value: Any, composed: DictConfig) -> int | Exception:
    """The job of a single run, called by Hydra, which would print more than the error if it were raised here."""
    try:
        job = _job(Path(HydraConfig.get().runtime.output_dir), composed, number=None)
        _write_config(job, name, composed)
        return commands.load(name).main(value, job) or 0
    except Exception as error:
        return error


@dataclass(frozen=True)
class Ended:
    """How one job of a sweep ended; `reason` is empty where it went well."""

    code: int
    reason: str = ""


def _swept_task(name: str, composed: DictConfig) -> Ended:
    """One job of a sweep, called by a launcher, in this process or another: a failure is noted, not raised."""
    command = commands.load(name)
    job = _job(Path(HydraConfig.get().runtime.output_dir), composed, number=HydraConfig.get().job.num)
    status = job.results / STATUS
    if status.exists():  # resumed: this one had ended
        code, _, reason = status.read_text(encoding="utf-8").partition(" ")
        return Ended(int(code), reason.strip())
    try:
        _write_config(job, name, composed)
        ended = Ended(command.main(built(command, composed, {}), job) or 0)
    except Exception as error:
        if not isinstance(error, RunnerError):
            (job.results / "traceback.txt").write_text(traceback.format_exc(), encoding="utf-8")
        if command.failed is not None:
            command.failed(job, error)
        reason = str(error) if isinstance(error, RunnerError) else f"{type(error).__name__}: {error}"
        ended = Ended(2 if isinstance(error, RunnerError) else 1, " ".join(reason.split()))
        print(f"job {job.number}: {ended.reason}", file=sys.stderr, flush=True)
    partial = status.with_suffix(".part")
    partial.write_text(f"{ended.code} {ended.reason}\n", encoding="utf-8")
    partial.replace(status)
    return ended


def _sweep(name: str, hydra: Composer, folder: Path, overrides: Sequence[str]) -> int:
    place = [f"hydra.sweep.dir={_literal(folder)}", "hydra.sweep.subdir=${hydra:job.num}", "hydra.mode=MULTIRUN"]
    try:
        returned = hydra.hydra.multirun(
            config_name=hydra.config_name,
            task_function=functools.partial(_swept_task, name),
            overrides=[*QUIET, *overrides, *place],
        )
    except KeyboardInterrupt as interrupt:
        raise KeyboardInterrupt(f"Go on with: runner {name} resume={folder}") from interrupt
    except Exception as error:
        raise _explain_sweep(error, hydra, overrides) from error
    (folder / "multirun.yaml").unlink(missing_ok=True)  # Hydra's; ours is sweep.txt
    ended = [r.return_value for batch in returned or () for r in batch if isinstance(r, JobReturn)]
    failed = [e for e in ended if e.code]
    print(f"{len(ended)} runs in {folder}" + (f", {len(failed)} of them failed" if failed else ""))
    return 1 if failed else 0


def _explain_sweep(error: Exception, hydra: Composer, overrides: Sequence[str]) -> Exception:
    """Return the line for an error of a sweep: that of the first job that can't be composed."""
    try:
        parser = OverridesParser.create(config_loader=hydra.hydra.config_loader)
        batches = BasicSweeper.split_arguments(parser.parse_overrides(list(overrides)), None)
    except Exception as syntax:
        return explain(syntax, overrides, hydra)
    for job in batches[0]:
        try:
            hydra.compose(job)
        except Exception as found:
            return explain(found, job, hydra)
    return explain(error, [], hydra)


def _swept_name(hydra: Composer, overrides: Sequence[str]) -> str | None:
    try:
        return hydra.compose(overrides, mode=RunMode.MULTIRUN).hydra.runtime.choices.get("experiment")
    except Exception as error:
        raise _explain_sweep(error, hydra, overrides) from error


def _remember(folder: Path, name: str, overrides: Sequence[str]) -> None:
    (folder / "sweep.txt").write_text(shlex.join([name, *overrides]) + "\n", encoding="utf-8")


def _resume(name: str, command: Command[Any], hydra: Composer, folder: Path, overrides: Sequence[str]) -> int:
    """Go on with a sweep that was stopped: the same settings, only the jobs that have not ended."""
    memory = folder / "sweep.txt"
    if not memory.is_file():
        raise ConfigError(f"resume: '{folder}' is no sweep: there is no {memory.name} in it.")
    before, *settings = shlex.split(memory.read_text(encoding="utf-8"))
    if before != name:
        raise ConfigError(f"resume: '{folder}' is a sweep of 'runner {before}', not of 'runner {name}'.")
    own = [o for o in overrides if not o.startswith("hydra")]
    if own:
        raise ConfigError(f"resume: goes on with the settings of before, so '{own[0]}' can't be changed.")
    with _folder(str(folder), ""):
        return _sweep(name, hydra, folder, [*settings, *overrides])


@contextmanager
def _folder(out: str | None, experiment: str, *, empty: bool = False) -> Iterator[Path]:
    """Make a results folder and hold it, so that no other process writes to it meanwhile.

    Raises:
        ConfigError: If the folder is in use, can't be made, or has to be empty and is not.
    """
    try:
        folder = Path(out).expanduser() if out else _new_folder(RESULTS / experiment.replace("/", "-"))
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"out: can't make the folder '{out or RESULTS}': {error.strerror}.") from error
    if empty and any(folder.iterdir()):
        raise ConfigError(f"out: '{folder}' is not empty; name a new folder, or go on with resume={folder}.")
    handle = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(handle)
        raise ConfigError(f"out: another run is writing to '{folder}'; name another folder.") from None
    try:
        yield folder
    finally:
        os.close(handle)


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


def _job(folder: Path | None, composed: DictConfig, *, number: int | None) -> Job:
    own = without_hydra(composed)
    plain = OmegaConf.to_container(own, resolve=True, enum_to_str=True)
    assert isinstance(plain, dict)
    parsed = OverridesParser.create().parse_overrides(list(HydraConfig.get().overrides.task))
    return Job(
        folder=folder,
        config={str(k): v for k, v in plain.items()},
        overrides={o.get_key_element(): None if o.is_delete() else o.value() for o in parsed},
        number=number,
        experiment=HydraConfig.get().runtime.choices.get("experiment"),
    )


def _write_config(job: Job, name: str, composed: DictConfig) -> None:
    settings = shlex.join(["runner", *name.split(), *HydraConfig.get().overrides.task])
    text = OmegaConf.to_yaml(composed, resolve=True)
    (job.results / "config.yaml").write_text(f"# {settings}\n{text}", encoding="utf-8")


def _literal(path: Path) -> str:
    return "'" + str(path).replace("'", "\\'") + "'"
