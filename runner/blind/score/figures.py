"""Figures of a blind score, in the look of the reports: light or dark in the page, light in files."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from scipy.stats import norm

from runner.blind.score import BlindScore
from runner.diagnosis.score import BINS, NONE, UNKNOWN, ordered_sizes
from runner.report.figures import ACCENT, BAND, FAINT, GREY, INK, ORANGE, STYLE, svg
from runner.storage.writing import replacing

DPI = 150
SIZES = {"subtle": GREY, "moderate": ACCENT, "strong": INK}
SEVERAL = "several"


def draw(found: BlindScore) -> dict[str, tuple[Figure, str]]:
    """Return the figures that there is something to draw for, by name, each with a description."""
    placed = bool(found.places["errors_off"].notna().any())
    closable = found.gap is not None and bool(found.gap["ratio"].notna().any())
    made: dict[str, tuple[Callable[[BlindScore], Figure], bool, str]] = {
        "bars": (_bars, True, "Every figure with its interval beside the bar that it is to reach"),
        "effects": (_effects, len(found.effects) > 0, "Share of first answers that are right, by effect and size"),
        "reliability": (_reliability, True, "Stated probability against how often the answer is right"),
        "confusion": (_confusion, True, "What was named for what was planted"),
        "coverage": (_coverage, len(found.parameters) > 0, "How the stated intervals hold what was planted"),
        "places": (_places, placed, "Distance of named places from the truth, and the stated error"),
        "gap": (_gap, closable, "Gap closed, own against the oracle's"),
    }
    with mpl.rc_context(STYLE):
        return {name: (of(found), text) for name, (of, there, text) in made.items() if there}


def write_figures(found: BlindScore, folder: Path) -> dict[str, str]:
    """Write PNG and SVG files and return the figures for a page, by name."""
    folder.mkdir(parents=True, exist_ok=True)
    out = {}
    for name, (figure, text) in draw(found).items():
        with mpl.rc_context({**STYLE, "svg.fonttype": "path"}):
            with replacing(folder / f"{name}.png") as png:
                figure.savefig(png, dpi=DPI, facecolor="white", metadata={"Software": None})
            with replacing(folder / f"{name}.svg") as drawn:
                figure.savefig(drawn, facecolor="white", metadata={"Date": None, "Creator": None})
        with mpl.rc_context(STYLE):
            out[name] = svg(figure, name, text)
    return out


def _new(width: float, height: float, *, left: float = 0.6, right: float = 0.15) -> Figure:
    """Return a figure with margins in inches."""
    figure = Figure(figsize=(width, height))
    figure.subplots_adjust(
        left=left / width, right=1 - right / width, bottom=0.5 / height, top=1 - 0.3 / height, wspace=0.24
    )
    return figure


def _percent(ax: Axes, axis: str = "x") -> None:
    getattr(ax, f"set_{axis}lim")(-0.02, 1.02)
    ticks = np.linspace(0, 1, 6)
    getattr(ax, f"set_{axis}ticks")(ticks, [f"{100 * t:.0f} %" for t in ticks])


def _bars(found: BlindScore) -> Figure:
    """Shares with intervals, and where they are to lie; the calibration error on the same scale."""
    shown = [b for b in found.bars if np.isfinite(b.value)]
    figure = _new(9.0, 0.9 + 0.36 * len(shown), left=2.9)
    ax = figure.add_subplot()
    for y, bar in enumerate(shown):
        low, high = max(bar.least, -0.02), min(bar.most, 1.06)
        ax.add_patch(Rectangle((low, y - 0.36), high - low, 0.72, facecolor=BAND, lw=0))
        for edge in (bar.least, bar.most):
            if np.isfinite(edge):
                ax.vlines(edge, y - 0.36, y + 0.36, color=INK, lw=1.2)
        colour = ACCENT if bar.missed_by == 0 else ORANGE
        ax.hlines(y, bar.low, bar.high, color=colour, lw=2.4)
        ax.plot(bar.value, y, "o", color=colour, ms=7)
    ax.set_yticks(range(len(shown)), [f"{b.name} ({b.cases})" for b in shown])
    ax.set_ylim(len(shown) - 0.5, -0.5)
    ax.tick_params(axis="y", length=0)
    _percent(ax)
    low = min([0.0, *(b.low for b in shown)])
    ax.set_xlim(max(low, -0.5) - 0.02, max(1.02, min(1.2, max(b.high for b in shown) + 0.02)))
    return figure


def _effects(found: BlindScore) -> Figure:
    """One row per effect: the share with its interval, and right of it counts by size."""
    table = found.effects
    whole = table[table["size"] == "all"].sort_values(["first_right", "effect"], ascending=[True, True])
    sizes = ordered_sizes(table.loc[table["size"] != "all", "size"])
    figure = _new(9.0, 0.9 + 0.26 * len(whole), left=2.0, right=0.4 + 0.9 * len(sizes))
    ax = figure.add_subplot()
    y = np.arange(len(whole))
    ax.hlines(y, whole["low"], whole["high"], color=FAINT, lw=3)
    ax.plot(whole["first_three_right"], y, "|", color=GREY, ms=9, mew=2)
    ax.plot(whole["first_right"], y, "o", color=ACCENT, ms=6)
    ax.set_yticks(y, [str(e).replace("_", " ") for e in whole["effect"]])
    ax.set_ylim(len(whole) - 0.5, -0.5)
    ax.tick_params(axis="y", length=0)
    _percent(ax)
    for k, size in enumerate(sizes):
        part = table[table["size"] == size].set_index("effect")
        right = 1.0 + (0.5 + 0.9 * k) / (9.0 - 2.0 - 0.4 - 0.9 * len(sizes))
        ax.text(right, 1.005, size, transform=ax.transAxes, ha="center", va="bottom", fontweight="bold")
        for row, effect in enumerate(whole["effect"]):
            if effect in part.index:
                n, share = int(part.loc[effect, "cases"]), float(part.loc[effect, "first_right"])
                hits = round(n * share)
                ax.text(
                    right, row, f"{hits} of {n}", transform=ax.get_yaxis_transform(), ha="center", va="center",
                    color=INK if hits == n else ORANGE,
                )  # fmt: skip
    return figure


def _reliability(found: BlindScore) -> Figure:
    """Upper: how often right against stated, with intervals. Lower: how many answers were stated so."""
    table = found.basic.calibration
    figure = _new(5.6, 5.2, left=0.85)
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=[3.2, 1])
    figure.subplots_adjust(hspace=0.12)
    upper.plot([0, 1], [0, 1], color=FAINT, lw=1.5)
    upper.vlines(table["stated"], table["low"], table["high"], color=ACCENT, lw=2.2)
    upper.plot(table["stated"], table["right"], "o", color=ACCENT, ms=6)
    _percent(upper, "y")
    upper.set_ylabel("first answer is right")
    lower.bar((table["from"] + table["to"]) / 2, table["cases"], width=0.9 / BINS, color=ACCENT, alpha=0.6)
    top = int(table["cases"].max())
    for row in table.itertuples():
        lower.text((row[1] + row[2]) / 2, row[3] + 0.03 * top, str(row[3]), ha="center", va="bottom", fontsize=8.5)
    lower.set_ylim(0, 1.3 * top)
    lower.set_yticks([])
    lower.set_ylabel("cases")
    lower.set_xlabel("stated probability of the first answer")
    _percent(lower)
    return figure


def _confusion(found: BlindScore) -> Figure:
    """Planted down, named across: right ones blue, wrong ones orange."""
    cases = found.basic.cases
    cases = cases[cases["kind"] != "pair"]
    first = cases["first"].where(~cases["first"].str.contains("+", regex=False), SEVERAL)
    last = {NONE: 1, UNKNOWN: 2, SEVERAL: 3}
    rows, columns = (sorted(set(v), key=lambda n: (last.get(n, 0), n)) for v in (cases["truth"], first))
    wide, cell = 11.0, 0.31  # one width, so that letters are as large as elsewhere
    figure = _new(wide, 2.3 + 0.25 * len(rows), left=1.75, right=max(wide - 1.75 - cell * len(columns), 0.4))
    figure.subplots_adjust(top=1 - 1.75 / figure.get_figheight(), bottom=0.1 / figure.get_figheight())
    ax = figure.add_subplot()
    counts = Counter(zip(cases["truth"], first, cases["right"], strict=True))
    for (truth, name, right), count in counts.items():
        x, y, colour = columns.index(name), rows.index(truth), ACCENT if right else ORANGE
        ax.add_patch(Rectangle((x - 0.46, y - 0.44), 0.92, 0.88, facecolor=colour, alpha=0.3, lw=0))
        ax.text(x, y, str(count), ha="center", va="center", fontweight="normal" if right else "bold")
    ax.set_xlim(-0.5, len(columns) - 0.5)
    ax.set_ylim(len(rows) - 0.5, -0.5)
    ax.set_xticks(range(len(columns)), [c.replace("_", " ") for c in columns], rotation=55, ha="left")
    ax.set_yticks(range(len(rows)), [r.replace("_", " ") for r in rows])
    ax.xaxis.tick_top()
    ax.tick_params(length=0)
    for side in ax.spines.values():
        side.set_visible(False)
    ax.hlines(np.arange(len(rows) - 1) + 0.5, -0.5, len(columns) - 0.5, color=BAND, lw=0.8, zorder=0)
    ax.vlines(np.arange(len(columns) - 1) + 0.5, -0.5, len(rows) - 0.5, color=BAND, lw=0.8, zorder=0)
    return figure


def _coverage(found: BlindScore) -> Figure:
    """Left: shares by parameter beside the nominal band. Right: errors in units of the stated ones."""
    table = found.coverage[found.coverage["values"] > 0]
    figure = _new(10.0, max(3.6, 0.9 + 0.24 * len(table)), left=2.9)
    left, right = figure.subplots(1, 2, width_ratios=[1.5, 1])
    y = np.arange(len(table))
    left.axvspan(0.90, 0.98, color=BAND, lw=0)
    left.hlines(y, table["low"], table["high"], color=FAINT, lw=3)
    left.plot(table["covered"], y, "o", color=ACCENT, ms=6)
    both = zip(table["effect"].str.replace("_", " "), table["parameter"], strict=True)
    names = [f"{effect} {parameter}".strip() for effect, parameter in both]
    left.set_yticks(y, [f"{n} ({v})" for n, v in zip(names, table["values"], strict=True)])
    left.set_ylim(len(table) - 0.5, -0.5)
    left.tick_params(axis="y", length=0)
    left.set_title("held by the 95 % interval")
    _percent(left)
    off = np.clip(found.parameters["errors_off"].dropna().to_numpy(float), -5.99, 5.99)
    edges = np.arange(-6, 6.01, 0.5)
    right.hist(off, bins=list(edges), color=ACCENT, alpha=0.6)
    x = np.linspace(-6, 6, 200)
    right.plot(x, 0.5 * len(off) * norm.pdf(x), color=INK, lw=1.2)
    right.set_title("errors, in stated standard errors")
    right.set_xlabel("value less truth (clipped at ±6)")
    right.set_yticks([])
    return figure


def _places(found: BlindScore) -> Figure:
    """Distance from the truth against the stated error, logarithmic; on the line they are equal."""
    figure = _new(5.4, 4.2, left=0.8)
    ax = figure.add_subplot()
    known = found.places.dropna(subset="errors_off")  # a logarithmic axis has no room for an error of nothing
    for (effect, part), colour in zip(known.groupby("effect"), (ACCENT, ORANGE), strict=False):
        ax.plot(
            part["stated_error_m"], part["distance_m"], "o", color=colour, ms=6, label=str(effect).replace("_", " ")
        )
    both = known[["stated_error_m", "distance_m"]].to_numpy(float)
    low, high = 0.6 * both.min(), 1.7 * both.max()
    ax.plot([low, high], [low, high], color=FAINT, lw=1.5)
    ax.set(xscale="log", yscale="log", xlim=(low, high), ylim=(low, high))
    ax.set(xlabel="stated standard error [m]", ylabel="distance from the truth [m]")
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_formatter(lambda v, _: f"{v:g}")
        axis.set_minor_formatter(lambda v, _: "")
    ax.legend(loc="upper left")
    return figure


def _gap(found: BlindScore) -> Figure:
    """Own against the oracle's share of the closable gap."""
    assert found.gap is not None
    figure = _new(5.4, 4.6, left=0.8)
    ax = figure.add_subplot()
    gap = found.gap.dropna(subset="ratio")  # without those in which there is nothing to close
    own, oracle = (np.clip(gap[c].to_numpy(float), -0.5, 1.1) for c in ("own", "oracle"))
    same = gap["as_planted"].to_numpy(bool)
    ax.plot([-0.5, 1.1], [-0.5, 1.1], color=FAINT, lw=1.5)
    ax.plot(oracle[same], own[same], "o", color=ACCENT, ms=5, alpha=0.7, label="named as planted")
    ax.plot(oracle[~same], own[~same], "o", color=ORANGE, ms=6, label="named otherwise")
    ax.set(xlabel="closed by the oracle, of what can be closed", ylabel="closed by the diagnosis")
    ax.legend(loc="lower right")
    low = min(0.0, float(own.min()), float(oracle.min())) - 0.05
    ax.set(xlim=(low, 1.12), ylim=(low, 1.12))
    return figure
