"""Figures of a report as SVG text to put into a page: transparent, in colours that follow its light or dark theme.

Measured black, nominal grey, corrected orange everywhere. Drawn with matplotlib in marker colours, which are then
replaced by the page's CSS variables.
"""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle

from runner.effects import AbstractEffect, FrictionPatch
from runner.noise.measured import CHANNELS, UNITS
from runner.report.before_after import NAMES, SMALL, Miss
from runner.report.motions import Paths, autocorrelation
from runner.report.wrench import COMPONENTS, Mean, Wrench

# colours that stand for the page's: what is drawn in them follows the theme
INK, GREY, ORANGE, FAINT, BAND, ACCENT = "#010203", "#8a8d91", "#d55e01", "#c1c2c3", "#e1e2e3", "#0b5a8e"
VARIABLES = {
    INK: "--ink",
    GREY: "--nominal",
    ORANGE: "--corrected",
    FAINT: "--rule",
    BAND: "--band",
    ACCENT: "--accent",
}
STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "runner",
    "font.family": "sans-serif",
    "font.size": 9.5,
    "axes.titlesize": 10,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": FAINT,
    "axes.labelcolor": INK,
    "axes.titlecolor": INK,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.major.size": 3,
    "ytick.major.size": 3,
    "legend.frameon": False,
    "path.simplify": True,
    "path.simplify_threshold": 0.4,
    "axes.unicode_minus": True,
}


def svg(figure: Figure, name: str, description: str) -> str:
    """Return a figure as an `<svg>` element with ids of its own, a text for screen readers, and themed colours."""
    out = io.StringIO()
    figure.savefig(out, format="svg", transparent=True, metadata={"Date": None, "Creator": None})
    text = out.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r'\bid="([^"]+)"', rf'id="{name}-\1"', text)
    text = re.sub(r"url\(#([^)]+)\)", rf"url(#{name}-\1)", text)
    text = re.sub(r'xlink:href="#([^"]+)"', rf'xlink:href="#{name}-\1"', text)
    for colour, variable in VARIABLES.items():
        text = text.replace(colour, f"var({variable})")
    # text without a colour of its own is black otherwise, on black
    text = re.sub(r"font: ([\d.]+px) [^;\"]*", r"font: \1 var(--sans)", text)
    text = re.sub(r"<svg ([^>]*?)width=\"[^\"]*\" height=\"[^\"]*\"", r"<svg \1", text, count=1)
    text = re.sub(r"<svg ", f'<svg role="img" aria-label="{_escaped(description)}" ', text, count=1)
    return re.sub(r"(\d+\.\d{2})\d+", r"\1", text)


def _escaped(text: str) -> str:
    return text.replace("&", "&amp;").replace('"', "&quot;").replace("<", "&lt;")


def _new(width: float, height: float, *, left: float = 0.5) -> Figure:
    """Return a figure with margins in inches; a layout engine would take longer than all else."""
    figure = Figure(figsize=(width, height))
    figure.subplots_adjust(
        left=left / width, right=1 - 0.1 / width, bottom=0.48 / height, top=1 - 0.26 / height, wspace=0.24, hspace=0.42
    )
    return figure


def trajectory(path: Paths, sigma: np.ndarray, number: int, name: str, *, after: str = ORANGE) -> str:
    """Return the way over the floor, and every channel with its residual, of one episode."""
    with mpl.rc_context(STYLE):
        figure = _new(11.0, 6.6, left=0.6)
        grid = figure.add_gridspec(4, 4, width_ratios=[1.25, 1, 1, 1], height_ratios=[1.6, 1, 1.6, 1], wspace=0.38)
        _way(figure.add_subplot(grid[:, 0]), path, after)
        for i in range(len(CHANNELS)):
            row, column = 2 * (i // 3), 1 + i % 3
            upper = figure.add_subplot(grid[row, column])
            lower = figure.add_subplot(grid[row + 1, column], sharex=upper)
            _channel(upper, path, i, after)
            _residual(lower, path, i, sigma, after)
        return svg(figure, name, f"Episode {number}: measured, nominal and corrected motion with residuals")


def _way(ax: Axes, path: Paths, after: str) -> None:
    ax.plot(path.nominal[:, 0], path.nominal[:, 1], color=GREY, lw=2.2)
    ax.plot(path.corrected[:, 0], path.corrected[:, 1], color=after, lw=2.2)
    ax.plot(path.measured[:, 0], path.measured[:, 1], color=INK, lw=1.0, ls=(0, (4, 2)))
    begin = path.measured[np.isfinite(path.measured[:, 0])][:1]
    ax.plot(begin[:, 0], begin[:, 1], "o", color=INK, ms=5)
    for motion, colour in ((path.nominal, GREY), (path.corrected, after)):
        ax.plot(*motion[-1, :2], "s", color=colour, ms=5)
    ax.set_aspect("equal", "box", anchor="NW")
    ax.set(title="way over the floor", xlabel="x [m]", ylabel="y [m]")
    ax.margins(0.1)


def _channel(ax: Axes, path: Paths, i: int, after: str) -> None:
    scale = 180 / np.pi if UNITS[i].startswith("rad") else 1.0
    unit = UNITS[i].replace("rad", "°")
    ax.plot(path.t_s, scale * path.nominal[:, i], color=GREY, lw=2.0)
    ax.plot(path.t_s, scale * path.corrected[:, i], color=after, lw=2.0)
    ax.plot(path.t_s, scale * path.measured[:, i], color=INK, lw=0.9)
    ax.set_title(f"{NAMES[CHANNELS[i]]} [{unit}]")
    ax.tick_params(labelbottom=False)


def _residual(ax: Axes, path: Paths, i: int, sigma: np.ndarray, colour: str) -> None:
    unit, scale = SMALL[UNITS[i]]
    ax.axhspan(-2 * scale * sigma[i], 2 * scale * sigma[i], color=BAND, lw=0)
    ax.axhline(0, color=INK, lw=0.6)
    before, after = (scale * (m - path.measured)[:, i] for m in (path.nominal, path.corrected))
    ax.plot(path.t_s, before, color=GREY, lw=1.2)
    ax.plot(path.t_s, after, color=colour, lw=1.0)
    top = max(float(np.nanpercentile(np.abs(np.concatenate([before, after])), 99.8)), 3 * scale * float(sigma[i]))
    ax.set_ylim(-1.1 * top, 1.1 * top)
    ax.set_ylabel(f"miss [{unit}]")
    if i >= 3:
        ax.set_xlabel("time [s]")
    else:
        ax.tick_params(labelbottom=False)


def horizons(found: Sequence[Miss], name: str, *, after: str = ORANGE) -> str:
    """Return the misses over the horizon, before and after, against the noise, one panel per channel."""
    with mpl.rc_context(STYLE):
        figure = _new(11.0, 3.9)
        for i, ax in enumerate(figure.subplots(2, 3, sharex=True).ravel()):
            part = [m for m in found if m.channel == CHANNELS[i]]
            ax.set_visible(bool(part))
            if not part:
                continue
            x = np.arange(len(part))
            ax.plot(x, [m.before for m in part], "o-", color=GREY, ms=4)
            ax.plot(x, [m.after for m in part], "o-", color=after, ms=4)
            ax.plot(x, [m.noise for m in part], color=INK, lw=0.9, ls=(0, (1, 2)))
            ax.set_ylim(0, 1.12 * max(max(m.before, m.after, m.noise) for m in part))
            ax.set_xticks(x, [m.horizon.replace("whole ", "") for m in part])
            ax.set_title(f"{part[0].name} [{part[0].unit}]")
        return svg(figure, name, "Error before and after over the horizon, per channel")


def bars(found: Sequence[Miss], name: str, *, colour: str = ORANGE) -> str:
    """Return the misses before and after in multiples of the noise, one row per channel."""
    with mpl.rc_context(STYLE):
        figure = _new(8.0, 2.6, left=0.9)
        ax = figure.add_subplot()
        y = np.arange(len(found))
        before, after = (np.array([getattr(m, k) / m.noise for m in found]) for k in ("before", "after"))
        ax.hlines(y, after, before, color=FAINT, lw=3)
        ax.plot(before, y, "o", color=GREY, ms=8)
        ax.plot(after, y, "o", color=colour, ms=8)
        ax.axvline(1, color=INK, lw=0.9, ls=(0, (1, 2)))
        ax.set_xscale("log")
        ax.xaxis.set_major_formatter(lambda v, _: f"{v:g}")
        ax.xaxis.set_minor_formatter(lambda v, _: f"{v:g}" if str(v)[0] in "25" else "")
        ax.set_yticks(y, [m.name for m in found])
        ax.invert_yaxis()
        ax.set_xlabel("missed, in noise levels (dotted: the noise itself, no simulator can do better)")
        return svg(figure, name, "Misses before and after in noise levels, per channel")


def regimes(before: Sequence[Mean], after: Sequence[Mean], name: str) -> str:
    """Return the mean missing wrench by regime with 95 % intervals, one panel per component."""
    order = list(dict.fromkeys(m.regime for m in before)) or [""]
    with mpl.rc_context(STYLE):
        figure = _new(11.0, 0.9 + 0.34 * len(order), left=2.1)
        axes = figure.subplots(1, len(COMPONENTS), sharey=True, gridspec_kw={"wspace": 0.12})
        for ax, (component, title) in zip(axes, COMPONENTS.items(), strict=True):
            ax.axvline(0, color=INK, lw=0.6)
            for means, colour, shift in ((before, GREY, -0.13 if after else 0.0), (after, ORANGE, 0.13)):
                part = [m for m in means if m.component == component and m.regime in order]
                y = np.array([order.index(m.regime) for m in part]) + shift
                x, half = np.array([m.value for m in part]), 1.96 * np.array([m.error for m in part])
                ax.hlines(y, x - half, x + half, color=colour, lw=2)
                ax.plot(x, y, "o", color=colour, ms=4.5)
            ax.set_title(title, fontsize=9)
            everything = [m for m in (*before, *after) if m.component == component and m.regime in order]
            ax.set_xlim(*_span([m.value for m in everything], [1.96 * m.error for m in everything]))
            ax.locator_params(axis="x", nbins=4)
            ax.tick_params(axis="y", length=0)
        axes[0].set_yticks(range(len(order)), order)
        axes[0].set_ylim(len(order) - 0.5, -0.5)
        return svg(figure, name, "Mean missing force and moment by regime, before and after")


def _span(values: Sequence[float], halves: Sequence[float]) -> tuple[float, float]:
    """Return limits that show zero and what is known; what is known badly may reach beyond them."""
    value, half = np.asarray(values, float), np.asarray(halves, float)
    known = np.isfinite(value) & np.isfinite(half)
    if not known.any():
        return -1.0, 1.0
    value, half = value[known], half[known]
    good = half <= 4 * np.median(half)
    low, high = min(0.0, float((value - half)[good].min())), max(0.0, float((value + half)[good].max()))
    room = 0.12 * max(high - low, 1e-9)
    return low - room, high + room


def wrench(before: Wrench, after: Wrench | None, name: str) -> str:
    """Return the missing wrench of one episode over time, with bands of two standard errors."""
    with mpl.rc_context(STYLE):
        figure = _new(11.0, 2.5)
        titles = ("towards world x [N]", "towards world y [N]", "moment about z [N m]")
        for i, (ax, title) in enumerate(zip(figure.subplots(1, 3, sharex=True), titles, strict=True)):
            ax.axhline(0, color=INK, lw=0.6)
            for found, colour in ((before, GREY), (after, ORANGE)):
                if found is None:
                    continue
                value = np.column_stack([found.force_n, found.moment_nm])[:, i]
                low, high = value - 2 * found.error[:, i], value + 2 * found.error[:, i]
                ax.fill_between(found.t_s, low, high, color=colour, alpha=0.25, lw=0)
                ax.plot(found.t_s, value, ".-", color=colour, lw=1.4, ms=5)
            shown = [f for f in (before, after) if f is not None]
            values = np.concatenate([np.column_stack([f.force_n, f.moment_nm])[:, i] for f in shown])
            ax.set_ylim(*_span(values.tolist(), np.concatenate([2 * f.error[:, i] for f in shown]).tolist()))
            ax.set_title(title)
            ax.set_xlabel("time [s]")
        return svg(figure, name, "Missing force and moment over time")


def floor(places: pd.DataFrame, paths: Sequence[Paths], effects: Sequence[AbstractEffect], name: str) -> str:
    """Return the map of the floor: how much worse than elsewhere the simulator is in each cell."""
    x, y, lift = (places[c].to_numpy(float) for c in ("x_m", "y_m", "lift"))
    gaps = np.concatenate([np.diff(np.unique(np.round(v, 6))) for v in (x, y)])
    side = float(gaps[gaps > 1e-6].min()) if (gaps > 1e-6).any() else 0.1
    with mpl.rc_context(STYLE):
        figure = _new(6.4, 5.2, left=0.6)
        ax = figure.add_subplot()
        top = max(float(np.nanmax(lift)), 1.0)
        for px, py, value, q in zip(x, y, lift, places["q"], strict=True):
            corner = (px - side / 2, py - side / 2)
            strength = float(np.clip(np.nan_to_num(value) / top, 0, 1))
            ax.add_patch(Rectangle(corner, side, side, facecolor=ACCENT, alpha=0.75 * strength, lw=0))
            if q < 0.05:
                ax.add_patch(Rectangle(corner, side, side, facecolor="none", edgecolor=INK, lw=1.6))
            ax.text(px, py + 0.32 * side, f"{value:.1f}×", ha="center", va="center", fontsize=8.5)
        for path in paths:
            ax.plot(path.measured[:, 0], path.measured[:, 1], color=INK, lw=0.6, alpha=0.55)
        for effect in effects:
            if isinstance(effect, FrictionPatch):
                ax.add_patch(Circle((effect.x_m, effect.y_m), effect.radius_m, fill=False, edgecolor=ORANGE, lw=2))
        ax.set_aspect("equal")
        ax.autoscale_view()
        ax.set(xlabel="x [m]", ylabel="y [m]")
        return svg(figure, name, "Map of the floor: gap in each place against the average")


def whiteness(
    before: np.ndarray, after: np.ndarray, step_s: float, name: str, *, colour: str = ORANGE, longest_s: float = 0.5
) -> str:
    """Return the autocorrelation of the whitened residuals (C, E, T), with the band of white noise."""
    lags = max(5, min(round(longest_s / step_s), before.shape[2] // 4))
    t = step_s * np.arange(1, lags + 1)
    with mpl.rc_context(STYLE):
        figure = _new(11.0, 3.6)
        for i, ax in enumerate(figure.subplots(2, 3, sharex=True, sharey=True).ravel()):
            first, _ = autocorrelation(before[i], lags)
            second, count = autocorrelation(after[i], lags)
            band = 1.96 / np.sqrt(max(count, 1))
            ax.axhspan(-band, band, color=BAND, lw=0)
            ax.axhline(0, color=INK, lw=0.6)
            ax.plot(t, first, color=GREY, lw=1.5)
            ax.vlines(t, 0, second, color=colour, lw=1.6)
            ax.plot(t, second, ".", color=colour, ms=3.5)
            ax.set_title(NAMES[CHANNELS[i]])
            ax.set_ylim(-0.5, 1.05)
            ax.set_yticks([0, 0.5, 1])
            if i >= 3:
                ax.set_xlabel("lag [s]")
        return svg(figure, name, "Autocorrelation of the residuals before and after, per channel")
