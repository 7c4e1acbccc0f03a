"""One spoilt input: made of its number and a seed alone, read, and what came of it."""

from __future__ import annotations

import os
import resource
import shutil
import tempfile
import time
import traceback
import warnings
from collections.abc import Mapping
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np

from runner.errors import RunnerError
from tests.fuzzing.mutations import spoilt
from tests.fuzzing.readers import Reader, readers

OWN = f"{os.sep}runner{os.sep}"
MEMORY = 8_000_000_000  # bytes of address space: a bomb is a MemoryError, or ends the process; 0: no limit
LONGEST_S = 20.0
LONGEST_LINE = 100_000  # of an error, before it is shortened for the terminal
REFUSED = (RunnerError, OSError, MemoryError)  # each is one line to the user, see `runner.__main__`


def kind_of(number: int, kinds: Mapping[str, Reader]) -> str:
    """Return the kind of a trial: they take turns."""
    return sorted(kinds)[number % len(kinds)]


def write_spoilt(kinds: Mapping[str, Reader], seed: int, number: int, folder: Path) -> str:
    """Write the files of a trial to a folder, which is emptied first; return the name of the one that is spoilt."""
    reader = kinds[kind_of(number, kinds)]
    rng = np.random.default_rng([seed, number])
    shutil.rmtree(folder, ignore_errors=True)
    name = reader.spoil[int(rng.integers(len(reader.spoil)))]
    for file, content in reader.good.items():
        (folder / file).parent.mkdir(parents=True, exist_ok=True)
        (folder / file).write_bytes(spoilt(file, content, rng) if file == name else content)
    return name


def trial(kinds: Mapping[str, Reader], seed: int, number: int, folder: Path) -> tuple[str, str]:
    """Read a spoilt input.

    Returns:
        `read`, `refused` or `failed`, and what failed.
    """
    kind = kind_of(number, kinds)
    file = write_spoilt(kinds, seed, number, folder)
    begin = time.monotonic()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            kinds[kind].read(folder)
        outcome, problem = "read", ""
    except REFUSED as error:
        outcome, problem = "refused", ""
        if len(str(error)) > LONGEST_LINE:
            outcome, problem = "failed", f"an error of {len(str(error)):,} characters"
    except Exception as error:
        place = traceback.extract_tb(error.__traceback__)
        own = next(
            (f for f in reversed(place) if f"runner{os.sep}" in f.filename and "tests" not in f.filename), place[-1]
        )
        where = f"{Path(own.filename).name}:{own.lineno}"
        outcome, problem = "failed", f"{type(error).__name__} at {where}: {' '.join(str(error).split())[:300]}"
    took_s = time.monotonic() - begin
    if took_s > LONGEST_S and outcome != "failed":
        outcome, problem = "failed", f"took {took_s:.0f} s"
    return outcome, f"{kind}, {file}: {problem}" if problem else ""


def work(pipe: Connection, first: int, last: int, seed: int, kind: str, memory: int = MEMORY) -> None:
    """Do trials one after another, and say what came of each."""
    if memory:
        resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    nowhere = os.open(os.devnull, os.O_WRONLY)
    with tempfile.TemporaryDirectory(prefix="runner-fuzz-") as name:
        os.chdir(name)
        os.dup2(nowhere, 1)
        os.dup2(nowhere, 2)  # what compiled libraries say of what they refuse
        kinds = readers(kind)
        for number in range(first, last):
            pipe.send((number, *trial(kinds, seed, number, Path(name) / "trial")))
