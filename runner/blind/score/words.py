"""The tables of a blind score as text, for the terminal and for the page alike."""

from __future__ import annotations

import math

import pandas as pd

from runner.blind.score import Bar, BlindScore
from runner.diagnosis.score import NONE, UNKNOWN, Score, grouped

Rows = list[tuple[str, ...]]


def spaced(name: str) -> str:
    """Return effects as they are read."""
    return name.replace("_", " ").replace("+", " + ")


def share(value: float, low: float, high: float) -> str:
    """Return a share with its interval in percent."""
    return "–" if not math.isfinite(value) else f"{100 * value:.0f} % ({100 * low:.0f}–{100 * high:.0f})"


def cases(count: int) -> str:
    """Return so many cases in words."""
    return f"{count} case" + "s" * (count != 1)


def figure(bar: Bar) -> str:
    """Return what was measured with its interval."""
    if not math.isfinite(bar.value):
        return "–"
    if bar.percent:
        return f"{100 * bar.value:.1f} % ({100 * bar.low:.0f}–{100 * bar.high:.0f})"
    return f"{bar.value:.3f} ({bar.low:.2f}–{bar.high:.2f})"


def wanted(bar: Bar) -> str:
    """Return what it is to reach."""
    low, high = (f"{100 * v:.0f}" if bar.percent else f"{v:g}" for v in (bar.least, bar.most))
    unit = " %" if bar.percent else ""
    if math.isfinite(bar.least) and math.isfinite(bar.most):
        return f"{low}–{high}{unit}"
    return f"≥ {low}{unit}" if math.isfinite(bar.least) else f"≤ {high}{unit}"


def outcome(bar: Bar) -> str:
    """Return whether it was reached, with a question mark where so few cases don't settle it."""
    if not math.isfinite(bar.value):
        return "not measured"
    if bar.missed_by == 0.0:
        return "met" if bar.certain else "met ?"
    by = f"{100 * bar.missed_by:.1f}" if bar.percent else f"{bar.missed_by:.3f}"
    return f"missed by {by}" + ("" if bar.certain else " ?")


def bars(found: BlindScore) -> tuple[tuple[str, ...], Rows]:
    """Return heading and rows of the figures beside their bars."""
    rows: Rows = [(b.name, str(b.cases), figure(b), wanted(b), outcome(b)) for b in found.bars]
    return ("", "n", "measured (95 %)", "bar", "outcome"), rows


def groups(table: pd.DataFrame) -> tuple[tuple[str, ...], Rows]:
    """Return heading and rows of the first answers by group."""
    rows: Rows = [
        (spaced(str(r["group"])), str(r["cases"]), share(r["first_right"], r["low"], r["high"]),
         share(r["first_three_right"], r["three_low"], r["three_high"]))
        for r in table.to_dict("records")
    ]  # fmt: skip
    return ("cases with", "cases", "first is right", "one of three is"), rows


def effects(table: pd.DataFrame) -> tuple[tuple[str, ...], Rows]:
    """Return heading and rows of single effects by size."""
    rows: Rows = []
    for (effect, size), part in grouped(table, ["effect", "size"], sort=False):
        r = part.iloc[0].to_dict()
        rows.append(
            ("" if size != "all" else spaced(str(effect)), str(size), str(r["cases"]),
             share(r["first_right"], r["low"], r["high"]),
             share(r["first_three_right"], r["three_low"], r["three_high"]))
        )  # fmt: skip
    return ("effect", "size", "cases", "first is right", "one of three is"), rows


def confusion(found: Score) -> tuple[tuple[str, ...], Rows]:
    """Return heading and rows of what was named for what was planted, wrong names marked."""
    order = {"single": 0, "pair": 1, UNKNOWN: 2, NONE: 3}
    cases = found.cases
    planted = cases["truth"].map(spaced).where(cases["kind"] != UNKNOWN, "unknown: " + cases["what"].map(spaced))
    rows: Rows = []
    for (_, truth), part in grouped(cases, [cases["kind"].map(order), planted]):
        counts = pd.Series(part.groupby(["right", "first"]).size()).sort_values(ascending=False)
        named = counts.sort_index(level=0, ascending=False)
        each = zip(named.index, named, strict=True)
        texts = [f"{spaced(str(n))} {c}{'' if right else ' ✗'}" for (right, n), c in each]
        rows.append((str(truth), ", ".join(texts)))
    return ("planted", "named, how often (✗ wrong)"), rows


def coverage(found: BlindScore) -> tuple[tuple[str, ...], Rows]:
    """Return heading and rows of the intervals that hold the truth."""
    rows: Rows = [
        (f"{spaced(r['effect'])} {r['parameter']}".strip(), str(r["values"]), share(r["covered"], r["low"], r["high"]),
         "–" if math.isnan(r["errors_off"]) else f"{r['errors_off']:.2f}")
        for r in found.coverage.to_dict("records")
    ]  # fmt: skip
    return ("parameter", "values", "held (95 %)", "rms error / stated"), rows


def places(found: BlindScore) -> tuple[tuple[str, ...], Rows]:
    """Return heading and rows of the places of patches and tethers."""
    rows: Rows = []
    for r in found.places.to_dict("records"):
        numbers = (r["distance_m"], ".3g"), (r["stated_error_m"], ".2g"), (r["errors_off"], ".1f")
        texts = [f"{value:{kind}}" if math.isfinite(value) else "–" for value, kind in numbers]
        rows.append((r["case"], spaced(r["effect"]), *texts))
    return ("case", "effect", "off [m]", "stated [m]", "off / stated"), rows


def worst(found: BlindScore) -> tuple[tuple[str, ...], Rows]:
    """Return heading and rows of the wrong answers that were most certain."""
    rows: Rows = []
    for r in found.worst.to_dict("records"):
        rank = r["rank_of_truth"]
        listed = rank is not None and math.isfinite(rank)
        truth = f"{rank:.0f}. ({100 * r['probability_of_truth']:.2g} %)" if listed else "not listed"
        sizes = "" if r["severity"] == "-" else f" ({spaced(r['severity'])})"
        stated = f"{100 * r['probability']:.1f} %"
        rows.append((r["case"], spaced(r["truth"]) + sizes, spaced(r["first"]), stated, truth, r["about"]))
    return ("case", "planted", "named", "stated", "truth came", "about the case"), rows


def notes(found: BlindScore) -> list[str]:
    """Return what must be said beside the figures."""
    out = []
    if missing := found.basic.unanswered:
        out.append(
            f"{len(missing)} of {len(found.basic.cases)} cases have no verdict and count as wrong: "
            f"{', '.join(missing[:4])}{f' and {len(missing) - 4} more' if len(missing) > 4 else ''}."
        )
    if found.gap is None:
        out.append("Without cases=DIR there is no oracle, and no parameter that is relative to the nominal model.")
    return out
