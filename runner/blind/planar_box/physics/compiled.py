"""The compiled functions that Python calls, kept on disk for as long as none of their sources changes."""

from __future__ import annotations

from pathlib import Path

from numba import njit

from runner.blind.planar_box.physics import derivative, motion, one_step
from runner.storage.numba_cache import fingerprint


def _kept(sources: int):
    """Compile them; `sources` stands in their closures, and so in the keys under which numba keeps them."""

    @njit(cache=True, error_model="numpy")
    def balance(p, y, t, mu, out):
        _ = sources
        return motion.balance(p, y, t, mu, out)

    @njit(cache=True, error_model="numpy")
    def rate(y, t, p):
        _ = sources
        return motion.rate(y, t, p)

    @njit(cache=True, error_model="numpy")
    def jacobian(y, t, p):
        _ = sources
        return derivative.jacobian(y, t, p)

    @njit(cache=True, error_model="numpy")
    def march(p, y, starts, targets, held, lag, first, last, end, sample, filled, result, rtol, atol):
        _ = sources
        return one_step.march(p, y, starts, targets, held, lag, first, last, end, sample, filled, result, rtol, atol)

    return balance, rate, jacobian, march


balance, rate, jacobian, march = _kept(fingerprint(*Path(__file__).parent.glob("*.py")))
