"""What a diagnosis has found so far, kept in its folder as long as it is under way: an interrupted one leaves that."""

from __future__ import annotations

import time
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from pathlib import Path

from runner.progress import ProgressObserver, Step, in_noises
from runner.storage.writing import write_json

FILE = "so_far.json"


class SoFar:
    """Writes each new best explanation into a file, and hands everything on.

    Args:
        observer: Is told all of it, too.
        path: Of the file.
    """

    def __init__(self, observer: ProgressObserver, path: Path) -> None:
        self._observer, self._path, self._began = observer, path, time.monotonic()
        self.sentence = ""

    def step(self, step: Step, what: str = "") -> None:
        """Hand it on."""
        self._observer.step(step, what)

    def fitting(self, effects: Sequence[str]) -> None:
        """Hand it on."""
        self._observer.fitting(effects)

    def best(self, effects: Sequence[str], noises: float, probability: float, part: str = "") -> None:
        """Write it down, and hand it on."""
        self._observer.best(effects, noises, probability, part)
        names = list(effects) or ["none"]
        of = f" of {part} alone" if part else ""
        self.sentence = f"So far{of}: {' + '.join(names)}, which {in_noises(noises)} ({self._path})."
        found = {"effects": names, "probability": probability, "noises_left": noises, "checked_on_unseen": False}
        if part:
            found["part"] = part
        write_json(self._path, found | {"after_s": time.monotonic() - self._began})


@contextmanager
def kept_so_far(observer: ProgressObserver, folder: Path) -> Generator[SoFar]:
    """Keep what is found in `so_far.json` of a folder until the end; an interruption leaves it, and says so."""
    kept = SoFar(observer, folder / FILE)
    try:
        yield kept
    except KeyboardInterrupt as error:
        error.args = (*error.args, kept.sentence) if kept.sentence else error.args
        raise
    (folder / FILE).unlink(missing_ok=True)
