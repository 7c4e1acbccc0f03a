"""Sweeps: every combination of the values is a job, Hydra's launcher gets chunks of them, and each job leaves a row.

A launcher starts a process, or composes a config, for each of its tasks, which takes longer than a run. So a task is a
chunk of jobs, done in one process. Each chunk leaves its rows in `rows/` of the sweep's folder when they are known;
when all jobs have ended they become `summary.parquet`. What has a row is not done again.
"""

from __future__ import annotations

import functools
import gc
import itertools
import math
import os
import sys
import threading
import traceback
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.types import RunMode

from runner import commands
from runner.commands import Command, Job
from runner.commands._belonging import job_provenance
from runner.commands._compose import Composer
from runner.commands._explain import built, explain
from runner.commands._jobs import ConfigWriter, JobComposer
from runner.commands._launch import is_alone, launch, literal
from runner.effects.wording import counted
from runner.errors import ConfigError, RunnerError
from runner.progress import progress
from runner.storage.writing import own_folder, write_text
from runner.teleop import tables
from runner.teleop.frames import ENDED, Status

Row = Mapping[str, Any]
TOGETHER = 32  # jobs done at once; memory grows with it, and the cost per run hardly falls any more
MOST_JOBS = 1_000_000
TASKS_PER_CORE = 4  # so that no core waits long for the last task
TOLD = 5  # failures that are told; all of them are in the table
POLL_S = 0.5


def whole_chunk(text: str | None) -> int | None:
    """Return the value of `chunk=`.

    Raises:
        ConfigError: If it is no whole number above zero.
    """
    if text is None:
        return None
    if not text.isdigit() or int(text) < 1:
        raise ConfigError(f"chunk: must be a whole number of runs of at least 1, got '{text}'.")
    return int(text)


def sweep(
    name: str, command: Command[Any], hydra: Composer, folder: Path, overrides: Sequence[str], chunk: int | None
) -> int:
    """Do the jobs of a sweep that have no row yet, and return the exit code: 1 if a job failed.

    Args:
        name: Of the command.
        command: What to do.
        hydra: Composes its config.
        folder: Of the sweep; exists.
        overrides: As the user gave them, with several values for what is swept.
        chunk: Jobs to a task of the launcher; None: chosen here.

    Raises:
        ConfigError: If one of the jobs can't be composed; nothing has been run then.
    """
    place = folder.absolute()
    try:
        composed = hydra.compose(overrides, mode=RunMode.MULTIRUN)
        own = hydra.bare(overrides, place=literal(place))
        alone = is_alone(own)
        swept = [f"{key}={values}" for key, values in (composed.hydra.sweeper.params or {}).items()]
        sources = [o for o in overrides if o.startswith("hydra.searchpath=")]
        jobs = combinations([*sources, *swept, *composed.hydra.overrides.task], hydra)
        with _watched(folder) as expect:
            missing = _missing(jobs, hydra, place)
            expect(len(missing))
            length = chunk or _length(command, len(missing), alone=alone)
            tasks = [missing[i : i + length] for i in range(0, len(missing), length)]
            work = _Work(name, place, tasks, threads=0 if alone else 1)
            launch(functools.partial(_chunk, work), len(tasks), own, hydra)
    except Exception as error:
        raise explain_sweep(error, hydra, overrides) from error
    rows = tables.finish_sweep(folder)
    if command.finish is not None:
        command.finish(folder)
    return _told(rows, folder)


def _told(rows: Sequence[Row], folder: Path) -> int:
    failed = [row for row in rows if row["status"] not in ENDED]
    astray = sum(row["status"] == Status.unconverged.value for row in rows)
    for row in failed[:TOLD]:
        print(f"job {row['job']}: {row['reason']}", file=sys.stderr)
    if len(failed) > TOLD:
        print(f"... and {len(failed) - TOLD} more: runner table {folder}", file=sys.stderr)
    count = len({row["job"] for row in rows})
    said = [(len(failed), "failed"), (astray, "did not converge")]
    print(f"{counted(count, 'run')} in {folder}" + "".join(f", {n} of them {what}" for n, what in said if n))
    return 1 if failed else 0


def combinations(settings: Sequence[str], hydra: Composer) -> list[list[str]]:
    """Return the settings of each job: every combination of the values, the last key's changing fastest.

    Raises:
        ConfigError: If a setting names a range without steps, or if there are more than `MOST_JOBS`.
    """
    choices: dict[str, list[str]] = {}
    for override in OverridesParser.create(config_loader=hydra.loader).parse_overrides(list(settings)):
        key = override.get_key_element()
        if override.is_sweep_override() and not override.is_discrete_sweep():
            raise ConfigError(
                f"{key}: '{override.get_value_string()}' has no steps; write key=a,b,c or key=range(a,b)."
            )
        values = override.sweep_string_iterator() if override.is_sweep_override() else None
        some = itertools.islice(values or [override.get_value_element_as_str()], MOST_JOBS + 1)
        choices[key] = [f"{key}={v}" for v in some]
        if math.prod(len(c) for c in choices.values()) > MOST_JOBS:
            raise ConfigError(f"{key}: with it there are more than {MOST_JOBS:,} jobs; a sweep may have so many.")
    return [list(job) for job in itertools.product(*choices.values())]


def _length(command: Command[Any], jobs: int, *, alone: bool) -> int:
    """Return how many jobs make a task."""
    if alone:
        return max(jobs, 1)
    if command.batch is None:  # long ones, one after another
        return 1
    return max(1, -(-jobs // (TASKS_PER_CORE * (os.cpu_count() or 1))))


@dataclass(frozen=True)
class _Swept:
    """One job of a sweep: its settings, what they compose to, and what its command is told of it."""

    overrides: tuple[str, ...]
    values: Mapping[str, Any]
    job: Job

    @property
    def number(self) -> int:
        """Its place in the sweep."""
        assert self.job.number is not None
        return self.job.number


@dataclass(frozen=True)
class _Work:
    """What a process must know to do any of the tasks."""

    name: str
    folder: Path
    tasks: list[list[_Swept]]
    threads: int


def _missing(jobs: Sequence[Sequence[str]], hydra: Composer, folder: Path) -> list[_Swept]:
    """Return the jobs that have no row yet, composed.

    Raises:
        ConfigError: If one of them can't be.
    """
    composer = JobComposer(hydra)
    done = {row["job"] for row in tables.sweep_rows(folder)}
    return [
        _Swept(tuple(job), *composer.job(job, folder / str(number), number))
        for number, job in enumerate(jobs)
        if number not in done
    ]


@contextmanager
def _watched(folder: Path) -> Generator[Callable[[int], None]]:
    """Show a bar of the runs that have ended, whoever does them, by their rows; give a function that sets the total."""
    total, over = [0], threading.Event()

    def watch() -> None:
        known = tables.count_rows(folder)
        begun = known
        while not total[0] and not over.wait(POLL_S):
            pass
        with progress("Running", total=total[0], unit="runs") as advance:
            while not over.wait(POLL_S):
                known, before = tables.count_rows(folder), known
                advance(known - before)
                if known - begun >= total[0]:
                    return

    def expect(jobs: int) -> None:
        total[0] = jobs

    if not sys.stdout.isatty():
        yield expect
        return
    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    try:
        yield expect
    finally:
        over.set()
        watcher.join()


def _chunk(work: _Work, number: int) -> None:
    """Do one task: called by a launcher, in this process or another, on this machine or another."""
    command = commands.load(work.name)
    task = work.tasks[number]
    writer = ConfigWriter(work.name)
    together = TOGETHER if command.batch is not None else 1
    by_hand = _collected_by_hand() if command.batch is not None else nullcontext()
    with tables.Ledger(work.folder, task[0].number).held() as ledger, by_hand:
        noted = ledger.noted()  # where the task was begun before, and its machine was lost
        task = [swept for swept in task if swept.number not in noted]
        for i in range(0, len(task), together):
            _do(command, writer, work.threads, task[i : i + together], ledger)
            gc.collect()


@contextmanager
def _collected_by_hand() -> Generator[None]:
    """Keep the garbage collector from looking for what it can't find yet, which takes longer than the updates do.

    Runs hold megabytes in few objects and are let go of all at once, which the caller knows and the collector does not.
    """
    gc.freeze()  # what was imported is there to stay
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


def _do(
    command: Command[Any], writer: ConfigWriter, threads: int, some: Sequence[_Swept], ledger: tables.Ledger
) -> None:
    """Do some jobs, together if the command can, and note how they ended."""
    ready: list[tuple[Any, Job]] = []
    for swept in some:
        job = swept.job
        own_folder(job.results.parent, job.results.name)
        writer.write(job.results, swept.overrides, job.config)
        try:
            value = built(command, swept.values, dict)
            job = replace(job, provenance=job_provenance(writer.name, command, value, job.config))
        except Exception as error:
            job = replace(job, provenance=job_provenance(writer.name, command, None, job.config))
            ledger.write(swept.number, [{**_failure(job, error), **job.provenance}])
            continue
        if command.batch is None:
            ledger.write(swept.number, [{**row, **job.provenance} for row in _alone(command, value, job)])
        else:
            ready.append((value, job))
    if command.batch is not None and ready:
        for row, (_, job) in zip(command.batch(ready, threads), ready, strict=True):
            noted = _failure(job, row) if isinstance(row, Exception) else {**job.about, **row}
            ledger.write(job.number or 0, [{**noted, **job.provenance}])


def _alone(command: Command[Any], value: Any, job: Job) -> list[Row]:
    try:
        code = command.main(value, job) or 0
    except Exception as error:
        return [_failure(job, error)]
    ended = {"status": "done" if code == 0 else "failed", "reason": "" if code == 0 else f"exit code {code}"}
    file = job.results / tables.SUMMARY
    return [{**job.about, **ended, **row} for row in (tables.read_summary(file) if file.is_file() else [{}])]


def _failure(job: Job, error: Exception) -> Row:
    if not isinstance(error, RunnerError):
        text = "".join(traceback.format_exception(error))
        write_text(job.results / "traceback.txt", text)
    return tables.failure_row(error, job.about)


def explain_sweep(error: Exception, hydra: Composer, overrides: Sequence[str]) -> Exception:
    """Return the line for an error of a sweep: that of the first job that can't be composed."""
    if isinstance(error, RunnerError):
        return error
    try:
        jobs = combinations(overrides, hydra)
    except Exception as syntax:
        return explain(syntax, overrides, hydra)
    for job in jobs:
        try:
            hydra.compose(job)
        except Exception as found:
            return explain(found, job, hydra)
    return explain(error, [], hydra)
