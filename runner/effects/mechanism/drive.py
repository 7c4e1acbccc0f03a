"""The drive behind a joint, as elements of plain MJCF: what backlash and compliance lie between.

A sibling of the link's body bears a joint of the same kind, place and axis: the drive. It has the armature of the
original joint, the actuators act on it, and part of the dry and viscous friction moves to it. A fixed tendon couples
the two: `length = q_link - q_drive`, with a range for play, a spring for compliance, one with a dead band for both.

All original names keep their meaning: the joint is the link's, its recorded position and its range too; an actuator
still has its name, and a position servo now feels its own encoder, which sits on the drive. The new joint is named
`JOINT~drive`; it comes after the link's own descendants, so positions in qpos may move: go by names.
"""

from __future__ import annotations

import mujoco
import numpy as np

from runner.effects.mechanism.parts import COUPLING, DRIVE, ON_JOINT

MASSLESS = 1e-7  # of the drive's inertia, given to its body: MuJoCo asks for some
UNKNOWN_ARMATURE = 0.02  # of the joint's inertia, where the model has none
STOP_TIME_CONSTANT_S = 1e-3  # MuJoCo raises it to two steps
STOP_IMPEDANCE = (0.99, 0.999, 0.001, 0.5, 2.0)


def add_drive(spec: mujoco.MjSpec, joint: str, friction_share: float) -> mujoco.MjsTendon:
    """Put a drive behind a hinge or slide unless it has one; return the tendon that couples them.

    Args:
        spec: Changed.
        joint: Its name.
        friction_share: Of dry and viscous friction, how much goes to the drive.
    """
    if spec.joint(joint + DRIVE) is not None:
        return spec.tendon(joint + COUPLING)
    model = spec.copy().compile()  # numbers with defaults and frames resolved
    link = spec.joint(joint)
    number = model.joint(joint).id
    dof, body = int(model.jnt_dofadr[number]), int(model.jnt_bodyid[number])
    armature = float(model.dof_armature[dof]) or UNKNOWN_ARMATURE * float(model.dof_M0[dof])

    carrier = link.parent.parent.add_body(
        name=joint + DRIVE,
        pos=model.body_pos[body],
        quat=model.body_quat[body],
        explicitinertial=True,
        ipos=model.jnt_pos[number],
        mass=MASSLESS * armature,
        inertia=np.full(3, MASSLESS * armature),
        gravcomp=1.0,
    )
    carrier.add_joint(
        name=joint + DRIVE,
        type=link.type,
        axis=model.jnt_axis[number],
        pos=model.jnt_pos[number],
        ref=link.ref,
        limited=int(mujoco.mjtLimited.mjLIMITED_FALSE),
        armature=armature,
        frictionloss=friction_share * link.frictionloss,
        damping=friction_share * np.asarray(link.damping),
        solref_friction=link.solref_friction,
        solimp_friction=link.solimp_friction,
        actfrcrange=link.actfrcrange,
        actfrclimited=link.actfrclimited,
    )
    link.armature = 0.0
    link.frictionloss = (1.0 - friction_share) * link.frictionloss
    link.damping = (1.0 - friction_share) * np.asarray(link.damping)
    link.actfrclimited = int(mujoco.mjtLimited.mjLIMITED_FALSE)

    for actuator in spec.actuators:
        if int(actuator.trntype) in ON_JOINT and actuator.target == joint:
            actuator.target = joint + DRIVE
    for sensor in spec.sensors:
        if sensor.type == mujoco.mjtSensor.mjSENS_JOINTACTFRC and sensor.objname == joint:
            sensor.objname = joint + DRIVE

    tendon = spec.add_tendon(name=joint + COUPLING)
    tendon.wrap_joint(joint, 1.0)
    tendon.wrap_joint(joint + DRIVE, -1.0)
    return tendon


def add_play(tendon: mujoco.MjsTendon, play: float) -> None:
    """Let the two joints that a tendon couples move freely by so much in all, rad or m."""
    half = 0.5 * play
    if np.asarray(tendon.stiffness).flat[0] > 0.0:
        tendon.springlength = [-half, half]
        return
    tendon.limited = int(mujoco.mjtLimited.mjLIMITED_TRUE)
    tendon.range = [-half, half]
    tendon.solref_limit = [STOP_TIME_CONSTANT_S, 1.0]
    tendon.solimp_limit = list(STOP_IMPEDANCE)


def add_spring(tendon: mujoco.MjsTendon, stiffness: float, damping: float) -> None:
    """Couple the two joints by a spring and a damper, N m/rad and N m s/rad, beyond the play that they have."""
    half = float(tendon.range[1]) if tendon.limited == mujoco.mjtLimited.mjLIMITED_TRUE else 0.0
    tendon.limited = int(mujoco.mjtLimited.mjLIMITED_FALSE)
    tendon.springlength = [-half, half]
    tendon.stiffness = _first(tendon.stiffness, stiffness)
    tendon.damping = _first(tendon.damping, damping)


def _first(coefficients: float | np.ndarray, value: float) -> float | np.ndarray:
    """Return coefficients of a polynomial (or the one coefficient) with the linear one replaced."""
    if np.ndim(coefficients) == 0:
        return value
    out = np.array(coefficients)
    out[0] = value
    return out


def settle(model: mujoco.MjModel, data: mujoco.MjData, joint: str) -> None:
    """Put a drive where it is when an episode or window begins: moving with the link, on the side that bears.

    `data` holds the other joints' positions and speeds and what is commanded. The drive lies against the flank that it
    would meet if link and drive were let go; a spring is wound up by the torque that keeps the two together.
    """
    link, drive = model.joint(joint), model.joint(joint + DRIVE)
    tendon = model.tendon(joint + COUPLING).id
    q, a, b = int(drive.qposadr[0]), int(link.dofadr[0]), int(drive.dofadr[0])
    data.qpos[q] = data.qpos[int(link.qposadr[0])]
    data.qvel[b] = data.qvel[a]
    mujoco.mj_forward(model, data)
    apart = float(data.qacc[a] - data.qacc[b])  # of the link from the drive
    if apart == 0.0:
        return
    half = float((model.tendon_range if model.tendon_limited[tendon] else model.tendon_lengthspring)[tendon, 1])
    offset = half if apart > 0 else -half
    stiffness = float(model.tendon_stiffness[tendon])
    if stiffness > 0.0:
        difference = np.zeros((1, model.nv))
        difference[0, a], difference[0, b] = 1.0, -1.0
        response = np.empty_like(difference)
        mujoco.mj_solveM(model, data, response, difference)
        offset += apart / (stiffness * float(difference[0] @ response[0]))
    data.qpos[q] -= offset
