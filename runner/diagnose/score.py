"""Hold verdicts against answers: how often the first explanation is right, what is taken for what, calibration.

The answers are read here and nowhere else.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import binomtest

from runner.errors import ResultError

NONE, UNKNOWN = "none", "unknown"


@dataclass(frozen=True)
class Score:
    """Figures by case (`cases`), by effect and size (`table`), and what was named for what (`confusion`)."""

    cases: pd.DataFrame
    table: pd.DataFrame
    confusion: pd.DataFrame
    summary: dict[str, float]


def read_answers(path: Path) -> dict[str, dict[str, Any]]:
    """Read `{case: {"effects": [{"name", "severity", ...}], "accept": [names]}}`.

    Raises:
        ResultError: If there is no such file, or it holds something else.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise ResultError(f"{path}: no such file.") from None
    except ValueError as error:
        raise ResultError(f"{path}: not JSON ({error}).") from None
    if not isinstance(content, dict) or not all(
        isinstance(a, dict) and isinstance(a.get("effects"), list) and isinstance(a.get("accept"), list)
        for a in content.values()
    ):
        raise ResultError(f"{path}: must hold an object with `effects` and `accept` for each case.")
    return content


def score(verdicts: dict[str, dict[str, Any]], answers: dict[str, dict[str, Any]]) -> Score:
    """Score the cases that have both a verdict and an answer.

    The first answer is right if every effect it names is accepted and it names at least one; of a case with two
    effects it must name both (an accepted equivalent counts for the one it stands for).

    Raises:
        ResultError: If no case has both.
    """
    shared = [c for c in answers if c in verdicts]
    if not shared:
        raise ResultError("no case has both a verdict and an answer; the names of the cases must be the same in both.")
    rows = []
    for case in shared:
        answer, ranked = answers[case], verdicts[case]["ranked"]
        truth = [e["name"] for e in answer["effects"]]
        accept = set(answer["accept"])
        ranks = [r for r in ranked if r["effects"]]
        first = ranks[0]["effects"]
        rows.append(
            {
                "case": case,
                "truth": "+".join(sorted(truth)) or NONE,
                "severity": "+".join(e.get("severity", "") for e in answer["effects"]) or "-",
                "first": "+".join(first),
                "probability": float(ranks[0]["probability"]),
                "right": _right(first, truth, accept),
                "one_right": bool(set(first) & accept),
                "in_first_three": any(_right(r["effects"], truth, accept) for r in ranks[:3]),
                "abstain": bool(verdicts[case].get("abstain", False)),
                "gap_closed": verdicts[case].get("gap_closed"),
                "effects": len(truth),
            }
        )
    cases = pd.DataFrame(rows)
    groups = [_row(name, part) for name, part in _groups(cases)]
    confusion = pd.crosstab(cases["truth"], cases["first"])
    return Score(cases, pd.DataFrame(groups), confusion, _summary(cases))


def _right(named: list[str], truth: list[str], accept: set[str]) -> bool:
    if not truth:
        return named == [NONE]
    if any(n not in accept for n in named):
        return False
    if UNKNOWN in accept and named == [UNKNOWN]:
        return True
    # each planted effect needs one name; a name that isn't planted itself stands for one that wasn't named
    return len(set(named)) == len(set(truth))


def _groups(cases: pd.DataFrame) -> list[tuple[str, pd.DataFrame]]:
    single = cases[cases["effects"] == 1]
    out = [
        ("all", cases),
        (NONE, cases[cases["effects"] == 0]),
        ("one effect", single),
        ("two effects", cases[cases["effects"] > 1]),
    ]
    out += [(f"one effect, {s}", part) for s, part in single.groupby("severity")]
    out += [(str(name), part) for name, part in single.groupby("truth")]
    return [(name, part) for name, part in out if len(part)]


def _row(name: str, part: pd.DataFrame) -> dict[str, Any]:
    right = int(np.count_nonzero(part["right"]))
    interval = binomtest(right, len(part)).proportion_ci(method="wilson")
    return {
        "group": name,
        "cases": len(part),
        "first_right": right / len(part),
        "low": interval.low,
        "high": interval.high,
        "first_three_right": float(np.mean(part["in_first_three"].to_numpy(float))),
        "one_right": float(np.mean(part["one_right"].to_numpy(float))),
    }


def _summary(cases: pd.DataFrame) -> dict[str, float]:
    p, right = cases["probability"].to_numpy(), cases["right"].to_numpy(float)
    bins = np.clip((p * 10).astype(int), 0, 9)
    calibration = sum(abs(p[bins == b].mean() - right[bins == b].mean()) * (bins == b).mean() for b in np.unique(bins))
    return {
        "first_right": float(right.mean()),
        "expected_calibration_error": float(calibration),
        "brier": float(np.mean((p - right) ** 2)),
    }
