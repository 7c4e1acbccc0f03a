"""Looking at a run must not change it; and what it looks like (figs. 10 to 12 and 17 of the paper)."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Polygon

from runner.figures import Drawn, Runs, figure
from runner.figures._look import INK, ORDERED, panels

CORNERS_M = 0.5 * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])  # of the cube of 1 m
EXPOSURE_S = 0.25


@figure("observer", "long_exposure")
def long_exposure(runs: Runs) -> Drawn:
    """The way of the remote cube, run by run, and how far the runs are apart."""
    kinds = [
        f"{'no .rrd' if rrd == 'off' else f'.rrd {rrd}'}, every {'step' if kept == 'steps' else 'update'} kept"
        for rrd, kept in zip(runs.values("log.rrd"), runs.values("log.frames"), strict=True)
    ]
    most, least = 0, len(kinds) - 1
    for i, (rrd, kept) in enumerate(zip(runs.values("log.rrd"), runs.values("log.frames"), strict=True)):
        most = i if (rrd, kept) == ("full", "steps") else most
        least = i if (rrd, kept) == ("off", "updates") else least
    page, (left, right) = panels(2, width_in=10.0, height_in=5.4)
    for ax, i in ((left, most), (right, least)):
        _expose(ax, runs, i)
        ax.set_title(f"{kinds[i]} (light: start, dark: end)")
    first = runs.frames(0).drop(columns=["frame", "update"])
    apart = max(float(np.nanmax(np.abs(runs.frames(i)[first.columns] - first))) for i in range(len(kinds)))
    same = len(set(runs.values("motion"))) == 1 and apart == 0.0
    return Drawn(
        page,
        claim="Looking at the object changes its motion, and no two runs are the same (figs. 10 to 12, 17).",
        seen=f"Logged in {len(kinds)} ways, from updates alone to every physics step in the viewer's log: the motion "
        + ("is the same to the last bit." if same else f"differs by up to {apart:.1g}."),
        holds=not same,
    )


def _expose(ax: Axes, runs: Runs, i: int) -> None:
    frames = runs.frames(i)
    time_s = frames["time_s"].to_numpy()
    pose = frames[["remote_x_m", "remote_y_m", "remote_yaw_rad"]].to_numpy()
    moments = np.searchsorted(time_s, np.arange(time_s[0], time_s[-1], EXPOSURE_S))
    for k in moments:
        x, y, yaw = pose[k]
        turn = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
        colour = ORDERED(time_s[k] / time_s[-1])
        ax.add_patch(Polygon(CORNERS_M @ turn + (x, y), closed=True, fill=False, ec=colour, lw=0.8, alpha=0.6))
    ax.plot(pose[:, 0], pose[:, 1], color=INK, lw=1.2)
    ax.plot(*pose[0, :2], "o", color=INK, ms=4)
    ax.set_aspect("equal")
    ax.autoscale_view()
    ax.set(xlabel="x [m]", ylabel="y [m]")
