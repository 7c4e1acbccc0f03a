"""Tables of text in the terminal that fit 80 columns: what is too long is folded, never cut."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text


def print_table(
    console: Console, title: str, content: tuple[Sequence[str], Sequence[Sequence[str]]], *, right: Collection[int] = ()
) -> None:
    """Print a table of heading and rows; columns named in `right` hold numbers, and are not folded."""
    heading, rows = content
    table = Table(
        title=title, title_justify="left", title_style="bold", box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False
    )
    for i, name in enumerate(heading):
        numbers = i in right
        table.add_column(name, justify="right" if numbers else "left", no_wrap=numbers, overflow="fold")
    for row in rows:
        table.add_row(*map(Text, row))  # a target in brackets is no markup
    console.print(table, "", highlight=False)
