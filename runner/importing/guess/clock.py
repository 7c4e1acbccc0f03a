"""Which clock a log goes by: stamps of messages before those of the recorder, a column that rises and is called so."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field

import numpy as np

from runner.importing.clocks import NS
from runner.importing.guess.names import BY_NAME, words_of
from runner.importing.map_file import TO_FILL
from runner.importing.readers.arrow import HEADER_STAMP
from runner.importing.signals import Part, Signal
from runner.importing.units import UNITS
from runner.numerics.arrays import FloatArray

NAMED = frozenset(["t", "time", "timestamp", "stamp", "elapsed", "clock", "timestamps", "times"])
RECORDER = ("log_time", "publish_time", "log_tick")  # set where it was written down, not where it was measured
SUFFIXES = {"s": "s", "sec": "s", "secs": "s", "seconds": "s", "ms": "ms", "us": "us", "ns": "ns", "nsec": "ns"}
EPOCHS = {"s": 1e9, "ms": 1e12, "us": 1e15, "ns": 1e18}  # since 1970: 2001 to 2286
STEPS = (("s", 0.9), ("ms", 900.0), ("us", 9e5), ("ns", np.inf))  # the largest usual step of a unit
EVEN_STEP, MOSTLY = 0.05, 0.7  # of the usual step: most steps of a clock are so near; lost rows make some longer
FEWEST_STAMPS = 10  # samples that show how a clock runs
EMPTY = 0.05  # share of empty cells from which an empty cell means that there is no sample


@dataclass(eq=False)
class ClockKeysGuess:
    """What the map says of clocks."""

    clock: dict[str, str] | None = None
    overrides: dict[str, str] = field(default_factory=dict)
    missing: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


@dataclass(eq=False)
class ClockGuess:
    """The clock that was found, if any.

    Args:
        name: Of a clock of the log, or of a signal.
        unit: Of a signal.
        names: Of signals that are times, and nothing else.
        sparse: Whether empty cells mean that there is no sample.
    """

    name: str | None
    unit: str | None
    names: frozenset[str]
    sparse: bool
    notes: list[str] = field(default_factory=list)

    def keys(self, used: Sequence[Signal]) -> ClockKeysGuess:
        """Return what the map has to say for the signals that are used."""
        out = ClockKeysGuess()
        if self.name is None:
            if not used or any(len(s.clocks) != 1 for s in used):
                out.missing.append("clock: no signal looks like a time; name one, or give rate_hz=HZ if there is none")
                out.clock = {"name": TO_FILL, "unit": "s"}
            return out
        out.clock = {"name": self.name} | ({"unit": self.unit} if self.unit else {})
        for signal in used:
            if self.unit is None and self.name not in signal.clocks and signal.clocks:
                own = next(iter(signal.clocks))
                out.overrides[signal.name] = own
        if out.overrides:
            first, own = next(iter(out.overrides.items()))
            out.notes.append(
                f"'{first}' has no {self.name} and goes by {own}: it is later by the time that a message takes"
            )
        out.notes += _lag(used, self.name)
        return out


def clock_times(part: Part, clock: ClockGuess) -> FloatArray | None:
    """Return the times of a clock that is a signal, s, (T,), NaN where it has none; None: it is no signal."""
    times = part.signals.get(clock.name or "")
    size = UNITS["s"].get(clock.unit or "")
    return None if times is None or size is None else times.values * size


def stamps_s(signals: Collection[Signal], clock: ClockGuess) -> FloatArray | None:
    """Return when any of some signals has a sample by the stamps of messages, s, in order; None: they have no stamps.

    Which of two messages came first is not told: stamps that are out of order are put in order when a map is used.

    Args:
        signals: Of one part.
        clock: That was found; a signal without it goes by its own first one, as in the map.
    """
    clocks = [s.clocks.get(clock.name or "", next(iter(s.clocks.values()))) for s in signals if s.clocks]
    in_ns = [c.stamps for c in clocks if c.in_ns]
    if not in_ns or len(in_ns) < len(signals):
        return None
    stamps = np.unique(np.concatenate(in_ns))
    return (stamps - stamps[0]) / NS


def guess_clock(part: Part, *, empty_is_lost: bool = False) -> ClockGuess:
    """Return the clock of a part.

    Args:
        part: Of the log.
        empty_is_lost: An empty cell is a sample that was lost, and no sign of streams of other rates in one table.
    """
    signals = list(part.signals.values())
    known = {name for s in signals for name in s.clocks}
    times = [s for s in signals if _is_time(s)]
    names = frozenset(s.name for s in times)
    sparse = not empty_is_lost and any(not s.clocks and np.isnan(s.values).mean() > EMPTY for s in signals)
    notes = ["empty cells: taken for times at which a signal has no sample (sparse)"] if sparse else []
    if known:
        ordered = sorted(
            known, key=lambda n: (n != HEADER_STAMP, n in RECORDER, RECORDER.index(n) if n in RECORDER else 0)
        )
        return ClockGuess(ordered[0], None, names, sparse, notes)
    if not times:
        return _by_running(signals, sparse, notes)
    best = max(times, key=lambda s: (len(s), -len(words_of(s.name))))
    unit, why = _unit(best)
    return ClockGuess(best.name, unit, names, sparse, [*notes, f"'{best.name}' is the clock, in {unit} ({why})"])


def _by_running(signals: Sequence[Signal], sparse: bool, notes: list[str]) -> ClockGuess:
    """Return a clock that no name tells: what rises in even steps, first what ends in a unit of time."""
    running = [s for s in signals if _runs(s)]
    suffixed = [s for s in running if words_of(s.name)[-1:] and words_of(s.name)[-1] in SUFFIXES]
    found = suffixed or [s for s in running if not _counts(s)]
    if len(found) != 1:
        return ClockGuess(None, None, frozenset(), sparse, notes)
    (best,) = found
    unit, why = _unit(best)
    said = f"'{best.name}' is taken for the clock, as it rises in even steps, in {unit} ({why})"
    return ClockGuess(best.name, unit, frozenset([best.name]), sparse, [*notes, said])


def _runs(signal: Signal) -> bool:
    """Whether a signal rises in even steps but where it begins anew."""
    values = signal.values
    if len(values) < FEWEST_STAMPS or not np.isfinite(values).all():
        return False
    steps = np.diff(values)
    usual = float(np.median(steps))
    whole = 0.0 if (values % 1).any() else 1.0  # numbers without a fraction are rounded to one
    near = np.abs(steps - usual) <= max(EVEN_STEP * usual, whole)
    return usual > 0 and bool(np.mean(near) >= MOSTLY)


def _counts(signal: Signal) -> bool:
    """Whether a signal counts samples: without a word on how many there are in a second it is no time."""
    return bool(np.median(np.diff(signal.values)) == 1.0)


def _is_time(signal: Signal) -> bool:
    words = words_of(signal.name)
    values = signal.values[np.isfinite(signal.values)]
    if not set(words) & NAMED or len(values) < 3:
        return False
    return bool(np.mean(np.diff(values) >= 0) > 0.9 and values.max() > values.min())


def _unit(signal: Signal) -> tuple[str, str]:
    last = words_of(signal.name)[-1]
    if last in SUFFIXES and (len(words_of(signal.name)) > 1 or last != "s"):
        return SUFFIXES[last], BY_NAME
    values = signal.values[np.isfinite(signal.values)]
    for unit, size in EPOCHS.items():
        if size <= values[0] < 10 * size:
            return unit, "since 1970"
    steps = np.diff(values)
    usual = float(np.median(steps[steps > 0]))
    unit = next(name for name, most in STEPS if usual <= most)
    return unit, f"its usual step is {usual:.4g}"


def _lag(used: Sequence[Signal], name: str) -> list[str]:
    """Say how far the recorder's stamps are behind the messages', where there are both."""
    lags = [
        s.clocks["log_time"].stamps - s.clocks[name].stamps
        for s in used
        if name == HEADER_STAMP and {"log_time", name} <= set(s.clocks)
    ]
    if not lags:
        return []
    all_ms = np.concatenate(lags) / 1e6
    return [f"log_time is {np.median(all_ms):.4g} ms behind {name} (median; 95 %: {np.percentile(all_ms, 95):.4g} ms)"]
