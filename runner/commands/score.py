"""Hold verdicts against answers: accuracy with intervals, what was taken for what, calibration.

`runner score verdicts=FILE answers=FILE` reads the `verdicts.json` of `runner diagnose` and the answers of the same
cases, prints the figures, and keeps them as tables. `runner blind score` does more, for cases of `runner blind make`.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from runner.blind.score import words
from runner.commands import Command, Job
from runner.commands._print import print_table
from runner.diagnosis.score import read_answers, score
from runner.diagnosis.verdict import ALL, read_verdicts
from runner.storage.provenance import digests
from runner.storage.reading import file_of
from runner.storage.writing import write_parquet


@dataclass(frozen=True)
class ScoreConfig:
    """`verdicts` is a `verdicts.json` of `runner diagnose`, `answers` the file of what is true."""

    verdicts: Path
    answers: Path


def main(config: ScoreConfig, job: Job) -> None:
    """Print the figures and keep the tables."""
    result = score(read_verdicts(config.verdicts), read_answers(config.answers))
    console = Console()
    print_table(console, "Answers that are right (95 % Wilson intervals)", words.groups(result.table), right=(1, 2, 3))
    print_table(console, "What was taken for what", words.confusion(result))
    for name, value in result.summary.items():
        console.print(f"{name.replace('_', ' ')}: {value:.3f}", highlight=False)
    if result.unanswered:
        console.print(f"{len(result.unanswered)} cases have no verdict: {', '.join(result.unanswered)}", soft_wrap=True)
    for name in ("cases", "table", "confusion", "calibration"):
        write_parquet(job.results / f"score_{name}.parquet", getattr(result, name))


def inputs(config: ScoreConfig) -> dict[str, str]:
    """Return hashes of the two files; what is not there is told where it is read."""
    return digests({"verdicts": file_of(config.verdicts, ALL), "answers": config.answers})


COMMAND = Command(
    config=ScoreConfig, main=main, keeps="score", inputs=inputs, aside=("verdicts", "answers"), again="Begin again with"
)
