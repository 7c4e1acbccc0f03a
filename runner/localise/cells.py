"""Cells: what went on and where, and which share of the excess each has, tested by permutation.

The excess is shifted in circles within each episode, which keeps its correlation in time (for cells that are whole
episodes: blocks of windows change places). Apart from the regimes themselves, the test is of what the regimes leave: a
place stands out only if it is worse than what was done there.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from runner.localise.excess import WindowExcess, probability_by_noise
from runner.settings import SETTINGS
from runner.systems.base import AbstractSystem

ORDERS_AT_ONCE = 100  # in memory


def tested_cells(system: AbstractSystem, windows: WindowExcess) -> pd.DataFrame:
    """Return share, lift and significance of every cell with windows in it, as `Where.cells` has them."""
    table, excess = windows.labels.table, windows.excess
    total = float(excess.sum())
    amount = excess.sum(axis=1)
    size = np.sign(amount) * np.sqrt(np.abs(amount))  # so that no window outweighs all others
    regime = table["regime"].to_numpy()
    beyond = size - pd.Series(size).groupby(regime).transform("mean").to_numpy()
    rows = []
    for c, channel in enumerate(system.channels):
        own = float(excess[:, c].sum())
        row = _row("channel", channel.name, len(table), own, 1.0 / len(system.channels))
        rows.append(row | {"p": probability_by_noise(own, float(windows.freedom[:, c].sum()))})
    labels = {factor: table[factor].to_numpy(dtype=object) for factor in system.factors}
    factors = {factor: _Factor.of(own, size if factor == "regime" else beyond) for factor, own in labels.items()}
    by_chance = _by_chance(factors, table["episode"].to_numpy())
    for factor, of in factors.items():
        for name, which, p in zip(of.names, of.inside.T, by_chance[factor], strict=True):
            row = _row(factor, name, int(which.sum()), float(amount[which].sum()), float(which.mean()))
            x, y = windows.labels.places.get(name, (np.nan, np.nan)) if factor == "place" else (np.nan, np.nan)
            # a cell with no more than its share is none that stands out, nor is the one cell of a factor
            here = float(amount[which].sum())
            fine = here > max(float(which.mean()) * total, 0.0) and len(of.names) > 1
            rows.append(row | {"p": float(p) if fine else 1.0, "x_m": x, "y_m": y})
    cells = _with_shares(pd.DataFrame(rows), total)
    cells["q"] = 1.0
    for chosen in (cells["factor"] == "channel", cells["factor"] != "channel"):
        cells.loc[chosen, "q"] = false_discovery(cells.loc[chosen, "p"].to_numpy())
    return cells


def _with_shares(cells: pd.DataFrame, total: float) -> pd.DataFrame:
    """Return cells with the share that each has of what its factor shares out, and their lift.

    A cell that shows less than the noise has none of it: were that taken off the whole, the others had more than all.
    """
    cells["share"] = np.nan
    for own in cells.groupby("factor").groups.values():
        excess = cells.loc[own, "excess"]
        elsewhere = max(total - float(excess.sum()), 0.0)  # in windows that no cell of it holds
        if total > 0:
            cells.loc[own, "share"] = excess.clip(lower=0.0) / (float(excess.clip(lower=0.0).sum()) + elsewhere)
    cells["lift"] = cells["share"] / cells.pop("part")
    return cells[["factor", "cell", "n", "excess", "share", "lift", "p", "x_m", "y_m"]]


def _row(factor: str, cell: str, n: int, excess: float, part: float) -> dict[str, object]:
    return {
        "factor": factor,
        "cell": cell,
        "n": n,
        "excess": excess,
        "part": part,
        "p": 1.0,
        "x_m": np.nan,
        "y_m": np.nan,
    }


@dataclass(frozen=True)
class _Factor:
    """What is tested of a factor: its cells, which windows are in each, (W, cells), and the size of windows, (W,)."""

    names: list[str]
    inside: np.ndarray
    size: np.ndarray

    @classmethod
    def of(cls, labels: np.ndarray, size: np.ndarray) -> _Factor:
        """Return the factor of which windows have these labels; those without one are in no cell."""
        names = sorted({label for label in labels if isinstance(label, str)})
        inside = np.stack([labels == name for name in names], axis=1) if names else np.zeros((len(labels), 0), bool)
        return cls(names, inside, size)

    def as_large(self, order: np.ndarray) -> np.ndarray:
        """Return in how many orders of the windows, (P, W), each cell has at least as much as it has, (cells,)."""
        return (self.size[order] @ self.inside >= self.size @ self.inside - 1e-9).sum(axis=0)


def _by_chance(factors: Mapping[str, _Factor], episode: np.ndarray) -> dict[str, np.ndarray]:
    """Return how likely each cell of each factor has so much by chance, (cells,)."""
    rng = np.random.default_rng(0)
    counts = {factor: np.zeros(len(of.names), int) for factor, of in factors.items()}
    for orders, whole in ((_shifts(episode, rng), False), (_blocks(len(episode), rng), True)):
        tested = [factor for factor in factors if (factor == "episode") is whole]
        for order in orders:
            for factor in tested:
                counts[factor] += factors[factor].as_large(order)
    return {factor: (1 + count) / (1 + SETTINGS.where.permutations) for factor, count in counts.items()}


def _shifts(episode: np.ndarray, rng: np.random.Generator) -> Iterator[np.ndarray]:
    """Yield orders of windows, shifted in circles within each episode, in portions (P, W)."""
    of = [np.flatnonzero(episode == name) for name in dict.fromkeys(episode)]
    count = SETTINGS.where.permutations
    starts = [rng.integers(len(index), size=(count, 1)) for index in of]
    for begin in range(0, count, ORDERS_AT_ONCE):
        out = np.empty((min(ORDERS_AT_ONCE, count - begin), len(episode)), dtype=int)
        for index, start in zip(of, starts, strict=True):
            out[:, index] = index[(np.arange(len(index)) + start[begin : begin + ORDERS_AT_ONCE]) % len(index)]
        yield out


def _blocks(count: int, rng: np.random.Generator) -> Iterator[np.ndarray]:
    """Yield orders of windows in which blocks of neighbours have changed places, in portions (P, W)."""
    blocks = np.array_split(np.arange(count), max(1, count // SETTINGS.where.block_windows))
    filled = np.full((len(blocks), max(map(len, blocks))), -1)
    for row, block in zip(filled, blocks, strict=True):
        row[: len(block)] = block
    orders = SETTINGS.where.permutations
    for begin in range(0, orders, ORDERS_AT_ONCE):
        moved = (filled[rng.permutation(len(blocks))] for _ in range(min(ORDERS_AT_ONCE, orders - begin)))
        yield np.array([order[order >= 0] for order in moved])


def false_discovery(p: np.ndarray) -> np.ndarray:
    """Return probabilities of many tests, adjusted so that of those below a limit no more than that share is chance.

    The step-up procedure of Benjamini and Hochberg (1995). scipy.stats has it; for its import every diagnosis would
    wait a second.
    """
    order = np.argsort(p)[::-1]
    out = np.empty(len(p))
    out[order] = np.minimum.accumulate(p[order] * (len(p) / np.arange(len(p), 0, -1)))
    return np.minimum(out, 1.0)
