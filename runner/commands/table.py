"""Collect any number of results folders into one table: runs, verdicts or gaps.

`runner table PATH...` takes run folders, sweep folders, or folders of these: a row for each run. Where there is no run,
it takes what `runner diagnose` left, a row for each number of each explanation, or what `runner gap` left. `--format
csv`, `markdown` and `parquet` give the table in full; `text` is for reading, and cuts long values short. `out=FILE`
writes it there, in the format of the file's ending unless a format is given.
"""

from __future__ import annotations

import math
import shutil
import sys
import textwrap
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

import pandas as pd

from runner.api.tables import VERDICT, read_table
from runner.commands import Command, Job
from runner.effects.wording import counted, percent, plus_minus, probability
from runner.errors import ConfigError
from runner.storage.writing import write_parquet, write_text
from runner.teleop import tables


class Format(Enum):
    """How a table is written."""

    text = "text"
    csv = "csv"
    markdown = "markdown"
    parquet = "parquet"


ENDINGS = {".txt": Format.text, ".csv": Format.csv, ".md": Format.markdown, ".parquet": Format.parquet}
FEW = 4  # fewer runs are printed side by side, one value a line
LONG = 32  # characters of a value that is printed in a row with others


@dataclass(frozen=True)
class TableConfig:
    """`paths` are folders of results; the table goes to the file `out`, or to the terminal."""

    paths: tuple[Path, ...]
    format: Format | None = None
    out: Path | None = None

    def __post_init__(self) -> None:
        if not self.paths:
            raise ConfigError("paths: at least one folder is needed, as in: runner table results.")
        if self.chosen is Format.parquet and self.out is None:
            raise ConfigError("out: a file is needed for format=parquet.")

    @property
    def chosen(self) -> Format:
        """The format, by itself or by the file's ending."""
        if self.format is not None:
            return self.format
        return ENDINGS.get(self.out.suffix, Format.text) if self.out else Format.text


def main(config: TableConfig, job: Job) -> None:
    """Print the table, or write it."""
    table = read_table(*config.paths)
    for folder, status in tables.unfinished(config.paths):
        print(f"{folder}: {status.value}; {tables.goes_on_with(folder)}", file=sys.stderr)
    if config.out is None:
        print(written(table, config.chosen))
        return
    config.out.parent.mkdir(parents=True, exist_ok=True)
    if config.chosen is Format.parquet:
        write_parquet(config.out, table)
    else:
        write_text(config.out, written(table, config.chosen) + "\n")
    print(f"{counted(len(table), 'run')} in {config.out}")


def written(table: pd.DataFrame, style: Format) -> str:
    """Return a table as text; CSV keeps every digit."""
    if style is Format.csv:
        return table.to_csv(index=False).rstrip("\n")
    digits = 6 if style is Format.markdown else 4
    cells = table.map(lambda value: _cell(value, digits))
    if style is Format.markdown:
        rows = [list(cells.columns), ["---"] * cells.shape[1], *cells.to_numpy().tolist()]
        return "\n".join("| " + " | ".join(str(c).replace("|", "\\|") for c in row) + " |" for row in rows)
    width = max(80, shutil.get_terminal_size().columns)
    if set(VERDICT) <= set(table.columns):
        return _verdicts(table, width)
    if len(cells) < FEW:
        room = (width - max(map(len, map(str, cells.columns)))) // max(len(cells), 1) - 2  # pandas parts columns by two
        return cells.map(lambda cell: _short(cell, room)).T.to_string(header=False)
    named = cells.map(lambda cell: _short(cell, LONG)).set_index(cells.columns[0])  # which is repeated in every block
    return named.rename_axis(index=None, columns=cells.columns[0]).to_string(line_width=width)


def _verdicts(table: pd.DataFrame, width: int) -> str:
    """Return explanations one below the other, likeliest first, each with its numbers: side by side they are too wide.

    A probability and a share read as everywhere else: 1e-126 is less than one in a hundred.
    """
    lines: list[str] = []
    for case, own in table.groupby("case", sort=False):
        lines += [str(case), "probability  gap closed  explanation"]
        for effects, rows in own.groupby("effects", sort=False):
            chance, closed = float(rows["probability"].iloc[0]), float(rows["gap_closed"].iloc[0])
            head = f"{probability(chance):>11}  {'' if math.isnan(closed) else percent(closed):>10}  "
            lines.append(
                textwrap.fill(
                    str(effects), width, initial_indent=head, subsequent_indent=" " * len(head), break_on_hyphens=False
                )
            )
            for row in rows.dropna(subset=["effect"]).to_dict("records"):
                value = plus_minus(row["value"], row["standard_error"])
                lines.append(f"{' ' * len(head)}  {row['effect']}.{row['parameter']} {value}")
    return "\n".join(lines)


def _short(cell: object, room: int) -> str:
    """Return a cell without its end where it is longer than its room."""
    text = str(cell)
    return text if len(text) <= room else f"{text[: room - 1]}…"


def _cell(value: object, digits: int) -> str:
    if isinstance(value, float):
        return "" if value != value else f"{value:.{digits}g}"
    return "" if value is None or value is pd.NA else str(value)


COMMAND = Command(config=TableConfig, main=main, positional="paths")
