"""`report.html`: everything that a diagnosis found, as one page that needs no network."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jinja2
import numpy as np
import pandas as pd
from markupsafe import Markup
from scipy.stats import chi2

from runner.localise.where import REGIMES
from runner.noise.measured import CHANNELS, UNITS
from runner.recording import Contact
from runner.report import figures, words
from runner.report.before_after import NAMES, SMALL, Miss, misses, whole
from runner.report.motions import Paths, autocorrelation, replay, where_after, whitened
from runner.report.wrench import Wrench, by_regime, missing_wrench
from runner.storage.writing import write_text

if TYPE_CHECKING:
    from runner.diagnosis.pipeline import Diagnosis, Ranked

FILE = "report.html"
TEMPLATE = "template.html.j2"
LONG = 220  # letters of a verdict, from which on it is set smaller
SHOWN = 8  # explanations in the ranking; the rest are summed up
WHITE_AT = 0.01  # significance below which residuals are called structured
STRUCTURE = 0.12  # of the noise's variance, over all channels: more than this is a cause of its own, not a trace
LAGS = 20


def write_html(diagnosis: Diagnosis, path: str | Path) -> Path:
    """Write the report of a diagnosis.

    Args:
        diagnosis: What was found.
        path: The file; a folder: `report.html` in it.

    Returns:
        The file.
    """
    path = Path(path)
    path = path / FILE if path.is_dir() else path
    path.parent.mkdir(parents=True, exist_ok=True)
    write_text(path, render(diagnosis))
    return path


def render(diagnosis: Diagnosis) -> str:
    """Return the report as HTML."""
    return page_template("runner.report", TEMPLATE).render(_content(diagnosis))


def page_template(package: str, name: str) -> jinja2.Template:
    """Return a page's template from its package; it may include the style that all pages share."""
    loaders = [jinja2.PackageLoader(p, ".") for p in dict.fromkeys((package, "runner.report"))]
    environment = jinja2.Environment(
        loader=jinja2.ChoiceLoader(loaders),
        autoescape=jinja2.select_autoescape(enabled_extensions=("j2",)),
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    return environment.get_template(name)


def _content(diagnosis: Diagnosis) -> dict[str, Any]:
    paths = replay(diagnosis)
    return {
        "case": diagnosis.case,
        "kind": _kind(diagnosis),
        "verdict": words.verdict(diagnosis),
        "long": len(words.verdict(diagnosis)) > LONG,
        "confounded": words.confounded(diagnosis),
        "steps": [_with_code(step) for step in words.next_steps(diagnosis)],
        "facts": _facts(diagnosis),
        "ranking": _ranking(diagnosis),
        "corrected": bool(diagnosis.effects),
        "trajectories": _trajectories(diagnosis, paths),
        "closure": _closure(diagnosis),
        "whiteness": _whiteness(diagnosis, paths),
        "where": _where(diagnosis, paths),
        "noise": _noise(diagnosis),
        "believed": _believed(diagnosis),
        "notes": list(dict.fromkeys([*diagnosis.notes, *diagnosis.recording.notes])),
        "effort": _effort(diagnosis),
    }


def _with_code(text: str) -> Markup:
    """Return text with what stands between backticks as code."""
    parts = text.split("`")
    return Markup("").join(Markup("<code>{}</code>").format(p) if i % 2 else p for i, p in enumerate(parts))


def _kind(diagnosis: Diagnosis) -> str:
    if words.settled(diagnosis):
        return "open" if words.likeliest(diagnosis).probability < words.HALF else "found"
    return words.likeliest(diagnosis).effects[0] if words.likeliest(diagnosis).effects else words.NONE


def _facts(diagnosis: Diagnosis) -> list[tuple[str, str]]:
    """Return the figures below the verdict: what, how much."""
    top = words.likeliest(diagnosis)
    facts = [("probability of this answer", words.probability(top.probability))]
    closure = diagnosis.closure
    if diagnosis.effects:
        low, high = getattr(closure, "gap_closed_low", None), getattr(closure, "gap_closed_high", None)
        value = words.percent(diagnosis.gap_closed)
        if low is not None and high is not None and np.isfinite([low, high]).all():
            value += f" ({100 * low:.0f}–{100 * high:.0f} %)".replace("-", "−")
        facts.append(("of the gap closed on episodes that were not fitted", value))
        if (share := getattr(closure, "closable_closed", None)) is not None and np.isfinite(share):
            facts.append(("of what can be closed, all but the noise", words.percent(share)))
    at_last = {m.channel: m for m in whole(diagnosis)}
    if {"x", "y"} <= set(at_last):
        before, after = (
            1e-3 * float(np.hypot(getattr(at_last["x"], k), getattr(at_last["y"], k))) for k in ("before", "after")
        )
        text = words.change(before, after) if diagnosis.effects else words.length(before)
        facts.append(("position missed on episodes that were not fitted (root mean square)", text))
    return facts


def _ranking(diagnosis: Diagnosis) -> dict[str, Any]:
    nominal = diagnosis.recording.nominal
    rows = []
    everything = words.ordered(diagnosis)
    for ranked in everything[:SHOWN]:
        rows.append(
            {
                "name": words.title(ranked.effects or (words.NONE,)),
                "label": words.listed([words.label(e) for e in ranked.effects or (words.NONE,)]),
                "probability": words.probability(ranked.probability),
                "width": f"{100 * min(max(ranked.probability, 0.0), 1.0):.1f}",
                "amounts": [p.amount for p in words.phrases(ranked, nominal) if p.amount],
                "parameters": _parameters(ranked),
                "gap": "" if ranked.gap_closed is None else words.percent(ranked.gap_closed),
                "equivalent": [words.title(e) for e in words.equals(ranked)],
            }
        )
    rest = everything[SHOWN:]
    return {
        "rows": rows,
        "rest": len(rest),
        "rest_probability": words.probability(sum(r.probability for r in rest)) if rest else "",
    }


def _parameters(ranked: Ranked) -> list[tuple[str, str]]:
    """Return each parameter as it stands in `corrected.yaml`, with its standard error."""
    out = []
    for effect, values in ranked.parameters.items():
        errors = ranked.errors.get(effect, {})
        out += [(f"{effect}.{name}", words.plus_minus(v, errors.get(name))) for name, v in values.items()]
    return out


def _trajectories(diagnosis: Diagnosis, paths: list[Paths]) -> list[dict[str, Any]]:
    """Return the figures of the held-out episodes, worst first; without any, of the episode that was missed most."""

    out = []
    for path in _shown(diagnosis, paths)[:3]:
        number = diagnosis.recording.episodes[path.episode].index
        before, after = (_missed(diagnosis, path, which) for which in ("nominal", "corrected"))
        out.append(
            {
                "episode": number,
                "held_out": path.held_out,
                "before": words.number(before, 2),
                "after": words.number(after, 2),
                "svg": Markup(
                    figures.trajectory(
                        path, diagnosis.measured.sigma, number, f"path{path.episode}", after=_after(diagnosis)
                    )
                ),
            }
        )
    return out


def _after(diagnosis: Diagnosis) -> str:
    """Return the colour of what is left: orange is for what was corrected."""
    return figures.ORANGE if diagnosis.effects else figures.GREY


def _missed(diagnosis: Diagnosis, path: Paths, which: str) -> float:
    """Root mean square of what a model misses of an episode, in noise levels."""
    return float(np.sqrt(np.nanmean(((getattr(path, which) - path.measured) / diagnosis.measured.sigma) ** 2)))


def _shown(diagnosis: Diagnosis, paths: list[Paths]) -> list[Paths]:
    """Return the held-out episodes, worst first; without any, the episode that was missed most."""
    ranked = sorted(paths, key=lambda p: -_missed(diagnosis, p, "nominal"))
    return [p for p in ranked if p.held_out] or ranked[:1]


def _closure(diagnosis: Diagnosis) -> dict[str, Any] | None:
    found = misses(diagnosis)
    if not found:
        return None
    rows: dict[str, list[Miss]] = {}
    for miss in found:
        rows.setdefault(miss.channel, []).append(miss)
    several = len({m.horizon for m in found}) > 1
    return {
        "horizons": [m.horizon for m in rows[found[0].channel]],
        "several": several,
        "rows": [
            {
                "name": part[0].name,
                "unit": part[0].unit,
                "noise": words.number(part[-1].noise, 2),
                "cells": [
                    {
                        "before": words.number(m.before, 2),
                        "after": words.number(m.after, 2),
                        "within": m.after <= 1.5 * m.noise,
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
                "before": words.number(math.sqrt(max(row["before"], 0.0)), 2),
                "after": words.number(math.sqrt(max(row["after"], 0.0)), 2),
                "within": row["after"] <= 1.5**2,
            }
            for row in diagnosis.closure.regimes.to_dict("records")
        ],
        "svg": Markup(
            figures.horizons(found, "closure", after=_after(diagnosis))
            if several
            else figures.bars(whole(diagnosis), "closure", colour=_after(diagnosis))
        ),
    }


def _whiteness(diagnosis: Diagnosis, paths: list[Paths]) -> dict[str, Any] | None:
    if not paths:
        return None
    before, after = (whitened(diagnosis, paths, which) for which in ("nominal", "corrected"))
    step_s = diagnosis.recording.episodes[0].step_s
    structured, extra = [], [0.0]
    for i, channel in enumerate(CHANNELS):
        lags = min(LAGS, after.shape[2] // 4)
        r, count = autocorrelation(after[i], lags)
        q = count * (count + 2) * float(np.sum(r**2 / (count - np.arange(1, lags + 1))))
        if chi2.sf(q, lags) < WHITE_AT / len(CHANNELS):
            structured.append(NAMES[channel])
            extra.append(float(np.nanmean(after[i] ** 2)) - 1.0)
    return {
        "structured": words.listed(structured),
        "strong": float(np.nanmean(after**2)) - 1.0 > STRUCTURE,
        "extra": words.percent(max(extra)),
        "lags": LAGS,
        "size": words.number(float(np.sqrt(np.nanmean(after**2))), 3),
        "before": words.number(float(np.sqrt(np.nanmean(before**2))), 3),
        "svg": Markup(figures.whiteness(before, after, step_s, "white", colour=_after(diagnosis))),
    }


def _where(diagnosis: Diagnosis, paths: list[Paths]) -> dict[str, Any] | None:
    """Return where the gap is: a sentence, the missing wrench, the map, and shares by what went on."""
    where = diagnosis.where
    if where is None:
        return None
    after = where_after(diagnosis)
    # windows of another length show another force: not to be drawn side by side
    alike = after if after is not None and math.isclose(after.window_s, where.window_s) else None
    places = where.cells.loc[where.cells["factor"] == "place"].dropna(subset=["x_m", "y_m"])
    mapped = where.exceeds and len(places) > 1
    worst = _shown(diagnosis, paths)[:1]
    wrenches = [(missing_wrench(diagnosis, w, p.episode), p) for p in worst for w in (where, alike)]
    return {
        "exceeds": where.exceeds,
        "sentence": _spelt(where.sentence),
        "after": None if after is None else {"exceeds": after.exceeds, "sentence": _spelt(after.sentence)},
        "left": None
        if alike is None or where.excess <= 0
        else words.percent(max(alike.excess, 0.0) / max(where.excess, 1e-9)),
        "alike": alike is not None,
        "window": f"{where.window_s:.3g} s",
        "regimes": Markup(
            figures.regimes(by_regime(diagnosis, where), by_regime(diagnosis, alike) if alike else [], "regimes")
        ),
        "map": Markup(figures.floor(places, paths, diagnosis.effects, "floor")) if mapped else None,
        "over_time": _over_time(diagnosis, wrenches),
        "factors": [
            _factor(where.cells, name)
            for name in dict.fromkeys(where.cells["factor"])
            if where.exceeds and name != "place"
        ],
    }


def _over_time(diagnosis: Diagnosis, wrenches: list[tuple[Wrench | None, Paths]]) -> dict[str, Any] | None:
    if not wrenches or wrenches[0][0] is None:
        return None
    before, after = wrenches[0][0], wrenches[1][0]
    number = diagnosis.recording.episodes[wrenches[0][1].episode].index
    return {"episode": number, "svg": Markup(figures.wrench(before, after, "wrench"))}


def _spelt(sentence: str) -> str:
    """Return the sentence of where the gap is with the channel in words."""
    first, comma, rest = sentence.partition(",")
    return NAMES.get(first, first) + comma + rest


ORDER = (*CHANNELS, *REGIMES, *(f"the {q} quarter" for q in ("first", "second", "third", "last")))


def _place(cell: str) -> tuple[float, str]:
    """Return what puts cells into their natural order: channels and regimes, numbers by size, the rest by name."""
    if cell in ORDER:
        return ORDER.index(cell), cell
    number = re.search(r"-?\d+(\.\d+)?", cell)
    return (float(number.group()) if number else math.inf), cell


def _factor(cells: pd.DataFrame, factor: str) -> dict[str, Any]:
    part = cells.loc[cells["factor"] == factor]
    part = part.iloc[sorted(range(len(part)), key=lambda i: _place(str(part["cell"].iloc[i])))]
    top = max(float(part["share"].max()), float((part["share"] / part["lift"]).max()), 1e-9)
    rows = []
    for row in part.to_dict("records"):
        share, lift = float(row["share"]), float(row["lift"])
        even = share / lift if lift else 0.0
        rows.append(
            {
                "name": NAMES.get(str(row["cell"]), re.sub(r"^-", "−", str(row["cell"]))),
                "share": words.percent(max(share, 0.0)) if np.isfinite(share) else "–",
                "width": f"{100 * float(np.clip(np.nan_to_num(share) / top, 0, 1)):.1f}",
                "even": f"{100 * float(np.clip(np.nan_to_num(even) / top, 0, 1)):.1f}",
                "stands_out": bool(row["q"] < 0.05),
            }
        )
    return {"name": factor, "rows": rows}


def _noise(diagnosis: Diagnosis) -> list[dict[str, str]]:
    out = []
    for i, channel in enumerate(CHANNELS):
        unit, scale = SMALL[UNITS[i]]
        colour = float(diagnosis.measured.colour.lag_one[i])
        out.append(
            {
                "name": NAMES[channel],
                "sigma": f"{words.number(scale * float(diagnosis.measured.sigma[i]), 2)} {unit}",
                "source": "stated in nominal.yaml" if diagnosis.measured.stated[i] else "estimated from the recording",
                "colour": f"correlated from sample to sample ({colour:.2f})" if colour > 0 else "white",
            }
        )
    return out


def _believed(diagnosis: Diagnosis) -> list[tuple[str, str]]:
    nominal, episodes = diagnosis.recording.nominal, diagnosis.recording.episodes
    duration_s = sum(float(e.t_s[-1] - e.t_s[0]) for e in episodes)
    size = " × ".join(words.number(2 * h) for h in nominal.half_size_m)
    held = words.listed([str(episodes[e].index) for e in diagnosis.held_out])
    return [
        (
            "recording",
            f"{len(episodes)} episodes, {words.number(duration_s)} s in all, "
            f"{words.number(nominal.rate_hz)} samples a second",
        ),
        ("kept from the fit", f"episodes {held}" if held else "none"),
        ("object", f"box of {size} m, {words.number(nominal.mass_kg)} kg"),
        (
            "friction",
            f"{nominal.friction:.3g}, "
            + ("under the whole base" if nominal.contact is Contact.PATCH else "at the corners"),
        ),
        ("gravity", f"{nominal.gravity_m_s2:.4g} m/s²"),
    ]


def _effort(diagnosis: Diagnosis) -> str:
    simulated = words.number(diagnosis.simulated_s)
    return f"{words.number(diagnosis.seconds, 2)} s, in which {simulated} s of motion were simulated"
