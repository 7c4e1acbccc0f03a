"""All figures of some folders: PNG, SVG, and one page with what the paper says and what is seen here."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import pandas as pd
from jinja2 import Environment, PackageLoader, StrictUndefined

from runner.errors import ResultError, nearest
from runner.figures import Drawn, Runs, load
from runner.figures._look import INK, STYLE
from runner.storage.writing import replacing, write_text
from runner.teleop import tables
from runner.teleop.frames import ENDED

VERDICT = {True: "holds", False: "does not hold", None: "no telling"}
NO_CLAIM = "nothing to hold"
DPI = 160


@dataclass(frozen=True)
class FigureEntry:
    """One figure on the page."""

    experiment: str
    file: str
    claim: str
    seen: str
    verdict: str
    runs: str


def runs_in(paths: Iterable[Path]) -> list[Runs]:
    """Return the runs in these folders by experiment, in the order of their first run.

    Raises:
        ResultError: If there are none.
    """
    table = tables.collect(paths)
    if "experiment" not in table:
        raise ResultError("paths: no row says of which experiment it is.")
    out = []
    for name, rows in table.groupby("experiment", sort=False):
        ended = rows["status"].isin(ENDED)
        well, badly = (pd.DataFrame(rows[which]).dropna(axis=1, how="all") for which in (ended, ~ended))
        out.append(Runs(str(name), well.reset_index(drop=True), badly.reset_index(drop=True)))
    return out


def write(paths: Iterable[Path], out: Path, skipped: Callable[[str], None]) -> list[FigureEntry]:
    """Draw what there is to draw and write it to a folder.

    Args:
        paths: Folders of runs.
        out: Where the figures go.
        skipped: Told of each figure that lacks something, such as frames that were not kept.

    Raises:
        ResultError: If there are no runs, or none of an experiment that has figures.
    """
    found, figures = runs_in(paths), load()
    known = [runs for runs in found if runs.experiment in figures and len(runs.table)]
    if not known:
        raise ResultError(
            f"paths: no figure for '{found[0].experiment}' with {len(found[0].table)} runs that ended well. "
            + nearest(found[0].experiment, figures)
        )
    out.mkdir(parents=True, exist_ok=True)
    entries = [entry for runs in known for entry in _drawn(runs, out, skipped)]
    _write_page(entries, out)
    return entries


def _drawn(runs: Runs, out: Path, skipped: Callable[[str], None]) -> Iterator[FigureEntry]:
    for name, draw in load()[runs.experiment].items():
        try:
            drawn = draw(runs)
        except ResultError as error:
            skipped(f"{runs.experiment}_{name}: left out. {error}")
            continue
        stem = f"{runs.experiment}_{name}"
        _save(drawn, out / stem)
        count = f"{len(runs.table)} runs" + (f", {len(runs.failed)} more failed" if len(runs.failed) else "")
        verdict = VERDICT[drawn.holds] if drawn.claim else NO_CLAIM
        yield FigureEntry(runs.experiment, stem, drawn.claim, drawn.seen, verdict, count)


def _save(drawn: Drawn, stem: Path) -> None:
    width = int(drawn.figure.get_figwidth() * 11)  # letters to a line, at this size
    lines = textwrap.wrap(drawn.seen, width)
    top = 1 - 0.1 / drawn.figure.get_figheight()
    with mpl.rc_context(STYLE):
        drawn.figure.text(
            0.1 / drawn.figure.get_figwidth(), top, "\n".join(lines), ha="left", va="top", fontsize=11, color=INK,
            fontweight="bold", linespacing=1.3,
        )  # fmt: skip
        with replacing(stem.with_suffix(".png")) as png:
            drawn.figure.savefig(png, dpi=DPI, metadata={"Software": None})
        drawn.figure.set_layout_engine("none")  # the panels stay where they are: finding their places takes a third
        with replacing(stem.with_suffix(".svg")) as svg:
            drawn.figure.savefig(svg, metadata={"Date": None, "Creator": None})


def _write_page(entries: list[FigureEntry], out: Path) -> None:
    templates = Environment(
        loader=PackageLoader("runner.figures", "."), undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True,
        autoescape=True,
    )  # fmt: skip
    html = templates.get_template("page.html.j2").render(entries=entries)
    write_text(out / "index.html", html)
    write_text(out / "index.md", _markdown(entries))


def _markdown(entries: list[FigureEntry]) -> str:
    rows = pd.DataFrame(
        {
            "figure": [f"[{e.file}]({e.file}.png)" for e in entries],
            "the paper": [e.claim for e in entries],
            "seen here": [e.seen for e in entries],
            "": [e.verdict for e in entries],
        }
    )
    head = ["| " + " | ".join(rows.columns) + " |", "|" + "---|" * rows.shape[1]]
    body = ["| " + " | ".join(str(c).replace("|", "\\|") for c in row) + " |" for row in rows.to_numpy()]
    pictures = [f"\n![{e.seen}]({e.file}.png)" for e in entries]
    return "\n".join(["# Figures", "", *head, *body, *pictures]) + "\n"
