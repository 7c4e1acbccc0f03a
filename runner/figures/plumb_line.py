"""The plumb line: how near the crossing is to the centre of mass."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.ticker import MaxNLocator

from runner.figures import Drawn, Runs, figure
from runner.figures._look import BLUE, INK, ORANGE, canvas

WANTED_MM = 1.0


@figure("plumb_line", "error")
def error(runs: Runs) -> Drawn:
    """Distance of every body's crossing from its true centre of mass."""
    table: Any = runs.table
    page, ax = canvas(
        xlabel="bodies, each series in order of its errors", ylabel="distance from the true centre of mass [mm]"
    )
    for points, colour in ((2, BLUE), (3, ORANGE)):
        rows = table[table["points"] == points]
        for column, marker, text in (
            ("error_mm", "o", "measured with noise"),
            ("error_without_noise_mm", "x", "without noise"),
        ):
            values = np.sort(rows[column].to_numpy())
            ax.plot(np.arange(1, len(values) + 1), values, marker, color=colour, label=f"{points} points, {text}")
    ax.axhline(WANTED_MM, color=INK, lw=1.0, ls=(0, (5, 3)))
    ax.set_yscale("log")
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    ax.legend(loc="center right")
    worst = table.groupby("points")["error_mm"].max()
    return Drawn(
        page,
        seen=f"Worst of {table['object'].nunique()} bodies: {worst.loc[2]:.2g} mm from two points, "
        f"{worst.loc[3]:.2g} mm from three; dashed: 1 mm.",
    )
