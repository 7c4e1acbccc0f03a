"""Samples of a command that the log has lost: what was commanded there is told by the samples around it, or by nothing.

A force that rises while its rows are lost did not stand still. Whether a command moves on between samples or keeps
still is seen where nothing is lost: there each sample is foretold by its neighbours, or by the one before it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicHermiteSpline, PPoly

from runner.importing.clocks import LOST, NS
from runner.importing.episodes import Series
from runner.importing.map_file import Between
from runner.importing.told import Told
from runner.numerics.arrays import FloatArray

# of the usual step, and of all steps: an even clock, whose longer steps lost samples
NEAR_STEPS, MOSTLY = 0.3, 0.9
SMOOTH = 0.5  # of the error of holding: neighbours that foretell by less say what is between them; a step has 0.7
ALIKE = 6.0  # times what samples differ by as a rule (median): of noise alone one pair in 15,000 differs by more
FEWEST_SAMPLES = 8  # that show how a clock runs


def with_lost(one: Series, told: Told) -> Series:
    """Return a command with the samples that the log has lost, where what is around them foretells others.

    Args:
        one: In the order of its stamps, one sample each, all of them numbers.
        told: What was done.
    """
    counts = _lost_steps(one.t_ns / NS)
    gaps = np.flatnonzero(counts > 1)
    if not len(gaps):
        return one
    line, _, held = _errors(one.values, counts)
    name, between = one.entry.column, one.entry.between
    if not between.moves_on and not line < SMOOTH * held:
        steps = np.abs(np.diff(one.values))
        jumped = gaps[steps[gaps] > ALIKE * np.median(steps)]
        said = "{names}: {n} samples were lost where the command changed; the one before is held, so it may change late"
        told.add(said, int((counts[jumped] - 1).sum()), column=name)
        still = np.setdiff1d(gaps, jumped)
        said = "{names}: {n} samples were lost between two that are alike; the one before is held"
        told.add(said, int((counts[still] - 1).sum()), column=name)
        return one
    after = np.repeat(gaps, counts[gaps] - 1)
    share = np.concatenate([np.arange(1, n) / n for n in counts[gaps]])
    t = one.t_ns[after] + np.round(share * (one.t_ns[after + 1] - one.t_ns[after])).astype(np.int64)
    values = through(one.t_ns / NS, one.values, between)(t / NS)
    said = f"{{names}}: {{n}} samples were lost; the {_named(between)} between those around them is taken"
    said += "" if between.moves_on else ", as that foretells the others"
    told.add(said, len(after), column=name)
    order = np.argsort(np.concatenate([one.t_ns, t]), kind="stable")
    return replace(
        one,
        at=np.concatenate([one.at, one.at[after]])[order],
        t_ns=np.concatenate([one.t_ns, t])[order],
        values=np.concatenate([one.values, values])[order],
    )


def _named(between: Between) -> str:
    return Between.CURVE.value if between is Between.CURVE else Between.LINE.value


def through(t_s: FloatArray, values: FloatArray, between: Between) -> PPoly:
    """Return what goes through samples: lines, or cubic curves with the slopes that their neighbours have.

    Such a curve (Catmull and Rom 1974) bends by four samples alone, so that a jump disturbs none that are further away.

    Args:
        t_s: Their times, (T,), s, rising, two or more.
        values: The samples, (T,).
        between: Which; what is held goes along lines here.
    """
    steps = np.diff(t_s)
    chords = np.diff(values) / steps
    if between is not Between.CURVE or len(t_s) == 2:
        return PPoly(np.stack([chords, values[:-1]]), t_s)
    return CubicHermiteSpline(t_s, values, np.gradient(values, t_s, edge_order=2))


def moves_on(components: Sequence[FloatArray], t_s: FloatArray | None) -> Between:
    """Return what is between samples: what its neighbours foretell moves on, and makes no steps.

    It does so along a curve where the cubic through four neighbours foretells a sample better than the line through
    two. Noise speaks for the line, as that takes the mean of fewer.

    Args:
        components: Of one force, (T,) each, NaN where not known: one sensor has one answer.
        t_s: Their times, (T,): where an episode ends, or samples were lost, neighbours are none. None: not known.
    """
    errors = []
    for values in components:
        there = np.isfinite(values) if t_s is None else np.isfinite(values) & np.isfinite(t_s)
        steps = np.ones(max(int(there.sum()) - 1, 0)) if t_s is None else np.diff(t_s[there])
        apart = np.abs(steps - np.median(steps)) > NEAR_STEPS * np.median(steps) if len(steps) else steps > 0
        errors.append(_errors(values[there], np.where(apart, 2, 1)))
    line, curve, held = np.sqrt(np.sum(np.square(errors), axis=0))
    if not line < SMOOTH * held:
        return Between.HELD
    return Between.CURVE if curve < line else Between.LINE


def _lost_steps(t_s: FloatArray) -> np.ndarray:
    """Return how many of the usual steps each step is, (T - 1,), where a clock is even and few are lost; else 1.

    Args:
        t_s: Stamps, (T,), s, rising.
    """
    steps = np.diff(t_s)
    if len(t_s) < FEWEST_SAMPLES:
        return np.ones(len(steps), dtype=np.int64)
    usual = float(np.median(steps))
    counts = np.maximum(np.round(steps / usual), 1)
    even = np.abs(steps - counts * usual) <= NEAR_STEPS * usual
    known = even & (counts <= LOST + 1) & bool(even.mean() >= MOSTLY)
    return np.where(known, counts, 1).astype(np.int64)


def _errors(values: FloatArray, counts: np.ndarray) -> tuple[float, float, float]:
    """Return how far forecasts of a sample are off, RMS over whole stretches.

    They are the line between its neighbours, the cubic through two on each side, and the sample before.
    """
    even = counts == 1
    inner = np.flatnonzero(even[1:-2] & even[2:-1] & even[:-3] & even[3:]) + 2
    if not len(inner):
        return np.inf, np.inf, 0.0
    near, far = (values[inner - k] + values[inner + k] for k in (1, 2))
    off = values[inner] - near / 2, values[inner] - (4 * near - far) / 6, values[inner] - values[inner - 1]
    line, curve, held = (float(np.sqrt(np.mean(each**2))) for each in off)
    return line, curve, held
