"""How figures of a report are drawn: SVG text to put into a page, transparent, in colours that follow its theme.

Measured black, nominal grey, corrected orange everywhere. Drawn with matplotlib in marker colours, which are then
replaced by the page's CSS variables. A figure of many channels is one small drawing for each: a page puts them side
by side, or one below the other where it is narrow, and their letters stay as large as its own.
"""

from __future__ import annotations

import io
import re
import textwrap
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import ScalarFormatter

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
LETTER, LINE = 0.085, 0.17  # width of a bold letter of a title, distance of its lines, inches
DIGIT, BESIDE = 0.075, 0.13  # width of a digit beside an axis, and what its mark and a gap take, inches
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
    _make_room(figure)
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
    # coordinates go as far as the eye; what stands between tags is read
    return re.sub(r"<[^>]*>", lambda tag: re.sub(r"(\d+\.\d{2})\d+", r"\1", tag[0]), text)


def _make_room(figure: Figure) -> None:
    """Widen the left margin to what the longest number beside an axis takes, and its label."""
    width, left = float(figure.get_figwidth()), figure.subplotpars.left
    for ax in figure.axes:
        numbers = ax.yaxis.get_major_formatter()
        if isinstance(numbers, ScalarFormatter) and ax.axison:
            low, high = sorted(ax.get_ylim())
            shown = numbers.format_ticks([y for y in ax.get_yticks() if low <= y <= high])
            taken = BESIDE + DIGIT * max(map(len, shown), default=0) + (LINE if ax.get_ylabel() else 0.0)
            left = max(left, taken / width)
    figure.subplots_adjust(left=left)


def _escaped(text: str) -> str:
    return text.replace("&", "&amp;").replace('"', "&quot;").replace("<", "&lt;")


def new(width: float, height: float, *, left: float = 0.5, top: float = 0.28, bottom: float = 0.44) -> Figure:
    """Return a figure with margins in inches; a layout engine would take longer than all else."""
    figure = Figure(figsize=(width, height))
    figure.subplots_adjust(
        left=left / width, right=1 - 0.08 / width, bottom=bottom / height, top=1 - top / height, hspace=0.16
    )
    return figure


def title(ax: Axes, text: str) -> None:
    """Write a title above axes, in as many lines as the figure's width asks for; the figure grows by them."""
    figure = ax.get_figure(root=True)
    assert isinstance(figure, Figure)
    width, height = figure.get_size_inches()
    lines = textwrap.wrap(text, max(12, int((width - width * figure.subplotpars.left) / LETTER))) or [""]
    more = LINE * (len(lines) - 1)
    below, above = height * figure.subplotpars.bottom, height * (1 - figure.subplotpars.top) + more
    figure.set_size_inches(width, height + more)
    figure.subplots_adjust(bottom=below / (height + more), top=1 - above / (height + more))
    ax.set_title("\n".join(lines))


def span(values: Sequence[float], halves: Sequence[float]) -> tuple[float, float]:
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
