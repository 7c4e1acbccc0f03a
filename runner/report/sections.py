"""The long sections of a report: motions, misses, what is left, where it is, the noise."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from markupsafe import Markup
from scipy.special import chdtrc  # of scipy.stats' import every diagnosis would wait for a second

from runner.effects.wording import counted, listed, number, percent, small_unit
from runner.importing.record import called, episode_sources
from runner.report import motion_figures, where_figures, words
from runner.report.before_after import Miss, misses, of_whole_episodes
from runner.report.figures import GREY, ORANGE
from runner.report.missing_force import by_regime, components, missing_force
from runner.report.motions import Paths, autocorrelation, where_after, whitened
from runner.report.statement import Statement
from runner.report.suspects import suspects
from runner.settings import SETTINGS

if TYPE_CHECKING:
    from runner.diagnosis.result import Diagnosis
    from runner.localise.where import Where

WHITE_AT = 0.01  # significance below which residuals are called structured
LAGS = 20
AS_NOISE = 1.5  # noise levels: within it is as good as the noise
QUARTERS = tuple(f"the {q} quarter" for q in ("first", "second", "third", "last"))


def first_figure(diagnosis: Diagnosis, paths: list[Paths]) -> dict[str, Any] | None:
    """Return the one figure at the top: where the simulator as believed misses, on the map or over time."""
    found = diagnosis.where
    if not found.exceeds:
        return None
    places = _places(found)
    about = {"sentence": spelt(diagnosis, found.sentence), "window": f"{found.window_s:.3g} s"}
    if diagnosis.system.plan_view is not None and np.any(
        places["q"].to_numpy(float) < SETTINGS.where.false_discovery_rate
    ):
        svg = where_figures.place_map(diagnosis.system, places, paths, diagnosis.effects, "first")
        return about | {"kind": "map", "svg": Markup(svg), "framed": None}
    # one cell is marked, that of the first sentence's: what was done, if anything done stands out
    marked = [s.cell for s in suspects(diagnosis.system, found) if s.cell is not None]
    svg, top, fewer = where_figures.timeline(found.windows, found.window_s, marked[0] if marked else None, "first")
    framed = diagnosis.system.phrase(*marked[0]) if marked else None
    left_out = f"{counted(fewer, 'episode')} in which less is missed" if fewer else ""
    return about | {
        "kind": "timeline",
        "svg": Markup(svg),
        "framed": framed,
        "top": number(top, 2),
        "left_out": left_out,
    }


def trajectories(diagnosis: Diagnosis, paths: list[Paths]) -> list[dict[str, Any]]:
    """Return the figures of the held-out episodes, worst first; without any, of the episode that was missed most."""
    out = []
    for path in _shown(diagnosis, paths)[:3]:
        episode = called(diagnosis.recording.path, diagnosis.recording.episodes[path.episode].index)
        before, after = (_missed(diagnosis, path, which) for which in ("nominal", "corrected"))
        way, channels = motion_figures.trajectory(
            diagnosis.system, path, diagnosis.measured.sigma, f"path{path.episode}", after=_colour(diagnosis)
        )
        out.append(
            {
                "episode": episode,
                "held_out": path.held_out,
                "before": number(before, 2),
                "after": number(after, 2),
                "way": None if way is None else Markup(way),
                "channels": _marked(channels),
                "of": len(diagnosis.system.channels),
            }
        )
    return out


def _marked(drawings: Sequence[str]) -> list[Markup]:
    return [Markup(d) for d in drawings]


def _colour(diagnosis: Diagnosis) -> str:
    """Return the colour of what is left: orange is for what was corrected."""
    return ORANGE if diagnosis.effects else GREY


def _missed(diagnosis: Diagnosis, path: Paths, which: str) -> float:
    """Root mean square of what a model misses of an episode, in noise levels."""
    return float(np.sqrt(np.nanmean(((getattr(path, which) - path.measured) / diagnosis.measured.sigma) ** 2)))


def _shown(diagnosis: Diagnosis, paths: list[Paths]) -> list[Paths]:
    """Return the held-out episodes, worst first; without any, the episode that was missed most."""
    ranked = sorted(paths, key=lambda p: -_missed(diagnosis, p, "nominal"))
    return [p for p in ranked if p.held_out] or ranked[:1]


def closure(diagnosis: Diagnosis) -> dict[str, Any] | None:
    """Return how far off the simulator is before and after, by channel and horizon, and by what went on."""
    found = misses(diagnosis)
    if not found:
        return None
    rows: dict[str, list[Miss]] = {}
    for miss in found:
        rows.setdefault(miss.channel.name, []).append(miss)
    several = len({m.horizon for m in found}) > 1
    return {
        "horizons": [m.horizon for m in rows[found[0].channel.name]],
        "several": several,
        "rows": [
            {
                "name": part[0].channel.label,
                "unit": part[0].unit,
                "noise": number(part[-1].noise, 2),
                "cells": [
                    {
                        "before": number(m.before, 2),
                        "after": number(m.after, 2),
                        "within": m.after <= AS_NOISE * m.noise,
                    }
                    for m in part
                ],
            }
            for part in rows.values()
        ],
        "regimes": [
            {
                "name": row["regime"],
                "windows": row["windows"],
                "before": number(math.sqrt(max(row["before"], 0.0)), 2),
                "after": number(math.sqrt(max(row["after"], 0.0)), 2),
                "within": row["after"] <= AS_NOISE**2,
            }
            for row in diagnosis.closure.regimes.to_dict("records")
        ],
        "panels": _marked(
            motion_figures.horizons(found, "closure", after=_colour(diagnosis))
            if several
            else [motion_figures.bars(of_whole_episodes(diagnosis), "closure", colour=_colour(diagnosis))]
        ),
    }


def whiteness(diagnosis: Diagnosis, said: Statement, paths: list[Paths]) -> dict[str, Any] | None:
    """Return whether what is left has a memory; what that means is the statement's to say."""
    if not paths:
        return None
    before, after = (whitened(diagnosis, paths, which) for which in ("nominal", "corrected"))
    step_s = diagnosis.recording.episodes[0].step_s
    channels = diagnosis.system.channels
    structured, most = [], 0
    for i, channel in enumerate(channels):
        lags = min(LAGS, after.shape[2] // 4)
        r, count = autocorrelation(after[i], lags)
        most = max(most, count)
        q = count * (count + 2) * float(np.sum(r**2 / (count - np.arange(1, lags + 1))))
        if chdtrc(lags, q) < WHITE_AT / len(channels):
            structured.append(channel.label)
    bold, tail = words.left_at_large(said)
    return {
        "bold": bold,
        "tail": tail,
        "memory": words.memory(said, listed(structured), LAGS, most),
        "panels": _marked(
            motion_figures.whiteness(channels, before, after, step_s, "white", colour=_colour(diagnosis))
        ),
    }


def where(diagnosis: Diagnosis, said: Statement, paths: list[Paths]) -> dict[str, Any]:
    """Return where the gap is: a sentence, the missing force, the map, and shares by what went on."""
    found = diagnosis.where
    after = where_after(diagnosis)
    # windows of another length show another force: not to be drawn side by side
    alike = after if after is not None and math.isclose(after.window_s, found.window_s) else None
    places = _places(found)
    mapped = found.exceeds and len(places) > 1 and diagnosis.system.plan_view is not None
    share = percent(max(alike.excess, 0.0) / found.excess) if alike is not None and alike.excess < found.excess else ""
    return {
        "exceeds": found.exceeds,
        "sentence": spelt(diagnosis, found.sentence),
        "after": None
        if after is None
        else words.left_in_windows(said, after.exceeds, share, spelt(diagnosis, after.sentence)),
        "alike": alike is not None,
        "window": f"{found.window_s:.3g} s",
        "regimes": _marked(
            where_figures.regimes(
                by_regime(diagnosis, found),
                by_regime(diagnosis, alike) if alike else [],
                components(diagnosis.system),
                "regimes",
            )
        ),
        "map": Markup(where_figures.place_map(diagnosis.system, places, paths, diagnosis.effects, "map"))
        if mapped
        else None,
        "over_time": _over_time(diagnosis, found, alike, _shown(diagnosis, paths)[:1]),
        "factors": [
            _factor(diagnosis, found.cells, str(name))
            for name, cells in found.cells["factor"].value_counts(sort=False).items()
            # all of it in one cell says nothing
            if found.exceeds and name != "place" and cells > 1
        ],
    }


def _places(found: Where) -> pd.DataFrame:
    return found.cells.loc[found.cells["factor"] == "place"].dropna(subset=["x_m", "y_m"])


def _over_time(
    diagnosis: Diagnosis, found: Where, alike: Where | None, worst: Sequence[Paths]
) -> dict[str, Any] | None:
    for path in worst:
        before, after = (missing_force(diagnosis, w, path.episode) for w in (found, alike))
        if before is not None and len(before.t_s) > 1:  # one window makes no course
            panels = where_figures.over_time(before, after, diagnosis.system.disturbance.labels, "force")
            episode = called(diagnosis.recording.path, diagnosis.recording.episodes[path.episode].index)
            return {"episode": episode, "panels": _marked(panels)} if panels else None
    return None


def spelt(diagnosis: Diagnosis, sentence: str) -> str:
    """Return the sentence of where the gap is with its channels, which come first, in words."""
    labels, words = _labels(diagnosis), re.split("(, | and )", sentence)
    names = itertools.takewhile(lambda word: word in labels, words[::2])
    for i, name in enumerate(list(names)):
        words[2 * i] = labels[name]
    return "".join(words)


def _labels(diagnosis: Diagnosis) -> dict[str, str]:
    return {c.name: c.label for c in diagnosis.system.channels}


def _place(cell: str, order: Sequence[str]) -> tuple[str, float, str]:
    """Return what puts cells into their natural order.

    Channels and regimes come as they are listed, joints each with all of its cells, numbers by size, the rest by name.
    """
    if cell in order:
        return "", order.index(cell), cell
    # a number in the name of a joint is none of its places
    quoted, place = re.findall(r"('.*' )?(.*)", cell, re.DOTALL)[0]
    found = re.search(r"-?\d+(\.\d+)?", place)
    return quoted, (float(found.group()) if found else math.inf), cell


def _factor(diagnosis: Diagnosis, cells: pd.DataFrame, factor: str) -> dict[str, Any]:
    labels = _labels(diagnosis)
    order = (*labels, *diagnosis.system.regimes, *QUARTERS)
    part = cells.loc[cells["factor"] == factor]
    part = part.iloc[sorted(range(len(part)), key=lambda i: _place(str(part["cell"].iloc[i]), order))]
    path = diagnosis.recording.path
    sources = episode_sources(path) if factor == "episode" else {}
    files = {f"episode {number}": f"episode {called(path, number)}" for number in sources}
    top = max(float(part["share"].max()), float((part["share"] / part["lift"]).max()), 1e-9)
    rows = []
    for row in part.to_dict("records"):
        share, lift = float(row["share"]), float(row["lift"])
        even = share / lift if lift else 0.0
        rows.append(
            {
                "name": (labels | files).get(str(row["cell"]), re.sub(r"(?<!\w)-(?=\d)", "−", str(row["cell"]))),
                "share": percent(max(share, 0.0)) if np.isfinite(share) else "–",
                "width": f"{100 * float(np.clip(np.nan_to_num(share) / top, 0, 1)):.1f}",
                "even": f"{100 * float(np.clip(np.nan_to_num(even) / top, 0, 1)):.1f}",
                "stands_out": bool(row["q"] < SETTINGS.where.false_discovery_rate),
            }
        )
    return {"name": factor, "rows": rows}


def noise(diagnosis: Diagnosis) -> list[dict[str, str]]:
    """Return the noise of each channel: how much, where it is known from, and whether it has a memory."""
    measured = diagnosis.measured
    out = []
    for i, channel in enumerate(diagnosis.system.channels):
        unit, scale = small_unit(channel.unit)
        lag_one = float(measured.noise_model.lag_one[i])
        stated = float(measured.stated[i])
        source = "estimated from the recording"
        if np.isfinite(stated):
            source = f"as the recording shows it; stated: {number(scale * stated, 2)}"
        if measured.is_scatter()[i]:
            source += f"; after a hit {number(scale * float(measured.sigma[i]), 2)} {unit} counts as noise".rstrip()
        out.append(
            {
                "name": channel.label,
                "sigma": f"{number(scale * float(measured.sensor[i]), 2)} {unit}".strip(),
                "source": source,
                "kind": f"correlated from sample to sample ({lag_one:.2f})" if lag_one > 0 else "white",
            }
        )
    return out
