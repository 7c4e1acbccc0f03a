"""Parts of a compiled mechanism by name, and what one of them typically does: what effects ask a model."""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence

import mujoco
import numpy as np

from runner.effects.mechanism.base import JointUnit, MechanismEffect, Scope
from runner.effects.wording import Values, listed
from runner.physics.joint_law import JointLaw
from runner.physics.medium import AIR

DRIVE, COUPLING = "~drive", "~coupling"  # what the joint behind a joint, and what couples the two, add to its name
HINGE, SLIDE = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)
ROUNDING = 1e-9  # relative
UNTOLD = 0.9  # of what was believed before: an error as large says that nothing was learned
ON_JOINT = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))


def is_of_air(body: str) -> bool:
    """Whether a body, by its name, is what the air acts on, and none that its owner speaks of."""
    return body.endswith(AIR)


def attribute(*values: float) -> str:
    """Return numbers as an attribute of MJCF has them; one that is nothing beside the largest is 0."""
    least = 1e-9 * max(abs(value) for value in values)
    return " ".join(f"{0.0 if abs(value) <= least else float(value):.5g}" for value in values)


def inertial(model: mujoco.MjModel, body: str | None) -> str:
    """Return the element of MJCF that says what a body of a model weighs, and how that is spread."""
    number = model.body(body).id
    quat = model.body_iquat[number]
    turned = f' quat="{attribute(*quat)}"' if abs(quat[0]) < 1.0 - ROUNDING else ""
    return (
        f'<inertial pos="{attribute(*model.body_ipos[number])}"{turned} mass="{attribute(model.body_mass[number])}" '
        f'diaginertia="{attribute(*model.body_inertia[number])}"/>'
    )


def to_give(model: mujoco.MjModel, body: str | None) -> str:
    """Return the sentence that has the owner write what a body of a changed model weighs, and how that is spread."""
    said = f'Give <body name="{body}"> {inertial(model, body)}'
    if not model.body(body).geomnum[0]:
        return f"{said}."
    return (
        f"{said}, which takes the place of what its geoms weigh (with "
        'inertiafromgeom="true" in <compiler> MuJoCo ignores it: set "auto").'
    )


def to_give_of(model: mujoco.MjModel, effect: type[MechanismEffect], target: str | None, **values: float) -> str:
    """Return the same for an effect on the body of the believed model; empty: its values are not known."""
    if not all(math.isfinite(value) for value in values.values()):
        return ""
    return to_give(changed(model, effect(target=str(target), **values)), target)  # ty: ignore[unknown-argument]


def changed(model: mujoco.MjModel, *effects: MechanismEffect) -> mujoco.MjModel:
    """Return a copy of a model with effects in it that add no element."""
    out = copy.copy(model)
    for effect in effects:
        effect.edit_model(out)
    return out


def axes_told(of: Values, untold_m: float, believed_m: Sequence[float] = (0.0, 0.0, 0.0)) -> list[str]:
    """Return the axes along which the motion tells where something is: along one that its body turns about none does.

    Args:
        of: Its place, `x_m`, `y_m`, `z_m`, with errors.
        untold_m: An error as large says that nothing was learned, unless the place is much farther off.
        believed_m: Where it is if nothing is learned, (3,).
    """
    off = {axis: abs(of[f"{axis}_m"] - at) for axis, at in zip("xyz", believed_m, strict=True)}
    return [axis for axis in "xyz" if (of.error(f"{axis}_m") or 0.0) < max(untold_m, 0.5 * off[axis])]


def said_of_others(told: Sequence[str]) -> str:
    """Return that the motion does not tell the axes beside those that it tells; empty: it tells all."""
    return f"the motion does not tell {listed([a for a in 'xyz' if a not in told], 'or')}" if len(told) < 3 else ""


def joint_of(model: mujoco.MjModel, name: str | None) -> int:
    """Return the number of a joint."""
    return model.joint(name).id


def dof_of(model: mujoco.MjModel, name: str | None) -> int:
    """Return the first degree of freedom of a joint."""
    return int(model.jnt_dofadr[joint_of(model, name)])


def is_axis(model: mujoco.MjModel, name: str | None) -> bool:
    """Whether a joint is a hinge or a slide."""
    return int(model.jnt_type[joint_of(model, name)]) in (HINGE, SLIDE)


def is_hinge(model: mujoco.MjModel, name: str | None) -> bool:
    """Whether a joint is a hinge."""
    return int(model.jnt_type[joint_of(model, name)]) == HINGE


def _unit(of_hinge: str, of_slide: str) -> JointUnit:
    """Return what tells the unit of a number of a joint, by its name."""
    return lambda model, name: of_hinge if is_hinge(model, name) else of_slide


position_unit, speed_unit, force_unit = _unit("rad", "m"), _unit("rad/s", "m/s"), _unit("N m", "N")
inertia_unit, damping_unit, stiffness_unit = _unit("kg m²", "kg"), _unit("N m s/rad", "N s/m"), _unit("N m/rad", "N/m")


def actuators_on(model: mujoco.MjModel, joint: str | None) -> list[int]:
    """Return the numbers of the actuators that act on a joint."""
    number = joint_of(model, joint)
    return [
        a
        for a in range(model.nu)
        if int(model.actuator_trntype[a]) in ON_JOINT and int(model.actuator_trnid[a, 0]) == number
    ]


def joint_of_actuator(model: mujoco.MjModel, actuator: str | None) -> str | None:
    """Return the name of the joint that an actuator acts on, None if it acts on something else."""
    a = model.actuator(actuator).id
    if int(model.actuator_trntype[a]) not in ON_JOINT:
        return None
    return model.joint(int(model.actuator_trnid[a, 0])).name


def drive_of(model: mujoco.MjModel, joint: str | None) -> str | None:
    """Return the name of the drive that an effect has put behind a joint, None without one."""
    name = f"{joint}{DRIVE}"
    return name if mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name) >= 0 else None


def sides_of(model: mujoco.MjModel, joint: str) -> list[str]:
    """Return the joint, and its drive where it has one."""
    drive = drive_of(model, joint)
    return [joint] if drive is None else [joint, drive]


def drive_side(model: mujoco.MjModel, joint: str) -> str:
    """Return the joint that the actuators act on: the drive where there is one."""
    return drive_of(model, joint) or joint


def law_of(model: mujoco.MjModel, joint: str) -> JointLaw:
    """Return the compiled law of a joint."""
    return JointLaw(model, joint_of(model, joint))


def divided(values: np.ndarray, dofs: list[int], total: float) -> None:
    """Set the sum of a coefficient over the two sides of a joint, whose shares stay; all at the last where it was 0."""
    old = values[dofs].sum()
    if len(dofs) == 1 or old == 0.0:
        values[dofs] = 0.0
        values[dofs[-1]] = total
    else:
        values[dofs] *= total / old


def typical_force(scope: Scope) -> float:
    """Return the force that usually moves the target joint, N or N m; more than 0."""
    dof = dof_of(scope.model, scope.target)
    return max(scope.force.get(scope.target or "", 0.0), float(scope.model.dof_frictionloss[dof]), 1e-6)


def typical_speed(scope: Scope) -> float:
    """Return the usual speed of the target joint, rad/s or m/s; more than 0."""
    return max(scope.speed.get(scope.target or "", 0.0), 1e-3)


def typical_reach(scope: Scope) -> float:
    """Return half the range that the target joint visited, rad or m; more than 0."""
    return max(scope.reach.get(scope.target or "", 0.0), 1e-3)


def joints_above(model: mujoco.MjModel, body: str | None) -> list[int]:
    """Return the numbers of the joints that move a body, from the body to the world."""
    number, found = model.body(body).id, []
    while number > 0:
        first, count = int(model.body_jntadr[number]), int(model.body_jntnum[number])
        found += range(first, first + count)
        number = int(model.body_parentid[number])
    return found


def can_turn(model: mujoco.MjModel, body: str | None) -> bool:
    """Whether a body has mass and may turn."""
    slides = [int(model.jnt_type[j]) == SLIDE for j in joints_above(model, body)]
    return float(model.body_mass[model.body(body).id]) > 0.0 and not all(slides)


def body_size_m(model: mujoco.MjModel, body: str | None) -> float:
    """Return a length that a body is about as large as: from its radius of gyration and its centre of mass, m."""
    number = model.body(body).id
    gyration = np.sqrt(model.body_inertia[number].sum() / (2.0 * model.body_mass[number]))
    return float(max(gyration, np.linalg.norm(model.body_ipos[number]), 1e-3))
