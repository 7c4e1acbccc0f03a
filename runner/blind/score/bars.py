"""Every figure of a blind score with its interval, beside the bar that it is to reach."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pandas as pd

from runner.diagnosis.score import NONE, UNKNOWN, calibration_error, share

DRAWS = 2000  # bootstrap over cases


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


def bars_of(cases: pd.DataFrame, parameters: pd.DataFrame, gap: pd.DataFrame | None) -> tuple[Bar, ...]:
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
