"""What stays behind: memory and handles over many runs in one process, and over an hour at 240 Hz that is diagnosed.

    python -m benchmarks.soak [runs=10000] [minutes=60] [every=500]

The runs are those of `runner run`, each with frames, `.rrd` and summary, into folders that are taken away again, one
after another in this process; some are in turn noisy, late, with another estimator, or refused. The recording is
a box that is pushed about for so many minutes in episodes of half a minute, sampled 240 times a second. Memory is the
resident set of this process after a collection of garbage; handles are open files, and threads.
"""

from __future__ import annotations

import contextlib
import gc
import io
import json
import os
import shutil
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from runner.__main__ import main as runner
from runner.recording import write_case
from tests import cases

BRIEF = ("forces.pushes=1", "forces.push_s=0.2", "forces.rest_s=0.2", "forces.lead_s=0.1")
TURNS = (
    ("run",),
    ("run", "link=noisy", "log.frames=steps"),
    ("run", "link=bad", "estimator=both"),
    ("run", "effect=[wind,stiction]", "start.mass_kg=2"),
    ("run", "start.mass_kg=-1"),  # refused
)
EPISODE_S, RATE_HZ = 30.0, 240.0


def state() -> dict[str, float]:
    """Return memory in MB, open files and threads of this process."""
    gc.collect()
    status = dict(line.split(":", 1) for line in Path("/proc/self/status").read_text().splitlines())
    return {
        "mb": round(int(status["VmRSS"].split()[0]) / 1024, 1),
        "handles": len(list(Path("/proc/self/fd").iterdir())),
        "threads": int(status["Threads"]),
    }


def quietly(arguments: list[str]) -> int:
    """Run a command without what it says."""
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        return runner(arguments)


def soak(runs: int, every: int, folder: Path) -> list[dict[str, float]]:
    """Do the runs, and return the state after every so many."""
    out, begin = [], time.monotonic()
    for k in range(runs):
        words = TURNS[k % len(TURNS)]
        code = quietly([*words, *BRIEF, f"seed={k}", f"out={folder / 'r'}"])
        assert code == (2 if "start.mass_kg=-1" in words else 0), (words, code)
        shutil.rmtree(folder / "r", ignore_errors=True)
        if k + 1 == every // 5 or (k + 1) % every == 0:  # the first when everything has been loaded
            out.append({"runs": k + 1, "s": round(time.monotonic() - begin), **state()})
            print(json.dumps(out[-1]), flush=True)
    return out


def hour(minutes: float, folder: Path) -> dict[str, object]:
    """Make the recording, diagnose it, and return what came of it."""
    episodes = max(3, round(minutes * 60 / EPISODE_S))
    nominal = replace(cases.NOMINAL, rate_hz=RATE_HZ)
    # at the rate of the tests' recordings, then between the samples: what is soaked is the size
    recording, _ = cases.made(episodes=episodes, seconds=EPISODE_S)
    t = np.arange(round(EPISODE_S * RATE_HZ) + 1) / RATE_HZ
    rng, longer = np.random.default_rng(0), []
    for episode in recording.episodes:
        at = np.minimum(np.searchsorted(episode.t_s, t + 1e-9, side="right") - 1, len(episode.t_s) - 1)
        pose = np.column_stack([np.interp(t, episode.t_s, c) for c in episode.pose.T])
        twist = np.column_stack([np.interp(t, episode.t_s, c) for c in episode.twist.T])
        pose, twist = pose + rng.normal(size=pose.shape) * 1e-3, twist + rng.normal(size=twist.shape) * 1e-2
        longer.append(
            replace(episode, t_s=t, pose=pose, twist=twist, force_n=episode.force_n[at], point_m=episode.point_m[at])
        )
    write_case(replace(recording, nominal=nominal, episodes=tuple(longer)), folder / "case")
    before, begin = state(), time.monotonic()
    code = quietly(["diagnose", str(folder / "case"), f"out={folder / 'd'}"])
    verdict = json.loads((folder / "d" / "verdict.json").read_text())
    sizes = {f.name: round(f.stat().st_size / 1e6, 1) for f in (folder / "d").iterdir() if f.stat().st_size > 1e6}
    return {
        "minutes": minutes,
        "rows": episodes * len(t),
        "code": code,
        "s": round(time.monotonic() - begin),
        "sentence": verdict["sentence"],
        "before": before,
        "after": state(),
        "peak_mb": _peak_mb(),
        "files_mb": sizes,
    }


def _peak_mb() -> float:
    status = dict(line.split(":", 1) for line in Path("/proc/self/status").read_text().splitlines())
    return round(int(status["VmHWM"].split()[0]) / 1024, 1)


def main(arguments: list[str]) -> int:
    """Soak, and say how much grew from the first tenth to the end; 1 where that is more than a leak-free process."""
    given = {"runs": "10000", "minutes": "60", "every": "500"}
    given |= dict(argument.split("=", 1) for argument in arguments)
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    with tempfile.TemporaryDirectory(prefix="runner-soak-") as name:
        grown = False
        if int(given["runs"]):
            states = soak(int(given["runs"]), int(given["every"]), Path(name))
            first, last = states[len(states) // 10], states[-1]
            grown = last["handles"] > first["handles"] or last["threads"] > first["threads"]
            print(f"{last['runs']} runs: {first} at first, {last} at the end")
        if float(given["minutes"]):
            print(json.dumps(hour(float(given["minutes"]), Path(name))), flush=True)
    return 1 if grown else 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
