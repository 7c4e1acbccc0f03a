"""Unit and upward axis of a log's positions by how a body falls: nothing else moves at 9.81 m/s2 all the time.

Over short windows of a flight the second derivative of the position is gravity. Its size in the log's numbers tells
their unit, its direction which axis points down.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from runner.importing.units import UNITS
from runner.numerics.arrays import FloatArray

# as long as noise asks for, and as short as flights of what is tossed low are; samples that tell a curvature from noise
WINDOWS_S, FEWEST_FALLING = (0.1, 0.06), 5
EVEN = 0.1  # of a step: how unevenly a window may be sampled
NEAR = 0.15  # of gravity: how far off a window in flight may be, by noise, spin of a marker, drag
WINDOWS = 5  # that agree, and
SHARE = 0.05  # of all: an accident of pushes and impacts is rarer
# by which units that are mixed up differ: of lengths, and of a clock that counts thousandths, squared
WRONG_SCALES = (1e3, 1e-3, 1e2, 1e-2, 10.0, 0.1, 1e6, 1e-6, 0.0254, 1 / 0.0254, 0.3048, 1 / 0.3048)


@dataclass(frozen=True)
class Fall:
    """How a body falls: the unit of its positions, the axis that points up, and the acceleration, m/s2."""

    unit: str
    up: str
    acceleration_m_s2: float


def falls(times_s: FloatArray, places: FloatArray, gravity_m_s2: float) -> Fall | None:
    """Return unit and upward axis (y or z) of positions, or None where nothing falls.

    Args:
        times_s: (T,), s.
        places: In the log's unit, (T, 3), NaN where not measured.
        gravity_m_s2: That is believed.
    """
    if not np.isfinite(gravity_m_s2) or gravity_m_s2 <= 0:
        return None
    best: tuple[int, Fall] | None = None
    for curved in _accelerations(times_s, places):
        for unit in ("m", "cm", "mm", "in"):
            for axis, up in ((1, "y"), (2, "z")):
                expected = np.zeros(3)
                expected[axis] = -gravity_m_s2
                si = curved * UNITS["m"][unit]
                near = _in_flight(si, expected)
                count = int(near.sum())
                if count and (best is None or count > best[0]):
                    best = count, Fall(unit, up, -float(np.median(si[near, axis])))
        if best is not None:
            break
    return None if best is None else best[1]


def falls_otherwise(times_s: FloatArray, places_m: FloatArray, gravity_m_s2: FloatArray) -> str:
    """Say how a body falls that does not fall as the model's gravity has it: by another unit, or another way; else "".

    Args:
        times_s: (T,), s; where an episode follows another, time falls back.
        places_m: As they were understood, (T, 3), m, world axes, NaN where not measured.
        gravity_m_s2: That is believed, (3,).
    """
    size = float(np.linalg.norm(gravity_m_s2))
    each = _accelerations(times_s, places_m)
    if not size > 0 or any(_in_flight(curved, gravity_m_s2).any() for curved in each):
        return ""
    for curved, times in ((c, s) for c in each for s in WRONG_SCALES):
        if _in_flight(times * curved, gravity_m_s2).any():
            return f"falls with {size / times:.3g} m/s2, where the model's gravity is {size:.3g}"
    for curved, axis, sign in ((c, a, s) for c in each for s in (-1.0, 1.0) for a in range(3)):
        if _in_flight(curved, sign * size * np.eye(3)[axis]).any():
            way = f"{'-' if sign < 0 else '+'}{'xyz'[axis]}"
            believed = ", ".join(f"{g:.3g}" for g in gravity_m_s2)
            return f"falls along {way} of the case's world, where the model's gravity is ({believed}) m/s2"
    return ""


def _in_flight(curved_m_s2: FloatArray, gravity_m_s2: FloatArray) -> NDArray[np.bool_]:
    """Return which accelerations (W, 3) are that of gravity (3,), (W,); none where few are, as by accident."""
    near = np.linalg.norm(curved_m_s2 - gravity_m_s2, axis=1) < NEAR * np.linalg.norm(gravity_m_s2)
    return near & (int(near.sum()) >= max(WINDOWS, SHARE * len(near)))


def _accelerations(times_s: FloatArray, places: FloatArray) -> list[FloatArray]:
    """Return second derivatives over windows that follow each other, (W, 3), in the log's unit per s2.

    For each length of a window, the longest first; none where there are no such windows.
    """
    steps = np.diff(times_s)
    rising = steps[steps > 0]
    if not len(rising):
        return []
    step = float(np.median(rising))
    counts = dict.fromkeys(max(FEWEST_FALLING, round(window_s / step)) for window_s in WINDOWS_S)
    return [_curved(steps, places, step, count) for count in counts if len(times_s) >= count]


def _curved(steps_s: FloatArray, places: FloatArray, step_s: float, count: int) -> FloatArray:
    """Return second derivatives over windows of so many samples that are evenly sampled and measured, (W, 3)."""
    windows = np.lib.stride_tricks.sliding_window_view(places, count, axis=0)  # (W, 3, count)
    even = np.lib.stride_tricks.sliding_window_view(np.abs(steps_s - step_s) < EVEN * step_s, count - 1).all(axis=1)
    whole = even & np.isfinite(windows).all(axis=(1, 2))
    at = (np.arange(count) - (count - 1) / 2) * step_s
    square = at**2 - np.mean(at**2)  # orthogonal to a line, so that its share is the curvature alone
    return 2 * windows[whole] @ square / float(square @ square)
