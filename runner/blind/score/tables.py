"""All tables of a blind score."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd

from runner.blind.checkpoint import Checkpoint
from runner.blind.run import read_hash
from runner.blind.score.bars import Bar, bars_of
from runner.blind.score.gap import gap_of, oracle_fits
from runner.blind.score.parameters import compared, coverage_of, places_of
from runner.blind.untried import untried
from runner.diagnosis.score import Score, accuracy, ordered_sizes, score
from runner.errors import ResultError
from runner.systems.case import open_case

WORST = 10
# of a case that was not diagnosed: wrong, and as if it had been certain
NO_VERDICT = {"ranked": [{"effects": ["no verdict"], "probability": 1.0, "parameters": {}, "standard_errors": {}}]}


@dataclass(frozen=True)
class BlindScore:
    """Everything that is scored; tables have one row per what their name says.

    Args:
        basic: What is right and wrong, confusion, calibration.
        bars: Figures beside their bars.
        effects: Single effects by name and size.
        parameters: Parameters of right answers beside the planted ones.
        coverage: How often the 95 % intervals hold the planted value, by parameter; the first row is of all.
        places: Patches and tethers that were named: distance from the truth beside the stated error.
        gap: Share of the closable gap closed, own and oracle, by case; None: not looked at.
        worst: Wrong answers, most certain first.
        untried: What the cases do not try, in words.
    """

    basic: Score
    bars: tuple[Bar, ...]
    effects: pd.DataFrame
    parameters: pd.DataFrame
    coverage: pd.DataFrame
    places: pd.DataFrame
    gap: pd.DataFrame | None
    worst: pd.DataFrame = field(repr=False)
    untried: str = field(repr=False)

    @property
    def tables(self) -> dict[str, pd.DataFrame]:
        """All tables by name, to be kept."""
        bars = pd.DataFrame([{**vars(b), "missed_by": b.missed_by, "certain": b.certain} for b in self.bars])
        out = {
            "bars": bars,
            "cases": self.basic.cases,
            "groups": self.basic.table,
            "effects": self.effects,
            "confusion": self.basic.confusion,
            "calibration": self.basic.calibration,
            "parameters": self.parameters,
            "coverage": self.coverage,
            "places": self.places,
            "worst": self.worst,
        }
        return out if self.gap is None else out | {"gap": self.gap}


def check_hash(answers: Path, *folders: Path) -> str:
    """Return the SHA-256 of the answers, if it is the one that stands beside the verdicts, and with the cases.

    Raises:
        ResultError: If the file or a stored hash is missing, or they differ.
    """
    try:
        digest = hashlib.sha256(answers.read_bytes()).hexdigest()
    except OSError as error:
        raise ResultError(f"answers: '{answers}' can't be read: {error.strerror}.") from None
    for folder in folders:
        if (stored := read_hash(folder)) != digest:
            raise ResultError(
                f"answers: the SHA-256 of '{answers}' is {digest[:12]}..., that in '{folder}' is {stored[:12]}...: "
                "these are not the answers that were set down beforehand."
            )
    return digest


def blind_score(
    verdicts: dict[str, dict[str, Any]],
    answers: dict[str, dict[str, Any]],
    cases: Path | None = None,
    *,
    checkpoint: Checkpoint | None = None,
    workers: int | None = None,
) -> BlindScore:
    """Score verdicts; a case that has an answer but no verdict counts as wrong.

    Args:
        verdicts: By case.
        answers: By case, with `true` values.
        cases: Folder of the cases, for the oracle and for what is relative to the nominal model; None: without these.
        checkpoint: Where the oracle's fits are kept; those that are there are not done again.
        workers: Processes for the oracle; None: one per core.

    Raises:
        ResultError: If no case has both, or a case is missing.
    """
    basic = score(verdicts, answers, otherwise=NO_VERDICT)
    verdicts = verdicts | dict.fromkeys(basic.unanswered, NO_VERDICT)
    names = list(basic.cases["case"])
    beliefs = {} if cases is None else {name: open_case(cases / name).beliefs for name in names}
    parameters = pd.DataFrame(
        [row for name in names for row in compared(name, answers[name], verdicts[name], beliefs.get(name))],
        columns=["case", "effect", "parameter", "true", "value", "standard_error", "errors_off", "covered", "right"],
    )
    gap = None
    if cases is not None:
        fits = oracle_fits(basic.cases, answers, verdicts, cases, checkpoint, workers)
        gap = gap_of(basic.cases, answers, verdicts, fits)
    right = parameters[parameters["right"].astype(bool)].drop(columns="right").reset_index(drop=True)
    single = basic.cases[basic.cases["kind"] == "single"]
    rows = [row for name, part in single.groupby("truth") for row in _by_size(str(name), part)]
    effects = pd.DataFrame(rows, columns=["effect", "size", *accuracy(single.head(1))])
    coverage = coverage_of(right)
    return BlindScore(
        basic, bars_of(basic.cases, right, gap), effects, right, coverage, places_of(parameters), gap,
        _worst(basic.cases, answers), untried(answers.values()),
    )  # fmt: skip


def _by_size(effect: str, cases: pd.DataFrame) -> list[dict[str, Any]]:
    sizes = [(size, cases[cases["severity"] == size]) for size in ordered_sizes(cases["severity"])]
    return [{"effect": effect, "size": size, **accuracy(part)} for size, part in [("all", cases), *sizes]]


def _worst(cases: pd.DataFrame, answers: dict[str, Any]) -> pd.DataFrame:
    wrong = cases[~cases["right"]].sort_values("probability", ascending=False, kind="stable").head(WORST)
    columns = ["case", "truth", "severity", "first", "probability", "rank_of_truth", "probability_of_truth"]
    out = pd.DataFrame(wrong, columns=columns).reset_index(drop=True)
    out["error_ratio"] = [answers[c].get("error_ratio") for c in out["case"]]
    out["about"] = [about(answers[c]) for c in out["case"]]
    return out


def about(answer: Mapping[str, Any]) -> str:
    """Return what is special about a case, in words: what it is apart from its effect, which effect if unknown."""
    made = answer.get("made", {})
    parts = [e["true"]["what"].replace("_", " ") for e in answer["effects"] if "what" in e.get("true", {})]
    if made.get("noise_slow_share"):
        parts.append(f"{100 * made['noise_slow_share']:.0f} % of the noise slow ({made['noise_slow_s']:.2g} s)")
    if made.get("outlier_share"):
        parts.append("outliers")
    if made.get("noise", {}).get("position", 1.0) < 0.003:
        parts.append("fine noise")
    if "mismatch_ratio" in made:
        parts.append(f"mismatch {made['mismatch_ratio']:.2f} noises")
    return ", ".join(parts)
