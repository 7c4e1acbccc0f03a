"""Effects to plant in the second physics: each drawn at random but for its size, which is found afterwards.

A plant holds everything about one effect except how large it is. Sizes are positive and have a largest value that is
physically sensible; zero is no effect at all.
"""

from __future__ import annotations

import numpy as np

from runner.blind.planar_box.plants.outside import OUTSIDE
from runner.blind.planar_box.plants.plant import Plant, UnplantedCase
from runner.blind.planar_box.plants.vocabulary import VOCABULARY
from runner.errors import ConfigError, nearest

__all__ = ["OUTSIDE", "TOGETHER_ALIKE", "VOCABULARY", "Plant", "UnplantedCase", "draw"]

# Pairs that are one effect to any such data, or that write the same field.
TOGETHER_ALIKE = (
    {"mass", "actuator_gain"}, {"floor_tilt", "wind"}, {"actuator_delay", "observation_delay"},
)  # fmt: skip


def draw(name: str, case: UnplantedCase, generator: np.random.Generator) -> Plant:
    """Draw an effect of the vocabulary, or one that it does not have, by name.

    Raises:
        ConfigError: If there is no such effect.
    """
    every = {**VOCABULARY, **OUTSIDE}
    if name not in every:
        raise ConfigError(f"blind.effect: no effect '{name}'. {nearest(name, every)}")
    return every[name](case, generator)
