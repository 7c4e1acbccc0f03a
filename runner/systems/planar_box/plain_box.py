"""A box under dry friction in plain MuJoCo: what the compiled friction does, as near as contacts of MJCF come to it.

The base points of the compiled friction become feet, small spheres that bear on the floor by explicit pairs, each with
its share of the load: the springs of equal feet share a load linearly, as the compiled law does. A grid of 4 x 4
Gauss-Legendre points has the second moments of a rectangle, so that moments shift the load as they do there, and its
mean radius to 1 % (2 % of one three times as long as wide): more feet are nearer to the even load, and farther in all,
as contacts push what slides fast, in proportion to their number (see `runner.physics.scene.contact`).
"""

from __future__ import annotations

import mujoco
import numpy as np

from runner.numerics.arrays import FloatArray
from runner.physics import medium
from runner.physics.dry_friction import FrictionView
from runner.physics.scene import Dof, FloorContact, SceneConfig, contact
from runner.recording.model_form_mjcf import quiet

FEET = 4  # along each edge
FLOOR, PITCH_ROLL = "floor", (("pitch", (0.0, 1.0, 0.0)), ("roll", (1.0, 0.0, 0.0)))


def plain(text: str, edited: mujoco.MjModel, name: str, push_n: FloatArray) -> mujoco.MjSpec:
    """Return a planar box as a model for plain MuJoCo, whose first joints are x, y and yaw.

    Args:
        text: The MJCF of the box under the compiled friction.
        edited: What it compiles to, with all numbers that count; its base points become the feet.
        name: Of the box.
        push_n: A constant force through its geometric centre, world axes, (2,), N.
    """
    with quiet():
        spec = mujoco.MjSpec.from_string(text)
        spec.compile()
        spec.copy_back(edited)
    body, view = spec.body(name), FrictionView(edited, edited.body(name).id)
    body.userdata, spec.nuser_body, spec.nuserdata = [], -1, 0
    spec.option.disableflags = 0
    _steady(body, view)
    points = view.points
    load = points[:, 2] * np.maximum(1.0 + view["pressure"] * points[:, 3], 0.0)
    borne = load > 0.0
    sunk_m = _stand(spec, name, points[borne, :2], load[borne] / load.sum(), view)
    body.pos = (0.0, 0.0, -view["base_z"] - sunk_m)
    _release(body, view)
    if view["air_drag"] > 0.0:
        medium.add_sphere(spec, name, np.zeros(3))
        coefficient = medium.of_sphere(view["air_drag"], spec.option.density)
        spec.geoms[-1].fluid_coefs = (coefficient, coefficient, 0.0, 0.0, 0.0)
    if push_n.any():
        _add_force(spec, name, push_n)
    return spec


def _steady(body: mujoco.MjsBody, view: FrictionView) -> None:
    """Give the box at least the inertia of a uniform one about level axes: those don't show in the plane.

    What is told of the vertical axis alone may be far less than a box that stands on all of its base can have.
    """
    x, y, z = body.inertia
    height = view["base_z"]
    x = max(x, body.mass * (view["half_y"] ** 2 + height**2) / 3)
    y = max(y, body.mass * (view["half_x"] ** 2 + height**2) / 3)
    body.inertia = (max(x, y - z), max(y, x - z), z)  # no moment is more than the sum of the others


def film_is_centred(view: FrictionView) -> bool:
    """Whether a film under the base acts at the body's axis: what joints can do."""
    return bool(
        np.allclose(view.points[:, 2] @ view.points[:, :2], 0.0, atol=1e-9 * max(view["half_x"], view["half_y"]))
    )


def _stand(spec: mujoco.MjSpec, name: str, feet: FloatArray, share: FloatArray, view: FrictionView) -> float:
    """Put the box on its feet, (n, 2), which bear these shares of its weight, (n,); return how far they sink in, m."""
    body, count = spec.body(name), len(feet)
    scene = SceneConfig(dof=Dof.free, contact=FloorContact.feet, gravity_m_s2=-float(spec.option.gravity[2]), grid=FEET)
    spec.option.timestep, spec.option.cone = scene.timestep_s, mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.tolerance, spec.option.impratio = 1e-10, contact.impratio(count)
    # what rocks faster than it heaves needs springs that are softer by as much, for the same step
    spread = share @ (feet - np.array(body.ipos[:2])) ** 2
    rocking = max(1.0, *(body.mass * spread / np.array([body.inertia[1], body.inertia[0]])))
    sunk_m = rocking * contact.penetration_m(scene.gravity_m_s2, scene.timestep_s)
    height = -view["base_z"]
    radius = 0.5 * min(view["half_x"], view["half_y"], height) / FEET
    kind = spec.add_default("foot", spec.default)
    kind.geom.type, kind.geom.size = mujoco.mjtGeom.mjGEOM_SPHERE, (radius, 0.0, 0.0)
    kind.geom.contype = kind.geom.conaffinity = 0
    kind.geom.group = 3  # which viewers don't show
    told = contact.floor_contact(1.0, sunk_m, scene, count)
    kind.pair.friction, kind.pair.condim = contact.coefficients(view["mu"]), told["condim"]
    kind.pair.solimp, kind.pair.solreffriction = told["solimp"], told["solreffriction"]
    for k, ((x, y), part) in enumerate(zip(feet, share, strict=True)):
        body.add_geom(kind, name=f"foot_{k}", pos=(x, y, radius - height))
        spec.add_pair(kind, geomname1=FLOOR, geomname2=f"foot_{k}", solref=part * np.array(told["solref"]))
    # the floor touches its feet; its sides may touch other things, unless it is no box but drawn as one
    floor, box = spec.geom(FLOOR), spec.geom(name)
    floor.contype = floor.conaffinity = 1
    box.contype = box.conaffinity = int(view["bearing_radius"] == 0.0)
    spec.add_exclude(bodyname1="world", bodyname2=name)
    return sunk_m


def _release(body: mujoco.MjsBody, view: FrictionView) -> None:
    """Let the box heave, pitch and roll too, and give its joints what a film under the base does."""
    film, drag, height = view["film"], float(body.joints[0].damping[0]), 0.0
    if film > 0.0 and film_is_centred(view):
        x, y, weight = view.points[:, 0], view.points[:, 1], view.points[:, 2]
        for joint, more in zip(body.joints, (film, film, film * float(weight @ (x**2 + y**2))), strict=True):
            joint.damping = (joint.damping[0] + more, 0.0, 0.0)
        # where the axes of pitch and roll pass the force of the joints before them acts: a film's at the base
        height = view["base_z"] * film / (film + drag)
    body.add_joint(name=f"{body.name}_z", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=(0.0, 0.0, 1.0))
    for name, axis in PITCH_ROLL:
        body.add_joint(name=f"{body.name}_{name}", type=mujoco.mjtJoint.mjJNT_HINGE, axis=axis, pos=(0.0, 0.0, height))


def _add_force(spec: mujoco.MjSpec, name: str, push_n: FloatArray) -> None:
    """Add a constant force through the geometric centre: two actuators that heed no command."""
    spec.worldbody.add_site(name="world")
    spec.body(name).add_site(name=f"{name}_centre")
    for axis, (letter, force) in enumerate(zip("xy", push_n, strict=True)):
        gear = np.zeros(6)
        gear[axis] = 1.0
        actuator = spec.add_actuator(
            name=f"constant_force_{letter}", target=f"{name}_centre", refsite="world", gear=gear,
            trntype=mujoco.mjtTrn.mjTRN_SITE, biastype=mujoco.mjtBias.mjBIAS_AFFINE,
        )  # fmt: skip
        actuator.gainprm[0], actuator.biasprm[0] = 0.0, float(force)
