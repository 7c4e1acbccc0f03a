"""Whether every episode of a log begins at rest: a motion that is not known otherwise is slower there than usual."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from runner.importing.guess.clock import ClockGuess, clock_times
from runner.importing.signals import Integers, Log, Part
from runner.numerics.arrays import FloatArray

SAMPLES = 5  # over which a speed is told
SLOW = 0.1  # of the usual speed, root mean square


def begins_at_rest(log: Log, names: Sequence[str], clock: ClockGuess, episodes: Mapping[str, object]) -> bool:
    """Tell whether all positions of all episodes begin far slower than they move as a rule, in whatever unit.

    Noise that hides how fast something moves hides that it rests, too.

    Args:
        log: What was read.
        names: Signals of positions and orientations.
        clock: That was found.
        episodes: What the map says of them.
    """
    begins = [_begins(part, clock, episodes) for part in log.parts]
    each = [[_cut(part, name, of) for part, of in zip(log.parts, begins, strict=True)] for name in names]
    return bool(each) and all(_rests(parts) for parts in each)


def _begins(part: Part, clock: ClockGuess, episodes: Mapping[str, object]) -> tuple[int, Integers]:
    """Return of how many samples a part is, -1: of any number, and at which of them episodes begin after the first."""
    none, by = np.empty(0, dtype=np.int64), episodes.get("by")
    if by == "part":
        return -1, none
    counter = part.signals.get(str(episodes.get("signal"))) if by == "column" else None
    course = counter.values if counter is not None else clock_times(part, clock)
    if course is None:
        return 0, none
    steps = np.diff(course)
    longest = float(str(episodes.get("longer_than_s", 0.0)))
    edges = {"column": steps != 0, "gap": steps > longest, "restart": steps < 0}[str(by)]
    return len(course), np.flatnonzero(edges) + 1


def _cut(part: Part, name: str, begins: tuple[int, Integers]) -> list[FloatArray]:
    """Return the samples of a signal that are numbers, of each episode; none where it has a clock of its own."""
    signal = part.signals.get(name)
    if signal is None or begins[0] not in (-1, len(signal)):
        return []
    return [v[np.isfinite(v)] for v in np.split(signal.values, begins[1])]


def _rests(parts: Sequence[Sequence[FloatArray]]) -> bool:
    episodes = [_speeds(v) for part in parts for v in part]
    if not all(parts) or not all(len(speeds) > SAMPLES for speeds in episodes):
        return False
    usual = float(np.sqrt(np.mean(np.concatenate(episodes) ** 2)))
    return all(abs(speeds[0]) < SLOW * usual for speeds in episodes)


def _speeds(values: FloatArray) -> FloatArray:
    """Return the slope over samples, in their unit by sample: (T - 4,)."""
    if len(values) < SAMPLES:
        return np.empty(0)
    line = np.arange(SAMPLES) - (SAMPLES - 1) / 2
    return np.convolve(values, line[::-1] / float(line @ line), "valid")
