"""What the estimate owes to the floor, to the push, and to the sensors."""

from __future__ import annotations

import numpy as np
from matplotlib.ticker import FuncFormatter

from runner.figures import Drawn, Runs, figure
from runner.figures._look import GREY, ORANGE, canvas, log_error, percent, size, stated, within

GRAVITY_M_S2 = 9.81


@figure("friction", "by_friction")
def friction(runs: Runs) -> Drawn:
    """Errors by the coefficient of friction."""
    mu = runs.values("remote.friction")
    final, peak = runs.values("mass_final_error"), runs.values("mass_peak_error")
    page, ax = canvas(xlabel="coefficient of friction", ylabel="relative error of the mass")
    ax.plot(mu, size(peak), "o-", mfc="white", color=GREY, label="peak")
    ax.plot(mu, size(runs.values("mass_median_error")), "o-", color=GREY, label="median over the run")
    ax.plot(mu, size(final), "o-", color=ORANGE, label="at the end")
    log_error(ax, highest=20)
    stated(ax, 1e-4, "paper: stable at 0.01 %")
    ax.legend(loc="center right")
    ax.set_xlim(0, None)
    small = mu[np.abs(final) < 1e-9]
    return Drawn(
        page,
        seen=f"Friction helps: with a coefficient of {mu.min():g} the error ends at {percent(abs(final[mu.argmin()]))}"
        + (f", and below 1e-9 from {small.min():g} on." if len(small) else "."),
    )


@figure("force_magnitude", "by_force")
def force_magnitude(runs: Runs) -> Drawn:
    """Errors by the size of the pushes."""
    force_n, final = runs.values("forces.force_n"), runs.values("mass_final_error")
    # the runs' own remote: where its friction begins to hold it
    holds_n = 0.3 * runs.values("mass_true_kg")[0] * GRAVITY_M_S2
    page, ax = canvas(xlabel="push [N]", ylabel="relative error of the mass")
    ax.axvspan(force_n.min() * 0.8, holds_n, color=GREY, alpha=0.12, lw=0)
    ax.text(holds_n * 0.96, 1e-8, "friction\nholds", ha="right", color=GREY)
    ax.plot(force_n, size(runs.values("mass_peak_error")), "o-", mfc="white", color=GREY, label="peak")
    ax.plot(force_n, size(runs.values("mass_median_error")), "o-", color=GREY, label="median over the run")
    ax.plot(force_n, size(final), "o-", color=ORANGE, label="at the end")
    log_error(ax, highest=200)
    ax.set_xscale("log")
    ticks = [4, 6, 8, 10, 15, 20, 30, 50, 100]
    ax.set_xticks(ticks, [str(t) for t in ticks])
    ax.minorticks_off()
    ax.set_xlim(force_n.min() * 0.8, force_n.max() * 1.1)
    ax.legend(loc="center", bbox_to_anchor=(0.45, 0.5))
    moved, held = (np.abs(final[which]).max(initial=0.0) for which in (force_n > holds_n, force_n <= holds_n))
    start = np.abs(runs.values("mass_start_kg") / runs.values("mass_true_kg") - 1).max()
    return Drawn(
        page,
        seen=f"Pushes above what friction holds ({holds_n:.3g} N) end {within(moved)}, best a little above it; "
        "weaker ones tell nothing"
        + (f", or mislead, up to {percent(held)}, where the remote barely moves." if held > start else "."),
    )


@figure("noise", "by_noise")
def noise(runs: Runs) -> Drawn:
    """Errors by the noise of the speeds."""
    sigma, median = runs.values("link.noise.velocity_m_s"), runs.values("mass_median_error")
    sizes = np.unique(sigma[sigma > 0])
    page, ax = canvas(
        xlabel="noise of the measured velocity, standard deviation [mm/s]", ylabel="relative error of the mass"
    )
    for values, colour, name in (
        (np.abs(runs.values("mass_final_error")), GREY, "at the end"),
        (median, ORANGE, "median over the run"),
    ):
        rows = np.array([np.quantile(values[sigma == s], [0.1, 0.5, 0.9]) for s in sizes])
        ax.fill_between(sizes, rows[:, 0], rows[:, 2], color=colour, alpha=0.2, lw=0)
        ax.plot(sizes, rows[:, 1], "o-", color=colour, label=f"{name}: median of the runs, middle 80 %")
    ax.set_xscale("log")
    ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{1e3 * value:g}"))
    ax.minorticks_off()
    log_error(ax, lowest=1e-6, highest=20)
    stated(ax, 1e-4, "paper: stable at 0.01 %")
    ax.legend(loc="upper left")
    final = np.abs(runs.values("mass_final_error"))
    few = sizes[sizes <= 3e-3]  # where errors still grow with the noise
    slope, last = (np.median([np.median(errors[sigma == s]) / s for s in few]) for errors in (median, final))
    exact = final[sigma == 0]
    return Drawn(
        page,
        seen=f"The median error is about {percent(1e-3 * slope)} for each mm/s of noise, the one at the end "
        f"{percent(1e-3 * last)}: to end within 0.01 % takes sensors of {1e-1 / last:.1g} mm/s"
        + (f"; without noise it ends {within(float(exact.max()))}." if len(exact) else "."),
    )
