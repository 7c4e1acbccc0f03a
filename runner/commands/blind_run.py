"""Diagnose cases in processes that can't read the answers.

`runner blind run DIR out=RESULTS` copies the cases of `runner blind make` to a temporary place under new names and
diagnoses the copies, in worker processes that may open nothing but those, Python and this program. The hash of the
answers, the program's version and its commit are in the results before the first diagnosis. With `out=PATH` of an
interrupted run, cases that have a verdict there are not done again, unless what they hold has changed.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from runner.blind.run import blind_run
from runner.commands import Command, Job
from runner.commands.diagnose import say_how_many
from runner.errors import check_workers


@dataclass(frozen=True)
class BlindRunConfig:
    """`cases` is the folder of them; `workers` are diagnosed at a time (None: one per core)."""

    cases: Path
    workers: int | None = None

    def __post_init__(self) -> None:
        check_workers(self.workers)


def main(config: BlindRunConfig, job: Job) -> int | None:
    """Diagnose."""
    count, failed = blind_run(
        config.cases, job.results, workers=config.workers, config_hash=job.provenance.get("config_hash")
    )
    return say_how_many(count, failed, job.results, Console())


COMMAND = Command(
    config=BlindRunConfig, main=main, keeps="blind", positional="cases", aside=("cases", "workers"), again="Go on with"
)
