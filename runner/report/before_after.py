"""How much is missed before and after, per channel and horizon, in units that read well."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from runner.noise.measured import CHANNELS, UNITS
from runner.report.motions import GRID
from runner.simulate.gap import measure_gap
from runner.systems.planar_box.simulator import Simulator

if TYPE_CHECKING:
    from runner.diagnosis.pipeline import Diagnosis

NAMES = {
    "x": "position x",
    "y": "position y",
    "yaw": "heading",
    "vx": "velocity x",
    "vy": "velocity y",
    "wz": "yaw rate",
}
HORIZONS_S = (0.1, 0.5, 1.0, 2.0)
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
    """Return the held-out episodes' misses, by channel, then by horizon, whole episodes last.

    The model starts anew every so many seconds; its start states are fitted to the window that follows.
    """
    simulator = Simulator(diagnosis.recording, grid=GRID)
    shortest = min(float(diagnosis.recording.episodes[e].t_s[-1]) for e in diagnosis.held_out)
    begins = min(float(diagnosis.recording.episodes[e].t_s[0]) for e in diagnosis.held_out)
    horizons = [h for h in HORIZONS_S if h < shortest - begins]
    tables = []
    for effects in ((), tuple(diagnosis.effects)):
        gap = measure_gap(
            simulator, diagnosis.measured, effects=effects, horizons_s=horizons, episodes=diagnosis.held_out
        )
        tables.append(gap.table[gap.table["starts"] == "fitted"].set_index(["channel", "horizon"]))
    before, after = tables
    at_last = {m.channel: m for m in whole(diagnosis)}
    out = []
    for channel in CHANNELS:
        unit, scale = SMALL[UNITS[CHANNELS.index(channel)]]
        for horizon in horizons:
            key = (channel, f"{horizon:g} s")
            values = (before.loc[key, "rms"], after.loc[key, "rms"], before.loc[key, "noise"])
            out.append(Miss(channel, unit, horizon, *(scale * float(v) for v in values)))  # type: ignore[arg-type]
        out += [at_last[channel]] if channel in at_last else []
    return out


def whole(diagnosis: Diagnosis) -> list[Miss]:
    """Return the misses over whole held-out episodes, one per channel, as the verdict has them."""
    out = []
    for channel in CHANNELS:
        unit, scale = SMALL[UNITS[CHANNELS.index(channel)]]
        part = diagnosis.closure.table[diagnosis.closure.table["channel"] == channel]
        if len(part):
            out.append(Miss(channel, unit, math.nan, *(scale * _rms(part[c]) for c in ("before", "after", "noise"))))
    return out


def _rms(values: ArrayLike) -> float:
    return float(np.sqrt(np.nanmean(np.asarray(values, float) ** 2)))
