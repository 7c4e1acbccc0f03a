"""A planar body (slides x, y and a hinge z): from MuJoCo's numbers to a step under dry friction, and back."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from runner.physics.dry_friction.pin import PIN_RADIUS, no_touch, touch_of
from runner.physics.dry_friction.record import (
    COLUMN,
    OUT_COP,
    OUT_FORCE,
    OUT_LIFTED,
    OUT_LOAD,
    OUT_PIN,
    OUT_POWER,
    OUT_SLIP,
    OUT_TORQUE,
    OUT_TURN,
    PIN_ADR,
    PUSH_SIZE,
)
from runner.physics.dry_friction.step import PlanarBody, step_in_parts

PUSH_ADR, POINTS, BASE_Z = COLUMN["push_adr"], COLUMN["points"], COLUMN["base_z"]
ALONG, ACROSS, ANISO_ANGLE, MASS_LEAK = COLUMN["along"], COLUMN["across"], COLUMN["aniso_angle"], COLUMN["mass_leak"]


class Engine(NamedTuple):
    """Live arrays and numbers of MuJoCo's model and data, under their names there."""

    timestep: float
    gravity: np.ndarray
    time: float
    body_mass: np.ndarray
    body_inertia: np.ndarray
    body_ipos: np.ndarray
    body_iquat: np.ndarray
    dof_damping: np.ndarray
    qpos: np.ndarray
    qvel: np.ndarray
    xfrc_applied: np.ndarray
    userdata: np.ndarray
    qfrc_applied: np.ndarray
    qfrc_passive: np.ndarray


@njit(error_model="numpy", forceinline=True)
def _inertia_about_frame(engine, body):
    """Return the moment of inertia about the vertical through the body frame, kg m2."""
    inertia, ipos, quat = engine.body_inertia, engine.body_ipos, engine.body_iquat
    qw, qx, qy, qz = quat[4 * body], quat[4 * body + 1], quat[4 * body + 2], quat[4 * body + 3]
    zx, zy, zz = 2.0 * (qx * qz - qw * qy), 2.0 * (qy * qz + qw * qx), 1.0 - 2.0 * (qx * qx + qy * qy)
    izz = inertia[3 * body] * zx * zx + inertia[3 * body + 1] * zy * zy + inertia[3 * body + 2] * zz * zz
    comx, comy = ipos[3 * body], ipos[3 * body + 1]
    return izz + engine.body_mass[body] * (comx * comx + comy * comy)


@njit(error_model="numpy", forceinline=True)
def _forces(engine, push, body, dof, mass, com_z, lever, c, s):
    """Return what acts on a body without friction, world axes, and where its load is then.

    Returns:
        Generalised force about the body frame (3), weight that the base carries, and where the load must be without
        friction, relative to the body frame (2).
    """
    user, gravity, passive, applied = engine.userdata, engine.gravity, engine.qfrc_passive, engine.qfrc_applied
    lx, ly = lever
    o = 6 * body
    xfrc = engine.xfrc_applied
    out0, out1, out2, out3, out4, out5 = xfrc[o], xfrc[o + 1], xfrc[o + 2], xfrc[o + 3], xfrc[o + 4], xfrc[o + 5]

    # push: force and moment about the body frame
    fx, fy, fz = user[push], user[push + 1], user[push + 2]
    sxx, sxy, sxz = user[push + 3], user[push + 4], user[push + 5]
    syx, syy, syz = user[push + 6], user[push + 7], user[push + 8]
    szx, szy = user[push + 9], user[push + 10]
    tz = (c * sxy - s * sxx) - (s * syy + c * syx)

    # forces on the joints (through the body frame), and at the centre of mass, where inertia acts, too
    v0, v1, v2 = engine.qvel[dof], engine.qvel[dof + 1], engine.qvel[dof + 2]
    k0, k1, k2 = engine.dof_damping[dof], engine.dof_damping[dof + 1], engine.dof_damping[dof + 2]
    joint0, joint1 = passive[dof] + k0 * v0 + applied[dof] + fx, passive[dof + 1] + k1 * v1 + applied[dof + 1] + fy
    com0, com1 = out0 + mass * gravity[0], out1 + mass * gravity[1]
    e0, e1 = joint0 + com0, joint1 + com1
    e2 = passive[dof + 2] + k2 * v2 + applied[dof + 2] + out5 + tz + lx * com1 - ly * com0

    # where the load must be without friction, from the moments about the centre of mass
    weight = -mass * gravity[2] - fz - out2
    mx = (weight + fz) * lx - (c * sxz - s * syz) + szx - com_z * joint0 + out4
    my = (weight + fz) * ly - (s * sxz + c * syz) + szy - com_z * joint1 - out3
    if weight > 0.0:
        mx /= weight
        my /= weight
    return (e0, e1, e2), weight, (mx, my)


@njit(error_model="numpy", forceinline=True)
def hand_over(engine, body, dof, lever, inertia, x):
    """Give MuJoCo what it needs so that its step, with its own mass and implicit damping, ends at velocity x."""
    h, gravity, passive, applied = engine.timestep, engine.gravity, engine.qfrc_passive, engine.qfrc_applied
    full = engine.body_mass[body]
    lx, ly = lever
    v0, v1, v2 = engine.qvel[dof], engine.qvel[dof + 1], engine.qvel[dof + 2]
    k0, k1, k2 = engine.dof_damping[dof], engine.dof_damping[dof + 1], engine.dof_damping[dof + 2]
    o = 6 * body
    out0, out1, out5 = engine.xfrc_applied[o], engine.xfrc_applied[o + 1], engine.xfrc_applied[o + 5]
    d0, d1, d2 = (x[0] - v0) / h, (x[1] - v1) / h, (x[2] - v2) / h
    n00, n11 = full + h * k0, full + h * k1
    n02, n12, n22 = -full * ly, full * lx, inertia + h * k2
    want0 = n00 * d0 + n02 * d2 - full * v2 * v2 * lx - full * gravity[0]
    want1 = n11 * d1 + n12 * d2 - full * v2 * v2 * ly - full * gravity[1]
    want2 = n02 * d0 + n12 * d1 + n22 * d2 - full * (lx * gravity[1] - ly * gravity[0])
    passive[dof] = want0 - applied[dof] - out0
    passive[dof + 1] = want1 - applied[dof + 1] - out1
    passive[dof + 2] = want2 - applied[dof + 2] - out5 - lx * out1 + ly * out0


@njit(error_model="numpy", forceinline=True)
def step_planar(record, body, dof, qadr, engine, room):
    """Take a step of a body with slides x, y and a hinge about z, and tell what friction did.

    `room` is memory for its base points, `room_for` them.

    Returns:
        Velocity at the end of the step (3), centre of mass relative to the body frame (2, world axes), and moment of
        inertia about the frame.
    """
    push = int(record[PUSH_ADR])
    n = int(record[POINTS])
    qpos, h = engine.qpos, engine.timestep
    yaw = qpos[qadr + 2]
    c, s = math.cos(yaw), math.sin(yaw)
    v0, v1, v2 = engine.qvel[dof], engine.qvel[dof + 1], engine.qvel[dof + 2]
    k0, k1, k2 = engine.dof_damping[dof], engine.dof_damping[dof + 1], engine.dof_damping[dof + 2]

    scale = max(1.0 - record[MASS_LEAK] * (engine.time + 0.5 * h), 0.05)
    mass = engine.body_mass[body] * scale
    inertia = _inertia_about_frame(engine, body)
    comx, comy, comz = engine.body_ipos[3 * body], engine.body_ipos[3 * body + 1], engine.body_ipos[3 * body + 2]
    lever = (c * comx - s * comy, s * comx + c * comy)
    (e0, e1, e2), weight, (mx, my) = _forces(engine, push, body, dof, mass, comz, lever, c, s)

    # into the axes of friction, and back
    turn = record[ANISO_ANGLE] if record[ALONG] != record[ACROSS] else 0.0
    cr, sr = math.cos(turn), math.sin(turn)
    ca, sa = math.cos(yaw + turn), math.sin(yaw + turn)
    px, py = cr * comx + sr * comy, cr * comy - sr * comx
    touch = no_touch()
    if record[PIN_RADIUS] > 0.0:
        pin = engine.userdata[push + PIN_ADR :]
        touch = touch_of(record, (qpos[qadr], qpos[qadr + 1], yaw, turn), pin[0], pin[1], pin[2], pin[3])
    planar = PlanarBody(
        force=(ca * e0 + sa * e1, ca * e1 - sa * e0, e2),
        mass=(mass, 0.0, -mass * py, mass, mass * px, scale * inertia),
        damping=(k0 * ca * ca + k1 * sa * sa, ca * sa * (k1 - k0), 0.0, k0 * sa * sa + k1 * ca * ca, 0.0, k2),
        first_moment=(mass * px, mass * py),
        weight=weight,
        com_height=comz - record[BASE_Z],
        com_z=comz,
        free_centre=(ca * mx + sa * my, ca * my - sa * mx),
        place=(qpos[qadr], qpos[qadr + 1], yaw + turn),
        turn=(cr, sr),
        touch=touch,
    )
    end, rub, cop, lifted, held = step_in_parts(record, n, h, (ca * v0 + sa * v1, ca * v1 - sa * v0, v2), planar, room)
    x0, x1, x2 = ca * end[0] - sa * end[1], sa * end[0] + ca * end[1], end[2]
    rub0, rub1, rub2 = ca * rub[0] - sa * rub[1], sa * rub[0] + ca * rub[1], rub[2]

    out = engine.userdata[push + PUSH_SIZE :]
    out[OUT_FORCE] = rub0
    out[OUT_FORCE + 1] = rub1
    out[OUT_TORQUE] = rub2
    out[OUT_COP] = cop[0]
    out[OUT_COP + 1] = cop[1]
    out[OUT_LIFTED] = lifted
    out[OUT_SLIP] = math.sqrt(x0 * x0 + x1 * x1)
    out[OUT_POWER] = 0.5 * (rub0 * (x0 + v0) + rub1 * (x1 + v1) + rub2 * (x2 + v2))
    out[OUT_LOAD] = max(weight, 0.0)
    out[OUT_TURN] = x2
    out[OUT_PIN] = ca * held[0] - sa * held[1]
    out[OUT_PIN + 1] = sa * held[0] + ca * held[1]
    return (x0, x1, x2), lever, inertia
