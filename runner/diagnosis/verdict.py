"""The verdict as data: what stands in `verdict.json` and `verdicts.json`; its probabilities come from `ranking`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field, StrictFloat, TypeAdapter, ValidationError

from runner.errors import ResultError
from runner.settings import SETTINGS
from runner.storage.checked import Keys, must, refusal
from runner.storage.reading import file_of, read_json

if TYPE_CHECKING:
    from runner.diagnosis.result import Diagnosis, Flights

FILE = "verdict.json"
ALL = "verdicts.json"
RIVALS_SHOWN = 6  # the most alike
WHERE = ["factor", "cell", "share", "lift", "q"]


def verdict(diagnosis: Diagnosis) -> dict[str, Any]:
    """Return a diagnosis as plain data; the probabilities sum to 1 over all explanations."""
    flights, notes = diagnosis.flights, [*diagnosis.doubts, *diagnosis.notes]
    return {
        "ranked": [
            {
                "effects": list(r.effects),
                "equivalent": [list(e) for e in r.equivalent],
                "equivalent_parameters": [r.equal_numbers.get(e, ({}, {}))[0] for e in r.equivalent],
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
            "cells": diagnosis.where.cells.loc[lambda c: c["q"] < SETTINGS.where.false_discovery_rate, WHERE].to_dict(
                "records"
            ),
        },
        "rivals": [
            {"effect": r.effect, "rival": r.rival, "alike": r.alike, "log_odds": r.log_odds, "confounded": r.confounded}
            for r in diagnosis.rivals[:RIVALS_SHOWN]
        ],
        "next_push": diagnosis.next_push,
        "notes": notes,
    } | ({} if flights is None else _of_flights(flights, notes))


def _of_flights(flights: Flights, notes: Sequence[str]) -> dict[str, Any]:
    """Return what flights add to a verdict: what explains them, and the notes with theirs as the last."""
    return {
        "flights": {
            "effects": list(flights.effects),
            "probability": flights.probability,
            "parameters": flights.parameters,
            "standard_errors": flights.errors,
            "noises_left": flights.noises,
        },
        "notes": [*notes, flights.note],
    }


class _Explanation(Keys):
    effects: Annotated[list[str], Field(min_length=1), must("have `effects`, a list of names")]
    probability: Annotated[StrictFloat, Field(ge=0.0, le=1.0), must("have a `probability` from 0 to 1")]
    parameters: Annotated[dict[str, dict], must("have `parameters` by effect")]
    standard_errors: Annotated[dict[str, dict], must("have `standard_errors` by effect")]


class _Verdict(Keys):
    ranked: Annotated[list[_Explanation], Field(min_length=1), must("be a list of explanations")]


_EACH = Annotated[_Verdict, must("have `ranked`, a list of explanations")]
_ONE = TypeAdapter(_EACH)
_VERDICTS = TypeAdapter(Annotated[dict[str, _EACH], must("hold an object with a verdict for each case")])


def read_verdict(path: Path) -> dict[str, Any]:
    """Read the `verdict.json` of one case.

    Raises:
        ResultError: If there is none, or it is something else.
    """
    content = read_json(path)
    try:
        _ONE.validate_python(content)
    except ValidationError as error:
        place, text = refusal(error)
        lead = f"explanation {int(place[1]) + 1} " if len(place) > 1 else "`ranked` " if place else ""
        raise ResultError(f"{path}: {lead}{text} `runner diagnose` writes what is wanted.") from None
    return content


def read_verdicts(path: Path) -> dict[str, dict[str, Any]]:
    """Read `verdicts.json`, or the one in a folder.

    Raises:
        ResultError: If there is none, or it is something else.
    """
    path = file_of(path, ALL)
    content = read_json(path, otherwise="`runner diagnose recording=CASES` and `runner blind run CASES` write one")
    try:
        _VERDICTS.validate_python(content)
    except ValidationError as error:
        place, text = refusal(error)
        lead = f"case '{place[0]}': " if place else ""
        lead += f"explanation {int(place[2]) + 1} " if len(place) > 2 else "`ranked` " if len(place) > 1 else ""
        raise ResultError(f"{path}: {lead}{text} `runner diagnose` writes what is wanted.") from None
    return content
