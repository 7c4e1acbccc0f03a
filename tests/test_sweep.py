"""A sweep ends with the same table whatever does it: chunks, processes, Ray on two nodes, submitit, a kill between."""

from __future__ import annotations

import importlib.util
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pandas as pd
import pytest
import rerun as rr

from runner.__main__ import main
from runner.teleop import tables

ELSEWHERE = ["wall_s", "steps_per_s", "log_s", "host"]  # depend on the machine and its load
BRIEF = ("forces.pushes=2", "forces.rest_s=0.3", "log.rrd=off")
SETTINGS = ("start.mass_kg=0.5,1,2,-1,4", "link.rate_hz=60,30", *BRIEF)
ENVIRONMENT = {
    **os.environ,
    "OMP_NUM_THREADS": "1",
    "RAY_AUTH_MODE": "disabled",  # else Ray writes a key into the home folder
    "RAY_USAGE_STATS_ENABLED": "0",
    # a busy machine is no dead one
    "RAY_raylet_start_wait_time_s": "300",
    "RAY_health_check_timeout_ms": "120000",
    "RAY_health_check_failure_threshold": "20",
}


def needs(module: str) -> pytest.MarkDecorator:
    """Skip a test where the extra is not installed."""
    there = importlib.util.find_spec(module) is not None
    return pytest.mark.skipif(not there, reason=f"{module} is not installed: pip install 'runner[cluster]'")


def runner(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run the command line as a process of its own."""
    return subprocess.run(
        [sys.executable, "-m", "runner", *arguments], cwd=cwd, env=ENVIRONMENT, capture_output=True, text=True,
        timeout=600, check=False,
    )  # fmt: skip


def table(folder: Path) -> pd.DataFrame:
    """Return what must be the same of a sweep; the rows carry a fingerprint of each run's every update."""
    rows = tables.collect([folder]).drop(columns=ELSEWHERE)
    rows["run"] = [Path(run).name for run in rows["run"]]
    return rows


def assert_same(one: Path, other: Path) -> None:
    """Two sweeps have the same table, bit for bit, and each run the same frames."""
    pd.testing.assert_frame_equal(table(one), table(other), check_exact=True)
    for frames in sorted(one.glob("*/frames.parquet")):
        assert frames.read_bytes() == (other / frames.relative_to(one)).read_bytes()


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Do the sweep in this process, all runs together."""
    folder = tmp_path_factory.mktemp("sweeps") / "whole"
    assert main(["-m", *SETTINGS, f"out={folder}"]) == 1  # two of the runs fail
    return folder


def test_rows_are_in_run_order_and_typed(whole: Path) -> None:
    """One row per run with the swept keys as numbers; failed runs are rows with a reason and do not stop the rest."""
    rows = table(whole)
    assert rows["job"].tolist() == list(range(10))
    assert rows["start.mass_kg"].tolist() == [0.5, 0.5, 1, 1, 2, 2, -1, -1, 4, 4]
    assert rows["link.rate_hz"].tolist() == [60, 30] * 5
    assert rows["status"].tolist() == ["done"] * 6 + ["failed"] * 2 + ["done"] * 2
    assert set(rows["reason"].iloc[6:8]) == {"start.mass_kg: must be a finite number in ]0, 1e+06] kg, got -1.0."}
    assert str(rows["steps"].dtype) == "Int64"  # though failed runs have none
    assert rows["steps"].isna().tolist() == [False] * 6 + [True] * 2 + [False] * 2
    assert len(set(rows["motion"].dropna())) == 8
    assert not (whole / tables.ROWS).exists()


def test_chunks_of_one_give_the_same(whole: Path, tmp_path: Path) -> None:
    """A run is the same alone and together with others."""
    assert main(["-m", *SETTINGS, "chunk=1", f"out={tmp_path}/s"]) == 1
    assert_same(tmp_path / "s", whole)


@pytest.mark.slow
def test_two_processes_give_the_same(whole: Path, tmp_path: Path) -> None:
    """The joblib launcher, two processes, five tasks."""
    done = runner("-m", *SETTINGS, "out=s", "chunk=2", "hydra/launcher=joblib", "hydra.launcher.n_jobs=2", cwd=tmp_path)
    assert done.stdout == "10 runs in s, 2 of them failed\n", done.stderr
    assert_same(tmp_path / "s", whole)


@needs("submitit")
@pytest.mark.slow
def test_submitit_gives_the_same(whole: Path, tmp_path: Path) -> None:
    """The launcher for Slurm, with its executor for this machine."""
    done = runner("-m", *SETTINGS, "out=s", "chunk=5", "hydra/launcher=submitit_local", cwd=tmp_path)
    assert done.stdout == "10 runs in s, 2 of them failed\n", done.stderr
    assert_same(tmp_path / "s", whole)


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[str]:
    """Start a Ray cluster of two nodes on this machine, one core each, and return its address."""
    ray = [str(Path(sys.executable).with_name("ray")), "start", "--block", "--num-cpus=1", "--disable-usage-stats"]
    ray += ["--object-store-memory=80000000"]
    port = 20_000 + os.getpid() % 10_000
    head = ["--head", "--node-ip-address=127.0.0.1", f"--port={port}", "--include-dashboard=false"]
    nodes = []
    # Ray's folder must have a short name, as it holds sockets
    temporary = Path(f"/tmp/ray_{os.getpid()}")
    try:
        for options in ([*head, f"--temp-dir={temporary}"], [f"--address=127.0.0.1:{port}"]):
            log = tmp_path / f"node{len(nodes)}.log"
            with log.open("w") as out:
                node = subprocess.Popen(
                    [*ray, *options], env=ENVIRONMENT, stdout=out, stderr=out, start_new_session=True
                )
            nodes.append(node)
            _wait_for(log, "Ray runtime started", node)
        yield f"127.0.0.1:{port}"
    finally:
        for node in reversed(nodes):
            node.send_signal(signal.SIGTERM)
        for node in reversed(nodes):
            try:
                node.wait(30)
            except subprocess.TimeoutExpired:
                os.killpg(node.pid, signal.SIGKILL)
                node.wait()
        shutil.rmtree(temporary, ignore_errors=True)


def _wait_for(log: Path, text: str, process: subprocess.Popen[bytes], patience_s: float = 300) -> None:
    end = time.monotonic() + patience_s
    while text not in log.read_text():
        assert process.poll() is None, log.read_text()
        assert time.monotonic() < end, log.read_text()
        time.sleep(0.2)


@needs("ray")
@pytest.mark.slow
def test_ray_on_two_nodes_gives_the_same(whole: Path, tmp_path: Path, cluster: str) -> None:
    """A head and a worker, each with one core; tasks go to both."""
    seen = subprocess.run(
        [sys.executable, "-c", TWO_NODES, cluster],
        env=ENVIRONMENT,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert seen.stdout.split() == ["2"], seen.stderr
    launcher = ("hydra/launcher=ray", f"hydra.launcher.address='{cluster}'")
    done = runner("-m", *SETTINGS, "out=s", "chunk=2", *launcher, cwd=tmp_path)
    assert done.stdout == "10 runs in s, 2 of them failed\n", done.stderr
    assert_same(tmp_path / "s", whole)


TWO_NODES = """
import sys, time, ray
ray.init(address=sys.argv[1], log_to_driver=False, logging_level="error")
@ray.remote(num_cpus=1)
def where():
    time.sleep(2)  # so that one node can't do both
    return ray.get_runtime_context().get_node_id()
print(len(set(ray.get([where.remote(), where.remote()]))))
"""


def test_killed_in_the_middle_it_resumes_to_the_same_table(tmp_path: Path) -> None:
    """50 runs, kill -9 when some have ended: `resume=` runs what is missing, and only that."""
    settings = ["-m", "seed=range(0,50)", "start.mass_kg=1.5", "link=poor", "follow=unaware", *BRIEF]
    command = [sys.executable, "-m", "runner", *settings, "out=killed"]
    process = subprocess.Popen(command, cwd=tmp_path, env=ENVIRONMENT, stdout=subprocess.DEVNULL)
    while tables.count_rows(tmp_path / "killed") < 20:
        assert process.poll() is None, "ended before it was killed"
        time.sleep(0.01)
    process.kill()
    assert process.wait() == -signal.SIGKILL
    ended = [row["job"] for row in tables.sweep_rows(tmp_path / "killed")]
    assert 20 <= len(ended) < 50
    # the table of a sweep that was stopped has the rows that there are
    assert table(tmp_path / "killed")["job"].tolist() == ended
    before = {job: (tmp_path / f"killed/{job}/frames.parquet").stat().st_mtime_ns for job in ended}
    assert main([f"resume={tmp_path}/killed"]) == 0
    assert {job: (tmp_path / f"killed/{job}/frames.parquet").stat().st_mtime_ns for job in ended} == before
    assert main([*settings, f"out={tmp_path}/whole"]) == 0
    assert_same(tmp_path / "killed", tmp_path / "whole")
    assert len(set(table(tmp_path / "whole")["motion"])) == 50


def test_a_sweep_whose_workers_live_on_is_not_resumed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A worker may outlive the process that was killed, on another machine even: two would write to one folder."""
    (tmp_path / tables.SWEEP).write_text("run start.mass_kg=1,2\n")
    with tables.Ledger(tmp_path, 0).held():
        assert main([f"resume={tmp_path}"]) == 2
    assert capsys.readouterr().err == (
        f"resume: a process of the sweep in '{tmp_path}' is still doing runs; end it, or wait.\n"
    )
    assert not tables.still_held(tmp_path)


def test_one_rrd_for_a_sweep(tmp_path: Path) -> None:
    """`log.rrd_files=one` leaves one file with a recording for each run, which Rerun finds sound."""
    settings = ("start.mass_kg=0.5,2", "remote.friction=0.2,0.4", *BRIEF[:2], "log.rrd_files=one")
    assert main(["-m", *settings, f"out={tmp_path}/s"]) == 0
    assert not list((tmp_path / "s").glob("*/*.rrd"))
    file = tmp_path / "s" / "sweep.rrd"
    found = rr.chunk.RrdReader(file)
    assert len(found.recordings()) == 4
    told = set()
    for recording in found.recordings():
        (chunk,) = (c for c in found.stream(store=recording) if c.entity_path == "/__properties/overrides")
        row = chunk.to_record_batch().to_pandas().iloc[0]
        told.add((float(row["start.mass_kg"][0]), float(row["remote.friction"][0])))
    assert told == {(0.5, 0.2), (0.5, 0.4), (2.0, 0.2), (2.0, 0.4)}
    checked = subprocess.run(
        [sys.executable, "-m", "rerun", "rrd", "verify", str(file)], capture_output=True, check=False
    )
    assert checked.returncode == 0
