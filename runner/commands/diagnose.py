"""Diagnose the gap: where it lies, which effect explains it, how far it shrinks.

`runner diagnose DIR` takes a case, or a folder of cases, which are diagnosed side by side. A single case leaves
`report.html`, `diagnosis.rrd`, `verdict.json`, tables and the corrected model in the results folder; many leave the
same in a folder each, and `verdicts.json` for all. With `out=PATH` of an interrupted run, cases that have a verdict
there are not done again.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from runner.commands import Command, Job
from runner.diagnosis.pipeline import diagnose
from runner.diagnosis.verdict import ALL, FILE
from runner.errors import check_workers
from runner.outputs.many import diagnose_many, write_all
from runner.progress import progress
from runner.recording import find_cases
from runner.report.terminal import summary
from runner.systems.case import open_case


@dataclass(frozen=True)
class DiagnoseConfig:
    """Which case or cases.

    `workers` cases are diagnosed at a time (None: one per core). `report` off leaves the verdicts alone.
    """

    recording: Path
    workers: int | None = None
    report: bool = True

    def __post_init__(self) -> None:
        check_workers(self.workers)


def main(config: DiagnoseConfig, job: Job) -> int | None:
    """Diagnose and report."""
    cases = find_cases(config.recording)
    console = Console()
    root = config.recording.parent if config.recording.is_file() else config.recording
    if len(cases) == 1 and cases[0] in (config.recording, root):
        system = open_case(cases[0])
        with progress("Diagnosing", total=None):
            diagnosis = diagnose(system)
            write_all(diagnosis, job.results, report=config.report)
        console.print(summary(diagnosis))
        console.print(f"{job.results / ('report.html' if config.report else FILE)}", highlight=False, soft_wrap=True)
        return None
    named = {case.relative_to(root).as_posix(): case for case in cases}
    failed = diagnose_many(named, job.results, workers=config.workers, report=config.report)
    return say_how_many(len(cases), failed, job.results, console)


def say_how_many(count: int, failed: Mapping[str, str], results: Path, console: Console) -> int | None:
    """Say how many cases were diagnosed and what was wrong with the others; return the exit code."""
    for name, problem in failed.items():
        console.print(f"{name}: {problem}", highlight=False, soft_wrap=True)
    console.print(f"{count - len(failed)} of {count} cases: {results / ALL}", highlight=False, soft_wrap=True)
    return 2 if failed else None


COMMAND = Command(config=DiagnoseConfig, main=main, keeps="diagnose", positional="recording")
