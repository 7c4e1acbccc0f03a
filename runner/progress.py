"""Progress bars for whatever takes more than a second or two; nothing at all where stdout is no terminal."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Sized
from contextlib import contextmanager
from typing import TypeVar

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

T = TypeVar("T")
PATIENCE_S = 1.0  # a bar for less than this would only flicker
Advance = Callable[[int], object]  # told of the steps that were taken since its last call


def silent(_: int) -> None:
    """Report progress to nobody."""


@contextmanager
def progress(description: str, *, total: float | None, unit: str = "") -> Iterator[Callable[..., None]]:
    """Give a function `advance(steps=1)` that moves a bar on; the bar shows after a second, on stderr.

    Args:
        description: What is being done, such as "Diagnosing".
        total: Number of steps, None if not known.
        unit: What is counted, such as "cases".
    """
    if not sys.stdout.isatty():
        yield lambda steps=1: None
        return
    bar = Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn(unit),
        TimeRemainingColumn(),
        console=Console(stderr=True),
        transient=True,
        refresh_per_second=5,
    )
    task = bar.add_task(description, total=total)

    def advance(steps: float = 1) -> None:
        bar.advance(task, steps)

    patience = threading.Timer(PATIENCE_S, bar.start)
    patience.daemon = True
    patience.start()
    try:
        yield advance
    finally:
        patience.cancel()
        bar.stop()


def track(items: Iterable[T], description: str, *, total: int | None = None, unit: str = "") -> Iterator[T]:
    """Yield the items and move a bar on after each."""
    if total is None and isinstance(items, Sized):
        total = len(items)
    with progress(description, total=total, unit=unit) as advance:
        for item in items:
            yield item
            advance()
