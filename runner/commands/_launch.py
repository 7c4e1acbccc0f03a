"""Work handed to Hydra's launchers: in this process, on its cores (joblib), on the nodes of Ray or of Slurm."""

from __future__ import annotations

import functools
import subprocess
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any, cast

from hydra.core.hydra_config import HydraConfig
from hydra.core.plugins import Plugins  # as Hydra's example of a sweeper does: nothing else gives a launcher
from hydra.experimental.callback import Callback
from hydra.types import HydraContext
from omegaconf import DictConfig

from runner.commands._compose import Composer
from runner.commands._trust import read_nothing_kept
from runner.errors import LauncherError, RunnerError
from runner.processes.workers import joblib_workers

OF_SUBMITIT, MOST_SAID = "submitit", 300
Task = Callable[[int], object]  # is told the number of its task


def literal(path: Path) -> str:
    """Return a path as a value that Hydra takes literally."""
    return "'" + str(path).replace("'", "\\'") + "'"


def is_alone(own: DictConfig) -> bool:
    """Tell whether everything is done in this process, as no other launcher was asked for."""
    return own.hydra.runtime.choices["hydra/launcher"] == "basic"


def launch(do: Task, count: int, own: DictConfig, hydra: Composer) -> None:
    """Hand so many tasks to the launcher that Hydra's own config asks for, and wait for them.

    Raises:
        Exception: That of the first task that ended with one.
        LauncherError: If a process of the launcher was lost, or it could not begin.
    """
    if not count:
        return
    # nothing is called when a job begins or ends: a callback of Hydra's that does nothing stands for all of them
    context = HydraContext(config_loader=hydra.loader, callbacks=cast(Any, Callback()))
    read_nothing_kept(own)
    launcher = Plugins.instance().instantiate_launcher(
        hydra_context=context, task_function=functools.partial(_ended, do), config=own
    )
    if isinstance(settings := getattr(launcher, "joblib", None), dict):
        settings |= joblib_workers()  # else those that wait for a task would wait for ever once this process is killed
    try:
        with _all_of_submitit() if OF_SUBMITIT in type(launcher).__module__ else nullcontext():
            ended = launcher.launch([[] for _ in range(count)], initial_job_idx=0)
    except RunnerError:
        raise
    except Exception as error:  # each launcher has words of its own, some of them hundreds of lines
        said = " ".join(str(error).split())[:MOST_SAID]
        raise LauncherError(f"hydra/launcher: {type(error).__name__}: {said}.") from error
    for returned in ended:
        if isinstance(returned.return_value, Exception):
            raise returned.return_value


@contextmanager
def _all_of_submitit() -> Generator[None]:
    """Have submitit wait for all of the jobs that it has sent, and cancel them where it can't.

    By itself it goes away when the first is lost, and the others stay at work, or in the queue: whoever went on would
    do them beside themselves.
    """
    import submitit

    executor: Any = submitit.AutoExecutor
    sent = executor.map_array

    def waited_for(*arguments: Any) -> Any:
        jobs = sent(*arguments)
        try:
            for job in jobs:
                job.wait()
        except BaseException:
            _cancel(jobs)
            raise
        return jobs

    executor.map_array = waited_for
    try:
        yield
    finally:
        executor.map_array = sent


def _cancel(jobs: Sequence[Any]) -> None:
    import submitit

    # an array is cancelled as a whole: one by one a thousand jobs take minutes
    numbers = dict.fromkeys(j.job_id.partition("_")[0] for j in jobs if isinstance(j, submitit.SlurmJob))
    if numbers:
        subprocess.run(["scancel", *numbers], check=False)
    for job in jobs:
        if not isinstance(job, submitit.SlurmJob):
            job.cancel(check=False)


def spread(own: DictConfig, hydra: Composer, calls: Sequence[Callable[[], object]]) -> None:
    """Make calls wherever the launcher does, each a task.

    Raises:
        Exception: As `launch` does.
    """
    launch(functools.partial(_call, list(calls)), len(calls), own, hydra)


def _call(calls: Sequence[Callable[[], object]], number: int) -> None:
    calls[number]()


def _ended(do: Task, composed: DictConfig) -> Exception | None:
    """Do one task, and return what went wrong in it: of what is raised, Hydra says in words of its own."""
    try:
        do(HydraConfig.get().job.num)
    except Exception as error:
        return error
    return None
