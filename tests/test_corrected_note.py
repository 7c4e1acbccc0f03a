"""A corrected model that can't be written costs itself and nothing else."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from runner.errors import ResultError, WriteError
from runner.outputs.one import with_corrected


@dataclass(frozen=True)
class Simulated:
    """A system whose written model fails as `error`; None: it does not."""

    error: Exception | None = None

    def is_solved(self, effects: Any) -> bool:
        """Return False: there is one way to solve it."""
        return False

    def write_model(self, effects: Any, folder: Path) -> tuple[str, ...]:
        """Fail, or write nothing."""
        if self.error is not None:
            raise self.error
        return ()


@dataclass(frozen=True)
class Found:
    """What is asked of a diagnosis."""

    system: Simulated
    notes: tuple[str, ...] = ("The noise was not stated.",)
    effects: tuple[Any, ...] = field(default=())


def test_the_rest_is_kept(tmp_path: Path) -> None:
    """The reason stands among the notes, which report and verdict show."""
    odd = Simulated(ResultError("model.xml: joint 'elbow' does not move as it does in the simulation."))
    found: Any = Found(odd)
    assert with_corrected(found, tmp_path).notes == (
        "The noise was not stated.",
        "No corrected model was written. model.xml: joint 'elbow' does not move as it does in the simulation.",
    )
    assert not (tmp_path / "corrected.yaml").exists()


def test_a_model_that_can_be_written_is(tmp_path: Path) -> None:
    """Then nothing is said."""
    found: Any = Found(Simulated())
    assert with_corrected(found, tmp_path) is found
    assert (tmp_path / "corrected.yaml").exists()


def test_a_full_disk_is_still_an_error(tmp_path: Path) -> None:
    """Nothing else could be written either."""
    found: Any = Found(Simulated(WriteError("model.xml: can't be written: No space left on device.")))
    with pytest.raises(WriteError):
        with_corrected(found, tmp_path)
