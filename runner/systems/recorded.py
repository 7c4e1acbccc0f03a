"""What every kind of recording has, whatever was recorded."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

from runner.numerics.arrays import FloatArray


class RecordedEpisode(Protocol):
    """What every kind of recording has of an episode."""

    @property
    def index(self) -> int:
        """Its number in the recording."""
        ...

    @property
    def t_s(self) -> FloatArray:
        """Time of each sample, (T,)."""
        ...

    @property
    def step_s(self) -> float:
        """Usual time from one sample to the next."""
        ...

    def __len__(self) -> int: ...


class Recorded(Protocol):
    """What every kind of recording has."""

    @property
    def path(self) -> Path:
        """Where it was read from."""
        ...

    @property
    def episodes(self) -> Sequence[RecordedEpisode]:
        """In the order of the file."""
        ...

    @property
    def notes(self) -> tuple[str, ...]:
        """What was odd about the files, yet no error."""
        ...
