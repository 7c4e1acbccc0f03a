"""What a plant is, and what it is drawn for."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from runner.blind.planar_box.physics import PlannedEpisode, World


@dataclass(frozen=True)
class Plant:
    """One effect, drawn but for its size.

    Args:
        name: Word of the vocabulary, or the name of an effect that the vocabulary does not have.
        largest: Largest size that is physically sensible.
        edit: World and size to the world with the effect.
        true: World and size to the true values, SI units.
        accept: Words that count as the right answer, exact equivalents included.
    """

    name: str
    largest: float
    edit: Callable[[World, float], World]
    true: Callable[[World, float], dict[str, float | str]]
    accept: tuple[str, ...]


@dataclass(frozen=True)
class UnplantedCase:
    """What a plant is drawn for: the world, its episodes, and where the box goes without any effect.

    Args:
        world: As the owner believes it to be.
        episodes: What is done to it.
        paths: Motion without any effect, one (n, 6) for each episode.
    """

    world: World
    episodes: list[PlannedEpisode]
    paths: list[np.ndarray]

    @property
    def weight_n(self) -> float:
        """Weight of the box, N."""
        return self.world.mass * self.world.gravity

    @property
    def friction_n(self) -> float:
        """Friction of the sliding box, N."""
        return self.world.friction * self.weight_n

    @property
    def spin_n_m(self) -> float:
        """Friction torque of the box that turns on the spot, about, N m."""
        return self.friction_n * 0.38 * (self.world.half_size[0] + self.world.half_size[1])

    @property
    def kern(self) -> float:
        """How far the centre of mass may be off, in half sizes, before the base would tip when sliding."""
        return min(0.6, 0.85 - self.world.friction * self.world.half_size[2] / min(self.world.half_size[:2]))

    def place(self, g: np.random.Generator) -> tuple[float, float]:
        """Draw a place that the box passes."""
        path = self.paths[int(g.integers(len(self.paths)))]
        row = path[int(g.integers(len(path)))]
        return float(row[0] + g.normal(0, 0.1)), float(row[1] + g.normal(0, 0.1))


Draw = Callable[[UnplantedCase, np.random.Generator], Plant]


def vector(size: float, angle: float) -> tuple[float, float]:
    """Return the components of a vector."""
    return size * math.cos(angle), size * math.sin(angle)
