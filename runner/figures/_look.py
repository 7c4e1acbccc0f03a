"""The one look of all figures: colours, sizes, and the marks that come back in many of them."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.ticker import FuncFormatter, NullLocator

INK, GREY, FAINT, BAND = "#16191d", "#8a8d91", "#d9dbde", "#eceef0"
ORANGE, BLUE, GREEN, PURPLE = "#d55e00", "#0b6aa8", "#33a06f", "#c9a0dc"
SERIES = (ORANGE, BLUE, GREEN, PURPLE, GREY, INK)  # told apart with any eyes
PAPER = BLUE  # what the paper states
ORDERED = LinearSegmentedColormap.from_list(
    "runner", ["#f9b64e", "#ee6c2b", "#cc2a5f", "#8b1a8f", "#3b3bb3", "#0d1440"]
)
FLOOR = 1e-16  # an exact estimate is drawn here: the resolution of the numbers

STYLE: dict[Any, Any] = {
    "svg.fonttype": "path",
    "svg.hashsalt": "runner",
    "font.family": "sans-serif",
    "font.size": 10,
    "axes.titlesize": 10,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": GREY,
    "axes.labelcolor": INK,
    "axes.titlecolor": INK,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": BAND,
    "grid.linewidth": 0.8,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.minor.visible": False,
    "ytick.minor.visible": False,
    "lines.linewidth": 1.6,
    "lines.markersize": 6,
    "legend.frameon": False,
    "legend.fontsize": 9,
    "axes.unicode_minus": True,
    "axes.xmargin": 0.02,
}
TITLE_IN = 0.6  # room for two lines of title on top
MARKS = 10  # at most so many on an axis of decades


def canvas(
    *, xlabel: str = "", ylabel: str = "", width_in: float = 8.0, height_in: float = 4.6, title: str = ""
) -> tuple[Figure, Axes]:
    """Return a figure with one panel."""
    page, (ax,) = panels(1, width_in=width_in, height_in=height_in)
    ax.set(xlabel=xlabel, ylabel=ylabel, title=title)
    return page, ax


def panels(
    columns: int, rows: int = 1, *, width_in: float = 10.0, height_in: float = 4.6, **grid: Any
) -> tuple[Figure, list[Axes]]:
    """Return a figure with panels side by side, row by row; other arguments go to `add_gridspec`."""
    below_title = ConstrainedLayoutEngine(rect=(0.0, 0.0, 1.0, 1.0 - TITLE_IN / height_in))
    page = Figure(figsize=(width_in, height_in), layout=below_title)
    spec = page.add_gridspec(rows, columns, **grid)
    return page, [page.add_subplot(spec[r, c]) for r in range(rows) for c in range(columns)]


def shades(count: int) -> list[Any]:
    """Return so many colours in an order that the eye follows, light to dark."""
    return [ORDERED(x) for x in np.linspace(0.0, 1.0, max(count, 1))]


def stated(ax: Axes, value: float, text: str, *, right_end: float = 1.0) -> None:
    """Draw a number that the paper states as a level line, its name on it up to this share of the axis."""
    ax.axhline(value, color=PAPER, lw=1.2, ls=(0, (5, 3)), zorder=1)
    ax.annotate(
        text, (right_end, value), xycoords=("axes fraction", "data"), xytext=(0, 3), textcoords="offset points",
        ha="right", va="bottom", color=PAPER, fontsize=9,
    )  # fmt: skip


def log_error(ax: Axes, *, lowest: float = FLOOR, highest: float | None = None) -> None:
    """Make the y axis one of relative errors in decades, in percent where that reads well; call it after plotting.

    The lowest mark is always there, and says where it stands for all that is smaller, and for nothing.
    """
    ax.set_yscale("log")
    ax.set_ylim(lowest / 2, highest)
    first, last = round(np.log10(lowest)), int(np.floor(np.log10(ax.get_ylim()[1])))
    ax.set_yticks(10.0 ** np.arange(first, last + 1, 1 + (last - first) // MARKS))
    ax.yaxis.set_minor_locator(NullLocator())
    ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: ("≤ " if value < 1.5 * FLOOR else "") + percent(value)))


def size(error: Any) -> np.ndarray:
    """Return absolute errors for a logarithmic axis: an exact one at the resolution of the numbers."""
    return np.maximum(np.abs(np.asarray(error, dtype=float)), FLOOR)


def percent(value: float) -> str:
    """Return a relative error as a reader likes it: `12 %`, `0.02 %`, `3e-11`."""
    if value != value:
        return "none"
    if abs(value) >= 0.9995e-4:
        return f"{100 * value:.2g} %" if abs(value) < 0.995 else f"{100 * value:.0f} %"
    return f"{value:.0e}".replace("e-0", "e-").replace("e+0", "e+") if value else "0"


def within(error: float) -> str:
    """Return how near a value is, as the end of a sentence."""
    return "to the last digit" if abs(error) < 2.3e-16 else f"within {percent(abs(error))}"
