"""Figures of where and when a simulator misses: the missing force, the map, the course of the episodes."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.patches import Circle, Rectangle

from runner.effects.base import Effects
from runner.report.figures import ACCENT, BAND, GREY, INK, ORANGE, STYLE, new, span, svg
from runner.report.figures import title as titled
from runner.report.missing_force import Mean, MissingForce
from runner.report.motions import Paths
from runner.systems.base import AbstractSystem

MOST_EPISODES = 10  # rows of the timeline: those with the largest gap
HIGH, LEAST_TOP = 99.0, 3.0  # percentile of the windows that reaches to the row above; noise levels that do at least


def regimes(before: Sequence[Mean], after: Sequence[Mean], titles: dict[str, str], name: str) -> list[str]:
    """Return the mean missing force by regime with 95 % intervals, one drawing per component."""
    order = list(dict.fromkeys(m.regime for m in before))
    out = []
    with mpl.rc_context(STYLE):
        for component, title in titles.items():
            both = [[m for m in means if m.component == component and m.regime in order] for means in (before, after)]
            if not any(both):
                continue
            figure = new(3.1, 0.72 + 0.36 * len(order), left=0.12)
            ax = figure.add_subplot()
            rows = np.arange(len(order))
            ax.vlines(np.zeros(len(order)), rows - 0.15, rows + 0.35, color=INK, lw=0.6)  # not across their names
            for part, colour, shift in zip(both, (GREY, ORANGE), (0.0, 0.2), strict=True):
                y = np.array([order.index(m.regime) for m in part]) + shift
                x, half = np.array([m.value for m in part]), 1.96 * np.array([m.error for m in part])
                ax.hlines(y, x - half, x + half, color=colour, lw=2)
                ax.plot(x, y, "o", color=colour, ms=4.5)
            everything = [m for part in both for m in part]
            ax.set_xlim(*span([m.value for m in everything], [1.96 * m.error for m in everything]))
            for row, regime in enumerate(order):
                ax.text(0.0, row - 0.22, regime, transform=ax.get_yaxis_transform(), fontsize=8.5, va="bottom")
            titled(ax, title)
            ax.locator_params(axis="x", nbins=5)
            ax.set_yticks([])
            ax.spines["left"].set_visible(False)
            ax.set_ylim(len(order) - 0.55, -0.75)
            out.append(svg(figure, f"{name}{len(out)}", f"Mean missing force by regime, before and after: {title}"))
    return out


def over_time(before: MissingForce, after: MissingForce | None, titles: Sequence[str], name: str) -> list[str]:
    """Return the missing force of one episode over time, with bands of two standard errors, by component."""
    shown = [(f, c) for f, c in ((before, GREY), (after, ORANGE)) if f is not None]
    out = []
    with mpl.rc_context(STYLE):
        for i, title in enumerate(titles):
            if not np.isfinite(before.value[:, i]).any():
                continue
            figure = new(3.1, 1.9)
            ax = figure.add_subplot()
            ax.axhline(0, color=INK, lw=0.6)
            for found, colour in shown:
                low, high = (found.value[:, i] + side * found.error[:, i] for side in (-2, 2))
                ax.fill_between(found.t_s, low, high, color=colour, alpha=0.25, lw=0)
                ax.plot(found.t_s, found.value[:, i], ".-", color=colour, lw=1.4, ms=5)
            values = np.concatenate([f.value[:, i] for f, _ in shown])
            bands = np.concatenate([2 * f.error[:, i] for f, _ in shown])
            ax.set_ylim(*span(values.tolist(), bands.tolist()))
            titled(ax, title)
            ax.set_xlabel("time [s]", labelpad=1)
            out.append(svg(figure, f"{name}{i}", f"Missing force over time: {title}"))
    return out


def place_map(system: AbstractSystem, places: pd.DataFrame, paths: Sequence[Paths], effects: Effects, name: str) -> str:
    """Return the map: how much worse than elsewhere the simulator is in each cell."""
    assert system.plan_view is not None
    flat = list(system.plan_view)
    x, y, lift = (places[c].to_numpy(float) for c in ("x_m", "y_m", "lift"))
    gaps = np.concatenate([np.diff(np.unique(np.round(v, 6))) for v in (x, y)])
    side = float(gaps[gaps > 1e-6].min()) if (gaps > 1e-6).any() else 0.1
    with mpl.rc_context(STYLE):
        figure = new(4.0, 3.5, left=0.55, top=0.08)
        ax = figure.add_subplot()
        top = max(float(np.nanmax(lift)), 1.0)
        for px, py, value, q in zip(x, y, lift, places["q"], strict=True):
            corner = (px - side / 2, py - side / 2)
            strength = float(np.clip(np.nan_to_num(value) / top, 0, 1))
            ax.add_patch(Rectangle(corner, side, side, facecolor=ACCENT, alpha=0.75 * strength, lw=0))
            if q < 0.05:
                ax.add_patch(Rectangle(corner, side, side, facecolor="none", edgecolor=INK, lw=1.6))
            told = f"{value:.1f}×".replace("-", "−")
            ax.text(px, py + 0.32 * side, told, ha="center", va="center", fontsize=8.5)
        for path in paths:
            ax.plot(*path.measured[:, flat].T, color=INK, lw=0.6, alpha=0.55)
        for effect in effects:
            # an effect that has a place and a reach is drawn there
            values = effect.report()
            if {"x_m", "y_m", "radius_m"} <= values.keys():
                place = (values["x_m"], values["y_m"])
                ax.add_patch(Circle(place, values["radius_m"], fill=False, edgecolor=ORANGE, lw=2))
        ax.set_aspect("equal")
        ax.autoscale_view()
        ax.set(xlabel=f"{system.channels[flat[0]].name} [m]", ylabel=f"{system.channels[flat[1]].name} [m]")
        return svg(figure, name, "Map: gap in each place against the average")


def timeline(
    windows: pd.DataFrame, window_s: float, framed: tuple[str, str] | None, name: str
) -> tuple[str, float, int]:
    """Return what is missed over time, one row per episode, of how many noise levels a full row is, and what lacks.

    That is how many episodes have no row, as others miss more.

    Args:
        windows: As in `Where`.
        window_s: How long each is.
        framed: A factor and a cell of it whose windows are marked below each row.
        name: Of the figure's ids.
    """
    excess, freedom, at = (windows[c].to_numpy(float) for c in ("excess", "freedom", "t_s"))
    of = windows["episode"].to_numpy(dtype=object)
    size = np.sqrt(np.maximum(1.0 + excess / np.maximum(freedom, 1e-9), 0.0))
    marked = np.zeros(len(of), bool) if framed is None else windows[framed[0]].to_numpy(dtype=object) == framed[1]
    names = list(dict.fromkeys(of))
    worst = sorted(names, key=lambda e: -float(excess[of == e].sum()))[:MOST_EPISODES]
    rows = [e for e in names if e in worst]
    top = max(float(np.percentile(size, HIGH)), LEAST_TOP)
    with mpl.rc_context(STYLE):
        figure = new(4.0, 0.62 + 0.32 * len(rows), left=0.82, top=0.12)
        ax = figure.add_subplot()
        for k, episode in enumerate(rows):
            here = of == episode
            step = float(np.median(np.diff(at[here]))) if here.sum() > 1 else window_s
            begin = at[here] - at[here][0]
            ax.stairs(k - 0.85 * np.minimum(size[here] / top, 1.0), np.append(begin, begin[-1] + step), baseline=k,
                      fill=True, color=ACCENT, lw=0)  # fmt: skip
            ax.hlines(k, 0.0, begin[-1] + step, color=BAND, lw=0.8)
            below = begin[marked[here]]
            ax.hlines(np.full(len(below), k + 0.07), below, below + step, color=INK, lw=2)
        ax.set_yticks(np.arange(len(rows)) - 0.3, rows)
        ax.set_ylim(len(rows) - 0.75, -1.0)
        ax.tick_params(axis="y", length=0)
        ax.set_xlabel("time [s]", labelpad=1)
        return svg(figure, name, "What is missed over time, by episode"), top, len(names) - len(rows)
