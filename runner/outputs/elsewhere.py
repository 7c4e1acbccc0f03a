"""Calls made by a launcher, in processes that may be on other machines: what came of each is a file in its folder.

A launcher says nothing of its tasks before all have ended, and where a process of its is lost, not which task was in
it. So each call notes in its folder that it has begun, and what came of it; the folders must be seen by all.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path

from runner.errors import ConfigError, LauncherError
from runner.storage.holding import holding, is_held
from runner.storage.reading import read_json
from runner.storage.writing import write_json

Spread = Callable[[Sequence[Callable[[], object]]], None]
NOTE = "ended.json"  # of a call: None while it is under way, then what was wrong with it, "" if nothing


def elsewhere(
    spread: Spread, calls: Mapping[str, Callable[[], str | None]], folders: Mapping[str, Path]
) -> Iterator[tuple[str, str | None]]:
    """Make calls, each a task, and yield what was wrong with each; one whose process is lost costs itself alone.

    Where processes are lost, what had not begun is begun again, all at once; what had, afterwards and one by one, as
    one of these it was. One that loses its process once more is given up.

    Args:
        spread: Makes calls, and waits for them.
        calls: By name; must be picklable, and return what was wrong, None if nothing.
        folders: Of each; made if they are not there.

    Raises:
        ConfigError: If a process that has outlived whoever made such calls before is still at one.
        WriteError: If a folder can't be written to.
    """
    for name in calls:
        if is_held(folders[name]):
            raise ConfigError(f"out: '{folders[name]}': a process is still at it; end it, or wait.")
    for name in calls:
        _noted(folders[name]).unlink(missing_ok=True)
    fresh, suspects = list(calls), list[str]()
    while fresh or suspects:
        some = fresh or suspects[:1]
        lost = _lost(spread, [partial(_call, calls[name], folders[name]) for name in some])
        notes = {name: _note(folders[name]) for name in some}
        ended = {name: note for name, note in notes.items() if isinstance(note, str)}
        for name, note in ended.items():
            yield name, note or None
            _noted(folders[name]).unlink(missing_ok=True)
        rest = [name for name in some if name not in ended]
        if not fresh:
            suspects = suspects[1:]
            for name in rest:
                yield name, f"its process was killed (the memory may not suffice){lost}."
            continue
        begun = [name for name in rest if _noted(folders[name]).is_file()] or rest
        suspects += begun
        fresh = [name for name in rest if name not in begun]


def _lost(spread: Spread, calls: Sequence[Callable[[], object]]) -> str:
    """Make calls, and return what the launcher says of processes that it lost."""
    try:
        spread(calls)
    except LauncherError as error:
        return f": {str(error).rstrip('.')}"
    return ""


def _call(call: Callable[[], str | None], folder: Path) -> None:
    """Make a call where the launcher has put it."""
    folder.mkdir(parents=True, exist_ok=True)
    with holding(folder):
        write_json(_noted(folder), None)
        write_json(_noted(folder), call() or "")


def _noted(folder: Path) -> Path:
    return folder / NOTE


def _note(folder: Path) -> object:
    return read_json(_noted(folder)) if _noted(folder).is_file() else None
