"""Figures of motions and what is missed of them: each channel a small drawing of its own."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes

from runner.effects.wording import small_unit
from runner.report.before_after import Miss
from runner.report.figures import BAND, FAINT, GREY, INK, ORANGE, STYLE, new, svg
from runner.report.figures import title as titled
from runner.report.motions import Paths, autocorrelation
from runner.systems.base import AbstractSystem
from runner.systems.channels import Channel, Space

MOST = 12  # channels of a trajectory: those that are missed most
DEGREE_UNITS = {"rad": "°", "rad/s": "°/s"}


def chosen(system: AbstractSystem, path: Paths, sigma: np.ndarray) -> list[int]:
    """Return which channels are drawn, in order: all, or those that the nominal model misses most."""
    if len(system.channels) <= MOST:
        return list(range(len(system.channels)))
    missed = np.nan_to_num(np.nanmean(((path.nominal - path.measured) / sigma) ** 2, axis=0))
    return sorted(np.argsort(-missed)[:MOST].tolist())


def trajectory(
    system: AbstractSystem, path: Paths, sigma: np.ndarray, name: str, *, after: str = ORANGE
) -> tuple[str | None, list[str]]:
    """Return one episode's way on the map, if there is one, and every channel over time with what is missed of it."""
    with mpl.rc_context(STYLE):
        way = None if system.plan_view is None else _way(system, path, f"{name}way", after)
        return way, [
            _channel(system, path, i, float(sigma[i]), f"{name}c{i}", after) for i in chosen(system, path, sigma)
        ]


def _way(system: AbstractSystem, path: Paths, name: str, after: str) -> str:
    assert system.plan_view is not None
    flat = list(system.plan_view)
    figure = new(3.1, 4.6, left=0.6)
    ax = figure.add_subplot()
    ax.plot(*path.nominal[:, flat].T, color=GREY, lw=2.2)
    ax.plot(*path.corrected[:, flat].T, color=after, lw=2.2)
    ax.plot(*path.measured[:, flat].T, color=INK, lw=0.9)
    begin = path.measured[np.isfinite(path.measured[:, flat]).all(axis=1)][:1, flat]
    ax.plot(*begin.T, "o", color=INK, ms=5)
    for motion, colour in ((path.nominal, GREY), (path.corrected, after)):
        ax.plot(*motion[-1, flat], "s", color=colour, ms=5)
    ax.set_aspect("equal", "datalim")
    x, y = (system.channels[i] for i in flat)
    ax.set(title="the way from above", xlabel=f"{x.name} [{x.unit}]", ylabel=f"{y.name} [{y.unit}]")
    ax.margins(0.1)
    ax.locator_params(nbins=5)
    return svg(figure, name, "Measured, nominal and corrected way from above")


def _channel(system: AbstractSystem, path: Paths, i: int, sigma: float, name: str, after: str) -> str:
    """Return one channel over time, and below it what is missed, with the noise as a band."""
    channel = system.channels[i]
    # an orientation is told as a turn away from what was measured: a reader wants to see how it turned
    turned = system.readable()[path.episode][:, i] if channel.space is Space.ROTATION else 0.0
    figure = new(3.1, 2.5, left=0.55)
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=[1.5, 1])
    figure.subplots_adjust(hspace=0.22)
    unit = DEGREE_UNITS.get(channel.unit, channel.unit)
    scale = 180 / np.pi if channel.unit in DEGREE_UNITS else 1.0
    upper.plot(path.t_s, scale * (turned + path.nominal[:, i]), color=GREY, lw=2.0)
    upper.plot(path.t_s, scale * (turned + path.corrected[:, i]), color=after, lw=2.0)
    upper.plot(path.t_s, scale * (turned + path.measured[:, i]), color=INK, lw=0.9)
    titled(upper, f"{channel.label} [{unit}]" if unit else channel.label)
    # marks between the two would strike through what is written there
    upper.tick_params(axis="x", length=0, labelbottom=False)

    unit, scale = small_unit(channel.unit)
    lower.axhspan(-2 * scale * sigma, 2 * scale * sigma, color=BAND, lw=0)
    lower.axhline(0, color=INK, lw=0.6)
    missed = [scale * (m - path.measured)[:, i] for m in (path.nominal, path.corrected)]
    for residual, colour, width in zip(missed, (GREY, after), (1.2, 1.0), strict=True):
        lower.plot(path.t_s, residual, color=colour, lw=width)
    known = np.abs(np.concatenate(missed))
    most = float(np.nanpercentile(known, 99.8)) if np.isfinite(known).any() else 0.0
    top = max(most, 3 * scale * sigma)
    lower.set_ylim(-1.1 * top, 1.1 * top)
    # not beside the axis, where long numbers push it out of the picture
    lower.set_title(f"missed [{unit}]" if unit else "missed", loc="left", fontsize="small", pad=2)
    lower.set_xlabel("time [s]", labelpad=1)
    return svg(figure, name, f"{channel.label}: measured, nominal and corrected, and what is missed")


def horizons(found: Sequence[Miss], name: str, *, after: str = ORANGE) -> list[str]:
    """Return the misses over the horizon, before and after, against the noise, one drawing per channel."""
    out = []
    with mpl.rc_context(STYLE):
        for i, channel in enumerate(dict.fromkeys(m.channel for m in found)):
            part = [m for m in found if m.channel == channel]
            figure = new(3.1, 1.9)
            ax, x = figure.add_subplot(), np.arange(len(part))
            ax.plot(x, [m.before for m in part], "o-", color=GREY, ms=4)
            ax.plot(x, [m.after for m in part], "o-", color=after, ms=4)
            ax.plot(x, [m.noise for m in part], color=INK, lw=0.9, ls=(0, (1, 2)))
            ax.set_ylim(0, 1.12 * max(max(m.before, m.after, m.noise) for m in part))
            ax.set_xticks(x, [m.horizon.replace("whole ", "").replace("parts of", "parts\nof") for m in part])
            titled(ax, part[0].title)
            out.append(svg(figure, f"{name}{i}", f"{channel.label}: error before and after over the horizon"))
    return out


def bars(found: Sequence[Miss], name: str, *, colour: str = ORANGE) -> str:
    """Return the misses before and after in multiples of the noise, one row per channel."""
    with mpl.rc_context(STYLE):
        figure = new(4.4, 0.62 + 0.24 * len(found), left=1.1, top=0.08)
        draw_bars(figure.add_subplot(), found, colour=colour)
        return svg(figure, name, "Misses before and after in noise levels, per channel")


def draw_bars(ax: Axes, found: Sequence[Miss], *, colour: str = ORANGE) -> None:
    """Draw the misses before and after in multiples of the noise, one row per channel."""
    y = np.arange(len(found))
    before, after = (np.array([getattr(m, k) / m.noise for m in found]) for k in ("before", "after"))
    ax.hlines(y, after, before, color=FAINT, lw=3)
    ax.plot(before, y, "o", color=GREY, ms=7)
    ax.plot(after, y, "o", color=colour, ms=7)
    ax.axvline(1, color=INK, lw=0.9, ls=(0, (1, 2)))
    ax.set_xscale("log")
    ax.xaxis.set_major_formatter(lambda v, _: f"{v:g}")
    ax.xaxis.set_minor_formatter(lambda v, _: f"{v:g}" if str(v)[0] in "25" else "")
    ax.set_yticks(y, [m.channel.label for m in found])
    ax.invert_yaxis()
    ax.set_xlabel("missed, in noise levels (dotted: the noise)")


def whiteness(
    channels: Sequence[Channel],
    before: np.ndarray,
    after: np.ndarray,
    step_s: float,
    name: str,
    *,
    colour: str = ORANGE,
    longest_s: float = 0.5,
) -> list[str]:
    """Return the autocorrelation of the whitened residuals (C, E, T), with the band of white noise, by channel."""
    lags = max(5, min(round(longest_s / step_s), before.shape[2] // 4))
    t = step_s * np.arange(1, lags + 1)
    out = []
    with mpl.rc_context(STYLE):
        for i, channel in enumerate(channels):
            figure = new(3.1, 1.75)
            ax = figure.add_subplot()
            first, _ = autocorrelation(before[i], lags)
            second, count = autocorrelation(after[i], lags)
            band = 1.96 / np.sqrt(max(count, 1))
            ax.axhspan(-band, band, color=BAND, lw=0)
            ax.axhline(0, color=INK, lw=0.6)
            ax.plot(t, first, color=GREY, lw=1.5)
            ax.vlines(t, 0, second, color=colour, lw=1.6)
            ax.plot(t, second, ".", color=colour, ms=3.5)
            titled(ax, channel.label)
            ax.set_ylim(-0.5, 1.05)
            ax.set_yticks([0, 0.5, 1])
            ax.set_xlabel("lag [s]", labelpad=1)
            out.append(svg(figure, f"{name}{i}", f"{channel.label}: autocorrelation of the residuals before and after"))
    return out
