"""The drive behind a joint, as elements of plain MJCF: what backlash and compliance lie between.

A sibling of the link's body bears a joint of the same kind, place and axis: the drive. It has the armature of the
original joint, the actuators act on it, and part of the dry and viscous friction moves to it. A fixed tendon couples
the two: `length = q_link - q_drive`, with a range for play, a spring for compliance, one with a dead band for both.

All original names keep their meaning: the joint is the link's, its recorded position and its range too; an actuator
still has its name, and a position servo now feels its own encoder, which sits on the drive. The new joint is named
`JOINT~drive`; it comes after the link's own descendants, so positions in qpos may move: go by names.
"""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass, fields, replace
from typing import NamedTuple

import mujoco
import numpy as np

from runner.effects.mechanism.parts import COUPLING, DRIVE, ON_JOINT

MASSLESS = 1e-7  # of the drive's inertia, given to its body: MuJoCo asks for some
UNKNOWN_ARMATURE = 0.02  # of the joint's inertia, where the model has none
STOP_TIME_CONSTANT_S = 1e-3  # MuJoCo raises it to two steps
STOP_IMPEDANCE = (0.99, 0.999, 0.001, 0.5, 2.0)
FASTEST = 0.7  # natural frequency times step that a spring may have
TIGHT = 1e-9  # rad or m, half the play where there is none: MuJoCo refuses a range of no width
SLUGGISH = 0.7  # damping ratio of one that would be faster
STIFFEST = 0.9999  # impedance of a constraint: MuJoCo's highest


def add_drive(spec: mujoco.MjSpec, joint: str, friction_share: float) -> None:
    """Put a drive behind a hinge or slide unless it has one.

    Args:
        spec: Changed.
        joint: Its name.
        friction_share: Of dry and viscous friction, how much goes to the drive.
    """
    if spec.joint(joint + DRIVE) is not None:
        return
    model = spec.copy().compile()  # numbers with defaults and frames resolved
    link = spec.joint(joint)
    number = model.joint(joint).id
    dof, body = int(model.jnt_dofadr[number]), int(model.jnt_bodyid[number])
    armature = drive_armature(model, dof)

    carrier = link.parent.parent.add_body(
        name=joint + DRIVE,
        pos=model.body_pos[body],
        quat=model.body_quat[body],
        explicitinertial=True,
        ipos=model.jnt_pos[number],
        mass=MASSLESS * armature,
        inertia=np.full(3, MASSLESS * armature),
        gravcomp=1.0,
        simple=0,  # else MuJoCo reckons its friction constraint without the armature
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


def drive_armature(model: mujoco.MjModel, dof: int) -> float:
    """Return the armature that a drive is given which is put behind a joint, kg m² or kg."""
    return float(model.dof_armature[dof]) or UNKNOWN_ARMATURE * float(model.dof_M0[dof])


@dataclass(frozen=True)
class Coupling:
    """What lies between drive and link. It is kept in the tendon's `user` numbers, in this order.

    Args:
        play: Rad or m, in all.
        stiffness: N m/rad or N/m; 0 stands for rigid flanks.
        damping_ratio: Of link against drive on the spring.
    """

    play: float = 0.0
    stiffness: float = 0.0
    damping_ratio: float = 0.0


def couple(spec: mujoco.MjSpec, joint: str, **changes: float) -> None:
    """Change the coupling of a joint and its drive: see `Coupling`; what is left out stays."""
    tendon = spec.tendon(joint + COUPLING)
    coupling = replace(Coupling(*tendon.userdata), **changes)
    tendon.userdata = astuple(coupling)
    if spec.nuser_tendon >= 0:
        spec.nuser_tendon = max(spec.nuser_tendon, len(tendon.userdata))
    # inertias are asked for by springs alone, and compiling takes a while
    numbers = _numbers(spec.copy().compile(), joint, coupling) if coupling.stiffness else _flanks(coupling)
    tendon.stiffness = _first(tendon.stiffness, numbers.stiffness)
    tendon.damping = _first(tendon.damping, numbers.damping)
    tendon.springlength, tendon.range = numbers.flanks, numbers.flanks
    kinds = mujoco.mjtLimited
    tendon.limited = int(kinds.mjLIMITED_TRUE if numbers.limited else kinds.mjLIMITED_FALSE)
    tendon.solref_limit, tendon.solimp_limit = numbers.solref, numbers.solimp


def fit_to_step(model: mujoco.MjModel, joint: str) -> None:
    """Write the coupling of a joint and its drive anew, for the step that the model has now."""
    tendon = model.tendon(joint + COUPLING).id
    numbers = _numbers(model, joint, Coupling(*model.tendon_user[tendon, : len(fields(Coupling))]))
    model.tendon_stiffness[tendon], model.tendon_damping[tendon] = numbers.stiffness, numbers.damping
    model.tendon_lengthspring[tendon], model.tendon_range[tendon] = numbers.flanks, numbers.flanks
    model.tendon_limited[tendon] = numbers.limited
    model.tendon_solref_lim[tendon], model.tendon_solimp_lim[tendon] = numbers.solref, numbers.solimp


class _Numbers(NamedTuple):
    """A coupling as numbers of a tendon, under MuJoCo's names."""

    stiffness: float
    damping: float
    flanks: list[float]
    limited: bool
    solref: list[float]
    solimp: list[float]


def _numbers(model: mujoco.MjModel, joint: str, coupling: Coupling) -> _Numbers:
    """Return the numbers of a coupling at the model's step.

    MuJoCo steps springs explicitly. One that is too fast for the step becomes a soft limit, which is solved implicitly:
    it gives as much under a steady load, and swings as fast as the step can follow, damped.
    """
    rigid, stiffness = _flanks(coupling), coupling.stiffness
    if stiffness == 0.0:
        return rigid
    inertia, step = _relative_inertia(model, joint), float(model.opt.timestep)
    if stiffness * step**2 <= FASTEST**2 * inertia:
        damping = 2.0 * coupling.damping_ratio * math.sqrt(stiffness * inertia)
        return rigid._replace(stiffness=stiffness, damping=damping, limited=False)
    # MuJoCo's constraint: force = weight (-rate r - damping v - a), weight = d / (1 - d) / inverse inertia
    inverse = float(model.tendon_invweight0[model.tendon(joint + COUPLING).id])
    weight = stiffness * step**2 / FASTEST**2
    d = min(weight * inverse / (1.0 + weight * inverse), STIFFEST)
    weight = d / (1.0 - d) / inverse
    rate = min(stiffness / weight, (FASTEST / step) ** 2)
    damping = 2.0 * SLUGGISH * math.sqrt(rate * (1.0 + inertia / weight))
    return rigid._replace(solref=[-rate * d, -damping * d], solimp=[d, d, 0.001, 0.5, 2.0])


def natural_rad_s(model: mujoco.MjModel, joint: str, stiffness: float) -> float:
    """Return the natural frequency of link against drive on a spring of that stiffness, rad/s."""
    return math.sqrt(stiffness / _relative_inertia(model, joint))


def _relative_inertia(model: mujoco.MjModel, joint: str) -> float:
    """Return the inertia of link against drive, kg m² or kg."""
    link, drive = (float(model.dof_M0[int(model.joint(j).dofadr[0])]) for j in (joint, joint + DRIVE))
    return link * drive / (link + drive)


def _flanks(coupling: Coupling) -> _Numbers:
    """Return the numbers of rigid flanks, so far apart as there is play."""
    half = max(0.5 * coupling.play, TIGHT)
    return _Numbers(0.0, 0.0, [-half, half], True, [STOP_TIME_CONSTANT_S, 1.0], [*STOP_IMPEDANCE])


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
    coupling = Coupling(*model.tendon_user[tendon, : len(fields(Coupling))])
    offset = math.copysign(0.5 * coupling.play, apart)
    if coupling.stiffness > 0.0:
        difference = np.zeros((1, model.nv))
        difference[0, a], difference[0, b] = 1.0, -1.0
        response = np.empty_like(difference)
        mujoco.mj_solveM(model, data, response, difference)
        offset += apart / (coupling.stiffness * float(difference[0] @ response[0]))
    data.qpos[q] -= offset
