"""A set of cases, made on all cores, and their answers; an interrupted one is taken up again."""

from __future__ import annotations

import hashlib
import json
import os
import time
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, cast

from joblib import Parallel, delayed

from runner.blind.checkpoint import Checkpoint
from runner.blind.make.maker import AbstractMaker, CasePlan, Purpose
from runner.blind.make.plan import Mix, case_names, plan_cases
from runner.errors import ConfigError, check_range
from runner.processes.workers import joblib_workers
from runner.progress import track
from runner.storage.writing import write_text

HASH_FILE = "answers.sha256"


@dataclass(frozen=True)
class MadeCases:
    """What `make_cases` made.

    Args:
        folder: One folder for each case, and the hash of the answers.
        answers: File of the answers.
        sha256: Of that file.
        cases: Names of the cases.
        seconds: Wall time.
    """

    folder: Path
    answers: Path
    sha256: str
    cases: tuple[str, ...] = field(repr=False)
    seconds: float


def make_cases(
    n: int,
    seed: int,
    out_dir: Path | str,
    answers_path: Path | str,
    maker: AbstractMaker,
    *,
    mix: Mix | None = None,
    purpose: Purpose = Purpose.SEALED,
    workers: int | None = None,
) -> MadeCases:
    """Make n cases; the same seed makes the same cases, whatever the number of workers.

    What was made before an interruption is kept, and its answers in a file beside the one for all of them: called
    again with the same arguments, this goes on from there.

    Args:
        n: Number of cases.
        seed: Of everything that is drawn.
        out_dir: Folder for the cases: must not exist, be empty, or be that of an interrupted call.
        answers_path: File for the answers, outside `out_dir`.
        maker: Of the kind of system that the cases are of.
        mix: Shares of singles, pairs, nulls and unknowns.
        purpose: Whether half of the kinds of effects that have no word are left out.
        workers: Processes; none: one for each core.

    Raises:
        ConfigError: If the folder is in use or can't be made, or the answers would lie inside it.
        ResultError: If an interrupted call was for other cases, or the answers can't be written.
    """
    check_range("blind.n", n, 1, 100000)
    folder, answers = Path(out_dir), Path(answers_path)
    if folder.resolve() == answers.resolve().parent or folder.resolve() in answers.resolve().parents:
        raise ConfigError(f"blind.answers: must lie outside the folder of the cases '{folder}', got '{answers}'.")
    kept = part_of(answers)
    if folder.exists() and not folder.is_dir():
        raise ConfigError(f"blind.out: '{folder}' is a file; give a folder.")
    if folder.exists() and any(folder.iterdir()) and not kept.exists():
        raise ConfigError(f"blind.out: the folder '{folder}' is not empty; give one that is new.")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        answers.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"blind.out: '{error.filename}' can't be made: {error.strerror}.") from None
    begun = time.perf_counter()
    mix = mix or Mix()
    belongs = {"n": n, "seed": seed, "out": str(folder.resolve()), "mix": asdict(mix), "system": maker.system}
    belongs |= {"purpose": purpose.value, **maker.settings()}
    checkpoint = Checkpoint(kept, belongs)
    names = case_names(n, seed)
    plans = zip(plan_cases(n, seed, mix, maker, purpose), names, strict=True)
    todo = [(plan, name) for plan, name in plans if name not in checkpoint.done]
    calls = (delayed(_made)(maker, plan, folder / name) for plan, name in todo)
    jobs = workers or os.cpu_count() or 1
    results = Parallel(n_jobs=jobs, **joblib_workers(), return_as="generator_unordered")(calls)
    results = cast("Iterable[tuple[str, dict]]", results)
    for name, answer in track(results, "Making cases", total=len(todo), unit="cases"):
        checkpoint.add(name, answer)
    text = json.dumps({name: checkpoint.done[name] for name in sorted(names)}, indent=1) + "\n"
    write_text(answers, text)
    digest = hashlib.sha256(text.encode()).hexdigest()
    write_text(folder / HASH_FILE, f"{digest}  {answers.name}\n")
    kept.unlink()
    return MadeCases(folder, answers, digest, tuple(sorted(names)), time.perf_counter() - begun)


def _made(maker: AbstractMaker, plan: CasePlan, folder: Path) -> tuple[str, dict[str, Any]]:
    return folder.name, maker.make(plan, folder)


def part_of(answers: Path) -> Path:
    """Return the file that holds the answers of the cases made so far."""
    return answers.with_name(f"{answers.name}.part")
