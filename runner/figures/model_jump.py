"""The model jump: its size against how far the shown cube is behind."""

from __future__ import annotations

from typing import Any

from runner.figures import Drawn, Runs, figure
from runner.figures._look import BLUE, GREEN, GREY, ORANGE, PURPLE, panels

COLOURS = {"immediate": ORANGE, "rate_limited": BLUE, "blended": GREEN, "free_space": PURPLE, "dead_band": GREY}
JUMPS = (
    ("largest_position_m", "largest jump of position [mm]", 1e3),
    ("largest_velocity_m_s", "largest jump of velocity [m/s]", 1.0),
    ("largest_force_n", "largest jump of force [N]", 1.0),
)
NOTHING_N = 1e-3  # a force of no jump is drawn here


@figure("model_jump", "tradeoff")
def tradeoff(runs: Runs) -> Drawn:
    """Largest jumps against tracking error, while the mass is searched for and after."""
    table: Any = runs.table
    page, axes = panels(3, width_in=12.0)
    for ax, (column, label, factor) in zip(axes, JUMPS, strict=True):
        for policy, rows in table.groupby("policy", sort=False):
            rows = rows.set_index("phase")
            behind = 1e3 * rows["behind_m"]
            jump = factor * rows[column].clip(lower=NOTHING_N / factor if column == "largest_force_n" else 0.0)
            colour = COLOURS.get(str(policy), GREY)
            ax.plot(behind, jump, color=colour, lw=1.0, alpha=0.5)
            ax.plot(behind["search"], jump["search"], "o", mfc="none", color=colour)
            ax.plot(behind["settled"], jump["settled"], "o", color=colour, label=str(policy).replace("_", " "))
        ax.set(xscale="log", yscale="log", xlabel="behind the remote, rms [mm]", ylabel=label)
    axes[2].legend(title="filled: settled, open: search", loc="lower center")
    settled = table[table["phase"] == "settled"].set_index("policy")
    best = settled["behind_m"].idxmin()
    return Drawn(
        page,
        seen=f"Settled, '{str(best).replace('_', ' ')}' is nearest ({1e3 * settled.loc[best, 'behind_m']:.2g} mm) with "
        f"jumps of force below {settled.loc[best, 'largest_force_n']:.2g} N; at once they reach "
        f"{settled.loc['immediate', 'largest_force_n']:.2g} N.",
    )
