"""The score of a blind test: every figure with its interval, beside the bar that it is to reach.

Beyond what is right and wrong: how well the stated intervals of parameters hold what was planted, how near the place
of a patch or a tether is, and which share of the closable gap is closed against an oracle that was told the effect.
"""

# pandas' own annotations name every type that an index could lead to, which no caller can narrow
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false, reportGeneralTypeIssues=false

from __future__ import annotations

import hashlib
import math
import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import numpy as np
import pandas as pd
from joblib import Parallel, delayed

from runner.blind.ledger import Ledger
from runner.blind.oracle import oracle_closed
from runner.blind.planted import difference, planted
from runner.blind.run import read_hash
from runner.diagnosis.score import (
    NONE,
    UNKNOWN,
    Score,
    accuracy,
    calibration_error,
    full_name,
    ordered_sizes,
    score,
    share,
)
from runner.errors import ResultError
from runner.progress import track
from runner.systems.case import open_case

DRAWS = 2000  # bootstrap over cases
WORST = 10
WIDE = 1.959964  # standard errors to each side of a 95 % interval
PLACED = ("friction_patch", "tether")
LEAST_CLOSED = 0.05  # of the noise's variance: less than this, even by the oracle, tells nothing
# of a case that was not diagnosed: wrong, and as if it had been certain
NO_VERDICT = {"ranked": [{"effects": ["no verdict"], "probability": 1.0, "parameters": {}, "standard_errors": {}}]}


@dataclass(frozen=True)
class Bar:
    """One figure and what it is to reach.

    Args:
        name: What it is of.
        value: Measured; NaN: there was nothing to measure it on.
        low, high: Its 95 % interval.
        cases: On how many cases, or parameters.
        least, most: The bar; one of them may be missing.
        percent: Whether it is a share.
    """

    name: str
    value: float
    low: float
    high: float
    cases: int
    least: float = -math.inf
    most: float = math.inf
    percent: bool = True

    @property
    def missed_by(self) -> float:
        """How far beyond the bar; 0 if it is reached, NaN if it was not measured."""
        return max(self.least - self.value, self.value - self.most, 0.0) if math.isfinite(self.value) else math.nan

    @property
    def certain(self) -> bool:
        """Whether the interval lies wholly on the side of the bar on which the value is, and has a width."""
        if self.low == self.high:  # a bootstrap of cases that are all alike
            return False
        inside = self.least <= self.low and self.high <= self.most
        return inside if self.missed_by == 0.0 else self.high < self.least or self.low > self.most


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
    """

    basic: Score
    bars: tuple[Bar, ...]
    effects: pd.DataFrame
    parameters: pd.DataFrame
    coverage: pd.DataFrame
    places: pd.DataFrame
    gap: pd.DataFrame | None
    worst: pd.DataFrame = field(repr=False)

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
    ledger: Ledger | None = None,
    workers: int | None = None,
) -> BlindScore:
    """Score verdicts; a case that has an answer but no verdict counts as wrong.

    Args:
        verdicts: By case.
        answers: By case, with `true` values.
        cases: Folder of the cases, for the oracle and for what is relative to the nominal model; None: without these.
        ledger: Where the oracle's fits are kept; those that are there are not done again.
        workers: Processes for the oracle; None: one per core.

    Raises:
        ResultError: If no case has both, or a case is missing.
    """
    basic = score(verdicts, answers, otherwise=NO_VERDICT)
    verdicts = verdicts | dict.fromkeys(basic.unanswered, NO_VERDICT)
    names = list(basic.cases["case"])
    beliefs = {} if cases is None else {name: open_case(cases / name).beliefs for name in names}
    parameters = pd.DataFrame(
        [row for name in names for row in _compared(name, answers[name], verdicts[name], beliefs.get(name))],
        columns=["case", "effect", "parameter", "true", "value", "standard_error", "errors_off", "covered", "right"],
    )
    gap = None
    if cases is not None:
        fits = _oracle(basic.cases, answers, verdicts, cases, ledger, workers)
        gap = _gap(basic.cases, answers, verdicts, fits)
    right = parameters[parameters["right"].astype(bool)].drop(columns="right").reset_index(drop=True)
    single = basic.cases[basic.cases["kind"] == "single"]
    rows = [row for name, part in single.groupby("truth") for row in _by_size(str(name), part)]
    effects = pd.DataFrame(rows, columns=["effect", "size", *accuracy(single.head(1))])
    coverage = _coverage(right)
    return BlindScore(
        basic, _bars(basic.cases, right, gap), effects, right, coverage, _places(parameters), gap,
        _worst(basic.cases, answers),
    )  # fmt: skip


def _by_size(effect: str, cases: pd.DataFrame) -> list[dict[str, Any]]:
    sizes = [(size, cases[cases["severity"] == size]) for size in ordered_sizes(cases["severity"])]
    return [{"effect": effect, "size": size, **accuracy(part)} for size, part in [("all", cases), *sizes]]


def _bars(cases: pd.DataFrame, parameters: pd.DataFrame, gap: pd.DataFrame | None) -> tuple[Bar, ...]:
    kind, single = cases["kind"], cases[cases["kind"] == "single"]
    subtle = single[single["severity"] == "subtle"]
    clear = single[single["severity"].isin(["moderate", "strong"])]
    null, unknown, pairs = (cases[kind == k] for k in (NONE, UNKNOWN, "pair"))
    p, right = cases["probability"].to_numpy(float), cases["right"].to_numpy(float)
    covered = parameters.groupby("case")["covered"].agg(["sum", "size"]).to_numpy(float)
    bars = [
        Bar("moderate, strong: first", *share(clear["right"]), len(clear), least=0.95),
        Bar("subtle: first", *share(subtle["right"]), len(subtle), least=0.80),
        Bar("false alarms on nulls", *share(~null["right"]), len(null), most=0.03),
        Bar("unknowns abstained from", *share(unknown["right"]), len(unknown), least=0.80),
        Bar("pairs: both found", *share(pairs["right"]), len(pairs), least=0.70),
        Bar("pairs: one found", *share(pairs["one_right"]), len(pairs), least=0.95),
        Bar(
            "calibration error", calibration_error(p, right), *_drawn(_error_of, np.column_stack([p, right])),
            len(cases), most=0.06, percent=False,
        ),
        Bar(
            "truth in 95 % intervals", share(parameters["covered"])[0],
            *_drawn(_held, covered), len(parameters), least=0.90, most=0.98,
        ),
    ]  # fmt: skip
    ratio = np.empty(0) if gap is None else gap["ratio"].dropna().to_numpy(float)
    bars.append(
        Bar(
            "gap closed, of oracle's", float(ratio.mean()) if len(ratio) else math.nan,
            *_drawn(lambda r: float(r.mean()), ratio), len(ratio), least=0.93,
        )
    )  # fmt: skip
    return tuple(bars)


def _error_of(pairs: np.ndarray) -> float:
    return calibration_error(pairs[:, 0], pairs[:, 1])


def _held(counts: np.ndarray) -> float:
    return float(counts[:, 0].sum() / counts[:, 1].sum())


def _drawn(statistic: Callable[[np.ndarray], float], rows: np.ndarray) -> tuple[float, float]:
    """Return the 95 % percentile bootstrap interval over cases; NaN of nothing."""
    if not len(rows):
        return math.nan, math.nan
    rng = np.random.default_rng(0)
    values = [statistic(rows[rng.integers(len(rows), size=len(rows))]) for _ in range(DRAWS)]
    return float(np.quantile(values, 0.025)), float(np.quantile(values, 0.975))


def if_calibrated(p: np.ndarray) -> float:
    """Return the calibration error that stated probabilities would show if they were exactly right, by chance alone."""
    rng = np.random.default_rng(0)
    return float(np.mean([calibration_error(p, (rng.random(len(p)) < p).astype(float)) for _ in range(DRAWS // 4)]))


def _compared(case: str, answer: dict[str, Any], verdict: dict[str, Any], beliefs: Any) -> list[dict[str, Any]]:
    """Return the parameters that the first answer states of effects that were planted, under their own names.

    One without a standard error claims to hold exactly that value; one without a value holds nothing.
    """
    first = verdict["ranked"][0]
    right = set(first["effects"]) == {full_name(e) for e in answer["effects"]}
    rows = []
    for effect in answer["effects"]:
        name, true = full_name(effect), planted(effect, answer, beliefs)
        for parameter, value in first["parameters"].get(name, {}).items():
            error = first["standard_errors"].get(name, {}).get(parameter) or 0.0
            if parameter in true:
                value = math.nan if value is None else value
                off = difference(effect["name"], parameter, value, true[parameter])
                rows.append(
                    {"case": case, "effect": name, "parameter": parameter, "true": true[parameter], "value": value,
                     "standard_error": error, "errors_off": off / error if error > 0 else math.nan,
                     "covered": abs(off) <= WIDE * error, "right": right}
                )  # fmt: skip
    return rows


def _coverage(parameters: pd.DataFrame) -> pd.DataFrame:
    groups = [(("all", ""), parameters), *parameters.groupby(["effect", "parameter"])]
    rows = []
    for (effect, parameter), part in groups:
        value, low, high = share(part["covered"])
        off = part["errors_off"].dropna().to_numpy(float)
        typical = float(np.sqrt(np.mean(off**2))) if len(off) else math.nan
        rows.append(
            {"effect": effect, "parameter": parameter, "values": len(part), "covered": value, "low": low, "high": high,
             "errors_off": typical}
        )  # fmt: skip
    return pd.DataFrame(rows)


def _places(parameters: pd.DataFrame) -> pd.DataFrame:
    rows = []
    for key, part in parameters[parameters["effect"].isin(PLACED)].groupby(["case", "effect"]):
        case, effect = tuple(key)
        part = part.set_index("parameter")
        if {"x_m", "y_m"} <= set(part.index):
            off = part.loc[["x_m", "y_m"], "value"] - part.loc[["x_m", "y_m"], "true"]
            distance_m = float(np.linalg.norm(off))
            stated_m = float(np.linalg.norm(part.loc[["x_m", "y_m"], "standard_error"]))
            rows.append(
                {"case": case, "effect": effect, "distance_m": distance_m, "stated_error_m": stated_m,
                 "errors_off": distance_m / stated_m if stated_m > 0.0 else math.nan,
                 "right": bool(part["right"].iloc[0])}
            )  # fmt: skip
    columns = ["case", "effect", "distance_m", "stated_error_m", "errors_off", "right"]
    return pd.DataFrame(rows, columns=columns).sort_values(["effect", "distance_m"], ignore_index=True)


def _oracle(
    cases: pd.DataFrame,
    answers: dict[str, Any],
    verdicts: dict[str, Any],
    folder: Path,
    ledger: Ledger | None,
    workers: int | None,
) -> dict[str, tuple[float, float]]:
    """Return what the oracle closes, and what can be closed, of each case with known effects."""
    names = list(cases.loc[cases["kind"].isin(["single", "pair"]), "case"])
    unseen = {name: verdicts[name].get("held_out") for name in names}
    # a fit is of a case and of the episodes that were left out of it
    keys = {name: f"{name} {unseen[name]}" for name in names}
    fits: dict[str, Any] = {} if ledger is None else dict(ledger.done)
    todo = [name for name in names if keys[name] not in fits]
    calls = (delayed(_told)(name, folder / name, answers[name]["effects"], unseen[name]) for name in todo)
    made = Parallel(n_jobs=workers or os.cpu_count() or 1, return_as="generator_unordered")(calls)
    made = cast("Iterable[tuple[str, tuple[float, float]]]", made)
    for name, fit in track(made, "Oracle", total=len(todo), unit="cases"):
        fits[keys[name]] = fit
        if ledger is not None:
            ledger.add(keys[name], fit)
    return {name: fits[keys[name]] for name in names}


def _told(
    name: str, case: Path, effects: list[dict[str, Any]], unseen: list[int] | None
) -> tuple[str, tuple[float, float]]:
    return name, oracle_closed(open_case(case), effects, unseen)


def _gap(
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
