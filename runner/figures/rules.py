"""The linear and the rotational rule on the same motion (figs. 5 to 7 of the paper)."""

from __future__ import annotations

import numpy as np

from runner.figures import Drawn, Runs, figure
from runner.figures._look import BLUE, INK, ORANGE, panels, percent


@figure("linear_vs_rotational", "signed_error")
def signed_error(runs: Runs) -> Drawn:
    """Mean and envelope over the runs of the signed error of both rules, whole and near zero."""
    page, (upper, lower) = panels(1, 2, height_in=5.6, height_ratios=[1, 1.2])
    every = [runs.frames(i) for i in range(len(runs.table))]
    time_s = every[0]["time_s"].to_numpy()
    spread = {}
    for name, colour in (("rotational", BLUE), ("linear", ORANGE)):
        errors = 100 * np.array([frames[f"{name}_mass_error"] for frames in every])  # (runs, updates)
        spread[name] = float(np.abs(errors[:, time_s > 2.5]).max())
        for ax in (upper, lower):
            ax.fill_between(time_s, errors.min(axis=0), errors.max(axis=0), color=colour, alpha=0.22, lw=0)
            ax.plot(time_s, errors.mean(axis=0), color=colour, label=f"{name}: mean and envelope")
    limit = 1.3 * max(spread.values())
    for ax in (upper, lower):
        ax.axhline(0, color=INK, lw=0.8)
        ax.set_ylabel("relative error [%]")
    upper.legend(loc="upper right")
    upper.set_title("whole range")
    lower.set(xlabel="time [s]", ylim=(-limit, limit), title="near zero")
    finals = {name: np.abs(runs.values(f"{name}_mass_median_error")).mean() for name in spread}
    better = min(finals, key=lambda name: finals[name])
    worse = max(finals, key=lambda name: finals[name])
    return Drawn(
        page,
        seen=f"With noise of 1 mm/s and 1 mrad/s over {len(every)} runs the median error over time is "
        f"{percent(finals[better])} with the {better} rule and {percent(finals[worse])} with the {worse} one.",
    )
