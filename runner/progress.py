"""Progress bars for whatever takes more than a second or two; nothing at all where stdout is no terminal.

What takes minutes says what it is at: a line that moves in a terminal, and a line now and then where there is none.
"""

from __future__ import annotations

import sys
import textwrap
import threading
import time
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence, Sized
from contextlib import contextmanager
from enum import Enum
from typing import Protocol, TypeVar

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    Task,
    TextColumn,
    TimeRemainingColumn,
)
from rich.text import Text

T = TypeVar("T")
PATIENCE_S = 1.0  # a bar for less than this would only flicker
# between two lines where there is no terminal, of the time that went by, and at most
EVERY_S, EVERY_SHARE, LATEST_S = 10.0, 1 / 6, 30.0
COLUMNS = 80  # as wide as lines are where there is no terminal that says how wide it is
AS_NOISE = 1.05  # what would be told as 1.0 times the noise
UNLIKELY = 0.005  # what would be told as 0.00
COMPILING = "compiling, the first time only, a minute or two"
NAMED = 2  # effects of a fit that are named; of more there are as many as make no difference to somebody who waits
Advance = Callable[[int], object]  # told of the steps that were taken since its last call


class Step(Enum):
    """The steps of a diagnosis, in their order, in words.

    How long one takes is not known beforehand: a search is made anew wherever it finds other noise, and then goes back
    to its step.
    """

    MEASURING = "measuring the noise"
    SEARCHING = "searching"
    CHECKING = "checking on the episodes left out"
    LOCATING = "telling where the gap lies"
    TRYING = "trying what could be taken for it, and what would tell"
    WRITING = "writing the report"


class ProgressObserver(Protocol):
    """Is told what a diagnosis is at; must be quick, and raise nothing."""

    def step(self, step: Step, what: str = "") -> object:
        """Take note that a step begins, or another part of it, such as "again with less slow noise"."""

    def fitting(self, effects: Sequence[str]) -> object:
        """Take note that these effects, none: the nominal model, are being fitted."""

    def best(self, effects: Sequence[str], noises: float, probability: float, part: str = "") -> object:
        """Take note of the likeliest explanation so far.

        Args:
            effects: What it holds; none: the nominal model.
            noises: The root mean square that it leaves.
            probability: Its own, `unknown` counted in, by what was fitted so far and nothing that is held out.
            part: Of what was recorded, which alone tells that, such as "flights until the first hit"; "": of all of it.
        """


class Unobserved:
    """Takes no note of anything."""

    def step(self, step: Step, what: str = "") -> None:
        """Ignore it."""

    def fitting(self, effects: Sequence[str]) -> None:
        """Ignore it."""

    def best(self, effects: Sequence[str], noises: float, probability: float, part: str = "") -> None:
        """Ignore it."""


UNOBSERVED = Unobserved()


class Spoken:
    """Puts what a diagnosis is at into a line, and hands it on whenever it changes.

    Args:
        say: Is given the line.
    """

    def __init__(self, say: Callable[[str], object]) -> None:
        self._say, self._step, self._fitting, self._best = say, "", "", ""

    def step(self, step: Step, what: str = "") -> None:
        """A step begins, or another part of it."""
        steps = list(Step)
        self._step = f"step {steps.index(step) + 1} of {len(steps)}, {step.value}" + (f", {what}" if what else "")
        self._fitting = ""
        self._changed()

    def fitting(self, effects: Sequence[str]) -> None:
        """Effects are being fitted."""
        more = f" + {len(effects) - NAMED} more" if len(effects) > NAMED else ""
        said = f"fitting {' + '.join(effects[:NAMED]) or 'the nominal model'}{more}"
        if said != self._fitting:
            self._fitting = said
            self._changed()

    def best(self, effects: Sequence[str], noises: float, probability: float, part: str = "") -> None:
        """The best so far."""
        of = f"of {part} alone, " if part else ""
        # its probability is among what was fitted so far: while anything else is to come it says little, and misleads
        said = f"best {' + '.join(effects) or 'none'}" if effects or probability >= UNLIKELY else "nothing explains it"
        self._best = f"so far {said} ({of}{in_noises(noises)})"
        self._changed()

    def _changed(self) -> None:
        head = ", ".join(part for part in (self._step, self._fitting) if part)
        self._say("; ".join(part for part in (head, self._best) if part))


def in_noises(noises: float) -> str:
    """Return what is left, a root mean square in noises, as a clause: less than the noise is the noise, too.

    While a search goes on the noise may be estimated from more than what the best so far leaves.
    """
    return "leaves no more than the noise" if noises < AS_NOISE else f"leaves {noises:.3g} times the noise"


def silent(_: int) -> None:
    """Report progress to nobody."""


@contextmanager
def waiting(description: str) -> Generator[None]:
    """Show that something is under way which has no steps, and that it compiles if it does, as `observed` does."""
    with _shown(description, lambda: ""):
        yield


@contextmanager
def observed(description: str) -> Generator[ProgressObserver]:
    """Give an observer of a diagnosis, which shows what it is at: on a terminal at once, else a line now and then."""
    current = [""]

    def say(line: str) -> None:
        current[0] = line

    with _shown(description, lambda: current[0]):
        yield Spoken(say)


@contextmanager
def _compiling() -> Generator[Callable[[], bool]]:
    """Give a function that says whether numba is compiling: whether it has its compiler locked for a second or more.

    It locks that for a moment, too, to load what it has kept of an earlier time. Where numba is not loaded by now,
    nothing is told of it: importing it would take longer than most commands.
    """
    event = sys.modules.get("numba.core.event")
    if event is None:
        yield lambda: False
        return
    since: list[float] = []  # one for each lock, as one that compiles has others compiled

    class Listener(event.Listener):
        def on_start(self, _: object) -> None:
            since.append(time.monotonic())

        def on_end(self, _: object) -> None:
            del since[-1:]

    listener = Listener()
    event.register("numba:compiler_lock", listener)
    try:
        yield lambda: any(time.monotonic() - began > PATIENCE_S for began in since[:1])
    finally:
        event.unregister("numba:compiler_lock", listener)


class _Description(ProgressColumn):
    """What a bar is of, or that it waits for the compiler."""

    def __init__(self, compiles: Callable[[], bool]) -> None:
        super().__init__()
        self._compiles = compiles

    def render(self, task: Task) -> Text:
        """Return it."""
        return Text(f"{task.description}: {COMPILING}" if self._compiles() else task.description)


@contextmanager
def _shown(description: str, line: Callable[[], str]) -> Generator[None]:
    """Show what changes until the end, behind the time that went by: after a second, or every ten.

    Lines of what takes minutes come more rarely, but so that nobody takes it for dead.
    Where there is no terminal, what is longer than a line goes on in the next ones, indented.
    """
    began, over = time.monotonic(), threading.Event()
    console = Console(stderr=True)
    moving = console.is_terminal
    status = console.status("", refresh_per_second=4)

    def text(compiles: bool) -> str:
        head, said = f"{description} ({time.monotonic() - began:.0f} s)", COMPILING if compiles else line()
        return f"{head}: {said}" if said else head

    def pause_s() -> float:
        return PATIENCE_S if moving else min(max(EVERY_S, EVERY_SHARE * (time.monotonic() - began)), LATEST_S)

    def show(compiles: Callable[[], bool]) -> None:
        while not over.wait(pause_s()):
            try:
                if moving:
                    status.update(Text(text(compiles()), overflow="ellipsis", no_wrap=True))
                    status.start()
                else:
                    print(_folded(text(compiles())), flush=True)
            except (OSError, ValueError):  # who read it has gone
                return

    with _compiling() as compiles:
        thread = threading.Thread(target=show, args=(compiles,), daemon=True)
        thread.start()
        try:
            yield
        finally:
            over.set()
            thread.join(PATIENCE_S)
            status.stop()


def _folded(line: str) -> str:
    return textwrap.fill(line, COLUMNS, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False)


@contextmanager
def progress(
    description: str, *, total: float | None, unit: str = "", minutes: bool = False
) -> Generator[Callable[..., None]]:
    """Give a function `advance(steps=1)` that moves a bar on; the bar shows after a second, on stderr.

    Args:
        description: What is being done, such as "Diagnosing".
        total: Number of steps, None if not known.
        unit: What is counted, such as "cases".
        minutes: Whether it takes minutes, so that it says where it is now and then even where there is no terminal.
    """
    if not sys.stdout.isatty():
        done = [0.0]

        def count(steps: float = 1) -> None:
            done[0] += steps

        if not minutes:
            yield count
            return
        with _shown(description, lambda: f"{done[0]:g} of {total:g} {unit}"):
            yield count
        return
    with _compiling() as compiles:
        bar = Progress(
            _Description(compiles),
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
