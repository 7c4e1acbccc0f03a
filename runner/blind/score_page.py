"""`score.html`: a blind score as one page that needs no network."""

# pandas' own annotations name every type that an index could lead to, which no caller can narrow
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false, reportGeneralTypeIssues=false

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from markupsafe import Markup

from runner.blind import score_words as words
from runner.blind.score import Bar, BlindScore, if_calibrated
from runner.report.html import page_template

FILE = "score.html"
TEMPLATE = "score_page.html.j2"


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
    path.write_text(page_template("runner.blind", TEMPLATE).render(_content(found, figures, digest, by)), "utf-8")
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
        "oracle_fits": 0 if found.gap is None else int((~found.gap["same"]).sum()),
        "oracle_cases": 0 if found.gap is None else len(found.gap),
        "notes": words.notes(found),
        "digest": digest,
        "by": by,
    }


def headline(bars: Sequence[Bar]) -> str:
    """Return in a sentence how many of the bars are reached and which are not."""
    measured = [b for b in bars if math.isfinite(b.value)]
    missed = [b.name for b in measured if b.missed_by > 0]
    if not missed:
        return f"All {len(measured)} bars that were measured are reached."
    return f"{len(measured) - len(missed)} of {len(measured)} bars are reached; missed: {'; '.join(missed)}."


def _state(bar: Bar) -> str:
    return "open" if not math.isfinite(bar.value) else "met" if bar.missed_by == 0 else "missed"
