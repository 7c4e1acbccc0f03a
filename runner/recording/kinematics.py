"""What positions and velocities of one quantity say of each other: one is the integral of the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from runner.numerics.arrays import FloatArray

LONE = 50.0  # times what is usual, and more: a sample that stands alone; heavy-tailed noise of practice cases: 15
APART, TOGETHER = 0.5, 0.1  # of the displacement is left unexplained: no integral of it at all; plainly one


@dataclass(frozen=True)
class Follows:
    """How positions follow the integral of velocities, over all stretches together.

    Args:
        correlation: Of displacement and integral.
        gain: Displacement over integral, least squares.
        unexplained: Share of the displacement's square that the integral leaves.
        moved: rms displacement about its mean, in the unit of the position.
        due: rms of the integral about its mean.
    """

    correlation: float
    gain: float
    unexplained: float
    moved: float
    due: float


def follows(t_s: Sequence[FloatArray], positions: Sequence[FloatArray], velocities: Sequence[FloatArray]) -> Follows:
    """Compare positions with integrals of velocities (trapezoid rule), each less its mean over its stretch.

    Args:
        t_s: Times of each stretch, each (T,), s.
        positions: At these times, each (T,).
        velocities: At these times, each (T,), per second.
    """
    ways, dues = [np.zeros(1)], [np.zeros(1)]
    for t, position, velocity in zip(t_s, positions, velocities, strict=True):
        due = np.concatenate([[0.0], np.cumsum(np.diff(t) * (velocity[1:] + velocity[:-1]) / 2)])
        ways.append(position - position.mean())
        dues.append(due - due.mean())
    way, due = np.concatenate(ways), np.concatenate(dues)
    ww, dd, wd = float(way @ way), float(due @ due), float(way @ due)
    size = float(np.sqrt(ww) * np.sqrt(dd))
    return Follows(
        correlation=wd / size if size > 0 else 0.0,
        gain=wd / dd if dd > 0 else 0.0,
        unexplained=float(np.sum((way - due) ** 2)) / ww if ww > 0 else float(dd > 0),
        moved=float(np.sqrt(ww / len(way))),
        due=float(np.sqrt(dd / len(due))),
    )


def without_gaps(t_s: FloatArray, positions: FloatArray, velocities: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return positions and velocities without NaN: lines between measured positions, slopes for missing velocities.

    A rough account of a motion, for labels and checks; nothing is fitted to it.

    Args:
        t_s: Times, (T,), s.
        positions: NaN where not measured, (T, K), each somewhere measured.
        velocities: The same per second, (T, K).
    """
    positions, velocities = positions.copy(), velocities.copy()
    for k in range(positions.shape[1]):
        there = np.isfinite(positions[:, k])
        if not there.all():
            positions[:, k] = np.interp(t_s, t_s[there], positions[there, k]) if there.any() else 0.0
        lacking = ~np.isfinite(velocities[:, k])
        if lacking.any():
            velocities[lacking, k] = np.gradient(positions[:, k], t_s)[lacking]
    return positions, velocities


def lone_samples(values: FloatArray) -> list[int]:
    """Return the samples that stand alone: far off both neighbours, to the same side, between which nothing happens.

    A step is none: there one neighbour lies on each side. Of what is rounded, a step of rounding is usual.
    """
    if len(values) < 5:
        return []
    off = np.zeros(len(values))
    off[1:-1] = values[1:-1] - (values[:-2] + values[2:]) / 2
    sizes = np.abs(off[1:-1])
    if not (sizes > 0).any():
        return []
    usual = max(float(np.median(sizes)) / 0.6745, float(sizes[sizes > 0].min()))
    half = np.stack([off[:-2], off[2:]]) / np.where(off[1:-1] == 0, 1.0, off[1:-1])  # of a lone sample: -1/2 and -1/2
    alone = (sizes > LONE * usual) & (np.abs(half + 0.5) < 0.25).all(axis=0)
    return (np.flatnonzero(alone) + 1).tolist()
