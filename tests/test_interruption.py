"""Ctrl-C, SIGTERM and SIGKILL: a line within two seconds that says how to go on, and no process that is left."""

from __future__ import annotations

import gc
import json
import os
import shlex
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from types import FrameType
from typing import Any

import pytest

from runner.diagnosis.verdict import FILE
from runner.recording import write_case
from runner.storage.run_status import Status, status_of
from runner.teleop import tables
from tests.cases import made

ROOT = Path(__file__).parents[1]
EXAMPLES = ROOT / "examples" / "cases"
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
WITHIN_S = 2.0
PATIENCE_S = 120.0
WORK_S = 3.0  # of a worker, by which it has imported what it needs and is at work
MANY = 100_000  # ledgers
RUNS = 20  # of a sweep, in tasks of five
TICKS = os.sysconf("SC_CLK_TCK")  # to a second


def begin(cwd: Path, *arguments: str) -> subprocess.Popen[str]:
    """Begin a command in a group of processes of its own, as a terminal does."""
    return subprocess.Popen(
        [sys.executable, "-m", "runner", *arguments], cwd=cwd, env=ENVIRONMENT, start_new_session=True, text=True,
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
    )  # fmt: skip


def family(process: subprocess.Popen[str]) -> set[int]:
    """Return the processes of the group that work: those of Python's own that only watch are left out."""
    found = set()
    for entry in Path("/proc").iterdir():
        if not entry.name.isdigit():
            continue
        try:
            state, _, group, *_ = (entry / "stat").read_text().rpartition(")")[2].split()
            if int(group) != process.pid or state == "Z":
                continue
            if b"resource_tracker import" not in (entry / "cmdline").read_bytes():
                found.add(int(entry.name))
        except OSError:
            continue
    return found


def worked_s(process: subprocess.Popen[str]) -> dict[int, float]:
    """Return for how long processors have worked for each process of the group."""
    found = {}
    for number in family(process):
        with suppress(OSError):  # it has just ended
            fields = Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()
            found[number] = (int(fields[11]) + int(fields[12])) / TICKS
    return found


def wait_for_work(process: subprocess.Popen[str], work_s: float, *, workers: int = 0) -> None:
    """Wait until so many workers of a process, none: it itself, have each worked for so long from now on.

    Work and not time: how far a command has come by some time depends on what else the machine does.
    """
    before = worked_s(process)

    def at_work() -> bool:
        now = worked_s(process)
        by = [s - before.get(k, 0.0) for k, s in now.items() if (k == process.pid) == (workers == 0)]
        return sum(s > work_s for s in by) >= max(workers, 1)

    wait_until(at_work, process, look_s=0.2)  # to look through all processes is work, too, and delays theirs


def wait_until(
    true: Callable[[], bool], process: subprocess.Popen[str] | None = None, *, look_s: float = 0.02
) -> float:
    """Wait, looking every so often, and return how long that took."""
    start = time.monotonic()
    while not true():
        assert time.monotonic() - start < PATIENCE_S
        assert process is None or process.poll() is None, process.communicate()[1]
        time.sleep(look_s)
    return time.monotonic() - start


def stopped(process: subprocess.Popen[str], number: int, *, all_of_them: bool) -> str:
    """Send a signal, to the whole group as a terminal does or to the one process, and return what is said of it."""
    start = time.monotonic()
    if all_of_them:
        os.killpg(process.pid, number)
    else:
        process.send_signal(number)
    _, err = process.communicate(timeout=PATIENCE_S)
    assert time.monotonic() - start < WITHIN_S
    wait_until(lambda: not family(process))
    assert time.monotonic() - start < WITHIN_S
    assert process.returncode == 128 + number
    assert err.count("\n") == 1, err
    return err.strip()


def begun_anew(line: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Do what the line says."""
    command = line.partition(" with: ")[2]
    assert command.startswith("runner ")
    return subprocess.run(
        [sys.executable, "-m", *shlex.split(command)], cwd=cwd, env=ENVIRONMENT, capture_output=True, text=True,
        timeout=600, check=False,
    )  # fmt: skip


CTRL_C, SIGTERM = (signal.SIGINT, True), (signal.SIGTERM, False)
ONE, JOBLIB = (), ("hydra/launcher=joblib", "hydra.launcher.n_jobs=2")


def test_while_a_ledger_is_taken_and_let_go_of(tmp_path: Path) -> None:
    """Wherever a signal comes then, it is told as itself and stands in no other's way."""
    count = 0
    while _interrupted_at(count, tables.Ledger(tmp_path, count)):
        with tables.Ledger(tmp_path, MANY + count).held():
            count += 1
    assert count > 10  # lines of it


def _interrupted_at(number: int, ledger: tables.Ledger) -> bool:
    """Hold a ledger, interrupted at such a line of what does that; False: there are fewer."""
    lines = 0

    def trace(frame: FrameType, event: str, _: object) -> Any:
        nonlocal lines
        if "contextlib" in frame.f_code.co_filename:
            return None
        if event == "line":
            lines += 1
            if lines > number:
                sys.settrace(None)
                raise KeyboardInterrupt
        return trace

    gc.disable()  # what is raised in the finalizer of some other test's garbage goes no further
    try:
        with suppress(KeyboardInterrupt):
            sys.settrace(trace)
            with ledger.held():
                pass
    finally:
        sys.settrace(None)
        gc.enable()
    return lines > number


@pytest.mark.parametrize(
    ("number", "all_of_them"),
    [pytest.param(*CTRL_C, id="ctrl-c"), pytest.param(*SIGTERM, id="sigterm", marks=pytest.mark.slow)],
)
def test_a_run(number: int, all_of_them: bool, tmp_path: Path) -> None:
    """A single run says how to begin again, and `run.yaml` that it was interrupted."""
    process = begin(tmp_path, "forces.pushes=3000", "log.rrd=off", "out=r")
    wait_until((tmp_path / "r/versions.yaml").exists, process)
    wait_for_work(process, 0.5)
    line = stopped(process, number, all_of_them=all_of_them)
    assert line == "Interrupted. Begin again with: runner run forces.pushes=3000 log.rrd=off out=r"
    assert status_of(tmp_path / "r") is Status.interrupted


@pytest.mark.parametrize(
    ("number", "all_of_them", "launcher"),
    [
        pytest.param(*CTRL_C, ONE, id="ctrl-c-one"),
        pytest.param(*SIGTERM, JOBLIB, id="sigterm-joblib", marks=pytest.mark.slow),
        pytest.param(*SIGTERM, ONE, id="sigterm-one", marks=pytest.mark.slow),
        pytest.param(*CTRL_C, JOBLIB, id="ctrl-c-joblib", marks=pytest.mark.slow),
    ],
)
def test_a_sweep(number: int, all_of_them: bool, launcher: tuple[str, ...], tmp_path: Path) -> None:
    """A sweep in one process and in two: what has ended is kept, the command goes on with the rest."""
    sweep = [
        "-m",
        f"seed=range(0,{RUNS})",
        "forces.pushes=6",
        "link=poor",
        "follow=unaware",
        "log.rrd=off",
        "out=s",
        "chunk=5",
    ]
    process = begin(tmp_path, *sweep, *launcher)
    wait_until(lambda: tables.count_rows(tmp_path / "s") > 5, process)
    line = stopped(process, number, all_of_them=all_of_them)
    assert line == "Interrupted. Go on with: runner run resume=s"
    assert status_of(tmp_path / "s") is Status.interrupted
    assert not tables.still_held(tmp_path / "s")
    ended = len(tables.sweep_rows(tmp_path / "s"))
    assert 5 < ended < RUNS
    assert tables.unfinished([tmp_path]) == [(tmp_path / "s", Status.interrupted)]
    if not launcher and all_of_them:
        # the link loses and delays what the estimator is never told of
        assert begun_anew(line, tmp_path).stdout == f"{RUNS} runs in s, {RUNS} of them did not converge\n"
        assert status_of(tmp_path / "s") is Status.done


def many(folder: Path, count: int) -> None:
    """Make a folder of so many cases, none of which is diagnosed soon."""
    for k in range(count):
        shutil.copytree(EXAMPLES / "slippery_floor", folder / f"c{k}")


@pytest.mark.parametrize(
    ("number", "all_of_them"),
    [pytest.param(*CTRL_C, id="ctrl-c"), pytest.param(*SIGTERM, id="sigterm", marks=pytest.mark.slow)],
)
def test_diagnoses(number: int, all_of_them: bool, tmp_path: Path) -> None:
    """Cases side by side: the workers end with it, and the command names the folder that it made by itself."""
    many(tmp_path / "cases", 4)
    process = begin(tmp_path, "diagnose", "cases", "workers=2", "report=false")
    wait_for_work(process, WORK_S, workers=2)
    line = stopped(process, number, all_of_them=all_of_them)
    (folder,) = (tmp_path / "results/diagnose").iterdir()
    assert line == (
        "Interrupted. Go on with: runner diagnose recording=cases workers=2 report=false "
        f"out={folder.relative_to(tmp_path)}"
    )
    assert status_of(folder) is Status.interrupted


def test_a_diagnosis_goes_on(tmp_path: Path) -> None:
    """What was diagnosed before the interruption is kept; the command that was named does the rest."""
    for name in ("c0", "c1"):
        write_case(made(episodes=2, seconds=1.0)[0], tmp_path / "cases" / name)
    process = begin(tmp_path, "diagnose", "cases", "workers=1", "report=false", "out=d")
    wait_until((tmp_path / "d/c0" / FILE).exists, process)
    line = stopped(process, signal.SIGTERM, all_of_them=False)
    first = (tmp_path / "d/c0" / FILE).read_bytes()
    assert not (tmp_path / "d/c1" / FILE).exists()
    done = begun_anew(line, tmp_path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "d/c0" / FILE).read_bytes() == first
    assert set(json.loads((tmp_path / "d/verdicts.json").read_text())) == {"c0", "c1"}


@pytest.mark.parametrize(
    ("number", "all_of_them"),
    [pytest.param(*CTRL_C, id="ctrl-c", marks=pytest.mark.slow), pytest.param(*SIGTERM, id="sigterm")],
)
def test_a_single_diagnosis(number: int, all_of_them: bool, tmp_path: Path) -> None:
    """Deep in compiled code, where Python comes back late."""
    process = begin(tmp_path, "diagnose", str(EXAMPLES / "slippery_floor"), "report=false", "out=d")
    wait_until((tmp_path / "d/config.yaml").exists, process)
    wait_for_work(process, 2.0)
    line = stopped(process, number, all_of_them=all_of_them)
    assert line.startswith("Interrupted. Go on with: runner diagnose recording=")
    assert status_of(tmp_path / "d") is Status.interrupted


@pytest.mark.parametrize(
    "command",
    [
        pytest.param(("diagnose", "cases", "workers=2", "report=false", "out=o"), id="diagnose"),
        pytest.param(
            ("-m", "seed=range(0,400)", "log.rrd=off", "out=o", "hydra/launcher=joblib", "hydra.launcher.n_jobs=2"),
            id="sweep",
        ),
        # by joblib, as a sweep has it
        pytest.param(
            ("blind", "make", "n=40", "out=o", "workers=2", "seed=1"), id="blind make", marks=pytest.mark.slow
        ),
    ],
)
def test_workers_end_with_their_parent(command: tuple[str, ...], tmp_path: Path) -> None:
    """SIGKILL leaves the parent no time for anything; the kernel ends its workers."""
    many(tmp_path / "cases", 4)
    process = begin(tmp_path, *command)
    wait_for_work(process, 1.0, workers=2)
    assert len(family(process)) >= 3
    process.kill()
    assert wait_until(lambda: not family(process)) < WITHIN_S
    process.communicate()
    if "blind" not in command:
        assert status_of(tmp_path / "o") is Status.killed


def test_the_one_line_is_the_only_one() -> None:
    """Where the main thread does not come back, Python's resource tracker has nothing to add to the line."""
    left = (
        "import os; from multiprocessing import get_context; from runner.processes.interruption import interruptible\n"
        "with interruptible():\n"
        "    lock = get_context('spawn').Lock()\n"
        "    os._exit(143)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", left], env=ENVIRONMENT, capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 143
    assert done.stderr == ""


def test_the_line_comes_before_what_may_take_long() -> None:
    """Where the main thread does not come back, nothing that is put in order then delays the line, or the end."""
    long = (
        "import hashlib, time; from runner.processes.interruption import going_on, interruptible\n"
        "with interruptible(), going_on('Go on with: it', lambda: time.sleep(60)):\n"
        "    print('at work', flush=True)\n"
        "    hashlib.pbkdf2_hmac('sha256', b'', b'', 10**9)\n"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", long], env=ENVIRONMENT, start_new_session=True, text=True, stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )  # fmt: skip
    assert process.stdout is not None
    assert process.stdout.readline() == "at work\n"
    wait_for_work(process, 0.2)  # then it is within the function
    assert stopped(process, signal.SIGTERM, all_of_them=False) == "Interrupted. Go on with: it"
