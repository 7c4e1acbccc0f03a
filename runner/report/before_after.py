"""How much is missed before and after, per channel and horizon, in units that read well."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from runner.diagnose.measured import CHANNELS, UNITS

if TYPE_CHECKING:
    from runner.diagnose.diagnosis import Diagnosis

NAMES = {
    "x": "position x",
    "y": "position y",
    "yaw": "heading",
    "vx": "velocity x",
    "vy": "velocity y",
    "wz": "yaw rate",
}
# the unit that a small amount is shown in, and what one SI unit is of it
SMALL = {"m": ("mm", 1e3), "rad": ("°", 180 / math.pi), "m/s": ("mm/s", 1e3), "rad/s": ("°/s", 180 / math.pi)}


@dataclass(frozen=True)
class Miss:
    """Root mean square of what is missed of one channel over one horizon, in `unit`; NaN horizon: whole episodes."""

    channel: str
    unit: str
    horizon_s: float
    before: float
    after: float
    noise: float

    @property
    def name(self) -> str:
        """The channel in words."""
        return NAMES[self.channel]

    @property
    def horizon(self) -> str:
        """The horizon in words."""
        return "whole episode" if math.isnan(self.horizon_s) else f"{self.horizon_s:.3g} s"


def misses(diagnosis: Diagnosis) -> list[Miss]:
    """Return the held-out episodes' misses, by channel, then by horizon, whole episodes last."""
    table = getattr(diagnosis.closure, "table", None)
    if table is None or not len(table):
        return []
    if "horizon_s" not in table:
        table = table.assign(horizon_s=math.nan)
    out = []
    for channel in CHANNELS:
        unit, scale = SMALL[UNITS[CHANNELS.index(channel)]]
        of_channel = table[table["channel"] == channel]
        for horizon, part in of_channel.groupby("horizon_s", dropna=False, sort=True):
            before, after, noise = (scale * _rms(part[c]) for c in ("before", "after", "noise"))
            out.append(Miss(channel, unit, float(horizon), before, after, noise))  # type: ignore[arg-type]
    return out


def longest(diagnosis: Diagnosis) -> list[Miss]:
    """Return the misses at the longest horizon, one per channel."""
    found = misses(diagnosis)
    last = {m.channel: m for m in found}
    return list(last.values())


def _rms(values: pd.Series) -> float:
    return float(np.sqrt(np.nanmean(values.to_numpy(float) ** 2)))
