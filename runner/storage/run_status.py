"""`run.yaml` of a results folder: what its results belong to, what makes them, and how far that has come.

It is there from the first second of a run. A run that says `running` while nobody holds its folder was killed.
"""

from __future__ import annotations

import socket
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path
from typing import Any

from runner.errors import ConfigError, ResultError, RunnerError, WriteError
from runner.storage.holding import is_held
from runner.storage.provenance import differences, program
from runner.storage.writing import write_yaml
from runner.storage.yaml_text import YamlError, read_yaml

FILE = "run.yaml"
CONFIG = "config.yaml"
BEGINNINGS = {FILE, CONFIG, "sweep.txt", "versions.yaml"}  # written before the first result


class Status(StrEnum):
    """How far a run has come."""

    running = "running"
    done = "done"
    failed = "failed"
    interrupted = "interrupted"
    killed = "killed"


@dataclass(frozen=True)
class Belongs:
    """What results belong to: a command, a hash of its settings, and one of each thing that it reads, by name."""

    command: str
    config_hash: str
    input_hashes: Mapping[str, str] = field(default_factory=dict)


def status_of(folder: Path) -> Status | None:
    """Return how far the run in a folder has come; None where there is no `run.yaml` that tells.

    Raises:
        ResultError: If `run.yaml` can't be read.
    """
    try:
        status = Status(begun(folder)["status"])
    except (KeyError, TypeError, ValueError):
        return None
    return Status.killed if status is Status.running and not is_held(folder) else status


def begun(folder: Path) -> dict[str, Any]:
    """Return what `run.yaml` holds; empty where it is missing or holds something else.

    Raises:
        ResultError: If it can't be read.
    """
    try:
        content = read_yaml(folder / FILE) if (folder / FILE).is_file() else {}
    except YamlError as error:
        raise ResultError(f"{folder / FILE}:{error}") from None
    return content if isinstance(content, dict) else {}


def check_belongs(folder: Path, belongs: Belongs) -> None:
    """Refuse a folder that holds results of another command, of other settings or of another recording.

    Raises:
        ConfigError: Naming what differs.
        ResultError: If `run.yaml` can't be read.
    """
    before = begun(folder)
    if only_begun(folder) or not (before or _of_runner(folder / CONFIG)):
        return
    name = f"out: '{folder}' holds the results of"
    if not before:
        raise ConfigError(f"{name} a run that did not note what they belong to; name another folder.")
    if before.get("command") != belongs.command:
        raise ConfigError(f"{name} 'runner {before.get('command')}'; name another folder.")
    if before.get("config_hash") != belongs.config_hash:
        raise ConfigError(f"{name} other settings, see {CONFIG} in it; name another folder.")
    old, new = before.get("input_hashes") or {}, dict(belongs.input_hashes)
    if other := [k for k in dict.fromkeys([*old, *new]) if old.get(k) != new.get(k)]:
        raise ConfigError(
            f"{name} another '{other[0]}', or of this one before its files were changed; name another folder."
        )


def only_begun(folder: Path) -> bool:
    """Tell whether a folder holds nothing but what a run notes before its first result."""
    return all(file.name in BEGINNINGS for file in folder.iterdir())


def _of_runner(config: Path) -> bool:
    try:
        return config.read_text(encoding="utf-8").startswith("# runner ")
    except (OSError, UnicodeDecodeError):
        return False


class Note:
    """What a run notes of itself while it is under way."""

    def __init__(self, folder: Path, belongs: Belongs, sessions: list[dict[str, Any]]) -> None:
        self._folder, self._belongs, self._sessions = folder, belongs, sessions
        self.failures: list[str] = []

    def fails(self, reason: str) -> None:
        """Say why the run has failed, though it ends without an error."""
        self.failures.append(reason)

    def status(self, status: Status, reason: str = "") -> None:
        """Write how far the run has come.

        Raises:
            WriteError: If it can't be written.
        """
        if status is not Status.running:
            self._sessions[-1].update(ended=_now(), status=status.value)
        head = {"status": status.value, "reason": reason} | asdict(self._belongs)
        write_yaml(self._folder / FILE, {**head, "sessions": self._sessions})

    def interrupted(self) -> None:
        """Write that the run was interrupted."""
        self.status(Status.interrupted)


@contextmanager
def running(folder: Path, belongs: Belongs, say: Callable[[str], object]) -> Generator[Note]:
    """Note a run's beginning and its end in `run.yaml`; the folder must be held.

    What made earlier parts of the results stays noted; where it was another program, that is said.

    Args:
        folder: Of the results.
        belongs: What they belong to.
        say: Takes a line for the user.

    Raises:
        WriteError: If it can't be written.
    """
    sessions = [s for s in begun(folder).get("sessions") or [] if isinstance(s, dict)]
    session: dict[str, Any] = {"begun": _now(), "ended": None, "status": None, "host": socket.gethostname()} | program()
    if sessions and (other := differences(sessions[-1], session)):
        say(f"{folder}: goes on with another program than before ({'; '.join(other)}); each result says which made it.")
    note = Note(folder, belongs, [*sessions, session])
    note.status(Status.running)
    try:
        yield note
    except BaseException as error:
        interrupted = isinstance(error, KeyboardInterrupt)
        reason = str(error) if isinstance(error, RunnerError) or interrupted else f"{type(error).__name__}: {error}"
        with suppress(WriteError):  # where nothing can be written any more, what was wrong before is what is told
            note.status(Status.interrupted if interrupted else Status.failed, reason)
        raise
    note.status(Status.failed if note.failures else Status.done, "; ".join(note.failures))


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")
