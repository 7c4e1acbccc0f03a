"""The equations of motion: mass matrix, Coriolis, centrifugal and gravity forces, what joints and actuators exert.

Lagrange's equations of two links in a plane (Spong, Hutchinson & Vidyasagar 2006, 7.3), with q the turn of each joint,
L the way between the joints in the first link's axes, c the centres of mass in their links' axes, R a turn, and

    p = L . R(q2) c2,   s = dp/dq2

    M11 = I1 + m1 c1^2 + I2 + m2 (L^2 + c2^2 + 2 p),   M12 = I2 + m2 (c2^2 + p),   M22 = I2 + m2 c2^2
    h1 = m2 s (2 v1 v2 + v2^2),   h2 = -m2 s v1^2

    M a + h = gravity + actuators + joints

With a pendulum there is one link, with a slide its mass alone. A drive behind a joint (play or give) is one more degree
of freedom, the last: it has the joint's armature and part of its friction, and the actuator acts on it.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from runner.blind.mechanism.physics import layout as at


@njit(error_model="numpy")
def drive_of(joints):
    """Return the joint that has a drive of its own, -1 if none has."""
    for j in range(joints.shape[0]):
        if joints[j, at.PLAY] > 0.0 or joints[j, at.GIVE] > 0.0:
            return j
    return -1


@njit(error_model="numpy")
def _second(whole, q):
    """Return p and s of the module's docstring."""
    cx, cz = whole[at.LINKS + at.LINK + at.COM_X], whole[at.LINKS + at.LINK + at.COM_Z]
    cos, sin = math.cos(q[1]), math.sin(q[1])
    length = whole[at.LENGTH]
    # L = (0, -length), R c = (x cos - z sin, x sin + z cos)
    return -length * (cx * sin + cz * cos), -length * (cx * cos - cz * sin)


@njit(error_model="numpy")
def mass_matrix(whole, joints, q, out):
    """Write the mass matrix (n, n), drives included."""
    count, driven = joints.shape[0], drive_of(joints)
    out[:, :] = 0.0
    if whole[at.SLIDES] != 0.0:
        out[0, 0] = whole[at.LINKS + at.MASS]
    else:
        for k in range(count):
            row = at.LINKS + k * at.LINK
            square = whole[row + at.COM_X] ** 2 + whole[row + at.COM_Z] ** 2
            own = whole[row + at.INERTIA] + whole[row + at.MASS] * square
            for i in range(k + 1):
                for j in range(k + 1):
                    out[i, j] += own
        if count == 2:
            p, _ = _second(whole, q)
            mass = whole[at.LINKS + at.LINK + at.MASS]
            out[0, 0] += mass * (whole[at.LENGTH] ** 2 + 2.0 * p)
            out[0, 1] += mass * p
            out[1, 0] += mass * p
    for j in range(count):
        d = count if j == driven else j
        out[d, d] += joints[j, at.ARMATURE]


@njit(error_model="numpy")
def gravity_and_speed(whole, joints, q, v, out):
    """Write gravity's forces less the Coriolis and centrifugal ones of the joints, (count,)."""
    count = joints.shape[0]
    gx, gz = whole[at.GRAVITY_X], whole[at.GRAVITY_Z]
    if whole[at.SLIDES] != 0.0:
        out[0] = whole[at.LINKS + at.MASS] * gx
        return
    angle = 0.0
    for k in range(count):
        angle += q[k]
        row = at.LINKS + k * at.LINK
        mass, cx, cz = whole[row + at.MASS], whole[row + at.COM_X], whole[row + at.COM_Z]
        cos, sin = math.cos(angle), math.sin(angle)
        # of g . R'(angle) c
        pull = mass * (gx * (-cx * sin - cz * cos) + gz * (cx * cos - cz * sin))
        out[k] = 0.0
        for i in range(k + 1):
            out[i] += pull
    if count == 2:
        mass, length = whole[at.LINKS + at.LINK + at.MASS], whole[at.LENGTH]
        out[0] += mass * length * (gx * math.cos(q[0]) + gz * math.sin(q[0]))
        _, s = _second(whole, q)
        out[0] -= mass * s * (2.0 * v[0] * v[1] + v[1] ** 2)
        out[1] += mass * s * v[0] ** 2


@njit(error_model="numpy")
def actuator_force(actuator, u, q, v, heat):
    """Return what an actuator exerts at a command that has reached it."""
    force = actuator[at.KP] * (u - q) - actuator[at.KV] * v if actuator[at.SERVO] != 0.0 else u
    force *= actuator[at.GAIN] * (1.0 - actuator[at.FADE] * heat)
    force *= 1.0 + actuator[at.ONE_SIDED] * (1.0 if force > 0.0 else -1.0)
    force = min(max(force, -actuator[at.LIMIT]), actuator[at.LIMIT])
    if actuator[at.SLIP] != 0.0 and abs(force) > actuator[at.SLIP_AT]:
        force = math.copysign(actuator[at.SLIP_AT] * (1.0 - actuator[at.SLIP]), force)
    return force


@njit(error_model="numpy")
def _smooth_joint_force(joint, waves, q, v, t, elapsed):
    """Return what acts on the link of a joint besides viscous and dry friction; pushes by their times."""
    force = joint[at.OFFSET] - joint[at.STIFFNESS] * (q - joint[at.REST])
    force -= joint[at.QUADRATIC] * v * abs(v) + joint[at.CUBIC] * (q - joint[at.CUBIC_REST]) ** 3
    if joint[at.PUSH_FROM] <= t < joint[at.PUSH_UNTIL]:
        force += joint[at.PUSH]
    beyond = (q - joint[at.STOP_AT]) * joint[at.STOP_SIDE]
    if beyond > 0.0:
        force -= joint[at.STOP_STIFFNESS] * beyond * joint[at.STOP_SIDE]
    for k in range(waves.shape[0]):
        if waves[k, 0] != 0.0:
            force += waves[k, 0] * math.sin(2.0 * math.pi * waves[k, 1] * (t + elapsed) + waves[k, 2])
    return force


@njit(error_model="numpy")
def forces(whole, joints, actuators, swings, q, v, u, built, heat, t, elapsed, exerted, out, up, down):
    """Write the forces (n,) but for dry friction, and the limits of that against motion up and down, (n,) each.

    Args:
        whole, joints, actuators, swings: The world, see `layout`.
        q, v: Positions and velocities, (n,).
        u: Commands that have reached the actuators, (count,).
        built: What Dahl's friction has built up, -1 to 1, (count,).
        heat: Of the actuators, 0 to about 1, (count,).
        t, elapsed: Time since the episode began, and since the recording did until then, s.
        exerted: Written: what the actuators exert, (count,).
        out, up, down: Written.
    """
    count, driven = joints.shape[0], drive_of(joints)
    gravity_and_speed(whole, joints, q, v, out)
    if driven >= 0:
        out[count] = 0.0
    for j in range(count):
        joint = joints[j]
        d = count if j == driven else j
        exerted[j] = actuator_force(actuators[j], u[j], q[d], v[d], heat[j])
        dry = joint[at.DRY] * (
            1.0 + joint[at.PATCH] * math.exp(-(((q[j] - joint[at.PATCH_AT]) / joint[at.PATCH_WIDTH]) ** 2))
        )
        if joint[at.EXCESS] != 0.0:
            dry *= 1.0 + joint[at.EXCESS] * math.exp(-((v[j] / joint[at.EXCESS_SPEED]) ** 2))
        cold = 1.0 + joint[at.WARM_UP] * math.exp(-(t + elapsed) / joint[at.WARM_UP_S])
        dry = dry * cold + joint[at.LOAD_SHARE] * 0.5 * abs(exerted[j] - out[j])
        damping = joint[at.DAMPING] * cold
        share = joint[at.DRIVE_SHARE] if j == driven else 0.0
        up[j] = (1.0 - share) * dry * (1.0 + 0.5 * joint[at.DRY_DIFFERENCE])
        down[j] = (1.0 - share) * dry * (1.0 - 0.5 * joint[at.DRY_DIFFERENCE])
        if j == driven:
            up[d] = down[d] = share * dry
        out[j] -= (1.0 - share) * damping * v[j] + 0.5 * joint[at.VISCOUS_DIFFERENCE] * damping * abs(v[j])
        out[d] -= share * damping * v[d]
    for j in range(count):
        joint = joints[j]
        d = count if j == driven else j
        out[j] += _smooth_joint_force(joint, swings[j], q[j], v[j], t, elapsed) - joint[at.DAHL] * built[j]
        out[d] += exerted[j] + joint[at.RIPPLE] * math.sin(joint[at.RIPPLE_RATE] * q[d] + joint[at.RIPPLE_PHASE])
        if actuators[j, at.CROSSTALK] != 0.0 and count == 2:
            out[1 - j] += actuators[j, at.CROSSTALK] * exerted[j]
    if driven >= 0 and joints[driven, at.GIVE] > 0.0:
        stiffness = 1.0 / joints[driven, at.GIVE]
        # the link's own inertia as it hangs straight, as the vocabulary's coupling has it
        inertia = spring_inertia(whole, joints, driven)
        damping = 2.0 * joints[driven, at.SPRING_DAMPING] * math.sqrt(stiffness * inertia)
        pull = stiffness * (q[count] - q[driven]) + damping * (v[count] - v[driven])
        out[driven] += pull
        out[count] -= pull


@njit(error_model="numpy")
def spring_inertia(whole, joints, driven):
    """Return the inertia that swings on a spring between drive and link where all joints are at zero."""
    count = joints.shape[0]
    matrix = np.zeros((3, 3))
    mass_matrix(whole, joints, np.zeros(3), matrix)
    link, drive = matrix[driven, driven], matrix[count, count]
    return link * drive / (link + drive)
