"""Draw the figures of all experiments in these folders, and a page that says what holds.

`runner figures PATH...` takes run folders, sweep folders, or folders of these, and draws from their stored tables
alone: a PNG and an SVG of each figure, `index.html` and `index.md` with what the paper says, what is seen here, and
whether it holds. They go to `figures` in the first folder, or to `out=FOLDER`.

    runner -m experiment=start_mass out=results/start_mass
    runner figures results
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

from runner.commands import Command, Job
from runner.effects.wording import counted
from runner.errors import ConfigError
from runner.figures._page import write


@dataclass(frozen=True)
class FiguresConfig:
    """`paths` are folders of results; the figures go to `out` (None: `figures` in the first of them)."""

    paths: tuple[Path, ...]
    out: Path | None = None

    def __post_init__(self) -> None:
        if not self.paths:
            raise ConfigError("paths: at least one folder is needed, as in: runner figures results.")


def main(config: FiguresConfig, job: Job) -> None:
    """Draw and say where."""
    out = config.out or config.paths[0] / "figures"
    entries = write(config.paths, out, skipped=lambda line: print(line, file=sys.stderr))
    for entry in entries:
        print(f"{entry.file}: {entry.seen}" + (f" The claim {entry.verdict}." if entry.claim else ""))
    print(f"{counted(len(entries), 'figure')}: {out / 'index.html'}")


COMMAND = Command(config=FiguresConfig, main=main, positional="paths")
