"""Diagnose the gap: where it lies, which effect explains it, how far it shrinks.

`runner diagnose DIR` takes a case, or a folder of cases, which are diagnosed side by side. A single case leaves
`report.html`, `diagnosis.rrd`, `verdict.json`, tables and the corrected model in the results folder; many leave the
same in a folder each, and `verdicts.json` for all. With `out=PATH` of an interrupted run, cases that have a verdict
there are not done again.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from rich.console import Console

from runner.commands import Command, Job
from runner.diagnose.corrected import write_corrected
from runner.diagnose.diagnosis import Diagnosis, diagnose
from runner.diagnose.verdict import ALL, FILE, verdict, write_verdict
from runner.errors import RunnerError, check_range
from runner.progress import progress
from runner.recording import find_cases, read_case
from runner.report.html import write_html
from runner.report.record import write_rrd
from runner.report.terminal import summary
from runner.simulate import Simulator


@dataclass(frozen=True)
class DiagnoseConfig:
    """Which case or cases.

    `workers` cases are diagnosed at a time (None: one per core). `report` off leaves the verdicts alone.
    """

    recording: Path
    workers: int | None = None
    report: bool = True

    def __post_init__(self) -> None:
        if self.workers is not None:
            check_range("workers", self.workers, 1, 1024)


def main(config: DiagnoseConfig, job: Job) -> int | None:
    """Diagnose and report."""
    cases = find_cases(config.recording)
    console = Console()
    if len(cases) == 1 and cases[0] == config.recording:
        recording = read_case(cases[0])
        with progress("Diagnosing", total=None):
            diagnosis = diagnose(recording)
            write_all(diagnosis, job.results, report=config.report)
        console.print(summary(diagnosis))
        console.print(f"{job.results / ('report.html' if config.report else FILE)}", highlight=False, soft_wrap=True)
        return None
    return _many(config, cases, job.results, console)


def write_all(diagnosis: Diagnosis, folder: Path, *, report: bool) -> None:
    """Write what a diagnosis leaves; `verdict.json` last, as the sign that all is there."""
    folder.mkdir(parents=True, exist_ok=True)
    diagnosis.closure.table.to_parquet(folder / "closure.parquet", index=False)
    write_corrected(folder, diagnosis.effects, Simulator(diagnosis.recording, grid=8))
    if report:
        where = diagnosis.where
        tables = {"gap": where.gap, "windows": where.windows, "wrench": where.wrench, "cells": where.cells}
        for name, table in tables.items():
            table.to_parquet(folder / f"where_{name}.parquet", index=False)
        write_html(diagnosis, folder / "report.html")
        write_rrd(diagnosis, folder / "diagnosis.rrd")
    write_verdict(folder / FILE, verdict(diagnosis))


def _one(path: Path, folder: Path, report: bool) -> str | None:
    """Diagnose a case in a process of its own; return what was wrong with it, if anything."""
    try:
        write_all(diagnose(read_case(path), threads=1), folder, report=report)
    except RunnerError as error:
        return str(error)
    return None


def _many(config: DiagnoseConfig, cases: list[Path], folder: Path, console: Console) -> int | None:
    names = _names(cases, config.recording)
    todo = [c for c in cases if not (folder / names[c] / FILE).exists()]
    workers = min(config.workers or len(os.sched_getaffinity(0)), max(len(todo), 1))
    failed: dict[str, str] = {}
    with progress("Diagnosing", total=len(cases), unit="cases") as advance:
        advance(len(cases) - len(todo))
        for case, problem in _run(todo, names, folder, workers, config.report):
            advance()
            if problem is not None:
                failed[names[case]] = problem
            write_verdict(folder / ALL, _collect(cases, names, folder))
    write_verdict(folder / ALL, _collect(cases, names, folder))
    for name, problem in failed.items():
        console.print(f"{name}: {problem}", highlight=False, soft_wrap=True)
    console.print(f"{len(cases) - len(failed)} of {len(cases)} cases: {folder / ALL}", highlight=False, soft_wrap=True)
    return 2 if failed else None


def _run(
    todo: list[Path], names: dict[Path, str], folder: Path, workers: int, report: bool
) -> Iterator[tuple[Path, str | None]]:
    # fresh processes: MuJoCo's threads and a fork don't go together
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        jobs = {pool.submit(_one, case, folder / names[case], report): case for case in todo}
        for job in as_completed(jobs):
            yield jobs[job], job.result()


def _names(cases: list[Path], root: Path) -> dict[Path, str]:
    return {c: c.relative_to(root).as_posix() for c in cases}


def _collect(cases: list[Path], names: dict[Path, str], folder: Path) -> dict[str, Any]:
    files = {names[c]: folder / names[c] / FILE for c in cases}
    return {name: json.loads(file.read_text(encoding="utf-8")) for name, file in files.items() if file.exists()}


COMMAND = Command(config=DiagnoseConfig, main=main, keeps="diagnose", positional="recording")
