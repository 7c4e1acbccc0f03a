"""Where the gap is, in one sentence."""

from __future__ import annotations

import pandas as pd

from runner.effects.wording import listed
from runner.settings import SETTINGS
from runner.systems.base import AbstractSystem


def sentence_of(system: AbstractSystem, cells: pd.DataFrame, p: float) -> str:
    """Say where the gap is, in one sentence."""
    level = SETTINGS.where.false_discovery_rate
    if not p < SETTINGS.where.significance:
        return "nothing exceeds chance"
    rows = cells.to_dict("records")
    channels = [r for r in rows if r["factor"] == "channel" and r["q"] < level and r["share"] > 0]
    largest = max((r["share"] for r in channels), default=0.0)
    # of several that miss about as much none is the place
    most = {r["cell"] for r in channels if r["share"] > SETTINGS.where.as_much_share * largest}
    parts = [listed([c.name for c in system.channels if c.name in most]) if most else "all channels"]
    found = [r for r in rows if r["factor"] != "channel" and r["q"] < level and r["lift"] > 1]
    # what is rarer by chance comes first, and of equals what has more of the excess
    for regime in (True, False):
        these = [r for r in found if (r["factor"] in system.activities) is regime]
        if these:
            best = min(these, key=lambda r: (r["p"], -r["share"]))
            # how much more than by chance that is, a share alone does not tell
            much = (
                f"{100 * best['share']:.0f} % of the excess in {100 * best['share'] / best['lift']:.0f} % of the time"
            )
            parts.append(f"{system.phrase(best['factor'], best['cell'])} ({much})")
    if len(parts) == 1:
        return f"{parts[0]}, wherever and whenever the {system.noun} moves"
    return ", ".join(parts)
