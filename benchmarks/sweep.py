"""What a sweep costs beyond its physics: CPU time against bare `mj_step` of the same steps, runs a minute, memory.

    python -m benchmarks.sweep [runs] [option=value ...]

The sweep is a process of its own (`runner -m`, one start mass for each run), start-up and all, and its workers count:
one for each core, by Hydra's joblib launcher unless another is named. The bare steps are `mujoco.rollout` of the same
scene under the same commands, in one call and one thread, on all cores at once as in the sweep, for some seconds before
and after it, as other work on the machine slows both. The peak memory is that of the largest process.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from benchmarks.core import EXPERIMENT, cpu_ms, replay

SEQUENCE = "forces.rest_s=1.45"  # as in `benchmarks.core`: ends after 20 s
KINDS = {
    "rows alone": ("log.rrd=off", "log.frames=off"),
    "frames, .rrd off": ("log.rrd=off",),
    "frames, .rrd full": ("log.rrd=full",),
}


def sweep(runs: int, options: tuple[str, ...], folder: Path) -> tuple[float, float, float]:
    """Return CPU s, wall s and peak memory in MB of a sweep."""
    masses = ",".join(f"{mass:.6g}" for mass in np.linspace(0.5, 6.0, runs))
    command = [sys.executable, "-m", "runner", "-m", f"start.mass_kg={masses}", SEQUENCE, f"out={folder}", *options]
    timed = [sys.executable, "-c", WATCH, *command]
    done = subprocess.run(timed, capture_output=True, text=True, check=True, env={**os.environ, "OMP_NUM_THREADS": "1"})
    cpu_s, wall_s, peak_mb = map(float, done.stdout.split()[-3:])
    return cpu_s, wall_s, peak_mb


WATCH = """
import resource, subprocess, sys, time
began = time.perf_counter()
subprocess.run(sys.argv[1:], check=True)
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(used.ru_utime + used.ru_stime, time.perf_counter() - began, used.ru_maxrss / 1024)
"""


def bare_ms() -> float:
    """Return the mean CPU time of the bare steps of one run, ms, with every core at it."""
    cores = len(os.sched_getaffinity(0))
    with ProcessPoolExecutor(cores, get_context("spawn")) as pool:
        return float(np.mean(list(pool.map(_bare_ms, range(cores)))))


def _bare_ms(_: int, rounds: int = 100) -> float:
    work = replay()
    work()
    return float(np.mean([cpu_ms(work) for _ in range(rounds)]))


def main(runs: int = 1000, extra: tuple[str, ...] = ()) -> None:
    """Print the table."""
    if not any(option.startswith("hydra/launcher=") for option in extra):
        extra = ("hydra/launcher=joblib", *extra)
    print(f"{runs} runs of {EXPERIMENT.steps} steps, two cubes, {' '.join(extra)}", flush=True)
    print(f"{'':22s}{'bare ms/run':>12s}{'CPU ms/run':>12s}{'ratio':>8s}{'runs/min':>10s}{'peak MB':>9s}", flush=True)
    for name, options in KINDS.items():
        with tempfile.TemporaryDirectory() as folder:
            before = bare_ms()
            cpu_s, wall_s, peak_mb = sweep(runs, (*options, *extra), Path(folder) / "sweep")
            bare = (before + bare_ms()) / 2
        each = 1e3 * cpu_s / runs
        print(
            f"{name:22s}{bare:12.1f}{each:12.1f}{each / bare:8.2f}{60 * runs / wall_s:10.0f}{peak_mb:9.0f}", flush=True
        )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 1000, tuple(sys.argv[2:]))
