"""A slice of the golden verdicts (`make golden` has them all)."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests import golden


# what a dead band is taken for is weighed in `test_diagnose`, too
@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.slow) if n == "small_dead_band" else n for n in golden.SMALL]
)
def test_verdicts_are_as_they_were(name: str, tmp_path: Path) -> None:
    """Every number of a verdict is what was agreed upon: nothing is at work, an effect, one that has no name."""
    known = json.loads(golden.FILE.read_text(encoding="utf-8"))
    found = golden.diagnosed_here({name: golden.small(tmp_path / "cases")[name]}, tmp_path / "verdicts")
    assert {n: list(golden.differences(v, known[n])) for n, v in found.items()} == {name: []}


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


def test_the_slice_has_every_kind_of_verdict() -> None:
    """What the slice compares with is there: first answers `none`, an effect, and `unknown`."""
    known = json.loads(golden.FILE.read_text(encoding="utf-8"))
    assert [known[name]["ranked"][0]["effects"] for name in golden.SMALL] == [["none"], ["viscous_drag"], ["unknown"]]
