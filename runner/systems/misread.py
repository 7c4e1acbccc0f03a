"""Numbers that were read in a wrong unit, told by the model.

They are a smaller or a larger motion, which some wrong gain, weight or friction follows as well: a fit can't tell them
apart from a model that is wrong by so much. But nobody's model is wrong by exactly what two units differ by, and right
beside that. So the model as believed is asked what it misses of the motion as it was read, and as it would be in other
units.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping

import numpy as np

from runner.numerics.arrays import FloatArray

UNITS: Mapping[str, Mapping[str, float]] = {
    "rad": {"rad": 1.0, "deg": np.pi / 180, "mrad": 1e-3, "turns": 2 * np.pi},
    "m": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254},
}
WINDOW_S, FEWEST_SAMPLES, WINDOWS = 0.5, 4, 24  # of the motion: as long as gravity and a servo need to show
FOLLOWED = 0.1  # of the motion: what misses less follows it in the units in which it was read
FOLLOWS = 0.3  # of the motion: what misses more does not follow it in others, either
FEWER = 1 / 3  # of what is missed as it was read: what is right leaves a ninth of the squares, or less
NEVER = 1e3  # of the motion: a model that goes astray misses so much and more


def in_another_unit(what: str, unit: str, missed: Callable[[float], float]) -> list[str]:
    """Say whether the model as believed follows the motion far better if its numbers were read in a wrong unit.

    Args:
        what: What numbers they are: "Angles".
        unit: In which they should be.
        missed: What the model misses of the motion, as a share of it, where that is so many times as large.
    """
    as_read = missed(1.0)
    if not as_read > FOLLOWED:
        return []
    better = []
    for read, is_in in itertools.permutations(UNITS[unit], 2):
        factor = UNITS[unit][is_in] / UNITS[unit][read]
        share = missed(factor)
        if share < min(FOLLOWS, FEWER * as_read):
            said = f"{percent(share)} if they are {is_in} that were read as {read}, {factor:.4g} times as large"
            better.append((share, said))
    if not better:
        return []
    return [
        f"{what} may have been read in a wrong unit: within {WINDOW_S:g} s the model as believed misses "
        f"{percent(as_read)} of the motion, and {' or '.join(said for _, said in sorted(better))}"
    ]


def share_missed(shown: FloatArray, measured: FloatArray) -> float:
    """Return what a model misses of the motion in windows, as a share of it: a root mean square over channels.

    Args:
        shown: By the model, (W, n, C).
        measured: (W, n, C), NaN where not measured.

    Returns:
        NaN where nothing moves.
    """
    known = np.isfinite(measured)
    moved = np.where(known, measured - measured[:, :1], 0.0)
    missed = np.where(known, np.nan_to_num(shown - measured, nan=np.inf), 0.0)
    motion = np.sqrt((np.nan_to_num(moved) ** 2).sum(axis=(0, 1)))
    moves = motion > 0
    if not moves.any():
        return np.nan
    with np.errstate(over="ignore"):
        share = np.sqrt((missed**2).sum(axis=(0, 1)))[moves] / motion[moves]
    return float(np.sqrt(np.mean(np.minimum(share, NEVER) ** 2)))


def percent(share: float) -> str:
    """Return a share in words."""
    if share > 100:
        return "far more than all"
    return f"{100 * share:.2g} %" if share < 1 else f"{100 * share:.0f} %"
