"""Sweeps: Hydra's sweeper says which jobs there are, its launcher gets chunks of them, and each job leaves a row.

A launcher starts a process, or composes a config, for each of its tasks, which takes longer than a run. So a task is a
chunk of jobs, done in one process. Each chunk leaves its rows in `rows/` of the sweep's folder when they are known;
when all jobs have ended they become `summary.parquet`. What has a row is not done again.
"""

from __future__ import annotations

import functools
import gc
import os
import sys
import threading
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hydra._internal.callbacks import Callbacks
from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.plugins import Plugins
from hydra.core.utils import JobReturn, JobStatus
from hydra.plugins.launcher import Launcher
from hydra.types import HydraContext, RunMode
from omegaconf import DictConfig, OmegaConf

from runner import commands
from runner.commands import Command, Job
from runner.commands._compose import Composer
from runner.commands._explain import built, explain
from runner.commands._jobs import ConfigWriter, JobComposer
from runner.errors import ConfigError, RunnerError
from runner.progress import progress
from runner.teleop import tables

Row = Mapping[str, Any]
TOGETHER = 32  # jobs done at once; memory grows with it, and the cost per run hardly falls any more
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


def literal(path: Path) -> str:
    """Return a path as a value that Hydra takes literally."""
    return "'" + str(path).replace("'", "\\'") + "'"


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
    place = [f"hydra.sweep.dir={literal(folder.absolute())}", "hydra.sweep.subdir=.", "hydra.mode=MULTIRUN"]
    try:
        composed = hydra.compose([*overrides, *place], mode=RunMode.MULTIRUN)
        context = HydraContext(config_loader=hydra.hydra.config_loader, callbacks=Callbacks(composed))
        sweeper = Plugins.instance().instantiate_sweeper(
            hydra_context=context, config=composed, task_function=functools.partial(_chunk, None)
        )
        assert sweeper.launcher is not None
        alone = composed.hydra.runtime.choices.get("hydra/launcher") == "basic"  # all in this process
        launcher = Chunks(sweeper.launcher, name, command, hydra, folder.absolute(), chunk, alone=alone)
        sweeper.launcher = launcher  # type: ignore[assignment]
        # Hydra would compose every job; the launcher of chunks does it sooner, and with our messages
        sweeper.validate_batch_is_legal = lambda batch: None  # type: ignore[method-assign]
        with _watched(folder) as expect:
            launcher.expect = expect
            sweeper.sweep(arguments=list(OmegaConf.to_container(composed.hydra.overrides.task, resolve=False)))  # type: ignore[arg-type]
    except KeyboardInterrupt as interrupt:
        raise KeyboardInterrupt(f"Go on with: runner {name} resume={folder}") from interrupt
    except Exception as error:
        raise explain_sweep(error, hydra, overrides) from error
    (folder / "multirun.yaml").unlink(missing_ok=True)  # Hydra's; ours is sweep.txt
    rows = tables.finish_sweep(folder)
    if command.finish is not None:
        command.finish(folder)
    return _told(rows, folder)


def _told(rows: Sequence[Row], folder: Path) -> int:
    failed = [row for row in rows if row["status"] != "done"]
    for row in failed[:TOLD]:
        print(f"job {row['job']}: {row['reason']}", file=sys.stderr)
    if len(failed) > TOLD:
        print(f"... and {len(failed) - TOLD} more: runner table {folder}", file=sys.stderr)
    count = len({row["job"] for row in rows})
    print(f"{count} runs in {folder}" + (f", {len(failed)} of them failed" if failed else ""))
    return 1 if failed else 0


class Chunks(Launcher):
    """A launcher that hands chunks of jobs to another one."""

    def __init__(
        self,
        inner: Launcher,
        name: str,
        command: Command[Any],
        hydra: Composer,
        folder: Path,
        chunk: int | None,
        *,
        alone: bool,
    ) -> None:
        self.inner, self.name, self.command, self.hydra, self.folder = inner, name, command, hydra, folder
        self.chunk, self.alone = chunk, alone
        self.expect: Callable[[int], None] = lambda jobs: None

    def _length(self, jobs: int) -> int:
        """Return how many jobs make a task."""
        if self.alone:
            return max(jobs, 1)
        if self.command.batch is None:  # long ones, one after another
            return 1
        return max(1, -(-jobs // (TASKS_PER_CORE * (os.cpu_count() or 1))))

    def setup(self, *, hydra_context: HydraContext, task_function: Any, config: DictConfig) -> None:
        self.inner.setup(hydra_context=hydra_context, task_function=task_function, config=config)

    def launch(self, job_overrides: Sequence[Sequence[str]], initial_job_idx: int) -> Sequence[JobReturn]:
        """Do the jobs that have no row yet and return what became of all.

        Raises:
            ConfigError: If one of the jobs can't be composed; none has been done then.
        """
        composer = JobComposer(self.hydra)
        jobs = dict(enumerate(map(tuple, job_overrides), initial_job_idx))
        done = {row["job"] for row in tables.sweep_rows(self.folder)}
        missing = [
            _Swept(overrides, *composer.job(overrides, self.folder / str(number), number))
            for number, overrides in jobs.items()
            if number not in done
        ]
        self.expect(len(missing))
        length = self.chunk or self._length(len(missing))
        tasks = [missing[i : i + length] for i in range(0, len(missing), length)]
        work = _Work(self.name, self.folder, tasks, threads=0 if self.alone else 1)
        self.inner.task_function = functools.partial(_chunk, work)  # type: ignore[attr-defined]
        if tasks:
            for returned in self.inner.launch([[] for _ in tasks], initial_job_idx=0):
                _ = returned.return_value  # raises what went wrong in the task itself
        status = {row["job"]: row["status"] for row in tables.sweep_rows(self.folder)}
        return [_returned(overrides, status[number]) for number, overrides in jobs.items()]


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


def _returned(overrides: Sequence[str], status: str) -> JobReturn:
    out = JobReturn(overrides=overrides, status=JobStatus.COMPLETED)
    out.return_value = status
    return out


@contextmanager
def _watched(folder: Path) -> Iterator[Callable[[int], None]]:
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


def _chunk(work: _Work | None, composed: DictConfig) -> None:
    """Do one task: called by a launcher, in this process or another, on this machine or another."""
    assert work is not None, "the launcher of chunks sets the work"
    command = commands.load(work.name)
    task = work.tasks[HydraConfig.get().job.num]
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
def _collected_by_hand() -> Iterator[None]:
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
        job.results.mkdir(exist_ok=True)
        writer.write(job.results, swept.overrides, job.config)
        try:
            value = built(command, swept.values, {})
        except Exception as error:
            ledger.write(swept.number, [_failure(job, error)])
            continue
        if command.batch is None:
            ledger.write(swept.number, _alone(command, value, job))
        else:
            ready.append((value, job))
    if command.batch is not None and ready:
        for row, (_, job) in zip(command.batch(ready, threads), ready, strict=True):
            noted = _failure(job, row) if isinstance(row, Exception) else {**job.about, **row}
            ledger.write(job.number or 0, [noted])


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
        (job.results / "traceback.txt").write_text(text, encoding="utf-8")
    return tables.failure_row(error, job.about)


def explain_sweep(error: Exception, hydra: Composer, overrides: Sequence[str]) -> Exception:
    """Return the line for an error of a sweep: that of the first job that can't be composed."""
    if isinstance(error, RunnerError):
        return error
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
