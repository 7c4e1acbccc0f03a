"""Run an experiment: a remote cube, a local cube that follows it, and an estimator of the mass.

Both cubes get the same forces. At every update the local cube receives the remote's position, rotation, linear and
angular velocity, the estimator compares the two, and the local cube takes over the remote's state. The results folder
holds the resolved config, `run.yaml` (how far it has come, and what the results belong to), `versions.yaml`,
`frames.parquet` with a frame for every update (`log.frames=steps`: and `steps.parquet` with one for every physics
step), `run.rrd` for the Rerun viewer, and `summary.parquet` with one row.

    runner                                        the published experiment
    runner run start.mass_kg=0.5 estimator=guard
    runner run -m start.mass_kg=0.5,1,2,4         a sweep
    runner run 'effect=[viscous_drag]' log.rrd=off
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd
from rich.console import Console
from rich.table import Table

from runner.commands import Command, Job
from runner.errors import ConfigError
from runner.estimation import averaged  # noqa: F401
from runner.estimation.convergence import judged
from runner.physics.forces import CsvForces
from runner.progress import progress
from runner.storage.provenance import files_digest, versions
from runner.storage.writing import write_yaml

# the studies must be registered
from runner.studies import (  # noqa: F401
    calibration,
    certainty,
    compound,
    eq6,
    joint,
    latency,
    model_jump,
    plumb_line,
    space,
)
from runner.studies.base import AbstractStudy
from runner.teleop.batch import run_batch
from runner.teleop.experiment import Experiment
from runner.teleop.frames import ENDED, RunResult, Status
from runner.teleop.loop import run
from runner.teleop.sinks import LogConfig, RrdSink, combine
from runner.teleop.tables import SUMMARY, summary_row, write_summary

SWEEP_RRD = "sweep.rrd"
WIDTH = 120  # of printed tables


@dataclass(frozen=True)
class RunConfig(Experiment):
    """An experiment: its parts by name, and what is kept of it (`log`).

    `seed` decides all that is random. `study` takes the place of the closed loop where an experiment is another kind of
    table."""

    log: LogConfig = field(default_factory=LogConfig)
    study: AbstractStudy | None = None


def main(config: RunConfig, job: Job) -> int | None:
    """Run, write, and print the row."""
    folder = job.results
    (folder / SUMMARY).unlink(missing_ok=True)  # of the same settings, and yet not of this run
    write_versions(folder)
    found = rows(config, job)
    write_summary(found, folder)
    if config.study is not None:
        _print_study(found, job)
        return None
    (row,) = found
    _print(config, row, folder)
    return None if row["status"] in ENDED else 1


def rows(config: RunConfig, job: Job) -> list[dict[str, Any]]:
    """Run, write what is kept of it but its summary, and return the rows of that: one, of a study many."""
    if config.study is not None:
        found = config.study.rows(config, job.results)
        return [{**job.about, "status": Status.done.value, **row, **job.provenance} for row in found]
    with progress("Running", total=config.steps, unit="steps") as advance:
        result = judged(config, run(config, advance))
    return [{**job.about, **_logged(result, config, job), **job.provenance}]


def batch(jobs: Sequence[tuple[RunConfig, Job]], threads: int) -> list[dict[str, Any] | Exception]:
    """Run many at once, write what each asks for, and return their rows; one that fails does not stop the others."""
    if any(config.study for config, _ in jobs):
        raise ConfigError("study: is a table of its own and can't be swept; sweep runs, or change the study.")
    write_versions(jobs[0][1].results.parent)
    try:
        results = run_batch([config for config, _ in jobs], threads=threads)
    except Exception as error:
        if len(jobs) == 1:
            return [error]
        return [row for job in jobs for row in batch([job], threads)]
    return [_logged(judged(config, result), config, job) for result, (config, job) in zip(results, jobs, strict=True)]


def _print_study(rows: Sequence[Mapping[str, Any]], job: Job) -> None:
    """Print the table of a study."""
    table = pd.DataFrame(rows).drop(columns=["experiment", "status", *job.provenance], errors="ignore")
    text = table.to_string(index=False, na_rep="", float_format=lambda x: f"{x:.4g}", line_width=WIDTH)
    console = Console()
    console.print(text, highlight=False, soft_wrap=True)
    console.print(f"Results: {job.results}", highlight=False, soft_wrap=True)


def _logged(result: RunResult, config: RunConfig, job: Job) -> dict[str, Any]:
    """Write what is kept of a run and return its row."""
    began = time.perf_counter()
    for sink in config.log.sinks(sweep=job.number is not None):
        sink.write(result, job.results, job.config, job.overrides)
    row = summary_row(result, {"seed": config.seed})
    row["log_s"] = time.perf_counter() - began
    return row


def finish(folder: Path) -> None:
    """Put the recordings of a sweep into one file, if they were kept for that."""
    parts = sorted(folder.glob(f"*/{RrdSink.PART}"), key=lambda part: int(part.parent.name))
    if parts:
        combine(parts, folder / SWEEP_RRD)
        for part in parts:
            part.unlink()
        print(f"Look at it: runner view {folder}")


def write_versions(folder: Path) -> None:
    """Write `versions.yaml`."""
    write_yaml(folder / "versions.yaml", dict(versions()))


def _print(config: RunConfig, row: Mapping[str, Any], folder: Path) -> None:
    table = Table(title=f"{row['simulated_s']:g} s, {row['updates']} updates: {row['status']}")
    table.add_column("")
    columns = []
    for name, rule in config.estimator.items():
        prefix = f"{name}_" if len(config.estimator) > 1 else ""
        for parameter in rule.names:
            stem, _, unit = parameter.rpartition("_")
            table.add_column(f"{name}: {stem}", justify="right")
            columns.append((prefix + stem, unit))
    for label, key in (("true", "true"), ("start", "start"), ("final", "final")):
        table.add_row(label, *(f"{row[f'{at}_{key}_{unit}']:.9g} {unit}" for at, unit in columns))
    table.add_row("final relative error", *(f"{row[f'{at}_final_error']:+.1e}" for at, _ in columns))
    table.add_row("median", *(f"{row[f'{at}_median_error']:.1e}" for at, _ in columns))
    table.add_row("peak", *(f"{row[f'{at}_peak_error']:.1e}" for at, _ in columns))
    for label, key in (("within 1 % from", "1pct"), ("within 0.1 % from", "0p1pct"), ("within 0.01 % from", "0p01pct")):
        table.add_row(label, *(_seconds(row[f"{at}_to_{key}_s"]) for at, _ in columns))
    console = Console()
    console.print(table)
    if row["reason"]:
        console.print(f"{row['status']}: {row['reason']}", highlight=False, soft_wrap=True)
    console.print(f"{row['steps_per_s']:,.0f} physics steps per second. Results: {folder}", highlight=False)
    if (folder / RrdSink.FILE).is_file():
        console.print(f"Look at it: runner view {folder}", highlight=False, soft_wrap=True)


def _seconds(value: float) -> str:
    return f"{value:.2f} s" if value == value else "never"


def inputs(config: RunConfig) -> dict[str, str]:
    """Return a hash of the file of forces, if there is one."""
    return {"forces": files_digest([("", Path(config.forces.path))])} if isinstance(config.forces, CsvForces) else {}


COMMAND = Command(
    config=RunConfig, main=main, keeps="run", batch=batch, finish=finish, inputs=inputs, again="Begin again with"
)
