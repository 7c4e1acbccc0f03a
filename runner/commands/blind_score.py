"""Score a blind run: every figure with its interval beside the bar that it is to reach, as tables, page and figures.

`runner blind score verdicts=RESULTS answers=FILE cases=DIR` first checks that the answers are those whose SHA-256 was
set down beside the verdicts before the first diagnosis. With `cases` an oracle that is told the effects is fitted to
see how much of the gap could have been closed. A case without a verdict counts as wrong. In the results:
`score.html`, `figures/`, and the tables as Parquet. With `out=PATH` of an interrupted run, what the oracle has fitted
is not fitted again.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path

from rich.console import Console

from runner.blind.checkpoint import Checkpoint, header
from runner.blind.run import own_provenance, provenance
from runner.blind.score import blind_score, check_hash, words
from runner.blind.score.figures import write_figures
from runner.blind.score.page import FILE, headline, write_page
from runner.commands import Command, Job
from runner.commands._print import print_table
from runner.diagnosis.score import read_answers
from runner.diagnosis.verdict import ALL, read_verdicts
from runner.errors import check_workers
from runner.storage.provenance import digests
from runner.storage.reading import file_of
from runner.storage.writing import write_parquet

FITS = "oracle.jsonl"


@dataclass(frozen=True)
class BlindScoreConfig:
    """`verdicts` is what `runner blind run` left, its folder or `verdicts.json`; `answers` is their file.

    With `cases` an oracle that knows the answers says how much of each gap could be closed.

    `workers` of the oracle run at a time (None: one per core).
    """

    verdicts: Path
    answers: Path
    cases: Path | None = None
    workers: int | None = None

    def __post_init__(self) -> None:
        check_workers(self.workers)


def main(config: BlindScoreConfig, job: Job) -> None:
    """Check, score, print and keep."""
    verdicts = read_verdicts(config.verdicts)
    beside = config.verdicts if config.verdicts.is_dir() else config.verdicts.parent
    folders = (beside,) if config.cases is None else (beside, config.cases)
    digest = check_hash(config.answers, *folders)
    answers = read_answers(config.answers)
    checkpoint = None if config.cases is None else _checkpoint(job.results / FITS, digest)
    found = blind_score(verdicts, answers, config.cases, checkpoint=checkpoint, workers=config.workers)
    for name, table in found.tables.items():
        write_parquet(job.results / f"score_{name}.parquet", table)
    figures = write_figures(found, job.results / "figures")
    page = write_page(found, figures, job.results / FILE, digest=digest, by=provenance(beside))
    console = Console()
    print_table(console, "Single effects by size", words.effects(found.effects), right=(2, 3, 4))
    print_table(console, "Answers that are right", words.groups(found.basic.table.head(8)), right=(1, 2, 3))
    print_table(console, "What was taken for what", words.confusion(found.basic))
    print_table(console, "95 % intervals of right answers' parameters", words.coverage(found), right=(1, 2, 3))
    if len(found.places):
        print_table(console, "Where it is", words.places(found), right=(2, 3, 4))
    heading, rows = words.worst(found)
    print_table(console, "Wrong answers, most certain first", (heading[:-1], [r[:-1] for r in rows]), right=(3,))
    print_table(console, "Against the bars", words.bars(found), right=(1, 2, 3))
    console.print("?: the interval reaches across the bar, so few cases don't settle it", style="dim", highlight=False)
    console.print(f"Brier score: {found.basic.summary['brier']:.3f}", highlight=False)
    for note in words.notes(found):
        console.print(f"Note: {note}", style="yellow", highlight=False)
    console.print(headline(found.bars), style="bold", highlight=False)
    console.print(f"{page}", highlight=False, soft_wrap=True)


def _checkpoint(path: Path, digest: str) -> Checkpoint:
    """Return the oracle's fits, those that another program or other answers left thrown away."""
    own = {k: v for k, v in asdict(own_provenance()).items() if k != "begun"}
    belongs = {"answers": digest, **own}
    if header(path) != belongs or own["changed"]:
        path.unlink(missing_ok=True)
    return Checkpoint(path, belongs)


def inputs(config: BlindScoreConfig) -> dict[str, str]:
    """Return hashes of verdicts and answers; what is not there is told where it is read."""
    return digests({"verdicts": file_of(config.verdicts, ALL), "answers": config.answers})


COMMAND = Command(
    config=BlindScoreConfig,
    main=main,
    keeps="blind_score",
    inputs=inputs,
    aside=("verdicts", "answers", "cases", "workers"),
    again="Go on with",
)
