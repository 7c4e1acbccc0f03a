"""The noise of a measured force: what was commanded is known, what a sensor shows is not."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion

from runner.numerics.arrays import FloatArray
from runner.numerics.differences import NORMAL_MEDIAN
from runner.settings import SETTINGS

ORDER = 5  # of differences that leave little of what a hand or an arm does, and most of white noise
# Orders of differences that are compared: high ones leave nothing of a force that changes within some samples, and need
# long pushes; neighbouring ones hardly differ for white noise, so that what it is hangs on chance.
ORDERS = ((8, 12), (5, 8), (5, 6))
FEWEST = 60  # differences, from which the two sizes are told to a tenth
CLIPPED = 2.5  # standard deviations: beyond are jumps of a force that begins or ends, and one in eighty of noise
OF_MEANS, OF_SMOOTH = 0.5, 1.5  # powers of cos^2 between those of single samples (0), of means of two (1), and of more
LATER = range(ORDER + 2, ORDER + 22)  # samples; means of two are alike up to one more than their differences


def force_noise(components: Iterable[Iterable[FloatArray]]) -> FloatArray:
    """Return the standard deviation of the noise of each component of a recorded force, in its unit; 0: it shows none.

    That of white noise that is as dense at low frequencies. A force that changes smoothly has none, as its differences
    become less from order to order. Nor has one that is held over some samples, a tone however fast, or what is as
    large as all of the force: a command may be random, a sensor that shows nothing else is not replayed.

    Noise whose density by frequency w falls with cos(w / 2)^(2 p) has (k + 1) / (k + 1 + p) times the variance of white
    noise in differences of the order k + 1 that it has in those of the order k, and from order to order on: p is 0 of
    samples as they are, 1 of means of two, as a line between samples leaves them, and more of what is smooth.

    Args:
        components: Of each the series of every episode, (T,) each, evenly sampled.

    Returns:
        (components,).
    """
    each = [tuple(series) for series in components]
    size = math.sqrt(sum(float(np.mean(np.concatenate([np.zeros(1), *series]) ** 2)) for series in each))
    told = [_told(series, _acting(each, series)) for series in each]
    # components of one sensor have been prepared alike: together they tell better whether as means of two
    p = float(np.mean([one.p for one in told if one is not None] or [0.0]))
    noise = [0.0 if one is None else one.small * (one.of_means if p > OF_MEANS else 1.0) for one in told]
    return np.array([n if n < SETTINGS.forces.most_noise * size else 0.0 for n in noise])


class _Told(NamedTuple):
    """What differences of a component say: their size, how many times that means of two are, and the power `p`."""

    small: float
    of_means: float
    p: float


def _acting(components: Sequence[Sequence[FloatArray]], series: Sequence[FloatArray]) -> list[NDArray[np.bool_]]:
    """Return for each series of a component, (T,), where the force acts, did before and will after.

    A log has zeros where nothing touches, as many as somebody has waited: they are no samples of what a sensor shows.
    The sample beside them is one of a force that has just begun or ended, be it a mean of the line to there.
    """
    alike = all([len(f) for f in other] == [len(f) for f in series] for other in components)
    acts = [np.any([c[k] for c in components] if alike else [f], axis=0) for k, f in enumerate(series)]
    return [binary_erosion(each, border_value=1) if len(each) else each for each in acts]


def pushing_noise(forces: Iterable[FloatArray]) -> FloatArray:
    """Return the noise of the forces that push a box in each episode, (T, 2), N: (2,), N; 0: they were commanded."""
    each = [np.nan_to_num(f) for f in forces]
    noise_n = force_noise([[f[:, axis] for f in each] for axis in (0, 1)])
    largest = max((float(np.abs(f).max(initial=0.0)) for f in each), default=0.0)
    return noise_n if noise_n.max() > SETTINGS.forces.least_noise * largest else np.zeros(2)


def _told(series: Sequence[FloatArray], acting: Sequence[NDArray[np.bool_]]) -> _Told | None:
    """Return what differences of one component say of its noise; None: it has none."""
    pairs = ((order, higher, _differences(series, acting, higher)) for order, higher in ORDERS)
    order, higher, changes = next(p for p in pairs if len(p[2]) >= FEWEST or p[:2] == ORDERS[-1])
    small, smaller = _size(_differences(series, acting, order)), _size(changes)
    if not (small > 0.0 and smaller > 0.0) or _is_held(series) or _is_a_tone(series):
        return None
    fallen = 2.0 * math.log(small / smaller)
    # by a line between what samples as they are and means of two have
    p = fallen / math.log(math.prod((k + 1.0) / k for k in range(order + 1, higher + 1)))
    return None if p > OF_SMOOTH else _Told(small, math.sqrt(2 * order + 2), p)


def _size(differences: FloatArray) -> float:
    """Return the standard deviation of normal values of these sizes, (n,), among which are some of something else."""
    if not len(differences):
        return 0.0
    most = CLIPPED * float(np.median(differences)) / NORMAL_MEDIAN
    inside = differences[differences <= most]
    if not len(inside):
        return 0.0
    # of a normal distribution within so many standard deviations
    density = math.exp(-0.5 * CLIPPED**2) / math.sqrt(2.0 * math.pi)
    variance = 1.0 - 2.0 * CLIPPED * density / math.erf(CLIPPED / math.sqrt(2.0))
    return math.sqrt(float(np.mean(inside**2)) / variance)


def _differences(series: Sequence[FloatArray], acting: Sequence[NDArray[np.bool_]], order: int) -> FloatArray:
    """Return how large differences of an order are while the force acts, (n,), of white noise as large as itself."""
    change = [np.empty(0)]
    for f, acts in zip(series, acting, strict=True):
        if len(f) > order:
            change.append(np.diff(f, order)[sliding_window_view(acts, order + 1).all(axis=1)])
    return np.abs(np.concatenate(change)) / math.sqrt(math.comb(2 * order, order))


def _is_held(series: Sequence[FloatArray]) -> bool:
    """Whether a force mostly stays what it was until the next command comes; where there is none it says nothing."""
    acts = [np.column_stack([f[:-1], np.diff(f)])[f[:-1] != 0.0] for f in series]
    return bool(np.mean(np.concatenate(acts)[:, 1] == 0.0) > SETTINGS.forces.held_share)


def _is_a_tone(series: Sequence[FloatArray]) -> bool:
    """Whether what is left of a force goes on as it did: differences of noise have nothing to do with later ones."""
    parts = [np.diff(f, ORDER) for f in series if len(f) > ORDER + max(LATER)]
    power = sum(float(d @ d) for d in parts)
    alike = [sum(float(d[k:] @ d[:-k]) for d in parts) / power for k in LATER] if power else [0.0]
    return float(np.sqrt(np.mean(np.square(alike)))) > SETTINGS.forces.tone_correlation
