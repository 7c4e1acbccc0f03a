"""The short windows that a recording is cut into, and how many of them a recording must have."""

from __future__ import annotations

from collections.abc import Sequence

from runner.errors import RecordingError
from runner.localise.linearised import DEGREE
from runner.simulate.shooting import windows_of
from runner.systems.base import AbstractSystem
from runner.systems.windows import Windows

WINDOWS_S = (0.25, 0.5, 1.0)  # a longer one is less local, and sees smaller effects: taken where a shorter sees none
FEWEST = 8  # windows


def windows_of_length(system: AbstractSystem, window_s: float, episodes: Sequence[int]) -> Windows:
    """Return windows of about this length, end to end, in these episodes of a recording."""
    lengths = [len(e) for e in system.recording.episodes]
    samples = max(DEGREE + 1, round(window_s * system.rate_hz))
    return windows_of(lengths, samples, episodes)


def check_length(system: AbstractSystem, episodes: Sequence[int] | None = None) -> None:
    """Refuse a recording, or these episodes of it, that is too short to tell anything.

    Raises:
        RecordingError: If there are not even a few windows.
    """
    chosen = range(len(system.recording.episodes)) if episodes is None else episodes
    count = len(windows_of_length(system, WINDOWS_S[0], chosen))
    if count < FEWEST:
        raise RecordingError(
            f"{system.recording.path}: {count} windows of {WINDOWS_S[0]:g} s, at least {FEWEST} are needed."
        )
