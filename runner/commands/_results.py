"""The folders that commands leave their results in: made, held while something is written to them, and spoken of."""

from __future__ import annotations

import sys
from collections.abc import Generator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path

from runner.errors import ConfigError
from runner.storage.holding import holding
from runner.storage.run_status import only_begun

RESULTS = Path("results")


@contextmanager
def results_folder(out: str | None, experiment: str, *, empty: bool = False) -> Generator[Path]:
    """Make a results folder and hold it, so that no other process writes to it meanwhile.

    Raises:
        ConfigError: If the folder is in use, can't be made, or has to be empty and is not.
    """
    try:
        folder = Path(out).expanduser() if out else _new_folder(RESULTS / experiment.replace("/", "-"))
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"out: can't make the folder '{out or RESULTS}': {error.strerror}.") from error
    with holding(folder) as held:
        if not held:
            raise ConfigError(f"out: another run is writing to '{folder}'; name another folder.")
        if empty and not only_begun(folder):  # looked at once it is held: another may just have been at work here
            raise ConfigError(f"out: '{folder}' is not empty; name a new folder, or go on with resume={folder}.")
        yield folder


def _new_folder(parent: Path) -> Path:
    """Make a folder named after the time, with a number behind it where two begin in the same second."""
    parent.mkdir(parents=True, exist_ok=True)
    stamp = datetime.now().strftime("%Y-%m-%d_%H-%M-%S")
    for number in range(1, 1000):
        folder = parent / (stamp if number == 1 else f"{stamp}_{number}")
        try:
            folder.mkdir()
            return folder
        except FileExistsError:
            continue
    raise ConfigError(f"out: no free name below '{parent}'.")


def say(line: str) -> None:
    """Say something of a folder that is no result."""
    print(line, file=sys.stderr)
