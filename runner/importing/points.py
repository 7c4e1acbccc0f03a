"""Where a force acts while there is none: logs leave that empty, and it makes no difference, but every row needs one.

A contact that is to come is told by its own point: a row that holds the mean of the line to the next sample has a part
of the force that comes, and a lost sample at the begin of a push is held from the one before it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from runner.importing.episodes import Series
from runner.importing.signals import Integers
from runner.importing.told import Told
from runner.recording.force_noise import force_noise
from runner.settings import SETTINGS


def with_points(series: Sequence[Series], told: Told) -> list[Series]:
    """Return the series of an episode, of points those that are empty where nothing pushes filled in.

    There the next point is taken, after the last one that, and of an episode without any the middle of the body. What
    is empty while a force acts stays so: then it was lost.

    Args:
        series: Of an episode, in order of arrival.
        told: What was done.
    """
    by_column = {one.entry.column: one for one in series}
    return [_filled(one, [by_column[c] for c in one.entry.acts if c in by_column], told) for one in series]


def _filled(point: Series, force: Sequence[Series], told: Told) -> Series:
    order = np.argsort(point.t_ns, kind="stable")
    values = point.values[order]
    there = np.isfinite(values)
    if there.all() or not force or not all(len(one.t_ns) for one in force):
        return point
    free = ~there & _is_none(force, point.t_ns[order])
    known = np.flatnonzero(there)
    if len(known):
        after = np.minimum(np.searchsorted(known, np.flatnonzero(free)), len(known) - 1)
        values[free] = values[known[after]]
    else:
        values[free] = 0.0
    said = "{names}: empty in {n} samples in which no force acts; the next place is taken, which pushes nothing"
    told.add(said, int(free.sum()), column=point.entry.column)
    filled = point.values.copy()
    filled[order] = values
    return replace(point, values=filled)


def _is_none(force: Sequence[Series], t_ns: Integers) -> NDArray[np.bool_]:
    """Return at which times, (T,), a force is nothing but the noise of its sensor; a commanded one is zero then."""
    held, known = [], []
    for one in force:
        order = np.argsort(one.t_ns, kind="stable")
        values = one.values[order]
        at = np.searchsorted(one.t_ns[order], t_ns, side="right") - 1
        held.append(values[np.maximum(at, 0)])
        known.append([values[np.isfinite(values)]])
    size = np.linalg.norm(held, axis=0)
    return np.isfinite(size) & (size <= SETTINGS.noise.outlier_sigmas * float(force_noise(known).max()))
