"""Slurm, by commands that stand in for it: what submitit sends is done, what is lost costs itself, nothing stays."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest

from runner.diagnosis.verdict import ALL
from runner.outputs.elsewhere import NOTE
from runner.recording import write_case
from runner.teleop import tables
from tests import slurm
from tests.cases import made
from tests.test_sweep import ENVIRONMENT, needs

SWEEP = ("-m", "seed=range(0,6)", "forces.pushes=20", "forces.rest_s=0.3", "log.rrd=off", "chunk=2", "out=s")
LAUNCHER = "hydra/launcher=submitit_slurm"
LONG = "forces.pushes=3000"  # takes minutes
pytestmark = [needs("submitit"), pytest.mark.slow]


class Cluster:
    """Commands of Slurm's in a folder, for programs that are started here."""

    def __init__(self, place: Path, nodes: int) -> None:
        self.place, self.state = place, place / "slurm"
        slurm.install(place / "bin")
        self.environment: Mapping[str, str] = {
            **ENVIRONMENT,
            "PATH": f"{place / 'bin'}{os.pathsep}{os.environ['PATH']}",
            "SLURM_STANDIN": str(self.state),
            "SLURM_STANDIN_NODES": str(nodes),
        }

    def begin(self, *arguments: str) -> subprocess.Popen[str]:
        """Start the command line."""
        return subprocess.Popen(
            [sys.executable, "-m", "runner", *arguments], cwd=self.place, env=self.environment,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip

    def states(self) -> list[str]:
        """Return what has become of the tasks, in the order in which they were sent."""
        asked = subprocess.run(
            [self.place / "bin" / "sacct", *(x for n in range(1, 9) for x in ("-j", str(n)))],
            env=self.environment, capture_output=True, text=True, check=True,
        )  # fmt: skip
        return [line.split("|")[1] for line in asked.stdout.splitlines()[1:]]

    def kill(self, task: str) -> None:
        """Kill a task's processes, as for want of memory."""
        os.killpg(int((self.state / task / "pid").read_text()), signal.SIGKILL)


def waited(until: Callable[[], bool], process: subprocess.Popen[str], patience_s: float = 900.0) -> None:
    """Wait while a process runs."""
    end = time.monotonic() + patience_s
    while not until():
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < end
        time.sleep(0.05)


def test_a_sweep_loses_a_task_and_goes_on(tmp_path: Path) -> None:
    """The tasks beside and behind the lost one are done, a line says how to go on, and then the table is whole."""
    cluster = Cluster(tmp_path, nodes=1)
    process = cluster.begin(*SWEEP, LAUNCHER)
    waited(lambda: bool(list((tmp_path / "s" / tables.ROWS).glob("*.jsonl"))), process)
    cluster.kill("1_0")
    out, err = process.communicate(timeout=900)
    assert (process.returncode, out) == (2, "")
    assert err.startswith("hydra/launcher: UncompletedJobError: Job 1_0 ")
    assert err.endswith("Go on with: runner run resume=s\n")
    assert err.count("\n") == 1
    assert cluster.states() == ["FAILED", "COMPLETED", "COMPLETED"]
    assert {2, 3, 4, 5} <= {row["job"] for row in tables.sweep_rows(tmp_path / "s")}
    process = cluster.begin("run", "resume=s")
    assert process.communicate(timeout=900) == ("6 runs in s\n", "")
    assert tables.collect([tmp_path / "s"])["status"].tolist() == ["done"] * 6


def test_an_interruption_takes_the_tasks_from_the_cluster(tmp_path: Path) -> None:
    """Those at work and those in the queue."""
    cluster = Cluster(tmp_path, nodes=1)
    process = cluster.begin(*SWEEP, LONG, LAUNCHER)
    waited(lambda: bool(list((tmp_path / "s" / tables.ROWS).glob("*.jsonl"))), process)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert (process.returncode, err) == (130, "Interrupted. Go on with: runner run resume=s\n")
    assert cluster.states() == ["CANCELLED"] * 3
    end = time.monotonic() + 60
    while tables.still_held(tmp_path / "s"):
        assert time.monotonic() < end
        time.sleep(0.05)


def test_of_a_folder_of_cases_a_lost_one_costs_itself(tmp_path: Path) -> None:
    """It is tried once more, alone; the others have their verdicts, and the same command does what is missing."""
    for name in ("a", "heavy", "z"):
        write_case(made(episodes=2, seconds=1.0)[0], tmp_path / "cases" / name)
    cluster = Cluster(tmp_path, nodes=1)
    command = ("diagnose", "cases", "report=false", "out=R", LAUNCHER)
    process = cluster.begin(*command)
    note = tmp_path / "R" / "heavy" / NOTE
    for task in ("1_1", "2"):  # of all three, and then by itself
        waited(lambda task=task: note.is_file() and (cluster.state / task / "pid").is_file(), process)
        cluster.kill(task)
        waited(lambda task=task: (cluster.state / task / "state").read_text() == "FAILED", process)
    out, _ = process.communicate(timeout=900)
    assert process.returncode == 2
    assert "heavy: its process was killed (the memory may not suffice): hydra/launcher: UncompletedJobError" in out
    assert set(json.loads((tmp_path / "R" / ALL).read_text())) == {"a", "z"}
    assert cluster.states() == ["COMPLETED", "FAILED", "COMPLETED", "FAILED"]
    process = cluster.begin(*command)
    out, _ = process.communicate(timeout=900)
    assert process.returncode == 0, out
    assert "3 of 3 cases" in out
    assert len(cluster.states()) == 5
