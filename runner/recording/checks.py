"""What a recording's numbers must obey: finite, in order, at even times, unit quaternions, angles without jumps."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from runner.numerics.arrays import FloatArray
from runner.recording.data import Form, Nominal
from runner.recording.table import FORCE, OPTIONAL, PIN, POINT, POSE, QUATERNION, TWIST, UNITS, Table

GRID_STEPS = 0.05  # a sample may be off the even grid by this share of a step (rounded times)
RATE_SHARE = 0.005  # two rates closer than this are one rate
FEWEST = 3  # samples of an episode: a place, a velocity, and what checks them
NORM_SHARE = 5e-3  # a quaternion this close to unit length is a rounded one
TIME_UNITS = {1e-3: "ms", 1e-6: "us", 1e-9: "ns", 1 / 60: "minutes"}


def check_finite(table: Table, form: Form) -> None:
    """Refuse what is not finite; NaN in a pose or velocity says `not measured`, in space or of a pin also in a force.

    Raises:
        RecordingError: Naming file, row, column and value, and how many such rows there are.
    """
    may_not = ("episode", "t", *PIN) if form is Form.SPATIAL or PIN[0] in table else ("episode", "t", *FORCE, *POINT)
    for name in table.columns:
        may_lack = name not in may_not
        bad = np.isinf(table[name]) if may_lack else ~np.isfinite(table[name])
        if bad.any():
            row = int(np.argmax(bad))
            more = f" ({bad.sum()} such rows)" if bad.sum() > 1 else ""
            hint = "; no force is 0, not empty" if form is Form.PLANAR and name in (*FORCE, *POINT) else ""
            unit = f" in {UNITS[name]}" if name in UNITS else ""
            raise table.error(
                f"column '{name}' must be a finite number{unit}{hint}, got {table[name][row]}{more}.", row
            )
    _check_measured(table, form)
    if form is Form.SPATIAL:
        _check_measured_in_space(table)


def _check_measured(table: Table, form: Form) -> None:
    for name in (*POSE[form], *TWIST[form]):
        lacking = np.isnan(table[name])
        if lacking.all() and name in POSE[form]:
            raise table.error(f"column '{name}' is NaN in all {len(table)} rows; it must be measured somewhere.")
    # a log without velocities has none to lose
    names = [*POSE[form], *(name for name in TWIST[form] if not np.isnan(table[name]).all())]
    table.notes.extend(lacking_notes(names, table.stack(names)))


def lacking_notes(names: Sequence[str], values: FloatArray) -> list[str]:
    """Return notes on what is not measured everywhere, one for all channels of a stream, which lack as many.

    Args:
        names: Of the channels, (C,).
        values: (T, C), NaN where not measured.
    """
    lost: dict[int, list[str]] = {}
    for name, n in zip(names, np.isnan(values).sum(axis=0), strict=True):
        if n:
            lost.setdefault(int(n), []).append(f"'{name}'")
    return [
        f"{', '.join(those)} {'is' if len(those) == 1 else 'are'} not measured (NaN) in {n} of {len(values)} rows"
        for n, those in lost.items()
    ]


def _check_measured_in_space(table: Table) -> None:
    part = np.isnan(table.stack(QUATERNION))
    torn = part.any(axis=1) & ~part.all(axis=1)
    if torn.any():
        raise table.error(
            "columns 'qw', 'qx', 'qy', 'qz' must all be numbers or all be NaN, got "
            f"{table.stack(QUATERNION)[np.argmax(torn)].tolist()}.",
            int(np.argmax(torn)),
        )
    names = [name for name in OPTIONAL[Form.SPATIAL] if name in table]
    if names:
        table.notes.extend(lacking_notes(names, table.stack(names)))
    if "fx" not in table:
        table.notes.append("no force columns: 'fx', 'fy', 'fz' are NaN, not measured")


def episode_spans(table: Table) -> list[slice]:
    """Return the rows of each episode, in order.

    Raises:
        RecordingError: If an episode is no integer, comes back after another one, or has fewer than three samples.
    """
    episode = table["episode"]
    broken = episode != np.round(episode)
    if broken.any():
        row = int(np.argmax(broken))
        raise table.error(f"column 'episode' must be an integer, got {episode[row]:g}.", row)
    steps = np.diff(episode)
    if (steps < 0).any():
        row = int(np.argmax(steps < 0)) + 1
        raise table.error(
            f"column 'episode' must not fall, got {episode[row]:g} after {episode[row - 1]:g}; "
            "sort the rows by 'episode', then 't'.",
            row,
        )
    edges = [0, *(np.flatnonzero(steps) + 1).tolist(), len(episode)]
    spans = [slice(start, stop) for start, stop in pairwise(edges)]
    for span in spans:
        if span.stop - span.start < FEWEST:
            raise table.error(
                f"the episode has {span.stop - span.start} samples, at least {FEWEST} are needed.", int(span.start)
            )
    return spans


def rising_steps(table: Table, span: slice) -> FloatArray:
    """Return the times from one sample of an episode to the next, (T - 1,).

    Raises:
        RecordingError: If one is not above zero: naming file and row.
    """
    t = table["t"][span]
    steps = np.diff(t)
    if (steps <= 0).any():
        k = int(np.argmax(steps <= 0))
        what = "is there twice" if steps[k] == 0 else f"follows {t[k]:.9g} s"
        raise table.error(
            f"column 't' must rise within an episode, {t[k + 1]:.9g} s {what}; sort by 'episode', then 't'.",
            int(span.start) + k + 1,
        )
    return steps


def check_times(table: Table, spans: list[slice], nominal: Nominal) -> None:
    """Refuse times that don't rise, are not even, or whose rate differs between episodes or from `rate_hz`.

    Raises:
        RecordingError: Naming file, row and the times or rates.
    """
    rates = []
    for span in spans:
        t, steps = table["t"][span], rising_steps(table, span)
        step = (t[-1] - t[0]) / (len(t) - 1)
        if np.abs(t - t[0] - step * np.arange(len(t))).max() > GRID_STEPS * step:
            usual = float(np.median(steps))
            k = int(np.argmax(np.abs(steps - usual)))
            raise table.error(
                f"column 't' must be even within {GRID_STEPS:.0%} of a step: {steps[k]:.6g} s since the last sample, "
                f"usually {usual:.6g} s{_gap(steps[k] / usual)}.",
                int(span.start) + k + 1,
            )
        rates.append(1 / step)
    _check_rates(table, spans, np.array(rates), nominal)


def _gap(ratio: float) -> str:
    lost = round(ratio) - 1
    samples = f"{lost} sample{'s' * (lost > 1)}"
    return f" ({samples} missing: fill in or split the episode)" if lost >= 1 and abs(ratio - lost - 1) < 0.2 else ""


def _check_rates(table: Table, spans: list[slice], rates_hz: FloatArray, nominal: Nominal) -> None:
    usual = float(np.median(rates_hz))
    for span, rate in zip(spans, rates_hz, strict=True):
        n = span.stop - span.start
        if abs(rate / usual - 1) > RATE_SHARE + 2 * GRID_STEPS / (n - 1):
            raise table.error(
                f"the episode has {rate:.6g} samples per second, the others {usual:.6g}; all must have one rate.",
                int(span.start),
            )
    longest = max(span.stop - span.start for span in spans)
    ratio = usual / nominal.rate_hz
    if abs(ratio - 1) <= RATE_SHARE + 2 * GRID_STEPS / (longest - 1):
        return
    units = [unit for factor, unit in TIME_UNITS.items() if abs(ratio / factor - 1) < 0.05]
    hint = f" 't' is probably in {units[0]}, allowed: s." if units else " One of the two is wrong."
    raise table.error(
        f"column 't' has {usual:.6g} samples per second, {nominal.path or 'nominal.yaml'} says rate_hz: "
        f"{nominal.rate_hz:g}.{hint}"
    )


def check_yaw(table: Table, spans: list[slice]) -> None:
    """Refuse a yaw that jumps by about a whole turn between two samples, and not so before and after.

    Raises:
        RecordingError: Naming file, row and jump, and what unwraps it.
    """
    for span in spans:
        rows = np.flatnonzero(np.isfinite(table["yaw"][span])) + span.start
        jumps = np.diff(table["yaw"][rows])
        sizes = np.pad(np.abs(jumps), 1)
        around = np.maximum(sizes[:-2], sizes[2:])
        for turn, slack, unit in ((2 * np.pi, 0.5, "rad"), (360.0, 30.0, "degrees; allowed: rad")):
            wraps = (np.abs(sizes[1:-1] - turn) < slack) & (around < turn / 4)
            if wraps.any():
                k = int(np.argmax(wraps))
                raise table.error(
                    f"column 'yaw' must be unwrapped, it jumps by {jumps[k]:+.4g} from one sample to the next, about a "
                    f"whole turn in {unit}; apply numpy.unwrap to each episode.",
                    int(rows[k + 1]),
                )


def check_tracked(table: Table, spans: list[slice], form: Form) -> None:
    """Refuse an episode whose pose was seen in fewer than three samples.

    Raises:
        RecordingError: Naming file, row, column and how many samples there are.
    """
    for span in spans:
        for name in POSE[form]:
            seen = int(np.isfinite(table[name][span]).sum())
            if seen < FEWEST:
                raise table.error(
                    f"column '{name}' is measured in {seen} samples of the episode, at least {FEWEST} are needed.",
                    int(span.start),
                )


def unit_quaternions(table: Table, spans: list[slice]) -> FloatArray:
    """Return qw, qx, qy, qz at unit length and without sign flips within an episode, shape (N, 4); NaN stays.

    Raises:
        RecordingError: If one is further from unit length than rounding explains: file, row, norm.
    """
    quaternions = table.stack(QUATERNION)
    norms = np.linalg.norm(quaternions, axis=1)
    off = np.abs(norms - 1) > NORM_SHARE
    if off.any():
        row = int(np.argmax(off))
        raise table.error(
            f"columns 'qw', 'qx', 'qy', 'qz' must be a unit quaternion within {NORM_SHARE:g}, got "
            f"{quaternions[row].tolist()} of norm {norms[row]:.6g}.",
            row,
        )
    inexact = np.abs(norms - 1) > 1e-12
    quaternions[inexact] /= norms[inexact, None]
    for span in spans:
        measured = np.flatnonzero(np.isfinite(norms[span])) + span.start
        dots = np.sum(quaternions[measured[1:]] * quaternions[measured[:-1]], axis=1)
        quaternions[measured[1:]] *= np.cumprod(np.where(dots < 0, -1.0, 1.0))[:, None]
    return quaternions
