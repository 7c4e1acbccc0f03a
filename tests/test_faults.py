"""Faults in the manner of SQLite, a slice: whatever call fails, what is there is old or new, and the user is told."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.faults.harness import compiler, start
from tests.faults.scenarios import PART

ROOT = Path(__file__).parents[1]


@pytest.mark.skipif(compiler() is None, reason="no C compiler for the library that makes calls fail")
def test_a_slice_of_the_faults(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> None:
    """Some calls of a table that is written over another; `make faults` goes through all, of everything."""
    monkeypatch.chdir(ROOT)
    code = start(["only=table", "every=3", "first=2"])
    out, err = capfd.readouterr()
    assert code == 0, out[-2000:] + err[-2000:]
    assert "table: " in out
    assert "0 left something between old and new" in out


def test_temporary_names_are_told_from_others() -> None:
    """A file under its temporary name is no result; everything else is looked at."""
    assert PART.fullmatch(".run.b3cbb670.rrd")
    assert PART.fullmatch(".verdict.00ff00ff.json")
    assert not PART.fullmatch("run.rrd")
    assert not PART.fullmatch(".submitit")
