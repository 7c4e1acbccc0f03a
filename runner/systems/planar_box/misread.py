"""What of a pushed box was read in another unit than it was in, see `runner.systems.misread`."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from runner.numerics.arrays import FloatArray
from runner.systems.channels import Channel
from runner.systems.misread import FEWEST_SAMPLES, WINDOW_S, WINDOWS, in_another_unit, share_missed
from runner.systems.windows import Windows, windows_of

WHAT = {"m": "Positions", "rad": "Headings"}
Replay = Callable[[Sequence[FloatArray], Windows], FloatArray]


def in_other_units(
    channels: Sequence[Channel], values: Sequence[FloatArray], rate_hz: float, replay: Replay
) -> list[str]:
    """Say what of a box's poses the model as believed follows far better if it was read in a wrong unit.

    Args:
        channels: What is measured.
        values: Of each episode, (T, C).
        rate_hz: Samples per second.
        replay: Returns what the model as believed shows in windows, (W, n, C), that begin as such values have it.
    """
    every_window = windows_of([len(v) for v in values], max(FEWEST_SAMPLES, round(WINDOW_S * rate_hz)))
    out = []
    for unit, what in WHAT.items() if len(every_window) else ():
        of_pose = np.array([c.unit == unit for c in channels])
        of_unit = np.array([c.unit.split("/")[0] == unit for c in channels])
        # where it moves most: of a box at rest each window shows noise alone; a sample that was lost is no motion
        shown = every_window.of(values)[..., of_pose]
        moves = np.nan_to_num(np.fmax.reduce(shown, axis=1) - np.fmin.reduce(shown, axis=1)).sum(axis=1)
        windows = every_window.at(np.sort(np.argsort(-moves)[:WINDOWS]))

        def missed(
            factor: float,
            windows: Windows = windows,
            pose: NDArray[np.bool_] = of_pose,
            every: NDArray[np.bool_] = of_unit,
        ) -> float:
            scaled = [v * np.where(every, factor, 1.0) for v in values]
            return share_missed(replay(scaled, windows)[..., pose], windows.of(scaled)[..., pose])

        out += in_another_unit(what, unit, missed)
    return out
