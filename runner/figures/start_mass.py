"""Start masses: how the error of the mass falls from each, and where it ends (figs. 13 and 14 of the paper)."""

from __future__ import annotations

import numpy as np

from runner.figures import Drawn, Runs, figure
from runner.figures._look import GREY, INK, ORANGE, canvas, log_error, panels, percent, shades, size, stated, within


@figure("start_mass", "over_time")
def over_time(runs: Runs) -> Drawn:
    """The estimate of the first second that tells something, and its error over the whole run, for each start mass."""
    true_kg = runs.values("mass_true_kg")[0]
    starts, colours = runs.values("mass_start_kg"), shades(len(runs.table))
    page, (left, right) = panels(2, height_in=4.8, width_ratios=[1, 1.5])
    over, at_s = np.zeros(len(starts)), 0.0
    for i, (start, colour) in enumerate(zip(starts, colours, strict=True)):
        frames = runs.frames(i)
        time_s, mass_kg = frames["time_s"].to_numpy(), frames["linear_mass_kg"].to_numpy()
        at_s = at_s or float(time_s[np.flatnonzero(mass_kg != start)[:1]].sum())
        over[i] = mass_kg.max() / true_kg - 1 if start < true_kg else 0.0
        left.step(time_s, mass_kg, where="post", color=colour, label=f"{start:g} kg")
        right.step(time_s, size(frames["linear_mass_error"]), where="post", color=colour, label=f"{start:g} kg")
    left.axhline(true_kg, color=INK, lw=1, zorder=1)
    left.set(
        xlim=(at_s - 0.05, at_s + 0.25),
        xlabel="time [s], first push",
        ylabel="mass [kg]",
        title="estimate, true in black",
    )
    log_error(right)
    stated(right, 2e-4, "paper: 0.02 %")
    right.set(xlabel="time [s]", title="relative error")
    right.legend(title="start mass", ncols=2, loc="center right")
    latest_s = float(runs.values("mass_to_1pct_s").max())  # NaN: not all
    low, other = over[starts < 0.5 * true_kg], over[(starts >= 0.5 * true_kg) & (starts < true_kg)]
    return Drawn(
        page,
        claim="Start masses far too low give a high peak at first; all then come near the true mass.",
        seen=(f"All stay within 1 % from {latest_s:.2f} s on" if latest_s == latest_s else "Not all come within 1 %")
        + f"; starts that are too low first overshoot, by up to {percent(float(over.max()))}.",
        holds=None if not (len(low) and len(other)) else bool(latest_s == latest_s and low.min() > other.max()),
    )


@figure("start_mass", "final_error")
def final_error(runs: Runs) -> Drawn:
    """The error at the end by the start mass."""
    true_kg, starts = runs.values("mass_true_kg")[0], runs.values("mass_start_kg")
    errors, peaks = np.abs(runs.values("mass_final_error")), runs.values("mass_peak_error")
    page, ax = canvas(xlabel="start mass [kg]", ylabel="relative error of the mass")
    ax.axvspan(0, 0.5 * true_kg, color=GREY, alpha=0.12, lw=0)
    ax.text(0.25 * true_kg, 1e-9, "below half\nthe true mass", ha="center", color=GREY)
    ax.plot(starts, size(peaks), "o", mfc="white", color=GREY, label="peak")
    ax.plot(starts, size(errors), "o", color=ORANGE, label="at the end")
    log_error(ax, highest=20)
    ax.set_xlim(0, None)
    stated(ax, 2e-4, "paper: 0.02 % from half the true mass on")
    ax.legend(loc="center right")
    worst, low = (float(errors[which].max(initial=0.0)) for which in (starts >= 0.5 * true_kg, starts < 0.5 * true_kg))
    return Drawn(
        page,
        claim="Start masses of at least 50 % of the true mass end within 0.02 % of it (figs. 13, 14).",
        seen=f"All start masses end at the true mass {within(worst)}."
        if within(low) == within(worst)
        else f"From half the true mass on all end {within(worst)} of it, those below {within(low)}.",
        holds=worst < 2e-4 if (starts >= 0.5 * true_kg).any() else None,
    )
