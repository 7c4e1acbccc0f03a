"""The published run: how the estimate comes about."""

from __future__ import annotations

from runner.figures import Drawn, Runs, figure
from runner.figures._look import GREY, INK, ORANGE, log_error, panels, size, stated, within


@figure("paper", "estimate")
def estimate(runs: Runs) -> Drawn:
    """The mass over time and its relative error, of the first run."""
    frames, row = runs.frames(0), runs.table.iloc[0]
    page, (upper, lower) = panels(1, 2, height_in=5.2, height_ratios=[1, 1.3])
    upper.axhline(row["mass_true_kg"], color=INK, lw=1.2)
    upper.step(frames["time_s"], frames["linear_mass_kg"], where="post", color=ORANGE)
    upper.set_ylabel("mass [kg]")
    pushed = frames[["force_x_n", "force_y_n"]].to_numpy().any(axis=1)
    for ax in (upper, lower):
        ax.fill_between(
            frames["time_s"], 0, 1, where=pushed, transform=ax.get_xaxis_transform(), color=GREY, alpha=0.15
        )
        ax.grid(False)
    lower.step(frames["time_s"], size(frames["linear_mass_error"]), where="post", color=ORANGE)
    log_error(lower)
    stated(lower, 1e-4, "paper: stable at 0.01 %")
    lower.set(xlabel="time [s], pushes shaded", ylabel="relative error")
    final = abs(row["mass_final_error"])
    return Drawn(
        page,
        claim="The error becomes stable at about 0.01 %.",
        seen=f"From {row['mass_start_kg']:g} kg the estimate comes to {row['mass_true_kg']:g} kg {within(final)}.",
        holds=bool(final < 1e-4),
    )
