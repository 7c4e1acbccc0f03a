"""What a model misses in each regime, with and without effects in it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from runner.effects.base import Effects
from runner.localise.excess import window_excess
from runner.localise.linearised import Model
from runner.localise.windows import windows_of_length
from runner.noise.measured import Measured
from runner.systems.base import AbstractSystem


def closure_by_regime(
    system: AbstractSystem, measured: Measured, episodes: Sequence[int], effects: Effects, window_s: float
) -> pd.DataFrame:
    """Return what a model misses in each regime before and after effects are added to it.

    Args:
        system: What was recorded.
        measured: Its channels and their noise.
        episodes: Those that count, by their position.
        effects: What is added.
        window_s: Length of the windows.

    Returns:
        `regime`, `windows`, and `before` and `after`: mean square of the slow residual over what noise makes of it
        (1: nothing but noise), as in `runner.localise.excess`. Of regimes that occur only.
    """
    windows = windows_of_length(system, window_s, sorted(episodes))
    if not len(windows):
        return pd.DataFrame(columns=["regime", "windows", "before", "after"])
    simulator = system.simulator()
    shown = [
        window_excess(Model(system, simulator, e), windows, measured, np.ones(len(system.channels)))
        for e in ((), effects)
    ]
    regime = shown[0].labels.table["regime"].to_numpy()
    rows = []
    for name in system.regimes:
        here = regime == name
        if here.any():
            ratios = [1.0 + float(k.excess[here].sum()) / max(float(k.freedom[here].sum()), 1e-9) for k in shown]
            rows.append({"regime": name, "windows": int(here.sum()), "before": ratios[0], "after": ratios[1]})
    return pd.DataFrame(rows)
