"""Diagnose cases where the answers can't be seen: copies under new names, workers behind a fence.

The path of the answers is given to nobody here. A worker sees a copy of each case that holds the recording and what
its owner believes, named after its own content; it may open no file outside its temporary folder, Python and the
package, and start no program: the kernel sees to that (`runner.blind.kernel_fence`), and the interpreter, which says so
in words (`runner.blind.fence`). Each verdict says in its provenance what was in force.
"""

from __future__ import annotations

import hashlib
import shutil
import tempfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import matplotlib
import numba
from numba.misc.appdirs import AppDirs

from runner.blind import kernel_fence
from runner.blind.fence import enter_fence, fence_of_kernel
from runner.blind.kernel_fence import Kept
from runner.blind.make import HASH_FILE
from runner.errors import ResultError
from runner.outputs.many import Seclusion, diagnose_many
from runner.recording import find_cases
from runner.storage.provenance import commit
from runner.storage.reading import read_json
from runner.storage.writing import write_json, write_text

PROVENANCE = "diagnosed_by.json"
COPIED = ("nominal.yaml", "model.xml", "recording.parquet", "recording.csv")


@dataclass(frozen=True)
class Provenance:
    """Which program diagnosed: version, commit (None: not under git), whether files differed from it, since when."""

    runner: str
    commit: str | None
    changed: bool | None
    begun: str


def blind_run(
    folder: Path, results: Path, *, workers: int | None = None, config_hash: str | None = None
) -> tuple[int, dict[str, str]]:
    """Diagnose the cases of a folder behind the fence; those that have a verdict in the results are kept.

    Args:
        folder: Made by `make_cases`: the cases, and the hash of their answers.
        results: Where the hash, the program's version and the verdicts go, in this order.
        workers: So many at a time; None: one per core.
        config_hash: Of the settings, for the verdicts.

    Returns:
        The number of cases, and what was wrong with those that could not be diagnosed, by name.

    Raises:
        ResultError: If the hash is missing, or the results are of other answers, or hold verdicts of another kind.
    """
    if not folder.is_dir():
        raise ResultError(f"cases: '{folder}' is no folder; name the one that `runner blind make` made.")
    cases = {case.relative_to(folder).as_posix(): case for case in find_cases(folder)}
    _remember(read_hash(folder), results)
    with tempfile.TemporaryDirectory(prefix="runner-blind-") as name:
        place = Path(name).resolve()
        hidden = copy_cases(cases, place / "cases")
        own = [place, *caches()]
        fence = Seclusion(place / "verdicts", (fence_of_kernel, (own,)), (begin_worker, (own,)))
        failed = diagnose_many(hidden, results, workers=workers, report=False, secluded=fence, config_hash=config_hash)
    return len(cases), failed


def read_hash(folder: Path) -> str:
    """Return the SHA-256 of the answers that stands in a folder.

    Raises:
        ResultError: If there is none.
    """
    try:
        words = (folder / HASH_FILE).read_text(encoding="utf-8", errors="replace").split()
    except OSError:
        raise ResultError(f"{folder / HASH_FILE}: no such file; it holds the SHA-256 of the answers.") from None
    if not words or len(words[0]) != 64 or set(words[0]) - set("0123456789abcdef"):
        raise ResultError(f"{folder / HASH_FILE}: holds no SHA-256.")
    return words[0]


def _remember(digest: str, results: Path) -> None:
    """Write down, before the first diagnosis, of which answers the verdicts will be and what makes them."""
    if (results / HASH_FILE).exists():
        if read_hash(results) != digest:
            raise ResultError(f"out: '{results}' holds verdicts for other answers; name a new folder.")
    else:
        # verdicts from before the hash was set down may have been made in sight of the answers
        if there := next(results.rglob("verdict*.json"), None):
            raise ResultError(f"out: '{there}' is of a diagnosis that was not blind; name a new folder.")
        write_text(results / HASH_FILE, f"{digest}\n")
    write_json(results / PROVENANCE, [*provenance(results), asdict(own_provenance())])


def provenance(results: Path) -> list[dict[str, Any]]:
    """Return what diagnosed, one entry for each time that the run was begun or taken up again.

    Raises:
        ResultError: If the file is spoilt.
    """
    file = results / PROVENANCE
    return read_json(file) if file.exists() else []


def own_provenance() -> Provenance:
    """Return what this program is."""
    sha, changed = commit()
    return Provenance(version("runner"), sha, changed, datetime.now(UTC).isoformat(timespec="seconds"))


def caches() -> list[Path]:
    """Return where libraries keep what takes them long to make: compiled functions, the list of fonts."""
    named = (numba.config.CACHE_DIR, AppDirs("numba", appauthor=False).user_cache_dir, matplotlib.get_cachedir())
    return [Path(name) for name in named if name and Path(name).is_dir()]


def begin_worker(folders: Sequence[Path]) -> dict[str, str]:
    """Shut a worker in; what a diagnosis is made of is loaded by then.

    Returns:
        What verdicts say of it.
    """
    import runner.diagnosis.pipeline
    import runner.outputs.one
    import runner.systems.case  # noqa: F401

    enter_fence(folders)
    return {"fence": " and ".join(filter(None, (kernel_fence.in_force(), Kept.hook)))}


def copy_cases(cases: dict[str, Path], place: Path) -> dict[str, Path]:
    """Copy what belongs to each case to folders named after their content, in the order of those names."""
    named: dict[str, list[str]] = {}
    for name, case in cases.items():
        digest = hashlib.sha256()
        for file in COPIED:
            if (case / file).is_file():
                digest.update(file.encode() + (case / file).read_bytes())
        named.setdefault(digest.hexdigest()[:16], []).append(name)
    hidden = {}
    for content, names in sorted(named.items()):
        for number, name in enumerate(names):
            hidden[name] = place / (f"{content}-{number}" if number else content)
            hidden[name].mkdir(parents=True)
            for file in COPIED:
                if (cases[name] / file).is_file():
                    shutil.copyfile(cases[name] / file, hidden[name] / file)
    return hidden
