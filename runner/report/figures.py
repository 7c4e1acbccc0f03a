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
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from runner.diagnose.measured import CHANNELS, UNITS
from runner.report.before_after import NAMES, SMALL, Miss
from runner.report.motions import Paths, autocorrelation

# colours that stand for the page's: what is drawn in them follows the theme
INK, GREY, ORANGE, FAINT, BAND = "#010203", "#8a8d91", "#d55e01", "#c1c2c3", "#e1e2e3"
VARIABLES = {INK: "--ink", GREY: "--nominal", ORANGE: "--corrected", FAINT: "--rule", BAND: "--band"}
STYLE: dict[str, Any] = {
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


def _new(width: float, height: float) -> Figure:
    return Figure(figsize=(width, height), layout="constrained")


def trajectory(path: Paths, sigma: np.ndarray, number: int, name: str) -> str:
    """Return the way over the floor, and every channel with its residual, of one episode."""
    with mpl.rc_context(STYLE):
        figure = _new(11.0, 6.2)
        grid = figure.add_gridspec(4, 4, width_ratios=[1.25, 1, 1, 1], height_ratios=[1.5, 1, 1.5, 1])
        _way(figure.add_subplot(grid[:, 0]), path)
        for i in range(len(CHANNELS)):
            row, column = 2 * (i // 3), 1 + i % 3
            upper = figure.add_subplot(grid[row, column])
            lower = figure.add_subplot(grid[row + 1, column], sharex=upper)
            _channel(upper, path, i)
            _residual(lower, path, i, sigma)
        return svg(figure, name, f"Episode {number}: measured, nominal and corrected motion with residuals")


def _way(ax: Axes, path: Paths) -> None:
    ax.plot(path.nominal[:, 0], path.nominal[:, 1], color=GREY, lw=2.2)
    ax.plot(path.corrected[:, 0], path.corrected[:, 1], color=ORANGE, lw=2.2)
    ax.plot(path.measured[:, 0], path.measured[:, 1], color=INK, lw=1.0, ls=(0, (4, 2)))
    begin = path.measured[np.isfinite(path.measured[:, 0])][:1]
    ax.plot(begin[:, 0], begin[:, 1], "o", color=INK, ms=5)
    for motion, colour in ((path.nominal, GREY), (path.corrected, ORANGE)):
        ax.plot(*motion[-1, :2], "s", color=colour, ms=5)
    ax.set_aspect("equal", "datalim")
    ax.set(title="way over the floor", xlabel="x [m]", ylabel="y [m]")
    ax.margins(0.1)


def _channel(ax: Axes, path: Paths, i: int) -> None:
    scale = 180 / np.pi if UNITS[i].startswith("rad") else 1.0
    unit = UNITS[i].replace("rad", "°")
    ax.plot(path.t_s, scale * path.nominal[:, i], color=GREY, lw=2.0)
    ax.plot(path.t_s, scale * path.corrected[:, i], color=ORANGE, lw=2.0)
    ax.plot(path.t_s, scale * path.measured[:, i], color=INK, lw=0.9)
    ax.set_title(f"{NAMES[CHANNELS[i]]} [{unit}]")
    ax.tick_params(labelbottom=False)


def _residual(ax: Axes, path: Paths, i: int, sigma: np.ndarray) -> None:
    unit, scale = SMALL[UNITS[i]]
    ax.axhspan(-2 * scale * sigma[i], 2 * scale * sigma[i], color=BAND, lw=0)
    ax.axhline(0, color=INK, lw=0.6)
    before, after = (scale * (m - path.measured)[:, i] for m in (path.nominal, path.corrected))
    ax.plot(path.t_s, before, color=GREY, lw=1.2)
    ax.plot(path.t_s, after, color=ORANGE, lw=1.0)
    top = max(float(np.nanpercentile(np.abs(np.concatenate([before, after])), 99.8)), 3 * scale * float(sigma[i]))
    ax.set_ylim(-1.1 * top, 1.1 * top)
    ax.set_ylabel(f"miss [{unit}]")
    if i >= 3:
        ax.set_xlabel("time [s]")
    else:
        ax.tick_params(labelbottom=False)


def horizons(found: Sequence[Miss], name: str) -> str:
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
            ax.plot(x, [m.after for m in part], "o-", color=ORANGE, ms=4)
            ax.plot(x, [m.noise for m in part], color=INK, lw=0.9, ls=(0, (1, 2)))
            ax.set_ylim(0, None)
            ax.set_xticks(x, [m.horizon.replace("whole ", "") for m in part])
            ax.set_title(f"{part[0].name} [{part[0].unit}]")
        return svg(figure, name, "Error before and after over the horizon, per channel")


def bars(found: Sequence[Miss], name: str) -> str:
    """Return the misses before and after in multiples of the noise, one row per channel."""
    with mpl.rc_context(STYLE):
        figure = _new(8.0, 2.6)
        ax = figure.add_subplot()
        y = np.arange(len(found))
        before, after = (np.array([getattr(m, k) / m.noise for m in found]) for k in ("before", "after"))
        ax.hlines(y, after, before, color=FAINT, lw=3)
        ax.plot(before, y, "o", color=GREY, ms=8)
        ax.plot(after, y, "o", color=ORANGE, ms=8)
        ax.axvline(1, color=INK, lw=0.9, ls=(0, (1, 2)))
        ax.set_xscale("log")
        ax.xaxis.set_major_formatter(lambda v, _: f"{v:g}")
        ax.xaxis.set_minor_formatter(lambda v, _: f"{v:g}" if str(v)[0] in "25" else "")
        ax.set_yticks(y, [m.name for m in found])
        ax.invert_yaxis()
        ax.set_xlabel("missed, in noise levels (dotted: the noise itself, no simulator can do better)")
        return svg(figure, name, "Misses before and after in noise levels, per channel")


def whiteness(before: np.ndarray, after: np.ndarray, step_s: float, name: str, longest_s: float = 0.5) -> str:
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
            ax.vlines(t, 0, second, color=ORANGE, lw=1.6)
            ax.plot(t, second, ".", color=ORANGE, ms=3.5)
            ax.set_title(NAMES[CHANNELS[i]])
            ax.set_ylim(-0.5, 1.05)
            ax.set_yticks([0, 0.5, 1])
            if i >= 3:
                ax.set_xlabel("lag [s]")
        return svg(figure, name, "Autocorrelation of the residuals before and after, per channel")
