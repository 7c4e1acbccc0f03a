"""What a missing force goes along with: the direction of motion, speed, place, command, time, or a beat of its own.

Where no known effect explains a recording, this is what tells a reader what to look for. The force that is missing in
short windows is regressed on one shape after another (weighted least squares), each by itself; what is told is the
share of its mean square, less what noise makes of it and less what as many random columns would take, that a shape
accounts for. A beat is a sine of one frequency with a phase of its own in each episode (Lomb 1976).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.special import fdtrc  # of scipy.stats' import every diagnosis would wait for a second

from runner.numerics.arrays import FloatArray
from runner.settings import SETTINGS
from runner.systems.base import AbstractSystem

SHAPES_SHOWN = 2  # of one force
RIDGE = 1e-9  # of a shape's size: shapes that are always the same have none


@dataclass(frozen=True)
class Likeness:
    """What one of the missing forces looks like.

    Args:
        component: Its name, as the system's disturbance has it.
        label: In words, with the unit.
        rms: Its root mean square over windows, less what noise makes of it.
        alike: What it goes along with, in words, and the share of its mean square, largest first.
    """

    component: str
    label: str
    rms: float
    alike: tuple[tuple[str, float], ...]


def likenesses(system: AbstractSystem, missing: pd.DataFrame) -> tuple[Likeness, ...]:
    """Return what the missing forces of windows look like, those first that are large for what acts there.

    Args:
        system: What was recorded; its `force_shapes` are what is tried.
        missing: One row per window, see `Where.missing_force`.
    """
    shapes = system.force_shapes(missing)
    found: list[tuple[float, Likeness]] = []
    names = zip(system.disturbance.names, system.disturbance.labels, system.disturbance.prior, strict=True)
    for name, label, prior in names:
        if name not in shapes:
            continue
        value, error = missing[name].to_numpy(float), missing[f"{name}_se"].to_numpy(float)
        seen = np.isfinite(value) & np.isfinite(error)
        square = float(np.mean(value[seen] ** 2) - np.mean(error[seen] ** 2)) if seen.any() else 0.0
        if seen.sum() < SETTINGS.likeness.min_windows or not square > 0:
            continue
        one = _Force(value[seen], 1.0 / (error[seen] ** 2 + square), missing.loc[seen, ["episode", "t_s"]])
        alike = one.alike({words: columns[seen] for words, columns in shapes[name].items()})
        found.append((square / prior**2, Likeness(name, label, float(np.sqrt(square)), alike)))
    return tuple(likeness for _, likeness in sorted(found, key=lambda f: -f[0]))


@dataclass(frozen=True)
class _Force:
    """A missing force, (n,), with weights, (n,), and when it was missing: `episode`, `t_s`."""

    value: FloatArray
    weight: FloatArray
    when: pd.DataFrame

    def alike(self, shapes: Mapping[str, FloatArray]) -> tuple[tuple[str, float], ...]:
        """Return which shapes it goes along with, and how much of it each accounts for, largest first."""
        shares = {words: self.share(columns) for words, columns in shapes.items()}
        hz, of_beat = self.beat()
        shares[f"a beat of {hz:.3g} Hz"] = of_beat
        told = sorted(((w, s) for w, s in shares.items() if s > SETTINGS.likeness.min_share), key=lambda s: -s[1])
        return tuple(told[:SHAPES_SHOWN])

    def share(self, columns: FloatArray) -> float:
        """Return the share of the mean square that columns (n, k) account for; 0 where that may be chance.

        NaN is where a shape is not defined: it accounts for nothing there.
        """
        x = np.nan_to_num(columns) * np.sqrt(self.weight)[:, None]
        y = self.value * np.sqrt(self.weight)
        size = np.linalg.norm(x, axis=0)
        x = x[:, size > 0] / size[size > 0]
        n, k = x.shape
        if not 0 < k < n:
            return 0.0
        gram = x.T @ x + RIDGE * np.eye(k)
        return _share(float(y @ x @ np.linalg.solve(gram, x.T @ y)), float(y @ y), n, k)

    def beat(self) -> tuple[float, float]:
        """Return the frequency of the sine that accounts for most, in Hz, and its share."""
        numbers = self.when["episode"].astype("category").cat.codes.to_numpy()
        t_s = self.when["t_s"].to_numpy(float)
        between = np.diff(t_s)[np.diff(numbers) == 0]
        between = between[between > 0]
        longest = max((float(np.ptp(t_s[numbers == e])) for e in np.unique(numbers)), default=0.0)
        if not len(between) or not longest > 2 * float(np.median(between)):
            return 0.0, 0.0
        best = (0.0, 0.0)
        for hz in np.geomspace(1.0 / longest, 0.5 / float(np.median(between)), SETTINGS.likeness.frequencies):
            best = max(best, (self._share_of_beat(2 * np.pi * hz * t_s, numbers), float(hz)))
        return best[1], best[0]

    def _share_of_beat(self, angle: FloatArray, numbers: np.ndarray) -> float:
        """Return the share of sine and cosine of an angle (n,), each in every episode by itself.

        Columns of different episodes have nothing in common: their normal equations are pairs, however many there are.
        """
        columns = np.stack([np.sin(angle), np.cos(angle)]) * np.sqrt(self.weight)
        y = self.value * np.sqrt(self.weight)
        size = np.sqrt([np.bincount(numbers, column**2) for column in columns])
        n, k = len(y), int((size > 0).sum())
        if not 0 < k < n:
            return 0.0
        size = np.where(size > 0, size, 1.0)
        right = np.stack([np.bincount(numbers, column * y) for column in columns]) / size
        across = np.bincount(numbers, columns.prod(axis=0)) / size.prod(axis=0)
        along = 1.0 + RIDGE
        taken = (along * (right**2).sum(axis=0) - 2 * across * right.prod(axis=0)) / (along**2 - across**2)
        return _share(float(taken.sum()), float(y @ y), n, k, SETTINGS.likeness.frequencies)


def _share(taken: float, whole: float, n: int, k: int, tried: int = 1) -> float:
    """Return the share of a sum of squares that k columns account for; 0 where that may be chance.

    Args:
        taken: What they take off it.
        whole: The sum, of n values.
        n: How many values.
        k: How many columns.
        tried: How many such shapes were looked through for the best.
    """
    left = max(whole - taken, 1e-300)
    if fdtrc(k, n - k, taken / k / (left / (n - k))) * tried > SETTINGS.likeness.significance:
        return 0.0
    return float(np.clip(1.0 - left / whole * n / (n - k), 0.0, 1.0))
