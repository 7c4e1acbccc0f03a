"""Say whether all is well here: versions, cores, graphics, disk, and a self-test against closed forms.

The self-test lets a box slide to rest and a pendulum swing, and holds distance and period against what they are in
closed form; it takes a few seconds, and a minute more where the friction law has to be compiled first.
Exit code 1: it failed.
"""

from __future__ import annotations

import os
import shutil
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from runner.commands import Command, Job
from runner.commands._print import print_table
from runner.commands._results import RESULTS
from runner.commands._self_test import ALLOWED, sliding, swinging
from runner.commands.view import has_display, viewer
from runner.progress import progress
from runner.storage.provenance import commit, versions

GIB = 2**30
LITTLE_GIB = 1.0  # a sweep with full logs takes that much
TESTING = "Testing"


@dataclass(frozen=True)
class DoctorConfig:
    """Nothing to set."""


def main(config: DoctorConfig, job: Job) -> int:
    """Look, test, and print what was found."""
    console = Console()
    print_table(console, "Versions", (("what", "version"), [*versions().items(), *_commit()]))
    print_table(console, "Machine", (("what", "found"), list(_machine())))
    began = time.perf_counter()
    outcomes, motions = [], (sliding, swinging)
    with progress(TESTING, total=len(motions), unit="motions", minutes=True) as advance:
        for motion in motions:
            outcomes.append(motion())
            advance()
    seconds = time.perf_counter() - began
    rows = [
        (o.what, f"{o.simulated:.6f} {o.unit}", f"{o.exact:.6f} {o.unit}", f"{o.off:.1e}", "ok" if o.passed else "OFF")
        for o in outcomes
    ]
    print_table(console, "Self-test", (("motion", "simulated", "exact", "off", ""), rows), right=(1, 2, 3))
    passed = all(o.passed for o in outcomes)
    said = "All is well" if passed else f"Something is wrong: more than {ALLOWED:g} off"
    console.print(f"{said} ({seconds:.1f} s).", highlight=False)
    return 0 if passed else 1


def _commit() -> list[tuple[str, str]]:
    sha, changed = commit()
    return [] if sha is None else [("commit", f"{sha[:12]}{', with changes' if changed else ''}")]


def _machine() -> Iterator[tuple[str, str]]:
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    busy = f", load {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else ""
    yield "cores", f"{cores} to use of {os.cpu_count()}{busy}"
    if sys.platform == "linux":
        pages, size = os.sysconf("SC_PHYS_PAGES"), os.sysconf("SC_PAGE_SIZE")
        yield "memory", f"{pages * size / GIB:.1f} GiB"
    yield "graphics", "none needed: reports and logs are drawn without, MUJOCO_GL has no say"
    yield "display", "there is one" if has_display() else "none: `runner view PATH --web` serves the viewer"
    yield "Rerun viewer", viewer() or "not found: install rerun-sdk"
    yield "results", _disk(RESULTS)
    yield "Python", sys.executable


def _disk(folder: Path) -> str:
    """Return how much room there is where results go, and whether they can be written."""
    there = next(p for p in (folder.absolute(), *folder.absolute().parents) if p.exists())
    free = shutil.disk_usage(there).free / GIB
    little = ", which is little" if free < LITTLE_GIB else ""
    writable = "" if os.access(there, os.W_OK) else "; NOT WRITABLE, name another place with out=PATH"
    return f"{there}: {free:.1f} GiB free{little}{writable}"


COMMAND = Command(config=DoctorConfig, main=main)
