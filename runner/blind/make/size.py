"""How large an effect is to be: the size that moves the recording by so many times the noise."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from runner.blind.make.maker import BANDS

SMALLEST = 1e-5  # of the largest size: below, an effect is not looked for
# error ratios, without gaps, from which to which effects go whose size is drawn evenly in its logarithm
RATIOS = {"single": (1.3, 60.0), "unknown": (3.0, 60.0), "pair": (3.0, 30.0)}
FIRST_SIZE = 0.03  # of the largest size: where the search begins


def error_ratio(paths: Sequence[np.ndarray] | None, nominal: Sequence[np.ndarray], sigma: np.ndarray) -> float:
    """Return the rms difference of channels (n, C) in units of the noise (C,), NaN left out; infinite without paths."""
    if paths is None:
        return math.inf
    difference = np.concatenate([(a - b) / sigma for a, b in zip(paths, nominal, strict=True)])
    return float(np.sqrt(np.nanmean(difference**2)))


def size_for(
    excess: Callable[[float], float],
    largest: float,
    severity: str,
    bands: Mapping[str, tuple[float, float]],
    g: np.random.Generator,
    *,
    lowest: str,
) -> tuple[float, str] | None:
    """Return the size that reaches a severity, or the next lower one, and its name; none where none can be reached.

    Args:
        excess: Error ratio at a size, without noise, which adds 1 in squares.
        largest: Largest size.
        severity: To be reached.
        bands: Error ratios, noise included, from which to which each severity goes.
        g: Draws where in the band.
        lowest: The lowest severity that will do.
    """
    excess = functools.cache(excess)
    names = [name for name in ("strong", "moderate", "subtle") if name in bands]
    for name in names[names.index(severity) : names.index(lowest) + 1]:
        low, high = bands[name]
        target = math.sqrt(float(np.exp(g.uniform(math.log(1.08 * low), math.log(0.92 * high)))) ** 2 - 1.0)
        share = float(g.uniform(0.2, 0.9))
        size = find_size(excess, largest, target)
        if size is None:
            least, top = math.sqrt((1.04 * low) ** 2 - 1.0), excess(largest)
            if least < top < target:
                size = find_size(excess, largest, least * (top / least) ** share)
        if size is not None:
            return size, name
    return None


def draw_size(
    excess: Callable[[float], float], largest: float, ratios: tuple[float, float], g: np.random.Generator
) -> float | None:
    """Return a size whose error ratio is drawn evenly in its logarithm, below what the largest size does."""
    low, high = ratios
    share = float(g.random())
    size = find_size(excess, largest, math.sqrt((low * (high / low) ** share) ** 2 - 1.0))
    if size is not None:
        return size
    top = math.sqrt(1.0 + excess(largest) ** 2)
    if not low < top < math.inf:
        return None
    return find_size(excess, largest, math.sqrt((low * (min(top, high) / low) ** (0.97 * share)) ** 2 - 1.0))


def nearest_band(moved: float) -> str:
    """Return the severity whose band is nearest to an error ratio."""
    middle = {name: math.sqrt(low * high) for name, (low, high) in BANDS.items()}
    return min(middle, key=lambda name: abs(math.log(moved / middle[name])))


def find_size(excess: Callable[[float], float], largest: float, target: float) -> float | None:
    """Return a size with an excess within 6 % of the target, or none: regula falsi in logarithms, inside a bracket.

    Args:
        excess: Excess at a size; rises with it, at least on the whole.
        largest: Largest size.
        target: Excess to reach.
    """
    low, high = math.log(largest * SMALLEST), math.log(largest)
    at_low, at_high = -8.0, math.nan  # errors at the ends; the upper end is looked at only where it has to be
    guess = high + math.log(FIRST_SIZE)
    for step in range(24):
        error = min(max(math.log(max(excess(math.exp(guess)), 1e-12) / target), -8.0), 8.0)
        if abs(error) < 0.06:
            return math.exp(guess)
        if error > 0:
            at_low *= 0.5 if high < math.log(largest) else 1.0  # Illinois: the lower end must not be stuck
            high, at_high = guess, error
        elif guess >= math.log(largest):
            return None  # the largest size does too little
        else:
            at_high *= 0.5 if at_low > -8.0 else 1.0
            low, at_low = guess, error
        if high - low < 1e-6:
            return None  # the excess jumps over the target
        if step < 2 or math.isnan(at_high):
            guess = min(guess - error, high)  # the excess is about proportional to the size
        else:
            guess = (low * at_high - high * at_low) / (at_high - at_low)
        if not low < guess <= high or (step % 4 == 3 and not math.isnan(at_high)):
            guess = 0.5 * (low + high)
    return None
