"""How much is missed before and after, per channel and horizon, in units that read well."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from runner.effects.wording import change, length, number, small_unit
from runner.simulate.gap import measure_gap, of_a_sample
from runner.systems.channels import Channel
from runner.systems.recorded import longest_part_s

if TYPE_CHECKING:
    from runner.diagnosis.result import Diagnosis

SHOWN_HORIZONS_S = (0.1, 0.5, 1.0, 2.0)


@dataclass(frozen=True)
class Miss:
    """Root mean square of what is missed of one channel over one horizon, in `unit`.

    NaN horizon: whole episodes, or where these are replayed in parts, those, the longest of which lasts `part_s`.
    """

    channel: Channel
    unit: str
    horizon_s: float
    before: float
    after: float
    noise: float
    part_s: float | None = None

    @property
    def title(self) -> str:
        """The channel in words, with the unit."""
        return f"{self.channel.label} [{self.unit}]" if self.unit else self.channel.label

    @property
    def horizon(self) -> str:
        """The horizon in words."""
        if math.isnan(self.horizon_s):
            return "whole episode" if self.part_s is None else f"parts of {self.part_s:.2g} s"
        return f"{self.horizon_s:.3g} s"


def misses(diagnosis: Diagnosis) -> list[Miss]:
    """Return the held-out episodes' misses, by channel, then by horizon, whole episodes last.

    The model starts anew every so many seconds; its start states are fitted to the window that follows. Where episodes
    were replayed in parts, over longer times than those nothing is to be foreseen, and nothing is claimed.
    """
    shortest = min(float(diagnosis.recording.episodes[e].t_s[-1]) for e in diagnosis.held_out)
    begins = min(float(diagnosis.recording.episodes[e].t_s[0]) for e in diagnosis.held_out)
    longest_s = min(shortest - begins, longest_part_s(diagnosis.recording, diagnosis.stretches) or math.inf)
    horizons = [h for h in of_a_sample(SHOWN_HORIZONS_S, diagnosis.system.rate_hz) if h < longest_s]
    tables = []
    for effects in ((), tuple(diagnosis.effects)):
        gap = measure_gap(
            diagnosis.system,
            diagnosis.measured,
            effects=effects,
            horizons_s=horizons,
            episodes=diagnosis.held_out,
            whole_episodes=False,
        )
        tables.append(gap.table[gap.table["starts"] == "fitted"].set_index(["channel", "horizon"]))
    before, after = tables
    at_last = {m.channel.name: m for m in of_whole_episodes(diagnosis)}
    out = []
    for channel in diagnosis.system.channels:
        unit, scale = small_unit(channel.unit)
        for horizon in horizons:
            key = (channel.name, f"{horizon:g} s")
            values = (before.loc[key, "rms"], after.loc[key, "rms"], before.loc[key, "noise"])
            if not np.isnan(float(values[0])):  # over less than it takes to settle nothing is told of a force
                out.append(Miss(channel, unit, horizon, *(scale * float(v) for v in values)))
        out += [at_last[channel.name]] if channel.name in at_last else []
    return out


def of_whole_episodes(diagnosis: Diagnosis) -> list[Miss]:
    """Return the misses over whole held-out episodes, one per channel, as the verdict has them."""
    out, part_s = [], longest_part_s(diagnosis.recording, diagnosis.stretches)
    table = diagnosis.closure.table
    named = table["channel"].to_numpy()
    values = {c: table[c].to_numpy(float) for c in ("before", "after", "noise")}
    for channel in diagnosis.system.channels:
        unit, scale = small_unit(channel.unit)
        there = named == channel.name
        if there.any():
            before, after, noise = (scale * _rms(of[there]) for of in values.values())
            out.append(Miss(channel, unit, math.nan, before, after, noise, part_s))
    return out


def headline_miss(diagnosis: Diagnosis) -> tuple[str, str] | None:
    """Return what is missed of where things are: of which sensor, and how much, before and after.

    On a map the distance; otherwise all channels of the sensor that is missed most, root of the mean square.
    """
    found = of_whole_episodes(diagnosis)
    system = diagnosis.system
    flat = () if system.plan_view is None else tuple(system.channels[i] for i in system.plan_view)
    if not found:
        return None
    group = flat[0].group if flat else max(found, key=lambda m: m.before / m.noise).channel.group
    part = [m for m in found if (m.channel in flat if flat else m.channel.group == group)]
    count = 1 if flat else len(part)
    before, after = (float(np.sqrt(sum(getattr(m, k) ** 2 for m in part) / count)) for k in ("before", "after"))
    if part[0].channel.unit == "m":
        text = change(1e-3 * before, 1e-3 * after) if diagnosis.effects else length(1e-3 * before)
    else:
        tail = part[0].unit if part[0].unit.startswith("°") else f" {part[0].unit}"
        text = f"{number(before, 2)} → {number(after, 2)}{tail}" if diagnosis.effects else f"{number(before, 2)}{tail}"
    return group, text


def _rms(values: ArrayLike) -> float:
    squares = np.asarray(values, float) ** 2
    # of numbers that are all there nanmean is the mean, and takes ten times as long
    return float(np.sqrt(np.nanmean(squares) if np.isnan(squares).any() else squares.mean()))
