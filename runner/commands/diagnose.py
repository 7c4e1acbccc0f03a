"""Diagnose the gap: where it lies, which effect explains it, how far it shrinks.

`runner diagnose DIR` takes a case, or a folder of cases, which are diagnosed side by side. A single case leaves
`report.html`, `diagnosis.rrd`, `verdict.json`, tables and the corrected model in the results folder, or `so_far.json`
where it was interrupted; many leave the same in a folder each, and `verdicts.json` for all. With `out=PATH` of an
interrupted run, cases that have a verdict there are not done again, unless what they hold has changed.

With a launcher, the cases of a folder are tasks of it, as the runs of a sweep are, and the same command goes on where
it was stopped:

    runner diagnose CASES hydra/launcher=ray hydra.launcher.address=auto out=RESULTS
    runner diagnose CASES hydra/launcher=submitit_slurm out=RESULTS
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from runner.commands import Command, Job
from runner.diagnosis.verdict import ALL
from runner.errors import check_workers
from runner.outputs.many import check_results, collect, diagnose_many
from runner.outputs.so_far import kept_so_far
from runner.progress import Step, observed, waiting
from runner.recording import find_cases
from runner.recording.case import content_hash
from runner.recording.data import warnings


@dataclass(frozen=True)
class DiagnoseConfig:
    """`recording` is a case, or a folder of cases.

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
    check_results(job.results)
    if cases == [config.recording]:
        _one(config, job, console)
        return None
    named = {case.relative_to(config.recording).as_posix(): case for case in cases}
    failed = diagnose_many(
        named,
        job.results,
        workers=config.workers,
        report=config.report,
        config_hash=job.provenance.get("config_hash"),
        spread=job.spread,
    )
    for name, found in collect(job.results, named).items():
        for note in warnings(found.get("notes", ())):
            console.print(f"{name}: {note}", highlight=False, soft_wrap=True)
    return say_how_many(len(cases), failed, job.results, console)


def _one(config: DiagnoseConfig, job: Job, console: Console) -> None:
    """Diagnose a single case, in this process."""
    # many are diagnosed by processes that import what that takes themselves
    from runner.api.case import read
    from runner.api.diagnosis import diagnose
    from runner.report.terminal import summary

    with waiting("Reading"):
        case = read(config.recording)
    with observed("Diagnosing") as shown, kept_so_far(shown, job.results) as observer:
        diagnosis = diagnose(case, progress=observer)
        observer.step(Step.WRITING)
        config_hash = job.provenance.get("config_hash")
        page = diagnosis.report(job.results, figures=config.report, config_hash=config_hash)
    console.print(summary(diagnosis.result))
    console.print(f"{page}", highlight=False, soft_wrap=True)


def say_how_many(count: int, failed: Mapping[str, str], results: Path, console: Console) -> int | None:
    """Say how many cases were diagnosed and what was wrong with the others; return the exit code."""
    for name, problem in failed.items():
        console.print(f"{name}: {problem}", highlight=False, soft_wrap=True)
    console.print(f"{count - len(failed)} of {count} cases: {results / ALL}", highlight=False, soft_wrap=True)
    return 2 if failed else None


def inputs(config: DiagnoseConfig) -> dict[str, str]:
    """Return a hash of a single recording; of many, each verdict keeps that of its own."""
    one = find_cases(config.recording) == [config.recording]
    return {"recording": content_hash(config.recording)} if one else {}


COMMAND = Command(
    config=DiagnoseConfig,
    main=main,
    keeps="diagnose",
    positional="recording",
    inputs=inputs,
    aside=("recording", "workers"),
    again="Go on with",
)
