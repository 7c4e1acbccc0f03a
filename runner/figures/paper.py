"""The published run: how the estimate comes about."""

from __future__ import annotations

import numpy as np

from runner.figures import Drawn, Runs, figure
from runner.figures._look import GREY, INK, ORANGE, log_error, panels, shades, size, stated, within

NAMED = 10  # so many curves at most are told apart in a legend


@figure("paper", "estimate")
def estimate(runs: Runs) -> Drawn:
    """The mass over time and its relative error, of every run."""
    starts, true_kg = runs.values("mass_start_kg"), runs.values("mass_true_kg")
    several = len(starts) > 1
    page, (upper, lower) = panels(1, 2, height_in=5.2, height_ratios=[1, 1.3])
    for value in np.unique(true_kg):
        upper.axhline(value, color=INK, lw=1.2)
    for i, colour in enumerate(shades(len(starts)) if several else [ORANGE]):
        frames = runs.frames(i)
        upper.step(frames["time_s"], frames["linear_mass_kg"], where="post", color=colour)
        error = size(frames["linear_mass_error"])
        lower.step(frames["time_s"], error, where="post", color=colour, label=f"{starts[i]:g} kg")
    upper.set_ylabel("mass [kg]")
    first = runs.frames(0)
    pushed = first[["force_x_n", "force_y_n"]].to_numpy().any(axis=1)
    for ax in (upper, lower):
        ax.fill_between(first["time_s"], 0, 1, where=pushed, transform=ax.get_xaxis_transform(), color=GREY, alpha=0.15)
        ax.grid(False)
    log_error(lower)
    stated(lower, 1e-4, "paper: stable at 0.01 %")
    lower.set(xlabel="time [s], pushes shaded", ylabel="relative error")
    if len(np.unique(starts)) > 1 and len(starts) <= NAMED:
        lower.legend(title="start mass", ncols=2, loc="center right")
    final = float(np.abs(runs.values("mass_final_error")).max())
    begun, ends = _between(starts), _between(true_kg)
    return Drawn(
        page,
        claim="The error becomes stable at about 0.01 %.",
        seen=f"From {begun} kg the estimate{' comes' if not several else 's come'} to {ends} kg {within(final)}.",
        holds=bool(final < 1e-4),
    )


def _between(values: np.ndarray) -> str:
    """Return the one value, or the smallest and the largest."""
    low, high = float(values.min()), float(values.max())
    return f"{low:g}" if low == high else f"{low:g} to {high:g}"
