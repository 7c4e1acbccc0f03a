"""Which share of the closable gap was closed, beside an oracle that was told the effects."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, cast

import numpy as np
import pandas as pd
from joblib import Parallel, delayed

from runner.blind.checkpoint import Checkpoint
from runner.blind.oracle import oracle_closed
from runner.diagnosis.score import full_name
from runner.processes.workers import joblib_workers
from runner.progress import track
from runner.systems.case import open_case

LEAST_CLOSED = 0.05  # of the noise's variance: less than this, even by the oracle, tells nothing


def oracle_fits(
    cases: pd.DataFrame,
    answers: dict[str, Any],
    verdicts: dict[str, Any],
    folder: Path,
    checkpoint: Checkpoint | None,
    workers: int | None,
) -> dict[str, tuple[float, float]]:
    """Return what the oracle closes, and what can be closed, of each case with known effects."""
    names = list(cases.loc[cases["kind"].isin(["single", "pair"]), "case"])
    unseen = {name: verdicts[name].get("held_out") for name in names}
    # a fit is of a case and of the episodes that were left out of it
    keys = {name: f"{name} {unseen[name]}" for name in names}
    fits: dict[str, Any] = {} if checkpoint is None else dict(checkpoint.done)
    todo = [name for name in names if keys[name] not in fits]
    calls = (delayed(_told)(name, folder / name, answers[name]["effects"], unseen[name]) for name in todo)
    made = Parallel(n_jobs=workers or os.cpu_count() or 1, **joblib_workers(), return_as="generator_unordered")(calls)
    made = cast("Iterable[tuple[str, tuple[float, float]]]", made)
    for name, fit in track(made, "Oracle", total=len(todo), unit="cases"):
        fits[keys[name]] = fit
        if checkpoint is not None:
            checkpoint.add(keys[name], fit)
    return {name: fits[keys[name]] for name in names}


def _told(
    name: str, case: Path, effects: list[dict[str, Any]], unseen: list[int] | None
) -> tuple[str, tuple[float, float]]:
    return name, oracle_closed(open_case(case), effects, unseen)


def gap_of(
    cases: pd.DataFrame, answers: dict[str, Any], verdicts: dict[str, Any], fits: Mapping[str, tuple[float, float]]
) -> pd.DataFrame:
    """Return, per case that the oracle fitted, the share of the closable gap closed, own and the oracle's."""
    rows = []
    for name, first in cases.set_index("case").loc[list(fits), "first"].items():
        own = float(verdicts[name].get("closable_closed") or 0.0)
        as_planted = set(first.split("+")) == {full_name(e) for e in answers[name]["effects"]}
        rows.append(
            {"case": name, "own": own, "oracle": fits[name][0], "ratio": of_oracle(own, *fits[name]),
             "as_planted": as_planted}
        )  # fmt: skip
    return pd.DataFrame(rows, columns=["case", "own", "oracle", "ratio", "as_planted"])


def of_oracle(own: float, oracle: float, closable: float) -> float:
    """Return the share of what an oracle closed that was closed without it, -1 to 1.

    The oracle's fit may end in a hollow where the search's did not: it is then credited with the search's, so that no
    case makes up for another. NaN where even it closes less than `LEAST_CLOSED` of the noise's variance.

    Args:
        own: Share of the closable mean square.
        oracle: The same by the oracle.
        closable: In squared noises.
    """
    best = max(own, oracle)
    # where the effects hardly show in these episodes both shares and what is closable may be below zero
    told = math.isfinite(oracle) and closable > 0.0 and best * closable > LEAST_CLOSED
    return float(np.clip(own / best, -1.0, 1.0)) if told else math.nan
