"""Goes through the faults of a scenario, in processes that are forked from this one, which has imported all they need.

This process is the one with the library: `in_force` tells, `start` begins one. It runs no command itself, so that it
has no threads that a fork would miss: Rerun starts its own for a recording when one is begun.
"""

from __future__ import annotations

import ctypes
import hashlib
import itertools
import os
import select
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from runner.errors import RunnerError
from tests.faults.scenarios import PART, SCENARIOS, Scenario, reset, warm

SOURCE = Path(__file__).parent / "preload.c"
LIBRARY = "RUNNER_FAULTS"  # in the environment: where the library is
PASSED, BROKE = 97, 99  # exit codes of a forked process: no fault came, an exception
PATIENCE_S = 600.0  # of a machine that does much else


@dataclass(frozen=True)
class Tried:
    """What was tried at one call, and what was wrong then; "": nothing.

    Attributes:
        call: Its number.
        how: "failed": the call did; "stopped": the process ended there.
        problem: What was wrong.
    """

    call: int
    how: str
    problem: str


def compiler() -> str | None:
    """Return the C compiler, if there is one."""
    return shutil.which("cc") if sys.platform == "linux" else None


def start(arguments: Sequence[str]) -> int:
    """Run `python -m tests.faults` with the library preloaded, and return the exit code."""
    with tempfile.TemporaryDirectory(prefix="runner-faults-") as name:
        library = Path(name) / "faults.so"
        build = [compiler() or "cc", "-shared", "-fPIC", "-O1", "-o", str(library), str(SOURCE), "-ldl"]
        subprocess.run(build, check=True)
        env = {**os.environ, "LD_PRELOAD": str(library), LIBRARY: str(library), "OPENBLAS_NUM_THREADS": "1"}
        return subprocess.run([sys.executable, "-m", "tests.faults", *arguments], env=env, check=False).returncode


def in_force() -> bool:
    """Tell whether this process has the library."""
    return LIBRARY in os.environ


def faults(name: str, *, every: int = 1, first: int = 1) -> Iterator[Tried]:
    """Yield what came of each fault of a scenario, or of every so many from the first on.

    First the calls at which the process stops, then those that fail. Where two stops leave the same, but for files
    under temporary names, what is there is looked at once.

    Args:
        name: Of the scenario.
        every: Step from one call to the next.
        first: Number of the first.
    """
    library = ctypes.CDLL(os.environ[LIBRARY])
    with tempfile.TemporaryDirectory(prefix="runner-faults-") as place:
        folder, apart, before, stops = (Path(place).resolve() / p for p in ("folder", "apart", "before", "stops"))
        for path in (folder, apart, stops):
            path.mkdir()
        scenario = SCENARIOS[name](folder, apart)
        warm()
        _done(apart / "laid", scenario.before)
        shutil.copytree(folder, before)
        known: dict[Path, str] = {}
        checker = _Checker(scenario)
        for call, state in _stopped(library, scenario, stops):
            if (call - first) % every == 0 and call >= first:
                if state not in known:
                    reset(folder, state)
                    known[state] = checker.problem(done=False)
                yield Tried(call, "stopped", known[state])
        for call, code, said in _failed(library, scenario, before, itertools.count(first, every)):
            yield Tried(call, "failed", _problem(scenario, code, said) or checker.problem(done=code == 0))


class _Line:
    """The line to a process that the library stops: numbers to and fro."""

    def __init__(self) -> None:
        (self._reads, self.asks), (self.answers, self._writes) = os.pipe(), os.pipe()

    def ours(self) -> None:
        """Close the ends that the other process alone holds from now on."""
        os.close(self.asks)
        os.close(self.answers)

    def heard(self) -> int | None:
        """Return the next number; None: the process has ended, or nothing comes."""
        if not select.select([self._reads], [], [], PATIENCE_S)[0]:
            return None
        number = os.read(self._reads, 4)
        return int.from_bytes(number, sys.byteorder) if number else None

    def say(self, number: int) -> None:
        """Answer with a number."""
        os.write(self._writes, number.to_bytes(4, sys.byteorder))

    def close(self) -> None:
        """Close what is ours."""
        os.close(self._reads)
        os.close(self._writes)


def _stopped(library: ctypes.CDLL, scenario: Scenario, stops: Path) -> list[tuple[int, Path]]:
    """Do it once, and return what was there at each call, as if the process had been killed at it.

    Returns:
        The number of each call, and a copy of the folder; the same copy where nothing had changed.
    """
    line = _Line()

    def act() -> int:
        library.faults_stop_at_each(os.fsencode(scenario.folder), line.asks, line.answers)
        code = scenario.act()
        library.faults_end()
        return code

    told = scenario.apart / "told"
    child = _fork(told, act)
    line.ours()
    copies: list[tuple[int, Path]] = []
    while (call := line.heard()) is not None:
        state = stops / _digest(scenario.folder)
        if not state.exists():
            shutil.copytree(scenario.folder, state)
        copies.append((call, state))
        line.say(0)
    line.close()
    if _waited(child) != 0:
        raise RuntimeError(told.read_text()[-2000:])
    if problem := _Checker(scenario).problem(done=True):
        raise RuntimeError(problem)
    return copies


def _failed(
    library: ctypes.CDLL, scenario: Scenario, before: Path, calls: Iterable[int]
) -> Iterator[tuple[int, int, str]]:
    """Have one call after another fail, and yield its number, how the process ended, and what it said.

    What is done before the first call is done once, in a process that stops there and is forked for each fault.
    """
    line = _Line()

    def act() -> int:
        library.faults_fork_at_first(os.fsencode(scenario.folder), line.asks, line.answers)
        try:
            code = scenario.act()
        except (RunnerError, OSError) as error:  # of the API; `main` has a line for either
            print(error, file=sys.stderr)
            code = 2
        return code if library.faults_end() >= wanted() else PASSED

    wanted = library.faults_wanted
    reset(scenario.folder, before)
    told = scenario.apart / "told"
    stopped = _fork(told, act)
    line.ours()
    try:
        for call in calls:
            reset(scenario.folder, before)
            os.truncate(told, 0)
            line.say(call)
            child, status = line.heard(), line.heard()
            if status is None and child is not None:
                os.kill(child, signal.SIGKILL)
                status = line.heard()
            if status is None:
                raise RuntimeError(told.read_text()[-2000:])
            code = os.waitstatus_to_exitcode(status)
            if code == PASSED:
                return
            yield call, code, told.read_text()
    finally:
        line.say(0)
        _waited(stopped)
        line.close()


def _problem(scenario: Scenario, code: int, said: str) -> str:
    """Return what is wrong with how a process ended of which a call had failed."""
    if code not in (0, 1, 2) or "a bug" in said or "Traceback" in said:
        return f"ended with {code}: {said[-300:]}"
    if code and not said.strip():
        return f"ended with {code}, and said nothing"
    if left := [f.name for f in scenario.folder.rglob(".*") if PART.fullmatch(f.name)]:
        return f"left {left[0]}"
    return ""


class _Checker:
    """Says what is wrong with what is there; whether the command goes on from there, once for each set of files."""

    def __init__(self, scenario: Scenario) -> None:
        self._scenario, self._gone_on = scenario, set[frozenset[str]]()

    def problem(self, *, done: bool) -> str:
        """Return it, "" if nothing is."""
        told, folder = self._scenario.apart / "checked", self._scenario.folder
        names = frozenset(str(f.relative_to(folder)) for f in folder.rglob("*") if not PART.fullmatch(f.name))
        goes_on = not done and names not in self._gone_on
        self._gone_on.add(names)

        def check() -> int:
            self._scenario.check(done=done)
            if goes_on:
                self._scenario.check_goes_on()
            return 0

        return "" if _waited(_fork(told, check)) == 0 else told.read_text()[-600:]


def _done(told: Path, function: Callable[[], object]) -> None:
    """Call a function in a process of its own."""

    def call() -> int:
        function()
        return 0

    if _waited(_fork(told, call)) != 0:
        raise RuntimeError(told.read_text())


def _fork(told: Path, function: Callable[[], int]) -> int:
    """Begin a process that calls a function and ends with what it returns; what it says goes to a file."""
    child = os.fork()
    if child:
        return child
    code = BROKE
    try:
        handle = os.open(told, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_APPEND, 0o644)
        os.dup2(handle, 1)
        os.dup2(handle, 2)
        code = function()
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def _waited(child: int) -> int:
    begin = time.monotonic()
    while time.monotonic() - begin < PATIENCE_S:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.005)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return -signal.SIGALRM


def _digest(folder: Path) -> str:
    """Return a hash of all names and contents below a folder, save for how far a file under a temporary name is."""
    whole = hashlib.sha256()
    for path in sorted(folder.rglob("*")):
        content = path.read_bytes() if path.is_file() and not PART.fullmatch(path.name) else b""
        whole.update(f"{path.relative_to(folder)}:{path.is_file()}:{len(content)}:".encode() + content)
    return whole.hexdigest()[:16]
