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
    form = FORMS[name](g) if name in FORMS else {}
    return ScenePlant(
        name,
        plant.largest,
        lambda scene, size: replace(scene, world=replace(plant.edit(scene.world, size), **form)),
        lambda scene, size: _told(plant.true(scene.world, size), form),
        plant.accept,
    )


def _stribeck_form(g: np.random.Generator) -> dict[str, float]:
    """Draw in which of the literature's forms friction falls with speed."""
    return {"stribeck_exponent": float(g.choice([0.5, 1.0, 2.0])), "stribeck_reference": float(g.choice([0.0, 1.0]))}


def _stiction_form(g: np.random.Generator) -> dict[str, float]:
    """Draw within which speed static friction is gone, m/s."""
    return {"stiction_speed": float(np.exp(g.uniform(np.log(1e-3), np.log(0.012))))}


# forms in which this world's friction laws differ from those of the other one
FORMS = {"stribeck": _stribeck_form, "stiction": _stiction_form}


def _told(true: dict[str, float | str], form: dict[str, float]) -> dict[str, float | str]:
    """Return true values with those of a form: a change is that of friction at rest against friction at speed."""
    told = dict(true)
    if "stribeck_exponent" in form:
        change, from_rest = float(true["change"]), form["stribeck_reference"]
        told["change"] = change / (1.0 - from_rest * change)
        told["exponent"] = form["stribeck_exponent"]
        told["reference"] = "rest" if from_rest else "sliding"
    if "stiction_speed" in form:
        told["speed_m_per_s"] = form["stiction_speed"]
    return told
