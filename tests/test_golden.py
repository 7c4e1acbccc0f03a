"""A slice of the golden verdicts (`make golden` has them all)."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests import golden

SLICE = ("nothing_differs", "slippery_floor")


def test_verdicts_are_as_they_were(tmp_path: Path) -> None:
    """Every number of three verdicts is what was agreed upon: two examples, and a made case."""
    known = json.loads(golden.FILE.read_text(encoding="utf-8"))
    every = golden.cases(tmp_path)
    made = min(p.name for p in (tmp_path / "made").iterdir() if p.is_dir())
    found = golden.diagnosed({n: every[n] for n in (*SLICE, made)}, tmp_path / "verdicts")
    assert {n: list(golden.differences(v, known[n])) for n, v in found.items()} == {n: [] for n in found}


def test_a_difference_is_found() -> None:
    """A number that moved by more than rounding, a name, an entry that came or went: each is said with its place."""
    verdict = {"ranked": [{"probability": 0.9, "effects": ["mass"]}], "notes": ["a"]}
    other = {"ranked": [{"probability": 0.8, "effects": ["friction"]}], "notes": [], "new": 1}
    assert list(golden.differences(verdict, verdict)) == []
    assert list(golden.differences(other, verdict)) == [
        ".new: new",
        ".notes: 1 entries, now 0",
        ".ranked[0].effects[0]: 'mass', now 'friction'",
        ".ranked[0].probability: 0.9, now 0.8",
    ]
    assert list(golden.differences({"a": 1.0 + 1e-9}, {"a": 1.0})) == []


@pytest.mark.parametrize("name", SLICE)
def test_the_slice_is_known(name: str) -> None:
    """What the slice compares with is there."""
    assert name in json.loads(golden.FILE.read_text(encoding="utf-8"))
