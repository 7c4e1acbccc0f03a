"""Diagnose many cases side by side, in processes of their own.

What a diagnosis is made of is imported by those alone (`runner.outputs.one`): they begin seconds sooner, and the
process that watches them stays small.
"""

from __future__ import annotations

import os
import pickle
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from runner.diagnosis.verdict import ALL, FILE
from runner.errors import ConfigError, ResultError, RunnerError
from runner.outputs.elsewhere import Spread, elsewhere
from runner.processes.workers import kill_workers, shielded, worker_of
from runner.progress import progress
from runner.recording.case import TABLES, content_hash
from runner.storage.provenance import program
from runner.storage.reading import read_json
from runner.storage.writing import check_own, replacing, write_json


def check_results(folder: Path) -> None:
    """Refuse a folder that holds a recording: its model would be written over.

    Raises:
        ConfigError: Naming the folder.
    """
    if any((folder / name).exists() for name in TABLES):
        raise ConfigError(f"out: '{folder}' holds a recording, and its model would be written over; name another.")


def made_from(case: Path, program: Mapping[str, Any]) -> dict[str, Any]:
    """Return what stands in a verdict of what made it: the program, and a hash of what the case held.

    Raises:
        RecordingError: If the case can't be read.
    """
    return {**program, "recording_hash": content_hash(case)}


def has_verdict(folder: Path, case: Path) -> bool:
    """Tell whether a folder holds the verdict of a case as it is now.

    Raises:
        ResultError: If the verdict can't be read.
        RecordingError: If the case can't be read.
    """
    if not (folder / FILE).exists():
        return False
    content = read_json(folder / FILE)
    provenance = content.get("provenance") if isinstance(content, dict) else None
    return isinstance(provenance, dict) and provenance.get("recording_hash") == content_hash(case)


@dataclass(frozen=True)
class Seclusion:
    """Keeps workers to themselves: what they leave is taken to the results by the process that started them.

    Args:
        folder: Where the workers write.
        first: Called in every worker before anything of size is imported, with its arguments; importable by name.
        begin: Called in every worker before its first case, likewise. What it returns stands in each verdict.
    """

    folder: Path
    first: tuple[Callable[..., object], tuple[Any, ...]]
    begin: tuple[Callable[..., Mapping[str, Any]], tuple[Any, ...]]


def diagnose_many(
    cases: Mapping[str, Path],
    results: Path,
    *,
    workers: int | None = None,
    report: bool = True,
    secluded: Seclusion | None = None,
    config_hash: str | None = None,
    spread: Spread | None = None,
) -> dict[str, str]:
    """Diagnose cases that have no verdict in the results yet, and keep `verdicts.json` of all up to date.

    A verdict is of a case if it was made from what the case holds now; others are made anew.

    Args:
        cases: Where each lies, by the name that it has in the results.
        results: A folder for each case, and `verdicts.json`.
        workers: So many at a time; None: one per core.
        report: Whether to write more than the verdict and the corrected model, and to look for advice.
        secluded: How workers are kept from everything but their cases; None: they are not.
        config_hash: Of the settings, for the verdicts.
        spread: Makes calls in other processes, maybe on other machines, which see the same folders, in place of
            `workers`; see `runner.outputs.elsewhere`.

    Returns:
        What was wrong with each case that could not be diagnosed, by name.

    Raises:
        ResultError: If there are verdicts of cases that are not among these, or one can't be read.
        WriteError: If the folder of a case is a link.
    """
    _check_others(results, cases)
    for name in cases:
        check_own(results, name)
    todo = [name for name, case in cases.items() if not has_verdict(results / name, case)]
    for name in todo:
        (results / name / FILE).unlink(missing_ok=True)
    made_with = {**program(), "config_hash": config_hash}
    count = min(workers or len(os.sched_getaffinity(0)), max(len(todo), 1))
    root = results if secluded is None else secluded.folder
    target = {name: root / (name if secluded is None else cases[name].name) for name in todo}
    failed: dict[str, str] = {}
    with progress("Diagnosing", total=len(cases), unit="cases", minutes=True) as advance:
        advance(len(cases) - len(todo))
        tasks = {n: (cases[n].absolute(), target[n].absolute()) for n in todo}
        ended = (
            _run(tasks, count, report, secluded, made_with)
            if spread is None
            else elsewhere(spread, {n: partial(_one_made_with, made_with, *tasks[n], report) for n in todo}, target)
        )
        for name, problem in ended:
            if problem is not None:
                failed[name] = problem
            elif secluded is not None:
                _take(target[name], results / name)
            write_json(results / ALL, collect(results, cases))
            advance()
    write_json(results / ALL, collect(results, cases))
    return failed


def collect(results: Path, names: Iterable[str]) -> dict[str, Any]:
    """Return the verdicts that are there, by case."""
    files = {name: results / name / FILE for name in names}
    return {name: read_json(file) for name, file in files.items() if file.exists()}


def _check_others(results: Path, cases: Iterable[str]) -> None:
    """Refuse a folder that holds verdicts of other cases."""
    there = {file.parent.relative_to(results).as_posix() for file in results.rglob(FILE)}
    if others := sorted(there - set(cases)):
        more = f" and {len(others) - 1} more" if len(others) > 1 else ""
        raise ResultError(f"out: '{results}' holds verdicts of other cases ('{others[0]}'{more}); name another folder.")


def _run(
    tasks: Mapping[str, tuple[Path, Path]],
    workers: int,
    report: bool,
    secluded: Seclusion | None,
    made_with: Mapping[str, Any],
) -> Iterator[tuple[str, str | None]]:
    """Yield each case with what was wrong with it, as they end.

    Where a process is killed, as for want of memory, nobody knows which case it was: what was not done is done one at
    a time, and one that is killed again by itself is given up.
    """
    # fresh processes: MuJoCo's threads and a fork don't go together
    first = [] if secluded is None else [secluded.first]
    begin = [pickle.dumps(called) for called in (*first, (_begin, (made_with, secluded)))]
    left = dict(tasks)
    while left:
        pool = ProcessPoolExecutor(workers, get_context("spawn"), worker_of, (os.getpid(), *begin))
        try:
            with shielded():
                jobs = {pool.submit(_one, case, folder, report): name for name, (case, folder) in left.items()}
            broken = False
            for job in as_completed(jobs):
                if isinstance(job.exception(), BrokenProcessPool):
                    broken = True
                    continue
                del left[jobs[job]]
                yield jobs[job], job.result()
        except KeyboardInterrupt:
            kill_workers()  # what they are at is begun anew on going on
            raise
        finally:
            pool.shutdown(cancel_futures=True)  # what waits is not begun after an interruption
        if broken and workers == 1:
            name = next(iter(left))
            del left[name]
            yield name, "its process was killed (the memory may not suffice)."
        workers = 1


_MADE_WITH: dict[str, Any] = {}  # in a worker: the program; git can't be asked from behind a fence


def _begin(made_with: Mapping[str, Any], secluded: Seclusion | None) -> None:
    """Begin a worker."""
    _MADE_WITH.update(made_with)
    if secluded is not None:
        function, arguments = secluded.begin
        _MADE_WITH.update(function(*arguments))


def _one_made_with(made_with: Mapping[str, Any], path: Path, folder: Path, report: bool) -> str | None:
    """Diagnose a case as `_one` does, in a process that was told nothing before."""
    _MADE_WITH.update(made_with)
    return _one(path, folder, report)


def _one(path: Path, folder: Path, report: bool) -> str | None:
    """Diagnose a case in a process of its own; return what was wrong with it, if anything."""
    from runner.diagnosis.pipeline import diagnose
    from runner.outputs.one import write_all
    from runner.systems.case import open_case

    try:
        provenance = made_from(path, _MADE_WITH)  # before it is read: what changes meanwhile is found on going on
        diagnosis = diagnose(open_case(path), threads=1, advise=report)
        write_all(diagnosis, folder, report=report, provenance=provenance)
    except RunnerError as error:
        return str(error)
    except Exception as error:  # one case that breaks must not take the others' verdicts with it
        return f"{type(error).__name__}: {error}"
    return None


def _take(folder: Path, target: Path) -> None:
    """Move what a worker left; the verdict last, as when it is written."""
    target.mkdir(parents=True, exist_ok=True)
    for file in sorted(folder.iterdir(), key=lambda f: f.name == FILE):
        with replacing(target / file.name) as part:
            shutil.move(file, part)
