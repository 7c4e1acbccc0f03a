"""`score.html`: a blind score as one page that needs no network."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from markupsafe import Markup

from runner.blind.score import Bar, BlindScore, if_calibrated, words
from runner.report.html import page_template
from runner.storage.writing import write_text

FILE = "score.html"
TEMPLATE = "page.html.j2"


def write_page(
    found: BlindScore, figures: Mapping[str, str], path: Path, *, digest: str, by: Sequence[Mapping[str, Any]]
) -> Path:
    """Write the page and return its file.

    Args:
        found: The score.
        figures: SVG elements by name.
        path: The file.
        digest: SHA-256 of the answers.
        by: What diagnosed, see `runner.blind.run.provenance`.
    """
    write_text(path, page_template("runner.blind.score", TEMPLATE).render(_content(found, figures, digest, by)))
    return path


def _content(
    found: BlindScore, figures: Mapping[str, str], digest: str, by: Sequence[Mapping[str, Any]]
) -> dict[str, Any]:
    cases = found.basic.cases
    return {
        "verdict": headline(found.bars),
        "facts": [
            ("cases", str(len(cases))),
            ("first answers that are right", f"{100 * found.basic.summary['first_right']:.0f} %"),
            ("Brier score", f"{found.basic.summary['brier']:.3f}"),
            ("expected calibration error", f"{found.basic.summary['expected_calibration_error']:.3f}"),
        ],
        "bars": [(row, _state(bar)) for row, bar in zip(words.bars(found)[1], found.bars, strict=True)],
        "figures": {name: Markup(text) for name, text in figures.items()},
        "tables": {
            "groups": words.groups(found.basic.table[~found.basic.table["group"].isin(found.effects["effect"])])
            if len(found.effects)
            else words.groups(found.basic.table),
            "effects": words.effects(found.effects),
            "confusion": words.confusion(found.basic),
            "coverage": words.coverage(found),
            "places": words.places(found),
            "worst": words.worst(found),
        },
        "by_chance": f"{if_calibrated(cases['probability'].to_numpy(float)):.3f}",
        "otherwise": _otherwise(found),
        "untried": found.untried,
        "not_closable": words.cases(0 if found.gap is None else int(found.gap["ratio"].isna().sum())),
        "notes": words.notes(found),
        "digest": digest,
        "by": by,
    }


def _otherwise(found: BlindScore) -> str:
    """Return the share of the oracle's closure where something else was named than was planted."""
    if found.gap is None:
        return ""
    ratio = found.gap.loc[~found.gap["as_planted"], "ratio"].dropna()
    return f"{100 * ratio.mean():.0f} % of the oracle's in {len(ratio)} such cases" if len(ratio) else "no such case"


def headline(bars: Sequence[Bar]) -> str:
    """Return in a sentence how many of the bars are reached, how many of these for certain, and which are not."""
    measured = [b for b in bars if math.isfinite(b.value)]
    reached, missed = ([b for b in measured if (b.missed_by > 0) == m] for m in (False, True))
    certain = f"{sum(b.certain for b in reached)} of them beyond what chance may do"
    if not missed:
        return f"All {len(measured)} bars that were measured are reached, {certain}."
    names = "; ".join(b.name for b in missed)
    return f"{len(reached)} of {len(measured)} bars are reached, {certain}; missed: {names}."


def _state(bar: Bar) -> str:
    return "open" if not math.isfinite(bar.value) else "met" if bar.missed_by == 0 else "missed"
