"""The MJCF of a box on a floor from what its owner believes of the two."""

from __future__ import annotations

import mujoco

from runner.recording import Nominal

BODY, FILE = "box", "model.xml"
# A rigid box on a rigid floor with Coulomb friction, as near as MuJoCo comes to it: a round cone, and contacts as
# hard as a step of a millisecond resolves well, four of them.
STEP_S, CONTACT_S = 0.001, 0.004
LEAST_FRICTION = 1e-5  # MuJoCo's own


def mjcf(nominal: Nominal) -> str:
    """Return the model as text.

    Args:
        nominal: What the owner believes. Of an inertia about the vertical alone the other two are those of a uniform
            box.
    """
    spec = mujoco.MjSpec()
    spec.modelname = BODY
    spec.option.timestep, spec.option.gravity = STEP_S, (0.0, 0.0, -nominal.gravity_m_s2)
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.worldbody.add_geom(name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=(0.0, 0.0, 0.1))
    body = spec.worldbody.add_body(name=BODY, pos=(0.0, 0.0, nominal.half_size_m[2]))
    body.add_freejoint(name=BODY)
    body.add_geom(
        name=BODY,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=nominal.half_size_m,
        mass=nominal.mass_kg,
        friction=(max(nominal.friction, LEAST_FRICTION), 0.005, 0.0001),
        solref=(CONTACT_S, 1.0),
        priority=1,
    )
    if nominal.inertia_kg_m2 is not None or nominal.com_m is not None:
        body.explicitinertial = True
        body.mass, body.ipos, body.inertia = nominal.mass_kg, nominal.com_m or (0.0, 0.0, 0.0), moments(nominal)
    spec.compile()
    return spec.to_xml()


def moments(nominal: Nominal) -> tuple[float, float, float]:
    """Return the believed inertia about the axes through the centre of mass, kg m2."""
    if isinstance(nominal.inertia_kg_m2, tuple):
        return nominal.inertia_kg_m2
    x, y, z = (h**2 * nominal.mass_kg / 3 for h in nominal.half_size_m)
    return y + z, x + z, x + y if nominal.inertia_kg_m2 is None else nominal.inertia_kg_m2
