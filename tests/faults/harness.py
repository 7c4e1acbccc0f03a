"""Goes through the faults of a scenario, each in a process of its own that is forked from this one.

This process is the one with the library: `in_force` tells, `start` begins one. It runs no command itself and does not
import Rerun, so that it has no threads, of which a fork would keep one; what else takes long is imported here, once.
"""

from __future__ import annotations

import ctypes
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from runner.errors import RunnerError
from tests.faults.scenarios import PART, SCENARIOS, Scenario, reset, warm

SOURCE = Path(__file__).parent / "preload.c"
LIBRARY = "RUNNER_FAULTS"  # in the environment: where the library is
ERROR, KILL = 1, 2
KILLED = 137
PATIENCE_S = 120.0


@dataclass(frozen=True)
class Fault:
    """One fault: which call, how it failed, what call it was, and what was wrong then; "": nothing."""

    number: int
    how: int
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


def faults(name: str, *, every: int = 1, first: int = 1) -> Iterator[Fault]:
    """Yield what came of each fault of a scenario, or of every so many from the first on.

    Args:
        name: Of the scenario.
        every: Step from one fault to the next.
        first: Number of the first.
    """
    library = ctypes.CDLL(os.environ[LIBRARY])
    with tempfile.TemporaryDirectory(prefix="runner-faults-") as place:
        folder, apart, before = (Path(place).resolve() / part for part in ("folder", "apart", "before"))
        for path in (folder, apart):
            path.mkdir()
        scenario = SCENARIOS[name](folder, apart)
        scenario.prepare()
        warm()

        def lay() -> int:
            scenario.before()
            return 0

        if _forked(apart / "laid", lay):
            raise RuntimeError((apart / "laid").read_text())
        shutil.copytree(folder, before)
        count = _forked(apart / "count", lambda: _counted(library, scenario))
        for number in range(first, count + 1, every):
            for how in (ERROR, KILL):
                reset(folder, before)
                yield Fault(number, how, _one(library, scenario, number, how))


def _counted(library: ctypes.CDLL, scenario: Scenario) -> int:
    """Do it without a fault, and return how many calls there were."""
    library.faults_arm(os.fsencode(scenario.folder), 0, 0)
    assert scenario.act() == 0
    seen = library.faults_seen()
    library.faults_arm(b"", 0, 0)
    scenario.check(done=True)
    print(f"calls: {seen}")
    return 0


def _one(library: ctypes.CDLL, scenario: Scenario, number: int, how: int) -> str:
    """Have one call fail, and return what was wrong with what came of it."""

    def act() -> int:
        library.faults_arm(os.fsencode(scenario.folder), number, how)
        try:
            code = scenario.act()
        except (RunnerError, OSError) as error:  # of the API; `main` has a line for either
            print(error, file=sys.stderr)
            code = 2
        library.faults_arm(b"", 0, 0)
        return code

    def check() -> int:
        scenario.check(done=code == 0)
        return 0

    told = scenario.apart / "told"
    code = _forked(told, act)
    said = told.read_text()
    if how == KILL and code not in (KILLED, 0):
        return f"ended with {code}: {said[-300:]}"
    if how == ERROR and (code not in (0, 1, 2) or "a bug" in said or "Traceback" in said):
        return f"ended with {code}: {said[-300:]}"
    if how == ERROR and (left := [f.name for f in scenario.folder.rglob(".*") if PART.fullmatch(f.name)]):
        return f"left {left[0]}"
    checked = scenario.apart / "checked"
    return checked.read_text()[-600:] if _forked(checked, check) else ""


def _forked(told: Path, function: Callable[[], int]) -> int:
    """Call a function in a process of its own, and return what it returns; what it says goes to a file.

    A first line `calls: N` in what it says is returned in its place.
    """
    child = os.fork()
    if child == 0:
        code = 99
        try:
            handle = os.open(told, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
            os.dup2(handle, 1)
            os.dup2(handle, 2)
            code = function()
        except BaseException:
            import traceback

            traceback.print_exc()
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(code)
    code = _waited(child)
    if code == 0:
        calls = [line for line in told.read_text().splitlines() if line.startswith("calls: ")]
        return int(calls[-1].split()[1]) if calls else 0
    return code


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
