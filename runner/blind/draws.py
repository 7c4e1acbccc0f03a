"""What makers of all worlds draw."""

from __future__ import annotations

import math

import numpy as np


def draw_sign(g: np.random.Generator) -> float:
    """Draw -1 or 1."""
    return float(g.choice([-1.0, 1.0]))


def draw_angle(g: np.random.Generator) -> float:
    """Draw an angle, rad."""
    return float(g.uniform(-math.pi, math.pi))
