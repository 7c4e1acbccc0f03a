"""Hold verdicts against answers: accuracy with intervals, the confusion table, calibration.

`runner score verdicts=FILE answers=FILE` reads the `verdicts.json` of `runner diagnose` and the answers of the same
cases, prints the figures, and keeps them as tables.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pandas as pd
from rich.console import Console
from rich.table import Table

from runner.commands import Command, Job
from runner.diagnose.score import read_answers, score
from runner.diagnose.verdict import read_verdicts


@dataclass(frozen=True)
class ScoreConfig:
    """Which verdicts, and which answers."""

    verdicts: Path
    answers: Path


def main(config: ScoreConfig, job: Job) -> None:
    """Print the figures and keep the tables."""
    result = score(read_verdicts(config.verdicts), read_answers(config.answers))
    console = Console()
    console.print(_table("First answers, with 95 % Wilson intervals", result.table))
    wrong = pd.DataFrame(
        result.cases[~result.cases["right"]], columns=["case", "truth", "severity", "first", "probability"]
    )
    if len(wrong):
        console.print(_table("Wrong", wrong))
    console.print(_table("What was named (across) for what (down)", result.confusion.reset_index()))
    for name, value in result.summary.items():
        console.print(f"{name.replace('_', ' ')}: {value:.3f}", highlight=False)
    for name in ("cases", "table", "confusion"):
        getattr(result, name).to_parquet(job.results / f"score_{name}.parquet")


def _table(title: str, frame: pd.DataFrame) -> Table:
    table = Table(title=title, title_justify="left")
    for name in frame.columns:
        table.add_column(str(name), overflow="fold")
    for row in frame.itertuples(index=False):
        table.add_row(*(f"{v:.2f}" if isinstance(v, float) else "" if v == 0 else str(v) for v in row))
    return table


COMMAND = Command(config=ScoreConfig, main=main, keeps="score")
