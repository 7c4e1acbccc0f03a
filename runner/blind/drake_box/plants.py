"""What can be planted in a world by Drake, drawn at random but for its size."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from runner.blind.drake_box.outside import OUTSIDE
from runner.blind.drake_box.physics import Scene
from runner.blind.planar_box.plants import VOCABULARY as PLANAR
from runner.blind.planar_box.plants import UnplantedCase
from runner.errors import ConfigError, nearest

# friction that differs along two axes is nothing that Drake's contact has
VOCABULARY = tuple(name for name in PLANAR if name != "anisotropic_friction")


@dataclass(frozen=True)
class ScenePlant:
    """One effect, drawn but for its size.

    Args:
        name: Of the vocabulary, or of what it does not have.
        largest: Largest size that is physically sensible.
        edit: Scene and size to the scene with the effect.
        true: Scene without it and size to the true values, SI units.
        accept: Words that count as the right answer.
    """

    name: str
    largest: float
    edit: Callable[[Scene, float], Scene]
    true: Callable[[Scene, float], dict[str, float | str]]
    accept: tuple[str, ...]


def draw(name: str, case: UnplantedCase, g: np.random.Generator) -> ScenePlant:
    """Draw an effect by name.

    Raises:
        ConfigError: If there is none of that name.
    """
    if name in OUTSIDE:
        strange = OUTSIDE[name](case, g)
        return ScenePlant(
            name, strange.largest, strange.edit, lambda _, size: {"size": size, **strange.true}, ("unknown",)
        )
    if name not in VOCABULARY:
        raise ConfigError(f"blind.effect: no effect '{name}'. {nearest(name, (*VOCABULARY, *OUTSIDE))}")
    plant = PLANAR[name](case, g)
    return ScenePlant(
        name,
        plant.largest,
        lambda scene, size: replace(scene, world=plant.edit(scene.world, size)),
        lambda scene, size: plant.true(scene.world, size),
        plant.accept,
    )
