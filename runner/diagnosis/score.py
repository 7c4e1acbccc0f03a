"""Hold verdicts against answers: how often the first explanation is right, what is taken for what, calibration.

The answers are read here and nowhere else.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import permutations
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any

import numpy as np
import pandas as pd
from pydantic import TypeAdapter, ValidationError
from scipy.stats import binomtest

from runner.errors import ResultError
from runner.storage.checked import Keys, must, refusal
from runner.storage.reading import read_json
from runner.systems.case import always_confounded

NONE, UNKNOWN = "none", "unknown"
BINS = 10
LISTS = "have the lists `effects` and `accept`"
FIRST = 3  # answers that are looked at beside the first one


@dataclass(frozen=True)
class Score:
    """Figures of the cases that are scored.

    Args:
        cases: One row per case: what was planted, what was named, whether that is right.
        table: First answers by group of cases: all, by number of effects, by size, by effect; 95 % Wilson intervals.
        confusion: How often each answer (`first`) was given for what was planted (`truth`), and whether it is right.
        calibration: Stated probability of the first answer against how often it is right, in ten bins.
        summary: `first_right`, `expected_calibration_error`, `brier`.
        unanswered: Cases with an answer but without a verdict.
    """

    cases: pd.DataFrame
    table: pd.DataFrame
    confusion: pd.DataFrame
    calibration: pd.DataFrame
    summary: dict[str, float]
    unanswered: tuple[str, ...]


class _Planted(Keys):
    name: Annotated[str, must("have a `name`")]
    accept: Annotated[list[str] | None, must("have `accept` as a list of names, if at all")] = None


class _Answer(Keys):
    effects: Annotated[list[Annotated[_Planted, must("have a `name`")]], must(LISTS)]
    accept: Annotated[list, must(LISTS)]


_EACH = Annotated[_Answer, must(LISTS)]
_ANSWERS = TypeAdapter(Annotated[dict[str, _EACH], must("hold an object with `effects` and `accept` for each case")])


def read_answers(path: Path) -> dict[str, dict[str, Any]]:
    """Read `{case: {"effects": [{"name", "severity", ...}], "accept": [names]}}`.

    An effect may have an `accept` of its own, which then says alone what else counts for it.

    Raises:
        ResultError: If there is no such file, or it holds something else.
    """
    content = read_json(path)
    try:
        _ANSWERS.validate_python(content)
    except ValidationError as error:
        place, text = refusal(error)
        lead = f"case '{place[0]}': " if place else ""
        raise ResultError(f"{path}: {lead}{'each of `effects` ' if len(place) > 2 else ''}{text}") from None
    return content


def score(
    verdicts: dict[str, dict[str, Any]],
    answers: dict[str, dict[str, Any]],
    *,
    otherwise: dict[str, Any] | None = None,
) -> Score:
    """Score the cases that have both a verdict and an answer; with `otherwise`, a verdict, that for those without too.

    The first answer is right if it names what was planted, each effect by its own name or by an accepted equivalent,
    and nothing else.

    Raises:
        ResultError: If no case has both.
    """
    shared = [c for c in answers if c in verdicts]
    if not shared:
        raise ResultError("no case has both a verdict and an answer; the names of the cases must be the same in both.")
    scored = {c: verdicts[c] for c in shared} if otherwise is None else dict.fromkeys(answers, otherwise) | verdicts
    cases = pd.DataFrame([_marked(case, scored[case], answers[case]) for case in answers if case in scored])
    confusion = pd.Series(cases.groupby(["truth", "first", "right"]).size(), name="cases").reset_index()
    p, right = cases["probability"].to_numpy(float), cases["right"].to_numpy(float)
    summary = {
        "first_right": float(right.mean()),
        "expected_calibration_error": calibration_error(p, right),
        "brier": float(np.mean((p - right) ** 2)),
    }
    table = pd.DataFrame([{"group": name, **accuracy(part)} for name, part in _groups(cases)])
    unanswered = tuple(c for c in answers if c not in verdicts)
    return Score(cases, table, confusion, calibration(p, right), summary, unanswered)


def grouped(
    table: pd.DataFrame, by: Sequence[Any], *, sort: bool = True
) -> Iterator[tuple[tuple[Any, ...], pd.DataFrame]]:
    """Yield the rows of each combination of several columns, below its values: pandas calls those a Hashable."""
    for key, part in table.groupby(list(by), sort=sort):
        assert isinstance(key, tuple)
        yield key, part


def _marked(case: str, verdict: dict[str, Any], answer: dict[str, Any]) -> dict[str, Any]:
    truth, accept = [full_name(e) for e in answer["effects"]], set(answer["accept"])
    own = {full_name(e): e["accept"] for e in answer["effects"] if e.get("accept") is not None}
    ranks = [r for r in verdict["ranked"] if r["effects"]]
    first = ranks[0]["effects"]
    rank = next((i for i, r in enumerate(ranks, 1) if is_right(r["effects"], truth, accept, own)), None)
    return {
        "case": case,
        "kind": NONE if not truth else UNKNOWN if UNKNOWN in truth else "single" if len(truth) == 1 else "pair",
        "truth": "+".join(sorted(truth)) or NONE,
        "what": "+".join(e.get("true", {}).get("what", "") for e in answer["effects"]),
        "severity": "+".join(e.get("severity", "") for e in answer["effects"]) or "-",
        "first": "+".join(first),
        "probability": float(ranks[0]["probability"]),
        "right": rank == 1,
        "one_right": any(any(_stands_for(n, t, truth, accept, own) for n in first) for t in truth),
        "in_first_three": rank is not None and rank <= FIRST,
        "rank_of_truth": rank,
        "probability_of_truth": 0.0 if rank is None else float(ranks[rank - 1]["probability"]),
        "abstain": bool(verdict.get("abstain", False)),
        "gap_closed": verdict.get("gap_closed"),
        "effects": len(truth),
    }


def is_right(
    named: Sequence[str],
    truth: Sequence[str],
    accept: Collection[str],
    own: Mapping[str, Collection[str]] = MappingProxyType({}),
) -> bool:
    """Tell whether names cover what was planted, one to one.

    Args:
        named: Full names of an answer.
        truth: Of what was planted.
        accept: What else counts, in a case as a whole.
        own: What else counts for one effect, by its full name; it then stands in place of `accept`.
    """
    if not truth:
        return list(named) == [NONE]
    orders = permutations(truth) if len(named) == len(truth) else ()
    return any(all(_stands_for(n, t, truth, accept, own) for n, t in zip(named, o, strict=True)) for o in orders)


def _stands_for(
    name: str, planted: str, truth: Collection[str], accept: Collection[str], own: Mapping[str, Collection[str]]
) -> bool:
    """Tell whether a name counts for an effect: its own, or an accepted one that was not planted itself."""
    if name == planted:
        return True
    plain, other = name.partition("[")[0], planted.partition("[")[0]
    if planted in own:
        return name not in truth and (name in own[planted] or f"{plain}[*]" in own[planted])
    accepted = name in accept or f"{plain}[*]" in accept
    # of several effects the case's list does not say which of them a name counts for
    confounded = [pair for pair in always_confounded() if plain in pair] if len(truth) > 1 else []
    return accepted and name not in truth and (not confounded or any(other in pair for pair in confounded))


def full_name(effect: Mapping[str, Any]) -> str:
    """Return the name of a planted effect with its target, if it has one: `joint_friction[elbow]`."""
    target = effect.get("target")
    return effect["name"] if target is None else f"{effect['name']}[{target}]"


def share(hits: Sequence[bool] | np.ndarray | pd.Series) -> tuple[float, float, float]:
    """Return a share and its 95 % interval by Wilson; NaN of nothing."""
    if not len(hits):
        return np.nan, np.nan, np.nan
    count = int(np.count_nonzero(hits))
    interval = binomtest(count, len(hits)).proportion_ci(method="wilson")
    return count / len(hits), float(interval.low), float(interval.high)


def accuracy(part: pd.DataFrame) -> dict[str, Any]:
    """Return how often the first answer, and one of the first three, is right in these cases."""
    first = dict(zip(("first_right", "low", "high"), share(part["right"]), strict=True))
    three = dict(zip(("first_three_right", "three_low", "three_high"), share(part["in_first_three"]), strict=True))
    return {"cases": len(part), **first, **three, "one_right": share(part["one_right"])[0]}


def _groups(cases: pd.DataFrame) -> list[tuple[str, pd.DataFrame]]:
    single = cases[cases["kind"] == "single"]
    out = [("all", cases), (NONE, cases[cases["kind"] == NONE]), ("one effect", single)]
    out += [(f"one effect, {s}", single[single["severity"] == s]) for s in ordered_sizes(single["severity"])]
    out += [("two effects", cases[cases["kind"] == "pair"]), (UNKNOWN, cases[cases["kind"] == UNKNOWN])]
    out += [(str(name), part) for name, part in single.groupby("truth")]
    return [(name, part) for name, part in out if len(part)]


def ordered_sizes(sizes: pd.Series) -> list[str]:
    """Return the sizes that occur, small to large."""
    known = ("subtle", "moderate", "strong")
    return sorted(set(sizes), key=lambda s: (known.index(s) if s in known else len(known), s))


def calibration(p: np.ndarray, right: np.ndarray) -> pd.DataFrame:
    """Return what was stated and what came of it in bins of equal width, with 95 % Wilson intervals."""
    bins, rows = _bins(p), []
    for b in np.unique(bins):
        value, low, high = share(right[bins == b])
        stated = float(p[bins == b].mean())
        rows.append(
            {"from": b / BINS, "to": (b + 1) / BINS, "cases": int((bins == b).sum()), "stated": stated,
             "right": value, "low": low, "high": high}
        )  # fmt: skip
    return pd.DataFrame(rows)


def calibration_error(p: np.ndarray, right: np.ndarray) -> float:
    """Return the expected calibration error: the mean distance of stated and true in the bins, by their cases."""
    return float(np.abs(np.bincount(_bins(p), weights=p - right)).sum() / len(p))


def _bins(p: np.ndarray) -> np.ndarray:
    return np.clip((p * BINS).astype(int), 0, BINS - 1)
