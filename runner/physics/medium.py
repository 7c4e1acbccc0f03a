"""A sphere for MuJoCo's media to act on: drag by the square of the speed, at one point, whatever the body's form."""

from __future__ import annotations

import mujoco
import numpy as np

from runner.numerics.arrays import FloatArray

AIR = "~air"  # what the body that the air acts on adds to the name of the one that it is part of
THIN = 1e-6  # kg/m3, where no medium is believed: so thin that nothing else notices
LIGHT_KG = 1e-9  # MuJoCo's media pass over what has no mass
RADIUS_M = 0.001  # the medium that a sphere carries along grows with its volume: of this it weighs next to nothing


def of_sphere(coefficient_n_s2_per_m2: float, density_kg_m3: float) -> float:
    """Return the coefficient, blunt and slender, of a drag by the area of the sphere, in its medium."""
    return coefficient_n_s2_per_m2 / (density_kg_m3 * np.pi * RADIUS_M**2)


def add_sphere(spec: mujoco.MjSpec, name: str, centre: FloatArray | None = None) -> None:
    """Add the sphere that the medium acts on, unless a corrected model has it already.

    Args:
        spec: Of the model; it gets a medium if it has none.
        name: Of the body.
        centre: Where on it, body axes, (3,), m; None: at its centre of mass.
    """
    if spec.option.density == 0.0:
        spec.option.density = THIN
    if spec.body(name + AIR) is not None:
        return
    if centre is None:
        centre = np.array(spec.copy().compile().body(name).ipos)
    spec.body(name).add_body(name=name + AIR, pos=centre).add_geom(
        type=mujoco.mjtGeom.mjGEOM_SPHERE,
        size=[RADIUS_M, 0.0, 0.0],
        pos=[0.0, 0.0, 0.0],
        mass=LIGHT_KG,
        contype=0,
        conaffinity=0,
        group=5,
        rgba=[0.0, 0.0, 0.0, 0.0],
        fluid_ellipsoid=1,
        fluid_coefs=np.zeros(5),
    )
