"""The compiled function that Python calls, kept on disk for as long as none of its sources changes."""

from __future__ import annotations

from pathlib import Path

from numba import njit

from runner.blind.mechanism.physics import stepping
from runner.storage.numba_cache import fingerprint


def _kept(sources: int):
    """Compile it; `sources` stands in its closure, and so in the key under which numba keeps it."""

    @njit(cache=True, error_model="numpy")
    def run(whole, joints, actuators, swings, lags, start, held, before, edges, commands, kept, elapsed, longest, out):
        _ = sources
        return stepping.run(
            whole, joints, actuators, swings, lags, start, held, before, edges, commands, kept, elapsed, longest, out
        )

    return run


run = _kept(fingerprint(*Path(__file__).parent.glob("*.py")))
