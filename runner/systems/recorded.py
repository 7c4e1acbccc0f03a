"""What every kind of recording has, whatever was recorded."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

from runner.numerics.arrays import FloatArray
from runner.recording import Span


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


def in_parts(recording: Recorded) -> bool:
    """Whether what counts as episodes are parts of one run, as a log in one piece is cut for something to check."""
    return any(getattr(episode, "after", None) is not None for episode in recording.episodes)


def longest_part_s(recording: Recorded, spans: Sequence[Span]) -> float | None:
    """Return how long the longest of some parts of episodes is, in seconds; None: they are the episodes, whole."""
    episodes = recording.episodes
    if list(spans) == [Span(e, 0, len(episode)) for e, episode in enumerate(episodes)]:
        return None
    return max((s.end - s.begin - 1) * episodes[s.episode].step_s for s in spans)
