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
SHORT_S = 100.0  # what is shorter is told in seconds
COLUMNS = 80  # as wide as lines are where there is no terminal that says how wide it is
# How many times as long as until the first explanation a whole diagnosis takes: the 10 % and 90 % quantiles of 17 logs
# that people made by simulators of their own (of 33 that ours made: 6 and 13). A search goes on as long as anything
# gains, so that nothing knows its end.
USUAL = (4.0, 30.0)
AS_NOISE = 1.05  # what would be told as 1.0 times the noise
UNLIKELY = 0.005  # what would be told as 0.00
COMPILING = "compiling, the first time only, two to three minutes"
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
        begun: Is called once there is an explanation.
    """

    def __init__(self, say: Callable[[str], object], begun: Callable[[], object] = lambda: None) -> None:
        self._say, self._begun, self._step, self._fitting, self._best = say, begun, "", "", ""

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
        if not self._best:
            self._begun()
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

    with _shown(description, lambda: current[0]) as begun:
        yield Spoken(say, begun)


class _Compiler:
    """Whether numba is compiling, and how long it has been."""

    def __init__(self) -> None:
        self._since: list[float] = []  # one for each lock, as one that compiles has others compiled
        self._ended_s = 0.0

    def begins(self) -> None:
        """Its compiler is locked."""
        self._since.append(time.monotonic())

    def ends(self) -> None:
        """It is free again."""
        began = self._since.pop() if self._since else time.monotonic()  # it was locked before anybody looked
        if not self._since:
            self._ended_s += time.monotonic() - began

    @property
    def is_busy(self) -> bool:
        """Whether it has been locked for a second or more: it is for a moment, too, to load what was kept."""
        return any(time.monotonic() - began > PATIENCE_S for began in self._since[:1])

    @property
    def so_far_s(self) -> float:
        """How long it has been locked in all."""
        return self._ended_s + sum(time.monotonic() - began for began in self._since[:1])


@contextmanager
def _compiling() -> Generator[_Compiler]:
    """Give what is told of numba's compiler.

    Where numba is not loaded by now, nothing is told of it: importing it would take longer than most commands.
    """
    compiler, event = _Compiler(), sys.modules.get("numba.core.event")
    if event is None:
        yield compiler
        return

    class Listener(event.Listener):
        def on_start(self, _: object) -> None:
            compiler.begins()

        def on_end(self, _: object) -> None:
            compiler.ends()

    listener = Listener()
    event.register("numba:compiler_lock", listener)
    try:
        yield compiler
    finally:
        event.unregister("numba:compiler_lock", listener)


class _Description(ProgressColumn):
    """What a bar is of, or that it waits for the compiler."""

    def __init__(self, compiler: _Compiler) -> None:
        super().__init__()
        self._compiler = compiler

    def render(self, task: Task) -> Text:
        """Return it."""
        return Text(f"{task.description}: {COMPILING}" if self._compiler.is_busy else task.description)


@contextmanager
def _shown(description: str, line: Callable[[], str]) -> Generator[Callable[[], None]]:
    """Show what changes until the end, behind the time that went by: after a second, or every ten.

    Lines of what takes minutes come more rarely, but so that nobody takes it for dead.
    Where there is no terminal, what is longer than a line goes on in the next ones, indented.

    Yields:
        To be called once the first of what takes as long as this usually does is done, if anything is.
    """
    began, over = time.monotonic(), threading.Event()
    console, first_s = Console(stderr=True), list[float]()
    moving = console.is_terminal
    status = console.status("", refresh_per_second=4)

    def passed_s() -> float:
        return time.monotonic() - began

    def text(compiler: _Compiler) -> str:
        usual = _usual(passed_s(), *first_s)
        head, said = f"{description} ({passed_s():.0f} s{usual})", COMPILING if compiler.is_busy else line()
        return f"{head}: {said}" if said else head

    def pause_s() -> float:
        return PATIENCE_S if moving else min(max(EVERY_S, EVERY_SHARE * passed_s()), LATEST_S)

    def show(compiler: _Compiler) -> None:
        while not over.wait(pause_s()):
            try:
                if moving:
                    status.update(Text(text(compiler), overflow="ellipsis", no_wrap=True))
                    status.start()
                else:
                    print(_folded(text(compiler)), flush=True)
            except (OSError, ValueError):  # who read it has gone
                return

    with _compiling() as compiler:
        thread = threading.Thread(target=show, args=(compiler,), daemon=True)
        thread.start()
        try:
            yield lambda: first_s.extend((passed_s(), compiler.so_far_s))
        finally:
            over.set()
            thread.join(PATIENCE_S)
            status.stop()


def _usual(passed_s: float, first_s: float = 0.0, compiling_s: float = 0.0) -> str:
    """Return " of 1 to 3 min as a rule", of what took so long up to its first result, or that it is longer than that.

    Args:
        passed_s: Since it began.
        first_s: Since it began when the first result was there.
        compiling_s: Of that, which happens once.
    """
    if not first_s:
        return ""
    low, high = (compiling_s + times * (first_s - compiling_s) for times in USUAL)
    if passed_s > high:
        return ", longer than usual"
    if high < SHORT_S:
        return f" of {low:.0f} to {high:.0f} s as a rule"
    from_min, to_min = max(round(low / 60.0), 1), max(round(high / 60.0), 2)
    return f" of {from_min} to {to_min} min as a rule"


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
    with _compiling() as compiler:
        bar = Progress(
            _Description(compiler),
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
