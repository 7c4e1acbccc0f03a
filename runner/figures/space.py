"""Estimation in space: errors against what is stated over time, and against the Cramer-Rao bound at the end."""

from __future__ import annotations

from typing import Any

import numpy as np

from runner.figures import Drawn, Runs, figure
from runner.figures._look import BAND, BLUE, INK, ORANGE, log_error, panels


@figure("space_held", "bound")
def held(runs: Runs) -> Drawn:
    """All ten, of a body that a hand shakes."""
    return _drawn(runs, "all ten parameters")


@figure("space_tossed", "bound")
def tossed(runs: Runs) -> Drawn:
    """What a flight tells."""
    return _drawn(runs, "centre of mass and shares of the inertia")


def _drawn(runs: Runs, what: str) -> Drawn:
    """Draw errors over time as shares of mass, half size and mean moment, and the last ones by their bound."""
    course, table = runs.parquet(0, "over_time.parquet"), runs.table
    told: Any = table[np.isfinite(table["bound"])]
    page, (left, right) = panels(2, width_in=12.0, width_ratios=[3, 2])
    groups = {"mass": INK, "com": BLUE, "inertia": ORANGE}
    seen: set[str] = set()
    for name, rows in course.groupby("parameter", sort=False):
        group = str(name).split("_")[0]
        label = None if group in seen else {"com": "CoM"}.get(group, group)
        seen.add(group)
        left.plot(rows["time_s"], rows["rmse"], color=groups[group], label=label)
        left.plot(rows["time_s"], rows["stated_sd"], color=groups[group], lw=0.9, ls=(0, (2, 2)))
    log_error(left, lowest=2e-5, highest=3.0)
    left.set(xlabel="time [s]", ylabel="root mean square error (shares)", title="dotted: as stated")
    left.legend(loc="upper right")
    at = np.arange(len(told))
    middle = told["ratio"].to_numpy(float)
    way = np.abs(told[["ratio_low", "ratio_high"]].to_numpy(float).T - middle)
    right.axvspan(0.0, 1.3, color=BAND)
    right.errorbar(middle, at, xerr=way, fmt="o", color=ORANGE, capsize=3)
    right.axvline(1.0, color=INK, lw=1.0)
    right.set_yticks(at, [str(name).removesuffix("_kg_m2").replace("_", " ") for name in told["parameter"]])
    right.invert_yaxis()
    right.set(xlabel="error / Cramer-Rao bound (shaded: wanted)", xlim=(0.6, 1.9))
    return Drawn(
        page,
        seen=f"Over {int(told['seeds'].min())} seeds the errors of {what} end between {middle.min():.2f} and "
        f"{middle.max():.2f} times the Cramer-Rao bound.",
    )
