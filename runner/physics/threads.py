"""Compiled loops that several threads share: they hold no interpreter lock."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np


def shared(part: Callable[[slice], None], count: int, threads: int) -> None:
    """Call a function for parts of so many things, each in a thread of its own; of one part in this one."""
    if threads == 1 or count == 1:
        part(slice(None))
        return
    edges = np.linspace(0, count, min(threads, count) + 1).round().astype(int)
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(part, map(slice, edges[:-1], edges[1:])))
