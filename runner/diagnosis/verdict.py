"""The verdict as data: what stands in `verdict.json` and `verdicts.json`."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

from runner.diagnosis.pipeline import Diagnosis
from runner.errors import ResultError

FILE = "verdict.json"
ALL = "verdicts.json"
CHANCE = 0.05  # of the cells that exceed chance, so many may do so by chance
RIVALS = 6  # the most alike
WHERE = ["factor", "cell", "share", "lift", "q"]


def verdict(diagnosis: Diagnosis) -> dict[str, Any]:
    """Return a diagnosis as plain data; the probabilities sum to 1 over all explanations."""
    return {
        "ranked": [
            {
                "effects": list(r.effects),
                "equivalent": [list(e) for e in r.equivalent],
                "probability": r.probability,
                "parameters": r.parameters,
                "standard_errors": r.errors,
                "gap_closed": r.gap_closed,
                "log_evidence": r.log_evidence,
            }
            for r in diagnosis.ranked
        ],
        "abstain": diagnosis.abstain,
        "gap_closed": diagnosis.gap_closed,
        "gap_closed_interval": [diagnosis.closure.gap_closed_low, diagnosis.closure.gap_closed_high],
        "closable_closed": diagnosis.closure.closable_closed,
        "held_out": [diagnosis.recording.episodes[k].index for k in diagnosis.held_out],
        "residual_excess": diagnosis.excess,
        "nominal_excess": diagnosis.nominal_excess,
        "where": {
            "sentence": diagnosis.where.sentence,
            "p": diagnosis.where.p,
            "cells": diagnosis.where.cells.loc[lambda c: c["q"] < CHANCE, WHERE].to_dict("records"),
        },
        "rivals": [
            {"effect": r.effect, "rival": r.rival, "alike": r.alike, "log_odds": r.log_odds, "confounded": r.confounded}
            for r in diagnosis.rivals[:RIVALS]
        ],
        "next_push": diagnosis.next_push,
        "notes": list(diagnosis.notes),
    }


def write_json(path: Path, content: Any) -> None:
    """Write JSON, numbers that don't exist as null; a reader never sees half a file."""
    part = path.with_suffix(".part")
    part.write_text(json.dumps(_finite(content), indent=1) + "\n", encoding="utf-8")
    part.replace(path)


def read_json(path: Path, *, otherwise: str | None = None) -> Any:
    """Read JSON; `otherwise` says what to do where there is no such file.

    Raises:
        ResultError: If it can't be read.
    """
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise ResultError(f"{path}: no such file{'' if otherwise is None else f'; {otherwise}'}.") from None
    except OSError as error:
        raise ResultError(f"{path}: can't be read: {error.strerror}.") from None
    except ValueError as error:
        raise ResultError(f"{path}: not JSON ({error}).") from None


def read_verdicts(path: Path) -> dict[str, dict[str, Any]]:
    """Read `verdicts.json`, or the one in a folder.

    Raises:
        ResultError: If there is none, or it is something else.
    """
    path = path / ALL if path.is_dir() else path
    content = read_json(path, otherwise="`runner diagnose recording=CASES` and `runner blind run CASES` write one")
    if not isinstance(content, dict):
        raise ResultError(f"{path}: must hold an object with a verdict for each case, as `runner diagnose` writes it.")
    for case, entry in content.items():
        if problem := _lacking(entry):
            raise ResultError(f"{path}: case '{case}': {problem}; `runner diagnose` writes what is wanted.")
    return content


def _lacking(entry: Any) -> str | None:
    """Return what a verdict lacks for being one."""
    ranked = entry.get("ranked") if isinstance(entry, dict) else None
    if not isinstance(ranked, list) or not ranked:
        return "`ranked` must be a list of explanations"
    for number, one in enumerate(ranked, 1):
        names = one.get("effects") if isinstance(one, dict) else None
        if not isinstance(names, list) or not names or not all(isinstance(n, str) for n in names):
            return f"explanation {number} must have `effects`, a list of names"
        p = one.get("probability")
        if not isinstance(p, int | float) or isinstance(p, bool) or not 0.0 <= p <= 1.0:
            return f"explanation {number} must have a `probability` from 0 to 1, got {p!r}"
        for key in ("parameters", "standard_errors"):
            if not isinstance(one.get(key), dict) or not all(isinstance(v, dict) for v in one[key].values()):
                return f"explanation {number} must have `{key}` by effect"
    return None


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _finite(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(v) for v in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
