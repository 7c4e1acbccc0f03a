"""Diagnose cases: what a diagnosis leaves in its folder, and many cases side by side in processes of their own."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from runner.diagnosis.corrected import write_corrected
from runner.diagnosis.pipeline import Diagnosis, diagnose
from runner.diagnosis.verdict import ALL, FILE, verdict
from runner.errors import RunnerError
from runner.progress import progress
from runner.report import words
from runner.report.html import write_html
from runner.report.record import write_rrd
from runner.storage.reading import read_json
from runner.storage.writing import replacing, write_json, write_parquet
from runner.systems.case import open_case


def write_all(diagnosis: Diagnosis, folder: Path, *, report: bool) -> None:
    """Write what a diagnosis leaves; `verdict.json` last, as the sign that all is there."""
    folder.mkdir(parents=True, exist_ok=True)
    write_parquet(folder / "closure.parquet", diagnosis.closure.table)
    write_parquet(folder / "closure_regimes.parquet", diagnosis.closure.regimes)
    write_corrected(folder, diagnosis.effects, diagnosis.system)
    if report:
        where = diagnosis.where
        tables = {
            "gap": where.gap,
            "windows": where.windows,
            "missing_force": where.missing_force,
            "cells": where.cells,
        }
        for name, table in tables.items():
            write_parquet(folder / f"where_{name}.parquet", table)
        write_html(diagnosis, folder / "report.html")
        write_rrd(diagnosis, folder / "diagnosis.rrd")
    write_json(folder / FILE, {"sentence": words.verdict(diagnosis), **verdict(diagnosis)})


@dataclass(frozen=True)
class Seclusion:
    """Keeps workers to themselves: what they leave is taken to the results by the process that started them.

    Args:
        folder: Where the workers write.
        begin: Called first in every worker; must be importable by name.
        arguments: What it is given.
    """

    folder: Path
    begin: Callable[..., None]
    arguments: tuple[Any, ...] = ()


def diagnose_many(
    cases: Mapping[str, Path],
    results: Path,
    *,
    workers: int | None = None,
    report: bool = True,
    secluded: Seclusion | None = None,
) -> dict[str, str]:
    """Diagnose cases that have no verdict in the results yet, and keep `verdicts.json` of all up to date.

    Args:
        cases: Where each lies, by the name that it has in the results.
        results: A folder for each case, and `verdicts.json`.
        workers: So many at a time; None: one per core.
        report: Whether to write more than the verdict and the corrected model, and to look for advice.
        secluded: How workers are kept from everything but their cases; None: they are not.

    Returns:
        What was wrong with each case that could not be diagnosed, by name.
    """
    todo = [name for name in cases if not (results / name / FILE).exists()]
    count = min(workers or len(os.sched_getaffinity(0)), max(len(todo), 1))
    root = results if secluded is None else secluded.folder
    target = {name: root / (name if secluded is None else cases[name].name) for name in todo}
    failed: dict[str, str] = {}
    with progress("Diagnosing", total=len(cases), unit="cases") as advance:
        advance(len(cases) - len(todo))
        for name, problem in _run({n: (cases[n], target[n]) for n in todo}, count, report, secluded):
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


def _run(
    tasks: Mapping[str, tuple[Path, Path]], workers: int, report: bool, secluded: Seclusion | None
) -> Iterator[tuple[str, str | None]]:
    """Yield each case with what was wrong with it, as they end.

    Where a process is killed, as for want of memory, nobody knows which case it was: what was not done is done one at
    a time, and one that is killed again by itself is given up.
    """
    # fresh processes: MuJoCo's threads and a fork don't go together
    begin, arguments = (None, ()) if secluded is None else (secluded.begin, secluded.arguments)
    left = dict(tasks)
    while left:
        pool = ProcessPoolExecutor(workers, get_context("spawn"), begin, arguments)
        try:
            jobs = {pool.submit(_one, case, folder, report): name for name, (case, folder) in left.items()}
            broken = False
            for job in as_completed(jobs):
                if isinstance(job.exception(), BrokenProcessPool):
                    broken = True
                    continue
                del left[jobs[job]]
                yield jobs[job], job.result()
        finally:
            pool.shutdown(cancel_futures=True)  # what waits is not begun after an interruption
        if broken and workers == 1:
            name = next(iter(left))
            del left[name]
            yield name, "its process was killed (the memory may not suffice)."
        workers = 1


def _one(path: Path, folder: Path, report: bool) -> str | None:
    """Diagnose a case in a process of its own; return what was wrong with it, if anything."""
    try:
        write_all(diagnose(open_case(path), threads=1, advise=report), folder, report=report)
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
