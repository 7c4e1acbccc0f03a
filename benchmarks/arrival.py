"""Whether fits arrive: an effect's fit from nothing beside the fit of the same effect that begins at the truth.

    python -m benchmarks.arrival CASES ANSWERS [--only CASE ...]

CASES is a folder of cases that `runner blind make` wrote, or of the same form, ANSWERS the file with what was planted.
Of every case with one planted effect that effect alone is sought, just as a diagnosis seeks it: pieces, whole
episodes, noise and all. Then it is fitted from what was planted, to the same episodes with the same noise. Printed are
log units by which the first lags behind the second: negative where the truth is not what explains the recording best,
as where another engine made it. A fit has arrived if it lags by at most two.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.optimize import least_squares

from runner.blind.planted import difference, planted
from runner.diagnosis.attempt import attempt
from runner.diagnosis.score import full_name
from runner.diagnosis.split import split
from runner.effects.vocabulary import Candidate, Vocabulary
from runner.inference.least_squares import Explanation
from runner.inference.parameters import bounds
from runner.systems.base import AbstractSystem
from runner.systems.case import open_case

ARRIVED = 2.0  # log units
STEPS = 80  # of the fit from the truth
SEVERITIES = ((0.0, "below 2"), (2.0, "2 to 10"), (10.0, "above 10"))  # error in noises


def vector_of(candidate: Candidate, values: dict[str, float], system: AbstractSystem) -> tuple[np.ndarray, float]:
    """Return the vector whose effect has these values, and how far off it is, as shares of the parameters' scales."""
    parameters = candidate.parameters(system.context)
    low, high = bounds(parameters)
    scale = np.array([p.scale for p in parameters])

    def off(z: np.ndarray) -> np.ndarray:
        told = candidate.make(np.clip(z * scale, low, high), system.context)[0].report()
        shared = [k for k in told if k in values]
        return np.array([difference(candidate.name, k, told[k], values[k]) / max(abs(values[k]), 1e-6) for k in shared])

    begins = [np.zeros(len(scale)), np.full(len(scale), 0.3), np.full(len(scale), -0.3)]
    begins += [s / scale for s in candidate.starts(system.context)]
    inside = [np.clip(b, low / scale + 1e-6, high / scale - 1e-6) for b in begins]
    found = [least_squares(off, b, bounds=(low / scale, high / scale), diff_step=1e-5) for b in inside]
    best = min(found, key=lambda f: f.cost)
    return np.clip(best.x * scale, low, high), float(np.sqrt(2 * best.cost))


def lag(path: Path, answer: dict) -> dict[str, object]:
    """Return a row: the effect, its severity, by how much the fit lags in log units, what both leave, and the time."""
    system, began = open_case(path), time.perf_counter()
    name = full_name(answer["effects"][0])
    variants = tuple(c for c in system.vocabulary if c.name == name)
    system.vocabulary = Vocabulary(variants)
    fitted, held_out = split([e.index for e in system.recording.episodes])
    found = attempt(system, system.simulator(), fitted, held_out)
    own = min((c.fit for c in found.confirmed.search.contenders if c.fit.explanation.candidates), key=lambda f: f.total)
    values, truths = planted(answer["effects"][0], answer, system.beliefs), []
    for candidate in variants:
        x, off = vector_of(candidate, values, system)
        fit = found.fitter.fit(Explanation((candidate,)), own.episodes, x=x, near=own, iterations=STEPS)
        truths.append((fit.total, off))
    total, off = min(truths)
    ratio = float(answer.get("error_ratio", np.nan))
    return {
        "case": path.name,
        "effect": name,
        "noises": ratio,
        "severity": next((label for least, label in reversed(SEVERITIES) if ratio >= least), "?"),
        "lag": 0.5 * (own.total - total),
        "left": found.fitter.measured.excess(own.total, own.episodes),
        "left_from_truth": found.fitter.measured.excess(total, own.episodes),
        "truth_off": off,
        "seconds": time.perf_counter() - began,
    }


def main() -> None:
    """Print a row for each case, and how many arrived by effect and by severity."""
    parser = argparse.ArgumentParser(description="How far fits from nothing lag behind fits from the truth.")
    parser.add_argument("cases", type=Path)
    parser.add_argument("answers", type=Path)
    parser.add_argument("--only", nargs="*", default=[])
    given = parser.parse_args()
    answers = json.loads(given.answers.read_text())
    rows = []
    for path in sorted(p for p in given.cases.iterdir() if p.name in answers):
        if len(answers[path.name]["effects"]) != 1 or (given.only and path.name not in given.only):
            continue
        try:
            rows.append(lag(path, answers[path.name]))
        except ValueError as error:  # an outsider, which the vocabulary has no word for
            print(f"{path.name}: left out, {error}")
            continue
        print(" ".join(f"{k} {v:.3g}" if isinstance(v, float) else str(v) for k, v in rows[-1].items()), flush=True)
    table = pd.DataFrame(rows)
    for by in ("effect", "severity"):
        groups = table.groupby(by)["lag"]
        summary = groups.agg(cases="size", arrived=lambda x: (x <= ARRIVED).mean(), median="median", worst="max")
        print(summary.round(2).to_string())


if __name__ == "__main__":
    main()
