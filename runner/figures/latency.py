"""Late, jittered and lost messages: whether the estimate is biased."""

from __future__ import annotations

from typing import Any

import numpy as np

from runner.figures import Drawn, Runs, figure
from runner.figures._look import BAND, BLUE, INK, ORANGE, log_error, panels, size

UNBIASED = 0.2  # standard errors


@figure("latency", "bias")
def bias(runs: Runs) -> Drawn:
    """Bias of every parameter in standard errors, and the rule that does not know of the delay."""
    table: Any = runs.table
    joint, rule = table[table["estimator"] == "joint"], table[table["estimator"] != "joint"]
    page, (left, right) = panels(2, width_in=11.0, width_ratios=[3, 2])
    delays = sorted(joint["delay_s"].unique())
    names = list(dict.fromkeys(joint["parameter"]))
    left.axhspan(-UNBIASED, UNBIASED, color=BAND)
    left.axhline(0.0, color=INK, lw=1.0)
    for i, delay in enumerate(delays):
        rows = joint[joint["delay_s"] == delay].set_index("parameter").loc[names]
        middle = rows["bias_per_se"].to_numpy()
        way = np.abs(rows[["bias_per_se_low", "bias_per_se_high"]].to_numpy().T - middle)
        at = np.arange(len(names)) + 0.16 * (i - (len(delays) - 1) / 2)
        colour = (ORANGE, BLUE, INK)[i % 3]
        left.errorbar(at, middle, way, fmt="o", color=colour, capsize=3, label=f"{1e3 * delay:g} ms late")
    left.set_xticks(range(len(names)), [name.replace("_", " ").replace("com", "CoM") for name in names])
    left.set(ylabel="bias, in standard errors of one run", ylim=(-0.3, 0.3))
    left.set_title("with noise: all parameters, shaded: a fifth of a standard error")
    left.legend(loc="upper right")
    for aware, colour, text in ((True, ORANGE, "compared as of its sending"), (False, INK, "taken for the present")):
        rows = rule[rule["aware"].astype(bool) == aware]
        right.plot(1e3 * rows["delay_s"], size(rows["largest_error"]), "o-", color=colour, label=text)
    log_error(right, highest=10.0)
    right.set_xticks([1e3 * delay for delay in delays])
    right.set(xlabel="delay [ms]", ylabel="largest relative error of the mass")
    right.set_title("without noise: the published rule in the closed loop")
    right.legend(loc="center right")
    worst, loss, seeds = joint["bias_per_se"].abs().max(), joint["loss"].iloc[0], int(joint["seeds"].min())
    return Drawn(
        page,
        seen=f"With {100 * loss:.0f} % lost the largest of {len(joint)} biases is {worst:.2g} standard errors "
        f"({seeds} pairs of runs with opposite noise; bars: 95 %).",
    )
