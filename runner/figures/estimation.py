"""Estimating all parameters: convergence, error against the bound, intervals, calibration, and eq. 6."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes

from runner.figures import Drawn, Runs, figure
from runner.figures._look import BAND, BLUE, GREY, INK, ORANGE, SERIES, log_error, panels, percent

PARAMETERS = {"mass": "mass", "com_x": "CoM x", "com_y": "CoM y", "yaw_inertia": "yaw inertia", "friction": "friction"}
COLOURS = dict(zip(PARAMETERS, SERIES, strict=False))


def _over_time(runs: Runs, name: str = "over_time.parquet") -> Any:
    return runs.parquet(0, name)


def _wanted(ax: Axes, value: float, text: str) -> None:
    """Draw what is wanted as a level line."""
    ax.axhline(value, color=INK, lw=1.0, ls=(0, (5, 3)))
    ax.annotate(
        text, (1.0, value), xycoords=("axes fraction", "data"), xytext=(0, -3), textcoords="offset points", ha="right",
        va="top", fontsize=9,
    )  # fmt: skip


@figure("joint_ideal", "errors")
def ideal(runs: Runs) -> Drawn:
    """The largest error of any start over time, without noise."""
    course = _over_time(runs)
    page, (ax,) = panels(1, width_in=9.0)
    for name, label in PARAMETERS.items():
        worst = course[f"{name}_error"].abs().groupby(course["time_s"]).max()
        ax.plot(worst.index, np.maximum(worst, 1e-12), color=COLOURS[name], label=label)
    table: Any = runs.table
    joint = table[table["estimator"] == "joint"]
    _wanted(ax, 1e-3, "wanted: 0.1 %")
    log_error(ax, lowest=1e-10, highest=30.0)
    ax.set(xlabel="time [s]", ylabel=f"largest error of {len(joint)} starts (CoM: of the half size)")
    ax.legend(loc="upper right", ncols=3)
    last = max(float(joint[f"{name}_final_error"].abs().max()) for name in PARAMETERS)
    since = float(joint["all_to_0p1pct_s"].max())
    return Drawn(
        page,
        seen=f"From {len(joint)} starts a factor of two off, all five parameters are within 0.1 % from {since:.2f} s "
        f"on, and end within {percent(last)}.",
    )


@figure("joint_noise", "bound")
def noise(runs: Runs) -> Drawn:
    """Root mean square errors over time against the Cramer-Rao bound, for each size of noise."""
    course = _over_time(runs)
    table: Any = runs.table
    sizes = sorted(course["noise_times"].unique())
    page, axes = panels(len(sizes) + 1, width_in=13.0, width_ratios=[3] * len(sizes) + [2])
    for ax, factor in zip(axes, sizes, strict=False):
        for name, label in PARAMETERS.items():
            rows = course[(course["noise_times"] == factor) & (course["parameter"] == name)]
            ax.plot(rows["time_s"], rows["rmse"], color=COLOURS[name], label=label)
            ax.plot(rows["time_s"], rows["bound"], color=COLOURS[name], lw=0.9, ls=(0, (2, 2)))
        rows = course[(course["noise_times"] == factor) & (course["parameter"] == "mass")]
        ax.plot(rows["time_s"], rows["published_rmse"], color=INK, lw=1.2, label="mass, published rule")
        log_error(ax, lowest=2e-5, highest=30.0)
        ax.set(xlabel="time [s]", ylabel="root mean square error (CoM: of the half size)")
        ax.set_title(f"noise x {factor:g} (dotted: Cramer-Rao bound)")
    axes[0].legend(loc="upper right", ncols=2)
    last = axes[-1]
    last.axvspan(0.0, 1.3, color=BAND)
    at = np.arange(len(PARAMETERS))
    for i, factor in enumerate(sizes):
        rows = table[table["noise_times"] == factor].set_index("parameter").loc[list(PARAMETERS)]
        middle = rows["ratio"].to_numpy()
        way = np.abs(rows[["ratio_low", "ratio_high"]].to_numpy().T - middle)
        last.errorbar(middle, at + 0.2 * (i - 0.5), xerr=way, fmt="o", color=(ORANGE, BLUE, INK)[i % 3], capsize=3,
                      label=f"noise x {factor:g}")  # fmt: skip
    last.axvline(1.0, color=INK, lw=1.0)
    last.set_yticks(at, list(PARAMETERS.values()))
    last.invert_yaxis()
    last.set(xlabel="error / bound (shaded: wanted)", xlim=(0.6, 1.9))
    last.legend(loc="upper right")
    return Drawn(
        page,
        seen=f"Over {int(table['seeds'].min())} seeds the errors end between {table['ratio'].min():.2f} and "
        f"{table['ratio'].max():.2f} times the Cramer-Rao bound; the published rule's mass ends "
        f"{percent(table['published_rmse'].max())} off.",
    )


@figure("certainty", "intervals")
def certainty(runs: Runs) -> Drawn:
    """How often stated intervals hold the truth, over time and at the end, and a run that is frozen and set free."""
    course, watched = _over_time(runs), _over_time(runs, "watched.parquet")
    table: Any = runs.table
    page, (left, middle, right) = panels(3, width_in=14.0, width_ratios=[3, 2, 3])
    for name, label in PARAMETERS.items():
        rows = course[course["parameter"] == name]
        left.plot(rows["time_s"], 100 * rows["coverage"], color=COLOURS[name], label=label)
    left.axhspan(93, 97, color=BAND)
    lowest = min(80.0, 100 * course["coverage"].min() - 2)
    left.set(xlabel="time [s]", ylabel="intervals that hold the truth [%]", ylim=(lowest, 101))
    left.set_title("shaded: 93 to 97 %")
    left.legend(loc="lower right", ncols=2)
    rows = table[table["part"] == "interval"].set_index("what").loc[list(PARAMETERS)]
    share = rows["coverage"].to_numpy()
    way = np.abs(rows[["coverage_low", "coverage_high"]].to_numpy().T - share)
    at = np.arange(len(PARAMETERS))
    middle.axvspan(93, 97, color=BAND)
    middle.errorbar(100 * share, at, xerr=100 * way, fmt="o", color=ORANGE, capsize=3)
    middle.set_yticks(at, list(PARAMETERS.values()))
    middle.invert_yaxis()
    middle.set(xlabel="at the end [%]", xlim=(85, 100))
    changes = [c for c in watched["change"].unique() if c.startswith("mass")]
    for change, colour in zip(changes, (ORANGE, BLUE), strict=False):
        one = watched[watched["change"] == change]
        right.plot(one["time_s"], one["mass_kg"], color=colour, label=change)
        frozen = one["mass_kg"].where(one["frozen"])
        right.plot(one["time_s"], frozen, color=colour, lw=4, alpha=0.35)
    right.set(xlabel="time [s]", ylabel="mass [kg]", ylim=(0, None))
    right.set_title("the object changes; thick: frozen")
    right.legend(loc="upper left")
    free = table[(table["part"] == "freezing") & (table["what"] != "none")]
    return Drawn(
        page,
        seen=f"Of {int(rows['runs'].min())} runs, {100 * share.min():.1f} to {100 * share.max():.1f} % have the truth "
        f"in their 95 % interval; a change is noticed within {free['set_free_longest_s'].max():.2f} s.",
    )


@figure("calibration", "time")
def calibration(runs: Runs) -> Drawn:
    """How the uncertainty shrinks with chosen pushes, the paper's, and random ones; time to 1 %."""
    course = _over_time(runs)
    table: Any = runs.table
    sizes = sorted(course["noise_times"].unique())
    page, axes = panels(len(sizes) + 1, width_in=13.0)
    names = {"chosen": ORANGE, "paper": INK, "paper_without_lead": GREY, "random": BLUE}
    columns = [f"{name}_sd" for name in PARAMETERS]
    for ax, factor in zip(axes, sizes, strict=False):
        for name, colour in names.items():
            rows = course[(course["noise_times"] == factor) & (course["pushes"] == name)]
            ax.plot(rows["time_s"], 1.96 * rows[columns].max(axis=1), color=colour, label=name.replace("_", " "))
        _wanted(ax, 0.01, "asked: 1 %")
        log_error(ax, lowest=1.2e-2, highest=2.0)
        ax.set(xlabel="time [s]", ylabel="widest 95 % half interval")
        ax.set_title(f"noise x {factor:g}, first run")
    axes[0].legend(loc="upper right")
    last = axes[-1]
    for i, factor in enumerate(sizes):
        rows = table[table["noise_times"] == factor].set_index("pushes").loc[list(names)]
        middle = rows["time_median_s"].to_numpy()
        way = np.array([np.zeros(len(names)), rows["time_longest_s"].to_numpy() - middle])
        last.barh(np.arange(len(names)) + 0.38 * (i - 0.5), middle, 0.36, xerr=way, capsize=2, ecolor=GREY,
                  color=list(names.values()), alpha=(0.9, 0.5)[i % 2])  # fmt: skip
    last.set_yticks(range(len(names)), [n.replace("_", " ") for n in names])
    last.invert_yaxis()
    last.set(xlabel="time to 1 % on every parameter [s]")
    last.set_title(f"median and longest of {int(table['seeds'].min())}; pale: noise x {sizes[-1]:g}")
    chosen = table[table["pushes"] == "chosen"]
    return Drawn(
        page,
        seen=f"Chosen pushes know every parameter to 1 % {chosen['faster'].min():.1f} to {chosen['faster'].max():.1f} "
        "times sooner than the paper's sequence.",
    )


@figure("com_eq6", "one_update")
def eq6(runs: Runs) -> Drawn:
    """What one update by eq. 6 says of the offset: against friction, force, and a wrong mass."""
    table: Any = runs.table
    page, axes = panels(3, width_in=13.0)
    looks = {
        "eq6_free": (INK, "I / (F T)"),
        "eq6_sliding": (BLUE, "with friction, closed form"),
        "eq6_simulated": (ORANGE, "simulated"),
    }
    shown = (
        ("friction", "friction", "friction of the floor"),
        ("force over threshold", "force_n", "push [N], threshold 8.8 N"),
        ("mass of the local cube, pushed beside the centre", "mass_ratio", "local mass / true mass, push 5 cm beside"),
    )
    for ax, (varied, column, label) in zip(axes, shown, strict=True):
        rows = table[table["varied"] == varied]
        for name, (colour, text) in looks.items():
            one = rows[rows["estimator"] == name]
            ax.plot(one[column], one["one_update"], "o-", color=colour, label=text)
        ax.axhline(1.0, color=GREY, lw=1.0)
        ax.set(xlabel=label, ylabel="offset told by one update / true offset", ylim=(0, 2))
    axes[0].legend(loc="upper left")
    rows = table[(table["varied"] == "friction") & (table["friction"] == 0.3)].set_index("estimator")["one_update"]
    return Drawn(
        page,
        seen=f"With friction 0.3 one update tells {100 * rows['eq6_free']:.0f} % of the offset without friction in the "
        f"factor, {100 * rows['eq6_sliding']:.0f} % with it, {100 * rows['eq6_simulated']:.0f} % with the model's own.",
        claim="The direction and size of the rotation difference give the centre of mass in one update (eq. 6).",
        holds=bool(abs(rows["eq6_free"] - 1) < 0.05),
    )
