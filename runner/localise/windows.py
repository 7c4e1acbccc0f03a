"""The short windows that a recording is cut into, and how many of them a recording must have."""

from __future__ import annotations

from collections.abc import Sequence

from runner.errors import RecordingError
from runner.settings import SETTINGS
from runner.systems.base import AbstractSystem
from runner.systems.windows import Windows, windows_of


def windows_of_length(system: AbstractSystem, window_s: float, episodes: Sequence[int]) -> Windows:
    """Return windows of about this length, end to end, in these episodes of a recording."""
    lengths = [len(e) for e in system.recording.episodes]
    samples = max(SETTINGS.noise.smooth_degree + 1, round(window_s * system.rate_hz))
    return windows_of(lengths, samples, episodes)


def window_lengths_s(system: AbstractSystem, episodes: Sequence[int]) -> tuple[float, ...]:
    """Return how long windows of a recording may be, in s, ascending, each twice as long as the one before.

    Where all is long enough, but episodes are so short that hardly any holds a usual window, as flights are that end
    soon after a touch, they begin with half of that, or half of that again, as long as enough samples are left.
    """
    usual, least = SETTINGS.where.window_lengths_s, SETTINGS.where.min_windows
    whole_s = sum(len(system.recording.episodes[e]) for e in episodes) / system.rate_hz
    if whole_s < least * usual[0]:
        return usual
    lengths = usual
    while len(windows_of_length(system, lengths[0], episodes)) < least:
        half_s = lengths[0] / 2
        if round(half_s * system.rate_hz) <= SETTINGS.noise.smooth_degree:
            return usual
        lengths = (half_s, *lengths)
    return lengths


def check_length(system: AbstractSystem, episodes: Sequence[int] | None = None) -> None:
    """Refuse a recording, or these episodes of it, that is too short to tell anything.

    Raises:
        RecordingError: If there are not even a few windows.
    """
    chosen = range(len(system.recording.episodes)) if episodes is None else episodes
    shortest_s, least = window_lengths_s(system, chosen)[0], SETTINGS.where.min_windows
    count = len(windows_of_length(system, shortest_s, chosen))
    if count < least:
        raise RecordingError(
            f"{system.recording.path}: {count} windows of {shortest_s:g} s, at least {least} are needed."
        )
