"""Pushes on bodies that MuJoCo's own contacts carry: they get the push, and no friction from here."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from runner.physics.dry_friction.record import COLUMN

PUSH_ADR = COLUMN["push_adr"]


@njit(error_model="numpy")
def push_free(record, dof, q, qpos, user, passive):
    """Push on a body with a free joint: force at the frame's origin, moment in body axes (MuJoCo's convention)."""
    q += 3
    push = int(record[PUSH_ADR])
    w, x, y, z = qpos[q], qpos[q + 1], qpos[q + 2], qpos[q + 3]
    rot = np.empty((3, 3))
    rot[0, 0] = 1 - 2 * (y * y + z * z)
    rot[0, 1] = 2 * (x * y - w * z)
    rot[0, 2] = 2 * (x * z + w * y)
    rot[1, 0] = 2 * (x * y + w * z)
    rot[1, 1] = 1 - 2 * (x * x + z * z)
    rot[1, 2] = 2 * (y * z - w * x)
    rot[2, 0] = 2 * (x * z - w * y)
    rot[2, 1] = 2 * (y * z + w * x)
    rot[2, 2] = 1 - 2 * (x * x + y * y)
    t0 = t1 = t2 = 0.0
    for i in range(3):
        s0, s1, s2 = user[push + 3 + 3 * i], user[push + 4 + 3 * i], user[push + 5 + 3 * i]
        t0 += rot[1, i] * s2 - rot[2, i] * s1
        t1 += rot[2, i] * s0 - rot[0, i] * s2
        t2 += rot[0, i] * s1 - rot[1, i] * s0
    for i in range(3):
        passive[dof + i] += user[push + i]
        passive[dof + 3 + i] += rot[0, i] * t0 + rot[1, i] * t1 + rot[2, i] * t2


@njit(error_model="numpy")
def push_upright(record, dof, q, qpos, user, passive):
    """Push on a body with slides x, y, z and a hinge about z."""
    push = int(record[PUSH_ADR])
    c, s = math.cos(qpos[q + 3]), math.sin(qpos[q + 3])
    sxx, sxy, syx, syy = user[push + 3], user[push + 4], user[push + 6], user[push + 7]
    passive[dof] += user[push]
    passive[dof + 1] += user[push + 1]
    passive[dof + 2] += user[push + 2]
    passive[dof + 3] += (c * sxy - s * sxx) - (s * syy + c * syx)
