"""Update rates, with updates on physics steps and with a clock of their own (figs. 15 and 16 of the paper)."""

from __future__ import annotations

import numpy as np

from runner.figures import Drawn, Runs, figure
from runner.figures._look import (
    BAND,
    BLUE,
    GREY,
    ORANGE,
    canvas,
    log_error,
    panels,
    percent,
    shades,
    size,
    stated,
    within,
)  # fmt: skip

RATE = "link.rate_hz"


@figure("update_rate", "over_time")
def over_time(runs: Runs) -> Drawn:
    """The error over time at each rate."""
    page, ax = canvas(xlabel="time [s]", ylabel="relative error of the mass", width_in=9.0)
    rates = runs.values(RATE)
    for i, (rate, colour) in enumerate(zip(rates, shades(len(rates)), strict=True)):
        frames = runs.frames(i)
        ax.step(frames["time_s"], size(frames["linear_mass_error"]), where="post", color=colour, label=f"{rate:g} Hz")
    log_error(ax, highest=20)
    stated(ax, 1e-4, "paper: stable at 0.01 %")
    ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    ends = dict(zip(rates.tolist(), np.abs(runs.values("mass_final_error")).tolist(), strict=True))
    good = [rate for rate, error in ends.items() if error < 1e-4]
    bad = ", ".join(f"{rate:g} Hz ({percent(error)})" for rate, error in ends.items() if error >= 1e-4)
    return Drawn(
        page,
        claim="The error becomes stable at about 0.01 %.",
        seen=f"From {min(good):g} Hz on the error falls {within(max(ends[rate] for rate in good))} and stays"
        + (f"; slower updates do not get there: {bad}." if bad else "."),
        holds=ends[60.0] < 1e-4,
    )


@figure("update_rate", "by_rate")
def by_rate(runs: Runs) -> Drawn:
    """How long it takes, by the rate."""
    rates, to_s = runs.values(RATE), runs.values("mass_to_0p01pct_s")
    medians = runs.values("mass_median_error")
    page, (left, right) = panels(2, height_in=4.4)
    left.plot(rates, to_s, "o-", color=ORANGE)
    left.set(title="time until the error stays within 0.01 %", ylabel="time [s]", ylim=(0, None))
    right.plot(rates, size(medians), "o-", color=ORANGE)
    log_error(right, highest=10)
    right.set_title("median error over the run")
    for ax in (left, right):
        ax.set_xscale("log")
        ax.set_xticks(rates, [f"{rate:g}" for rate in rates])
        ax.minorticks_off()
        ax.set_xlabel("updates a second [Hz]")
    missing = [f"{rate:g}" for rate, at in zip(rates, to_s, strict=True) if at != at]
    if missing:
        left.text(0.02, 0.04, f"never at {', '.join(missing)} Hz", transform=left.transAxes, color=GREY)
    at = dict(zip(rates.tolist(), to_s.tolist(), strict=True))
    better = [rate for rate in (30.0, 45.0) if at[rate] < at[60.0]]
    return Drawn(
        page,
        claim="30 and 45 Hz do better than 60 Hz (figs. 15, 16).",
        seen="The more updates the better: within 0.01 % after "
        + ", ".join(f"{at[rate]:.3g} s at {rate:g} Hz" for rate in (30.0, 45.0, 60.0))
        + ".",
        holds=len(better) == 2,
    )


@figure("unfixed_clock", "by_rate")
def unfixed(runs: Runs) -> Drawn:
    """The error by the rate over a physics of 50 Hz, on one machine and on two whose steps do not begin together."""
    rates, phases = runs.values(RATE), runs.values("link.phase")
    page, axes = panels(2, height_in=4.8)
    ticks = np.unique(rates)
    found = np.empty(0)

    def errors_at(rate: float) -> float:
        return float(np.abs(runs.values("mass_final_error"))[(rates == rate) & (phases == 0)][0])

    for ax, column, title in zip(
        axes, ("mass_final_error", "mass_median_error"), ("error at the end", "median error over the run"), strict=True
    ):
        errors = size(runs.values(column))
        two = np.array([errors[(rates == rate) & (phases > 0)] for rate in ticks])
        one = np.array([errors[(rates == rate) & (phases == 0)] for rate in ticks])[:, 0]
        found = two if column == "mass_final_error" else found
        ax.axvline(50, color=BAND, lw=6, zorder=0)
        ax.fill_between(ticks, two.min(axis=1), two.max(axis=1), color=BLUE, alpha=0.18, lw=0)
        ax.plot(ticks, np.median(two, axis=1), "o-", color=BLUE, label="two, median and range")
        ax.plot(ticks, one, "o-", color=ORANGE, label="one machine")
        log_error(ax, highest=50)
        stated(ax, 1e-4, "paper: 0.01 %")
        ax.set_xscale("log")
        ax.set_xticks(ticks, [f"{rate:g}" if rate not in (25, 45, 50) else "" for rate in ticks])
        ax.minorticks_off()
        ax.set(title=title, xlabel="updates a second [Hz], over physics at 50 Hz")
    axes[1].legend(loc="lower left")
    spread: dict[float, np.ndarray] = {float(rate): found[i] for i, rate in enumerate(ticks)}
    worse = int(((spread[60.0] > 1.05 * spread[30.0]) & (spread[60.0] > 1.05 * spread[45.0])).sum())
    typical = float(np.median([spread[rate] for rate in (30.0, 45.0, 60.0)]))
    at_once = errors_at(60.0)
    return Drawn(
        page,
        claim="That 30 and 45 Hz do better than 60 Hz is due to Unity's physics clock of 50 Hz.",
        seen=f"On one machine the clock does no harm: 60 Hz ends {within(at_once)}. On two, 60 Hz ends worse than both "
        f"in {worse} of {len(spread[60.0])} phases, but with errors of {percent(typical)}, not 0.01 %.",
        holds=at_once > max(1e-9, 1.05 * errors_at(30.0), 1.05 * errors_at(45.0)),
    )
