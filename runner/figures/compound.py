"""A compound object and one box in its place: the parameters, and the motion under pushes on the floor."""

from __future__ import annotations

from typing import Any

import numpy as np

from runner.figures import Drawn, Runs, figure
from runner.figures._look import GREY, ORANGE, log_error, panels, percent, size


@figure("compound", "fit")
def fit(runs: Runs) -> Drawn:
    """Errors of the ten parameters, and how far the boxes are off under pushes that were not fitted."""
    table: Any = runs.table
    fitted, tested = table[table["parameter"].notna()], table[table["test"].notna()]
    page, (left, right) = panels(2, width_in=12.0)
    names = list(dict.fromkeys(fitted["parameter"]))
    noisy, exact = fitted[fitted["noise"].astype(bool)], fitted[~fitted["noise"].astype(bool)]
    for rows, colour, text in ((noisy, ORANGE, "with noise"), (exact, GREY, "without noise")):
        left.plot([names.index(n) for n in rows["parameter"]], size(rows["error"]), "o", color=colour, label=text)
    log_error(left, highest=1.0)
    left.set_xticks(range(len(names)), [_short(name) for name in names], rotation=45)
    left.set_ylabel("error: of the mass, half size, mean moment")
    left.legend(loc="lower left")
    rows = tested[tested["noise"].astype(bool)] if tested["noise"].astype(bool).any() else tested
    at = np.arange(len(rows))
    right.bar(at - 0.2, 1e3 * rows["start_off_m"], 0.4, color=GREY, label="box as believed")
    right.bar(at + 0.2, 1e3 * rows["fitted_off_m"], 0.4, color=ORANGE, label="box as fitted")
    right.set_yscale("log")
    labels = [f"{test}\ntilts {tilt:.0f}°" for test, tilt in zip(rows["test"], rows["tilt_deg"], strict=True)]
    right.set_xticks(at, labels)
    right.set_ylabel("largest distance from the object [mm]")
    right.set_title("pushes on the floor, not fitted")
    right.set_ylim(top=1e5)  # room for the legend
    right.legend(loc="upper center", ncols=2)
    worst = noisy["error"].abs().max() if len(noisy) else exact["error"].abs().max()
    rocked = rows["tilt_deg"] < 45
    off, tumbled = 1e3 * rows["fitted_off_m"][rocked].max(), 1e3 * rows["fitted_off_m"].max()
    return Drawn(
        page,
        seen=f"All ten parameters are within {percent(worst)}. On the floor the box is within {off:.2g} mm; "
        f"where it falls over, within {tumbled:.0f} mm.",
    )


def _short(name: str) -> str:
    what, axis = name.split("_")[:2]
    return {"mass": "mass", "com": f"CoM {axis}", "inertia": f"I {axis}"}[what]
