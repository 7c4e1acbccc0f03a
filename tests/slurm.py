"""Slurm on one machine: `sbatch`, `srun`, `sacct`, `scancel` and `squeue`, as far as submitit asks for them.

Jobs are run by this machine, so many at a time as `SLURM_STANDIN_NODES` says, in the order in which they were sent. A
job whose process ends with something else than 0, or is killed, has failed. The state is kept in the folder
`SLURM_STANDIN`: a folder for each task, with `state`, and `pid` while it runs.

    python slurm.py install FOLDER    puts the commands into a folder, for PATH
"""

from __future__ import annotations

import os
import re
import shlex
import signal
import subprocess
import sys
import time
from contextlib import suppress
from itertools import pairwise
from pathlib import Path

COMMANDS = ("sbatch", "srun", "sacct", "scancel", "squeue")
STATE = Path(os.environ.get("SLURM_STANDIN", "/nonexistent"))
NODES = int(os.environ.get("SLURM_STANDIN_NODES", "2"))


def install(folder: Path) -> None:
    """Put the commands into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in COMMANDS:
        command = folder / name
        command.write_text(f'#!/bin/sh\nexec {shlex.quote(sys.executable)} {shlex.quote(__file__)} {name} "$@"\n')
        command.chmod(0o755)


def tasks() -> dict[str, Path]:
    """Return the folder of each task by its name, `7` or `7_3`, in the order in which they were sent."""
    there = (f for f in STATE.iterdir() if re.fullmatch(r"\d+(_\d+)?", f.name)) if STATE.is_dir() else ()
    return {f.name: f for f in sorted(there, key=lambda f: [int(n) for n in f.name.split("_")])}


def say(task: Path, state: str) -> None:
    """Note a state; what was cancelled stays so."""
    part = task / f"state.{os.getpid()}"
    part.write_text(state)
    if state == "CANCELLED" or not (task / "state").exists() or (task / "state").read_text() != "CANCELLED":
        part.rename(task / "state")
    else:
        part.unlink()


def sbatch(arguments: list[str]) -> int:
    """Take a job; a process of its own, which stands for the nodes, does it."""
    script = Path(arguments[-1]).read_text()
    given = dict(re.findall(r"^#SBATCH --([a-z-]+)=(.*)$", script, re.M))
    STATE.mkdir(parents=True, exist_ok=True)
    number = 1 + max((int(name.partition("_")[0]) for name in tasks()), default=0)
    last = re.fullmatch(r"0-(\d+)(%\d+)?", shlex.split(given["array"])[0]) if "array" in given else None
    names = [f"{number}_{i}" for i in range(int(last[1]) + 1)] if last else [str(number)]
    for name in names:
        (STATE / name).mkdir()
        (STATE / name / "script.sh").write_text(script)
        say(STATE / name, "PENDING")
    subprocess.Popen(
        [sys.executable, __file__, "nodes", *names], start_new_session=True,
        stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    print(f"Submitted batch job {number}")
    return 0


def nodes(names: list[str]) -> int:
    """Do tasks, so many at a time as there are nodes."""
    waiting, running = list(names), dict[str, subprocess.Popen[bytes]]()
    while waiting or running:
        while waiting and len(running) < NODES:
            name = waiting.pop(0)
            task = STATE / name
            if (task / "state").read_text() == "CANCELLED":
                continue
            number, _, index = name.partition("_")
            own = {"SLURM_JOB_ID": number, "SLURM_JOB_NODELIST": "here", "SLURM_NTASKS": "1", "SLURM_PROCID": "0"}
            own |= {"SLURM_ARRAY_JOB_ID": number, "SLURM_ARRAY_TASK_ID": index} if index else {}
            running[name] = subprocess.Popen(
                ["/bin/bash", str(task / "script.sh")], env={**os.environ, **own}, start_new_session=True
            )
            (task / "pid").write_text(str(running[name].pid))
            say(task, "RUNNING")
        for name, process in list(running.items()):
            if process.poll() is not None:
                say(STATE / name, "COMPLETED" if process.returncode == 0 else "FAILED")
                del running[name]
        time.sleep(0.05)
    return 0


def srun(arguments: list[str]) -> int:
    """Become the program of a task, with its output where it was asked for."""
    number, index = os.environ["SLURM_JOB_ID"], os.environ.get("SLURM_ARRAY_TASK_ID", "")
    named = {"%j": number, "%A": number, "%a": index, "%t": "0"}
    while arguments[0].startswith("-"):
        option = arguments.pop(0)
        if option in ("--output", "--error"):
            file = re.sub("%[jAat]", lambda m: named[m[0]], arguments.pop(0))
            handle = os.open(file, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
            os.dup2(handle, 1 if option == "--output" else 2)
    os.execvp(arguments[0], arguments)


def sacct(arguments: list[str]) -> int:
    """Say what has become of jobs."""
    asked = [b for a, b in pairwise(arguments) if a == "-j"]
    print("JobID|State|NodeList")
    for name, task in tasks().items():
        if name.partition("_")[0] in asked:
            print(f"{name}|{(task / 'state').read_text()}|here")
    return 0


def scancel(arguments: list[str]) -> int:
    """End jobs, and take them from the queue."""
    for name, task in tasks().items():
        state = (task / "state").read_text()
        if {name, name.partition("_")[0]} & set(arguments) and state in ("PENDING", "RUNNING"):
            say(task, "CANCELLED")
            if (task / "pid").exists():
                with suppress(ProcessLookupError):
                    os.killpg(int((task / "pid").read_text()), signal.SIGKILL)
    return 0


def squeue(arguments: list[str]) -> int:
    """Say which jobs have not ended."""
    print("JOBID ST")
    for name, task in tasks().items():
        if (state := (task / "state").read_text()) in ("PENDING", "RUNNING"):
            print(name, state)
    return 0


if __name__ == "__main__":
    if sys.argv[1] == "install":
        install(Path(sys.argv[2]))
    else:
        raise SystemExit(globals()[sys.argv[1]](sys.argv[2:]))
