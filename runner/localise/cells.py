"""Cells: what went on and where, and which share of the excess each has, tested by permutation.

The excess is shifted in circles within each episode, which keeps its correlation in time (for cells that are whole
episodes: blocks of windows change places). Apart from the regimes themselves, the test is of what the regimes leave: a
place stands out only if it is worse than what was done there.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from runner.localise.excess import WindowExcess, probability_by_noise
from runner.systems.base import AbstractSystem

PERMUTATIONS = 3999
BLOCK = 4  # windows that change places together where whole episodes are compared


def tested_cells(system: AbstractSystem, windows: WindowExcess) -> pd.DataFrame:
    """Return share, lift and significance of every cell with windows in it, as `Where.cells` has them."""
    table, excess = windows.labels.table, windows.excess
    total = float(excess.sum())
    amount = excess.sum(axis=1)
    size = np.sign(amount) * np.sqrt(np.abs(amount))  # so that no window outweighs all others
    regime = table["regime"].to_numpy()
    beyond = size - pd.Series(size).groupby(regime).transform("mean").to_numpy()
    rng = np.random.default_rng(0)
    episode = table["episode"].to_numpy()
    shifts, blocks = _shifts(episode, rng), _blocks(len(table), rng)
    rows = []
    for c, channel in enumerate(system.channels):
        own = float(excess[:, c].sum())
        row = _row("channel", channel.name, len(table), own, total, 1.0 / len(system.channels))
        rows.append(row | {"p": probability_by_noise(own, float(windows.freedom[:, c].sum()))})
    for factor in system.factors:
        labels = table[factor].to_numpy(dtype=object)
        names = sorted({label for label in labels if isinstance(label, str)})
        inside = np.stack([labels == name for name in names], axis=1) if names else np.zeros((len(table), 0), bool)
        values = size if factor == "regime" else beyond
        order = blocks if factor == "episode" else shifts
        by_chance = values[order] @ inside
        found = values @ inside
        p = (1 + (by_chance >= found - 1e-9).sum(axis=0)) / (1 + len(order))
        for i, name in enumerate(names):
            which = inside[:, i]
            row = _row(factor, name, int(which.sum()), float(amount[which].sum()), total, float(which.mean()))
            x, y = windows.labels.places.get(name, (np.nan, np.nan)) if factor == "place" else (np.nan, np.nan)
            # a cell without excess is none that stands out, and all windows in one cell stand out from nothing
            fine = float(amount[which].sum()) > 0 and not which.all()
            rows.append(row | {"p": float(p[i]) if fine else 1.0, "x_m": x, "y_m": y})
    cells = pd.DataFrame(rows)
    cells["q"] = 1.0
    for chosen in (cells["factor"] == "channel", cells["factor"] != "channel"):
        cells.loc[chosen, "q"] = false_discovery(cells.loc[chosen, "p"].to_numpy())
    return cells


def _row(factor: str, cell: str, n: int, excess: float, total: float, part: float) -> dict[str, object]:
    share = excess / total if total > 0 else np.nan
    return {
        "factor": factor,
        "cell": cell,
        "n": n,
        "excess": excess,
        "share": share,
        "lift": share / part,
        "p": 1.0,
        "x_m": np.nan,
        "y_m": np.nan,
    }


def _shifts(episode: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return orders of windows, shifted in circles within each episode, (P, W)."""
    out = np.empty((PERMUTATIONS, len(episode)), dtype=int)
    for name in dict.fromkeys(episode):
        index = np.flatnonzero(episode == name)
        start = rng.integers(len(index), size=(PERMUTATIONS, 1))
        out[:, index] = index[(np.arange(len(index)) + start) % len(index)]
    return out


def _blocks(count: int, rng: np.random.Generator) -> np.ndarray:
    """Return orders of windows in which blocks of neighbours have changed places, (P, W)."""
    blocks = np.array_split(np.arange(count), max(1, count // BLOCK))
    return np.array(
        [np.concatenate([blocks[b] for b in rng.permutation(len(blocks))]) for _ in range(PERMUTATIONS)]
    ).reshape(PERMUTATIONS, count)


def false_discovery(p: np.ndarray) -> np.ndarray:
    """Return probabilities of many tests, adjusted so that of those below a limit no more than that share is chance.

    The step-up procedure of Benjamini and Hochberg (1995). scipy.stats has it; for its import every diagnosis would
    wait a second.
    """
    order = np.argsort(p)[::-1]
    out = np.empty(len(p))
    out[order] = np.minimum.accumulate(p[order] * (len(p) / np.arange(len(p), 0, -1)))
    return np.minimum(out, 1.0)
