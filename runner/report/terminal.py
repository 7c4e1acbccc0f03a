"""The summary of a diagnosis in the terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich import box
from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from runner.effects.wording import listed, number, percent, probability
from runner.recording.data import introduced
from runner.report import unknown, words
from runner.report.before_after import of_whole_episodes
from runner.report.statement import NONE, caveats, doubts, state

if TYPE_CHECKING:
    from runner.diagnosis.result import Diagnosis

SHOWN = 5


def summary(diagnosis: Diagnosis) -> RenderableType:
    """Return the verdict, the ranking and the gap before and after, to be printed by rich."""
    parts: list[RenderableType] = [Text(words.verdict(diagnosis), style="bold")]
    if confounded := words.confounded(diagnosis):
        parts.append(Text(confounded, style="yellow"))
    parts += [Text(doubt, style="yellow") for doubt in doubts(diagnosis)]
    if diagnosis.flights is not None:
        parts.append(Text(diagnosis.flights.note, style="yellow"))
    parts.append(Padding(ranking(diagnosis), (1, 0, 0, 0)))
    if lines := unknown.lines(diagnosis):
        parts.append(Padding(Text("\n".join(lines)), (1, 0, 0, 0)))
    if (gap := gap_table(diagnosis)) is not None:
        parts.append(Padding(gap, (1, 0, 0, 0)))
    if diagnosis.next_push:
        parts.append(Text(diagnosis.next_push))
    parts += [Text(introduced(note), style="dim") for note in caveats(diagnosis)]
    parts.append(Text(f"It took {words.effort(diagnosis)}.", style="dim"))
    return Group(*parts)


def ranking(diagnosis: Diagnosis) -> Table:
    """Return the explanations with their probabilities, parameters and share of the gap that they close."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False)
    table.add_column("probability", justify="right")
    table.add_column("explanation", overflow="fold")
    table.add_column("gap closed", justify="right")
    said = state(diagnosis)
    shown, rest = said.shown(SHOWN)
    for ranked in shown:
        closed = said.closed_by(ranked)
        # below the name, not in columns: those would fold each other in 80 of them
        equals = words.equals_with_amounts(diagnosis.system, ranked)
        lines = [*words.amounts(diagnosis.system, ranked), *([f"or {listed(equals, 'or')}"] if equals else [])]
        name = Text(words.title(ranked.effects or (NONE,)), style="bold")
        told = [Padding(Text(line, overflow="fold"), (0, 0, 0, 2)) for line in lines]
        table.add_row(probability(ranked.probability), Group(name, *told), "" if closed is None else percent(closed))
    if rest:
        table.add_row(probability(sum(r.probability for r in rest)), f"{len(rest)} others", style="dim")
    return table


def gap_table(diagnosis: Diagnosis) -> Table | None:
    """Return what is missed before and after, per channel, at the longest horizon; None: there are no numbers."""
    found = of_whole_episodes(diagnosis)
    if not found:
        return None
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False)
    table.add_column("missed on episodes not fitted")
    for name in ("before", "after", "noise"):
        table.add_column(name, justify="right")
    for m in found:
        before, after, noise = (number(v, 2) for v in (m.before, m.after, m.noise))
        table.add_row(Text(m.title), before, after if diagnosis.effects else "", noise)
    return table
