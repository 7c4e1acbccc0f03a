"""Noise as sensors have it: white, slow in part, with outliers."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class NoiseCharacter:
    """How the noise of a case is, but for its size.

    Args:
        slow_share: Share of its variance that is autoregressive.
        slow_s: For how long, s.
        outlier_share: Share of the samples that are 5 to 15 standard deviations further off.
    """

    slow_share: float
    slow_s: float
    outlier_share: float

    def draw(self, n: int, sigma: np.ndarray, rate_hz: float, g: np.random.Generator) -> np.ndarray:
        """Return noise (n, C) of standard deviations (C,), at so many samples per second."""
        shape = n, len(sigma)
        memory = math.exp(-1.0 / (self.slow_s * rate_hz))
        noise = math.sqrt(1.0 - self.slow_share) * g.standard_normal(shape)
        if self.slow_share > 0.0:
            slow = g.standard_normal(shape)
            for k in range(1, n):
                slow[k] = memory * slow[k - 1] + math.sqrt(1.0 - memory * memory) * slow[k]
            noise += math.sqrt(self.slow_share) * slow
        if self.outlier_share > 0.0:
            far = g.random(shape) < self.outlier_share
            noise[far] += (g.choice([-1.0, 1.0], far.sum())) * g.uniform(5.0, 15.0, far.sum())
        return noise * sigma

    def told(self) -> dict[str, float]:
        """Return it as an answer tells it."""
        return {
            "noise_slow_share": round(self.slow_share, 3),
            "noise_slow_s": round(self.slow_s, 4),
            "outlier_share": self.outlier_share,
        }


def draw_character(coloured: float, outliers: float, g: np.random.Generator) -> NoiseCharacter:
    """Draw one: `coloured` of all cases are slow in part, `outliers` of them have one sample in 200 far off."""
    slow_share = float(g.uniform(0.4, 1.0)) if g.random() < coloured else 0.0
    slow_s = float(np.exp(g.uniform(math.log(0.02), math.log(0.12))))
    return NoiseCharacter(slow_share, slow_s, 0.005 if g.random() < outliers else 0.0)
