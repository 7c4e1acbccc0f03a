"""Clocks of signals: stamps as whole nanoseconds of one origin, and a report of how even and complete they are."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from runner.errors import RecordingError
from runner.importing.map_file import ClockKeys
from runner.importing.signals import Clock, Integers, Part, Signal, nearest_of
from runner.importing.units import UNITS
from runner.numerics.arrays import FloatArray

NS = 1_000_000_000
JITTER_PERCENTILE = 95
LOST = 8  # samples in a row that may be lost: behind a longer pause something new begins
AS_ROUNDED = 2.5e-4  # of a rate: half a millisecond in two seconds, what rounded stamps leave open


def clock_of(key: str, part: Part, signal: Signal, chosen: ClockKeys | None, own: str | None) -> tuple[str, Clock]:
    """Return the name and the stamps of the clock that a signal goes by.

    Args:
        key: Place in the map, for messages.
        part: The signal's, whose other signals may be clocks, as a table's column of times is.
        signal: Of which the clock is wanted.
        chosen: By the map for all signals.
        own: By the map for this signal.

    Raises:
        RecordingError: If it has no such clock, or several and none is chosen.
    """
    name = own if own is not None else chosen.name if chosen is not None else None
    if name is None:
        if len(signal.clocks) == 1:
            return next(iter(signal.clocks.items()))
        has = (
            f"it has {', '.join(map(repr, signal.clocks))}" if signal.clocks else "name the signal that holds the time"
        )
        raise RecordingError(f"clock: none is chosen for signal '{signal.name}' ({key}); {has}, or give log.rate_hz.")
    if name in signal.clocks:
        return name, signal.clocks[name]
    other = part.signals.get(name)
    if other is not None and len(other) == len(signal) and other.stream == signal.stream:
        return name, Clock(other.values, in_ns=False)
    if other is not None:
        raise RecordingError(
            f"{key}: clock '{name}' has {len(other)} samples, signal '{signal.name}' has {len(signal)}: it can't be "
            "its clock."
        )
    candidates = {**signal.clocks, **{s.name: s for s in part.signals.values() if s.stream == signal.stream}}
    raise RecordingError(f"{key}: signal '{signal.name}' has no clock '{name}'. {nearest_of(name, candidates)}")


def nanoseconds(clocks: Sequence[Clock], unit: str) -> tuple[list[Integers], list[np.ndarray]]:
    """Return stamps in whole ns since the earliest of all, and which samples have one at all.

    Args:
        clocks: All that a part is read by.
        unit: Of those that are plain numbers.

    Raises:
        RecordingError: If some are in ns since an epoch and others plain numbers: they have no common origin.
    """
    kinds = {clock.in_ns for clock in clocks}
    if len(kinds) > 1:
        raise RecordingError(
            "clock: clocks of the log and columns of numbers can't be mixed; they have no common zero."
        )
    stamped = [np.isfinite(clock.stamps) for clock in clocks]
    known = [clock.stamps[has] for clock, has in zip(clocks, stamped, strict=True)]
    if not any(len(k) for k in known):
        raise RecordingError("clock: no sample has a time.")
    origin = min(k.min() for k in known if len(k))
    if kinds == {True}:
        return [(k - origin).astype(np.int64) for k in known], stamped
    size = UNITS["s"][unit] * NS
    return [np.round((k - origin) * size).astype(np.int64) for k in known], stamped


def rate_of(steps_s: FloatArray) -> float:
    """Return the rate of a clock, Hz, of which samples may be lost and which may start anew.

    Stamps are rounded, to whole milliseconds as a rule: the mean of many steps tells what one does not. Where samples
    were lost a step counts as the several that it is, so that the errors of the stamps in between cancel.

    Args:
        steps_s: Between stamps, at least one of them above 0.
    """
    counts = np.round(steps_s / float(np.median(steps_s[steps_s > 0])))
    kept = (counts >= 1) & (counts <= LOST)
    rate = float(counts[kept].sum() / steps_s[kept].sum())
    return float(round(rate)) if abs(rate - round(rate)) < AS_ROUNDED * rate else rate


@dataclass(frozen=True)
class ClockReport:
    """How a clock ran.

    Args:
        stream: The topic, table or group.
        clock: Its name.
        samples: With a stamp.
        rate_hz: Of most steps, whatever stamps were rounded to; see `rate_of`.
        jitter_ms: 95 % of the steps are within this much of the median one.
        longest_gap_s: Between two samples, within a part or episode.
        duplicates: Share of samples with the stamp of another.
        out_of_order: Samples that are stamped before an earlier one.
    """

    stream: str
    clock: str
    samples: int
    rate_hz: float
    jitter_ms: float
    longest_gap_s: float
    duplicates: float
    out_of_order: int

    def row(self) -> dict:
        """Return it as plain data, rounded to what is worth reading."""
        return {k: float(f"{v:.6g}") if isinstance(v, float) else v for k, v in asdict(self).items()}


def report(stream: str, clock: str, runs: Iterable[Integers]) -> ClockReport:
    """Return how a clock ran over several runs of stamps in order of arrival, ns."""
    runs = [r for r in runs if len(r)]
    steps = np.concatenate([np.diff(np.sort(r)) for r in runs])
    rising = steps[steps > 0]
    count = sum(map(len, runs))
    usual = float(np.median(rising)) if len(rising) else float("nan")
    return ClockReport(
        stream=stream,
        clock=clock,
        samples=count,
        rate_hz=rate_of(steps / NS) if len(rising) else float("nan"),
        jitter_ms=float(np.percentile(np.abs(rising - usual), JITTER_PERCENTILE)) / 1e6
        if len(rising)
        else float("nan"),
        longest_gap_s=float(rising.max()) / NS if len(rising) else float("nan"),
        duplicates=float(np.sum(steps == 0)) / count,
        out_of_order=int(sum(np.sum(np.diff(r) < 0) for r in runs)),
    )
