"""Update rates, with updates on physics steps and with a clock of their own (figs. 15 and 16 of the paper)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from runner.errors import ResultError
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
LAST_DIGITS = 1e-12  # errors below come of rounding
WORSE = 1.05  # times, from which on it counts


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
    at_60 = np.abs(runs.at(RATE, 60.0).values("mass_final_error")).max()
    good = [rate for rate, error in ends.items() if error < 1e-4]
    bad = ", ".join(f"{rate:g} Hz ({percent(error)})" for rate, error in ends.items() if error >= 1e-4)
    return Drawn(
        page,
        claim="The error becomes stable at about 0.01 %.",
        seen=(f"From {min(good):g} Hz on the error ends {within(max(ends[r] for r in good))}; " if good else "")
        + (f"not within 0.01 %: {bad}." if bad else "none ends above 0.01 %."),
        holds=bool(at_60 < 1e-4),
    )


@figure("update_rate", "by_rate")
def by_rate(runs: Runs) -> Drawn:
    """How long it takes, by the rate, and how 30 and 45 Hz compare with 60 Hz."""
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
        ax.set_xlim(0.9 * rates.min(), 1.1 * rates.max())
        ax.set_xticks(rates, [f"{rate:g}" for rate in rates])
        ax.minorticks_off()
        ax.set_xlabel("updates a second [Hz]")
    missing = [f"{rate:g}" for rate, at in zip(rates, to_s, strict=True) if at != at]
    if missing:
        left.text(0.02, 0.04, f"never at {', '.join(missing)} Hz", transform=left.transAxes, color=GREY)
    at_30, at_45 = _against(runs, (30.0, 45.0), 60.0)
    return Drawn(
        page,
        claim="30 and 45 Hz do better than 60 Hz (figs. 15, 16).",
        seen=f"While the error falls it is {at_30:.2g} times that of 60 Hz at 30 Hz, and {at_45:.2g} times at 45 Hz "
        "(geometric means over the moments at which all three update).",
        holds=at_30 < 1.0 and at_45 < 1.0,
    )


def _against(runs: Runs, rates: Sequence[float], other: float) -> list[float]:
    """Return how many times the error of another rate each of some has, from the first update to the last digits."""
    errors = {}
    for rate in (*rates, other):
        frames = runs.at(RATE, rate).frames(0)
        errors[rate] = pd.Series(np.abs(frames["linear_mass_error"].to_numpy()), frames["time_s"].round(6))
    together = pd.DataFrame(errors).dropna()
    telling = together[(together < together.iloc[0]).all(axis=1) & (together > LAST_DIGITS).all(axis=1)]
    if telling.empty:
        raise ResultError(f"paths: the runs of '{runs.experiment}' learn nothing at once at {other:g} Hz and others.")
    return [float(np.exp(np.log(telling[rate] / telling[other]).mean())) for rate in rates]


@figure("unfixed_clock", "by_rate")
def unfixed(runs: Runs) -> Drawn:
    """The error by the rate over a physics of 50 Hz, on one machine and on two whose steps do not begin together."""
    rates, two = runs.values(RATE), runs.values("link.phase") > 0
    page, axes = panels(2, height_in=4.8)
    ticks = np.unique(rates)
    for ax, column, title in zip(
        axes, ("mass_final_error", "mass_median_error"), ("error at the end", "median error over the run"), strict=True
    ):
        errors = size(runs.values(column))
        ax.axvline(50, color=BAND, lw=6, zorder=0)
        ax.plot(rates[two], errors[two], "o", color=BLUE, ms=5, alpha=0.3, mew=0, label="two machines, each phase")
        middle = pd.Series(errors[two]).groupby(rates[two]).median()
        ax.plot(middle.index, middle, "_", color=BLUE, ms=13, mew=2, label="median of the phases")
        ax.plot(rates[~two], errors[~two], "o-", color=ORANGE, label="one machine")
        log_error(ax, highest=50)
        stated(ax, 1e-4, "paper: 0.01 %", right_end=0.62)
        ax.set_xscale("log")
        ax.set_xticks(ticks, [f"{rate:g}" if rate not in (25, 45, 50) else "" for rate in ticks])
        ax.minorticks_off()
        ax.set(title=title, xlabel="updates a second [Hz], over physics at 50 Hz")
    axes[1].legend(loc="lower left")
    final = {rate: _by_phase(runs.at(RATE, rate)) for rate in (30.0, 45.0, 60.0)}
    phases = set.intersection(*(set(at) for at in final.values())) - {0.0}
    if not phases:
        raise ResultError(f"paths: no runs of '{runs.experiment}' at 30, 45 and 60 Hz with one link.phase above 0.")
    at_30, at_45 = _against(runs.at("link.phase", 0.0), (30.0, 45.0), 60.0)
    worse = [p for p in phases if final[60.0][p] > max(LAST_DIGITS, WORSE * final[30.0][p], WORSE * final[45.0][p])]
    typical = float(np.median([at[p] for at in final.values() for p in phases]))
    alone, apart = max(at_30, at_45) < 1 / WORSE, 2 * len(worse) > len(phases)
    return Drawn(
        page,
        claim="That 30 and 45 Hz do better than 60 Hz is due to Unity's physics clock of 50 Hz.",
        seen=f"On one machine 30 and 45 Hz have {at_30:.2g} and {at_45:.2g} times the error of 60 Hz while it falls; "
        f"all end {within(max(at[0.0] for at in final.values()))}. On two, 60 Hz ends worse than both in "
        f"{len(worse)} of {len(phases)} phases, with errors of {percent(typical)}, not 0.01 %.",
        holds=alone if alone == apart else None,
    )


def _by_phase(runs: Runs) -> dict[float, float]:
    """Return the error at the end by the phase of the two clocks, 0: one machine."""
    return dict(zip(runs.values("link.phase").tolist(), np.abs(runs.values("mass_final_error")).tolist(), strict=True))
