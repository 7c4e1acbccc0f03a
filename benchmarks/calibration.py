"""Whether stated probabilities hold on a world that they were not fitted on.

    python -m benchmarks.calibration VERDICTS ANSWERS VERDICTS ANSWERS [...]

Each pair is a set of blind cases of a world of its own: the `verdicts.json` of `runner blind run`, the answers of
`runner blind make`. Two numbers are fitted by log loss on one set and scored on every other: a temperature, by which
the log odds between explanations are divided once more, and how much the log odds of `unknown` are raised. Printed are
as stated and as fitted elsewhere: log loss, expected calibration error, and what of all stated above 0.95 is wrong.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.optimize import minimize
from scipy.special import expit, logit, softmax

from runner.diagnosis.score import UNKNOWN, calibration_error, full_name, is_right, read_answers, share
from runner.inference.probability import as_unknown
from runner.storage.reading import read_json

LEAST = 1e-3  # what is not in a ranking may be this likely: a log loss has no bound otherwise
SURE = 0.95


@dataclass(frozen=True)
class Case:
    """What was stated of a case: log probabilities of named explanations, which are right, and of `unknown`."""

    named: np.ndarray
    right: np.ndarray
    unknown: float
    unknown_is_right: bool

    def stated(self, temperature: float, raised: float) -> tuple[float, float, bool]:
        """Return the probability of what is right, that of the first answer, and whether the first answer is right."""
        unknown = as_unknown(expit(logit(self.unknown) + raised))
        each = np.append((1.0 - unknown) * softmax(self.named / temperature), unknown)
        right = np.append(self.right, self.unknown_is_right)
        first = int(each.argmax())
        return float(each[right].sum()), float(each[first]), bool(right[first])


def case_of(verdict: dict[str, Any], answer: dict[str, Any]) -> Case:
    """Return what a verdict states of a case."""
    truth = [full_name(e) for e in answer["effects"]]
    own = {full_name(e): e["accept"] for e in answer["effects"] if e.get("accept") is not None}
    named = [r for r in verdict["ranked"] if r["effects"] != [UNKNOWN]]
    return Case(
        named=np.log([max(r["probability"], 1e-300) for r in named]),
        right=np.array([is_right(r["effects"], truth, set(answer["accept"]), own) for r in named]),
        unknown=next(r["probability"] for r in verdict["ranked"] if r["effects"] == [UNKNOWN]),
        unknown_is_right=UNKNOWN in truth,
    )


def read(verdicts: str, answers: str) -> list[Case]:
    """Return the cases of a set that have a verdict."""
    told, planted = read_json(Path(verdicts)), read_answers(Path(answers))
    return [case_of(told[name], planted[name]) for name in planted if name in told]


def log_loss(cases: list[Case], temperature: float, raised: float) -> float:
    """Return the mean of minus the log probability of what is right."""
    return float(-np.mean([np.log(max(c.stated(temperature, raised)[0], LEAST)) for c in cases]))


def fitted(cases: list[Case]) -> tuple[float, float]:
    """Return the temperature and the raise that make the log loss least; 1 and 0 where cases say nothing."""
    begins = [(0.0, 0.0), (0.7, 0.0), (0.0, 1.0), (0.0, -1.0)]
    prior = 0.5 / len(cases)  # one standard deviation is a factor of e in either
    found = [
        minimize(lambda z: log_loss(cases, np.exp(z[0]), z[1]) + prior * float(z @ z), b, method="Nelder-Mead")
        for b in begins
    ]
    best = min(found, key=lambda f: f.fun)
    return float(np.exp(best.x[0])), float(best.x[1])


def row(cases: list[Case], temperature: float, raised: float) -> dict[str, object]:
    """Return the figures of a set at a temperature and a raise."""
    told = [c.stated(temperature, raised) for c in cases]
    p, right = np.array([t[1] for t in told]), np.array([t[2] for t in told])
    wrong, low, high = share(~right[p > SURE])
    return {
        "n": len(cases),
        "temperature": round(temperature, 2),
        "raised": round(raised, 2),
        "right": f"{right.mean():.1%}",
        "log loss": round(log_loss(cases, temperature, raised), 3),
        "calibration error": round(calibration_error(p, right.astype(float)), 3),
        f"above {SURE}": int((p > SURE).sum()),
        "of them wrong": f"{wrong:.1%} ({low:.1%} to {high:.1%})",
    }


def main(arguments: list[str]) -> None:
    """Print the table."""
    if len(arguments) < 2 or len(arguments) % 2:
        raise SystemExit(__doc__)
    sets = {Path(v).parent.name: read(v, a) for v, a in zip(arguments[::2], arguments[1::2], strict=True)}
    rows = [{"scored on": name, "fitted on": "as stated", **row(cases, 1.0, 0.0)} for name, cases in sets.items()]
    for name, cases in sets.items():
        for other, its in sets.items():
            if other != name:
                rows.append({"scored on": name, "fitted on": other, **row(cases, *fitted(its))})
    print(pd.DataFrame(rows).to_string(index=False))


if __name__ == "__main__":
    main(sys.argv[1:])
