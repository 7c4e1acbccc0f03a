"""Friction and forces in joints that MuJoCo lacks: what the model.xml beside model.py needs of it.

    import mujoco, model
    m = model.load("model.xml")
    mujoco.mj_step(m, mujoco.MjData(m))

From then on every step of this process has them, also those of `mujoco.viewer.launch` and `mujoco.rollout`: it is a
passive callback of MuJoCo's, in Python. Without it the model moves as if they were not there, as it always does in MJX,
which has no callbacks. MuJoCo compiles no model while a Python callback is in place (its issue 1376): load further ones
by `load`, too, or take it away meanwhile, by `mujoco.set_mjcb_passive(None)`, and `install` it again.

The numbers stand in the attribute `user` of the joints that have any, after `TAG`, in the order of `FIELDS`. For a
hinge or slide at position q with velocity v they mean two things.

The limit of the joint's dry friction, for as long as a step lasts, is

    frictionloss (1 + excess exp(-(|v| / excess_speed)^excess_power)) + load_share * load
    load = |tau_drive - tau_load| / 2

where tau_drive is what the actuators exert, and tau_load what gravity, inertial forces other than of the joint's own
acceleration, springs and applied forces exert against it. MuJoCo solves friction with that limit as with its own, so
that a joint truly sticks.

And these forces act besides, in N m or N:

    offset - dry_difference / 2 frictionloss - viscous_difference / 2 damping |v|
    + ripple_sin sin(ripple_rate q) + ripple_cos cos(ripple_rate q)
    + push, from the time `push_from` until `push_until`

Dry friction that differs between the two directions is just its mean and that constant force.
"""

from __future__ import annotations

import math

import mujoco
import numpy as np

TAG = 314159.0  # in `user` of a joint: the numbers that follow are those of `FIELDS`
FIELDS = (
    "offset",
    "excess",
    "excess_speed",
    "excess_power",
    "load_share",
    "drive_after",  # the actuators act on the degree of freedom that comes so many after the joint's: on its drive
    "dry_difference",
    "viscous_difference",
    "ripple_sin",
    "ripple_cos",
    "ripple_rate",
    "push",
    "push_from",
    "push_until",
)


def load(path: str) -> mujoco.MjModel:
    """Return the model of an MJCF file, and let MuJoCo call `passive` in each step from then on, see `install`."""
    install()
    mujoco.set_mjcb_passive(None)
    try:
        return mujoco.MjModel.from_xml_path(path)
    finally:
        install()


def install() -> None:
    """Let MuJoCo call `passive` in each step of this process, of any model; joints without numbers are left alone.

    Raises:
        RuntimeError: If MuJoCo calls something else already; call `passive` from that.
    """
    if mujoco.get_mjcb_passive() not in (None, passive):
        raise RuntimeError("mjcb_passive is in use: call `passive(model, data)` of this module from the callback.")
    mujoco.set_mjcb_passive(passive)


def passive(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Set the limits of dry friction and add the forces of all joints that have numbers.

    It is for MuJoCo's passive callback, and does as well between `mj_step1` and `mj_step2`, once each step.
    """
    for joint, column in zip(*np.nonzero(model.jnt_user == TAG), strict=True):
        law = dict(zip(FIELDS, model.jnt_user[joint, column + 1 :].tolist(), strict=False))
        dof = int(model.jnt_dofadr[joint])
        limit = friction_limit(model, data, dof, law)
        if limit != model.dof_frictionloss[dof]:
            limit_friction(data, dof, limit)
        q = float(data.qpos[model.jnt_qposadr[joint]])
        data.qfrc_passive[dof] += added_force(model, data, dof, q, law)


def friction_limit(model: mujoco.MjModel, data: mujoco.MjData, dof: int, law: dict[str, float]) -> float:
    """Return the limit of a joint's dry friction at its speed and load, N m or N."""
    dry = limit = float(model.dof_frictionloss[dof])
    if law["excess"]:
        speed = abs(float(data.qvel[dof]))
        limit += dry * law["excess"] * math.exp(-((speed / law["excess_speed"]) ** law["excess_power"]))
    if law["load_share"]:
        limit += law["load_share"] * gear_load(model, data, dof, dof + int(law["drive_after"]))
    return limit


def gear_load(model: mujoco.MjModel, data: mujoco.MjData, dof: int, drive: int) -> float:
    """Return the load on a joint's gear: the mean of what acts on its two sides, N m or N."""
    bias = np.empty(model.nv)  # gravity and inertial forces, with the opposite sign
    mujoco.mj_rne(model, data, 0, bias)
    mujoco.mj_fwdActuation(model, data)
    against = data.qfrc_spring[dof] + data.qfrc_gravcomp[dof] + data.qfrc_applied[dof] - bias[dof]
    return 0.5 * abs(float(data.qfrc_actuator[drive] - against))


def limit_friction(data: mujoco.MjData, dof: int, limit: float) -> None:
    """Set the limit of a joint's dry friction in the step that is being made. One without `frictionloss` has none."""
    rows = np.arange(data.ne, data.ne + data.nf)
    of_joints = data.efc_type[rows] == mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF
    for row in rows[of_joints & (data.efc_id[rows] == dof)]:
        data.efc_frictionloss[row] = limit
        if data.nisland:
            # what does not touch each other is solved apart, from copies that have been made by now
            data.iefc_frictionloss[data.map_efc2iefc[row]] = limit


def added_force(model: mujoco.MjModel, data: mujoco.MjData, dof: int, q: float, law: dict[str, float]) -> float:
    """Return the force that acts on a joint besides, N m or N."""
    speed = abs(float(data.qvel[dof]))
    force = law["offset"] - 0.5 * law["dry_difference"] * float(model.dof_frictionloss[dof])
    force -= 0.5 * law["viscous_difference"] * float(model.dof_damping[dof]) * speed
    angle = law["ripple_rate"] * q
    if law["ripple_rate"]:
        force += law["ripple_sin"] * math.sin(angle) + law["ripple_cos"] * math.cos(angle)
    # the mean over the step: a push need not begin with one
    step_s = float(model.opt.timestep)
    lasts_s = min(law["push_until"], data.time + step_s) - max(law["push_from"], data.time)
    return force + law["push"] * max(lasts_s / step_s, 0.0)
