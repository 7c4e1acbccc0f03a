"""Where episodes begin: at parts, where a signal that counts them steps, or where the clock leaps or goes back.

A counter is known by what it does, whatever it is called: whole numbers that stay the same over stretches, and each of
them in one stretch only. That the clock goes back or leaps where it steps says the same a second time.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray

from runner.importing.guess.clock import ClockGuess, clock_times, stamps_s
from runner.importing.signals import Integers, Log, Signal
from runner.numerics.arrays import FloatArray

NAMED = ("episode", "episode_index", "episode_id", "run", "trial", "toss", "push", "demo", "rollout")
GAP_STEPS, GAP_S = 50.0, 0.5  # a clock that leaps further has begun another run
STRETCH = 10  # samples: what steps more often counts something else
BY_CLOCK = {"gap": "where it leaps", "restart": "where it goes back"}


def guess_episodes(
    log: Log, clock: ClockGuess, besides: Collection[str], measured: Collection[Signal] = ()
) -> tuple[dict[str, object], str]:
    """Return what the map says of episodes, and a sentence on how that is known; "": nothing need be said.

    Args:
        log: What was read.
        clock: That was found.
        besides: Signals that are something else.
        measured: Those of channels: where messages have stamps of their own, a run ends where none of them comes.
    """
    part = log.parts[0]
    if len(log.parts) > 1:
        return {"by": "part"}, ""
    times = clock_times(part, clock)
    edges = _edges(times)
    counters = {s.name: steps for s in part.signals.values() if s.name not in besides and len(steps := _steps(s))}
    if counters:
        name = max(counters, key=lambda n: (_at_edges(counters[n], edges), _rank(n), len(counters[n])))
        at_edges = _at_edges(counters[name], edges)
        rising = bool((np.diff(part.signals[name].values) >= 0).all())
        if at_edges or _rank(name) > -len(NAMED) or rising:
            return {"by": "column", "signal": name}, _why(name, counters[name], at_edges)
    return _by_clock(stamps_s(measured, clock) if times is None else times)


def _edges(times: FloatArray | None) -> Integers:
    """Return the samples at which the clock goes back or leaps."""
    if times is None or len(times) < 2:
        return np.empty(0, dtype=np.int64)
    steps = np.diff(times)
    usual = float(np.nanmedian(steps))
    return np.flatnonzero((steps < -usual) | _leaps(steps, usual)) + 1


def _leaps(steps: FloatArray, usual: float) -> NDArray[np.bool_]:
    """Return which steps of a clock are so long that another run has begun."""
    return steps > max(GAP_STEPS * usual, GAP_S)


def _steps(signal: Signal) -> Integers:
    """Return the samples at which a counter steps; none where the signal is no counter."""
    values, none = signal.values, np.empty(0, dtype=np.int64)
    if len(values) < 2 * STRETCH or not np.isfinite(values).all() or (values % 1).any():
        return none
    at = np.flatnonzero(np.diff(values) != 0) + 1
    lengths = np.diff(np.concatenate([[0], at, [len(values)]]))
    once = len(np.unique(values)) == len(at) + 1
    return at.astype(np.int64) if once and np.median(lengths) >= STRETCH else none


def _at_edges(steps: Integers, edges: Integers) -> bool:
    """Whether the clock goes back or leaps wherever a counter steps."""
    return bool(np.isin(steps, edges).all())


def _rank(name: str) -> int:
    """Return how likely a name is that of a counter; the last are those that say nothing."""
    return -NAMED.index(name) if name in NAMED else -len(NAMED)


def _why(name: str, steps: Integers, at_edges: bool) -> str:
    counts = f"{len(steps) + 1} of them"
    if name in NAMED:
        return f"'{name}' counts the episodes, {counts}"
    known = "the clock goes back or leaps wherever it steps" if at_edges else "check that it does, the clock runs on"
    return f"'{name}' is taken to count the episodes, {counts}: {known}"


def _by_clock(times: FloatArray | None) -> tuple[dict[str, object], str]:
    if times is None:
        return {"by": "part"}, ""
    steps = np.diff(times[np.isfinite(times)])
    usual = float(np.median(steps)) if len(steps) else 0.0
    gaps = steps[_leaps(steps, usual)]
    found: dict[str, object] = {"by": "part"}
    if (steps < -usual).any() and usual > 0:
        found = {"by": "restart"}
    elif len(gaps):
        found = {"by": "gap", "longer_than_s": float(f"{gaps.min() / 2:.2g}")}
    said = BY_CLOCK.get(str(found["by"]))
    return found, f"several runs in one file: the clock parts episodes {said}" if said else ""
