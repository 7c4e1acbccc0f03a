"""Drake, where it is installed: an extra that nothing else needs; and materials of its point contact."""

from __future__ import annotations

import functools
import importlib
import logging
from typing import Any

from runner.errors import ConfigError

STIFF_N_PER_M = 1e14  # of a floor beside the springs of what stands on it
ROUGH = 1e6  # coefficient of a floor: Drake takes 2 a b / (a + b) of two, so that a point has twice its own


@functools.cache
def drake(module: str) -> Any:
    """Return a module of pydrake by its name below the package.

    Raises:
        ConfigError: If Drake is not installed, or does not load here.
    """
    try:
        found = importlib.import_module(f"pydrake.{module}")
    except ImportError as error:
        raise ConfigError(
            f"system: this one needs Drake, which is not here: pip install 'runner[blind]' ({error})."
        ) from None
    # it says of every floor that is a half space that deformable bodies would not touch it
    logging.getLogger("drake").setLevel(logging.ERROR)
    return found


def available() -> bool:
    """Return whether Drake can be loaded."""
    try:
        drake("multibody.plant")
    except ConfigError:
        return False
    return True


def material(*, stiffness_n_per_m: float, friction: float, **damping: float) -> Any:
    """Return the proximity properties of a point.

    Args:
        stiffness_n_per_m: Of its spring.
        friction: Coefficient, static and sliding.
        **damping: `dissipation_s_per_m`, Hunt and Crossley's; or `relaxation_s`, of a linear damper.
    """
    properties, coulomb = drake("geometry").ProximityProperties(), drake("multibody.plant").CoulombFriction
    drake("geometry").AddContactMaterial(
        dissipation=damping.get("dissipation_s_per_m"),
        point_stiffness=stiffness_n_per_m,
        friction=coulomb(friction, friction),
        properties=properties,
    )
    if "relaxation_s" in damping:
        properties.AddProperty("material", "relaxation_time", damping["relaxation_s"])
    return properties


def ground_material(**damping: float) -> Any:
    """Return the proximity properties of a ground on which every point has its own stiffness, damping and friction."""
    return material(stiffness_n_per_m=STIFF_N_PER_M, friction=ROUGH, **damping)


def half_of(friction: float) -> float:
    """Return the coefficient of a point of which Drake makes `friction` with the ground's."""
    return friction * ROUGH / (2.0 * ROUGH - friction)
