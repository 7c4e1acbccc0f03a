"""Positions, inertia and inertial forces of a tree of hinges and slides.

Motions and forces are six numbers about the origin of the world, in its axes: turning and moving, moment and force.
There inertias of bodies add up as they are (Featherstone 2008, chapters 5 and 6).
"""

from __future__ import annotations

import math

from numba import njit

from runner.physics.joint_tree.numbers import BODY, JOINT

POS, TURNED, FRAME, MASS = (BODY[n] for n in ("pos", "turned", "frame", "mass"))
COM, INERTIA, HELD = BODY["com"], BODY["inertia"], BODY["held"]
ANCHOR, AXIS, ZERO = (JOINT[n] for n in ("anchor", "axis", "zero"))


@njit(error_model="numpy", inline="always")
def place(shape, bodies, joints, q, frames, origins, axes, inertias):
    """Place the bodies of a tree.

    Args:
        shape: See `Shape`.
        bodies, joints: Their numbers, (B, .) and (V, .).
        q: Positions of the joints, (V,).
        frames: Out: axes of each body in the world, row by row, (B, 9).
        origins: Out: their origins, (B, 3).
        axes: Out: what each joint moves, (V, 6).
        inertias: Out: of each body about the origin of the world: mass, first moments, second (xx, yy, zz, xy, xz, yz).
    """
    # numbers that are worked with are kept in names of their own: of arrays no compiler knows that they do not overlap
    for b in range(1, len(bodies)):
        body, up, at = bodies[b], frames[shape.parents[b]], origins[shape.parents[b]]
        r0, r1, r2, r3, r4, r5, r6, r7, r8 = up[0], up[1], up[2], up[3], up[4], up[5], up[6], up[7], up[8]
        x, y, z = body[POS], body[POS + 1], body[POS + 2]
        ox, oy, oz = (
            at[0] + r0 * x + r1 * y + r2 * z,
            at[1] + r3 * x + r4 * y + r5 * z,
            at[2] + r6 * x + r7 * y + r8 * z,
        )
        if body[TURNED] != 0.0:
            a0, a1, a2 = body[FRAME], body[FRAME + 1], body[FRAME + 2]
            a3, a4, a5 = body[FRAME + 3], body[FRAME + 4], body[FRAME + 5]
            a6, a7, a8 = body[FRAME + 6], body[FRAME + 7], body[FRAME + 8]
            r0, r1, r2 = r0 * a0 + r1 * a3 + r2 * a6, r0 * a1 + r1 * a4 + r2 * a7, r0 * a2 + r1 * a5 + r2 * a8
            r3, r4, r5 = r3 * a0 + r4 * a3 + r5 * a6, r3 * a1 + r4 * a4 + r5 * a7, r3 * a2 + r4 * a5 + r5 * a8
            r6, r7, r8 = r6 * a0 + r7 * a3 + r8 * a6, r6 * a1 + r7 * a4 + r8 * a7, r6 * a2 + r7 * a5 + r8 * a8
        for j in range(shape.first[b], shape.first[b] + shape.count[b]):
            joint, axis, way = joints[j], axes[j], q[j] - joints[j, ZERO]
            x, y, z = joint[AXIS], joint[AXIS + 1], joint[AXIS + 2]
            ux, uy, uz = r0 * x + r1 * y + r2 * z, r3 * x + r4 * y + r5 * z, r6 * x + r7 * y + r8 * z
            if not shape.hinge[j]:
                axis[0], axis[1], axis[2], axis[3], axis[4], axis[5] = 0.0, 0.0, 0.0, ux, uy, uz
                ox, oy, oz = ox + way * ux, oy + way * uy, oz + way * uz
                continue
            x, y, z = joint[ANCHOR], joint[ANCHOR + 1], joint[ANCHOR + 2]
            px, py, pz = ox + r0 * x + r1 * y + r2 * z, oy + r3 * x + r4 * y + r5 * z, oz + r6 * x + r7 * y + r8 * z
            axis[0], axis[1], axis[2] = ux, uy, uz
            axis[3], axis[4], axis[5] = py * uz - pz * uy, pz * ux - px * uz, px * uy - py * ux
            # the columns of the frame turn about the axis, which is the same in body and world
            s, c = math.sin(way), math.cos(way)
            f = 1.0 - c
            t0, t1, t2 = c + f * ux * ux, f * ux * uy - s * uz, f * ux * uz + s * uy
            t3, t4, t5 = f * ux * uy + s * uz, c + f * uy * uy, f * uy * uz - s * ux
            t6, t7, t8 = f * ux * uz - s * uy, f * uy * uz + s * ux, c + f * uz * uz
            r0, r3, r6 = t0 * r0 + t1 * r3 + t2 * r6, t3 * r0 + t4 * r3 + t5 * r6, t6 * r0 + t7 * r3 + t8 * r6
            r1, r4, r7 = t0 * r1 + t1 * r4 + t2 * r7, t3 * r1 + t4 * r4 + t5 * r7, t6 * r1 + t7 * r4 + t8 * r7
            r2, r5, r8 = t0 * r2 + t1 * r5 + t2 * r8, t3 * r2 + t4 * r5 + t5 * r8, t6 * r2 + t7 * r5 + t8 * r8
            ox, oy, oz = (
                px - (r0 * x + r1 * y + r2 * z),
                py - (r3 * x + r4 * y + r5 * z),
                pz - (r6 * x + r7 * y + r8 * z),
            )
        own, here, out = frames[b], origins[b], inertias[b]
        own[0], own[1], own[2], own[3], own[4], own[5], own[6], own[7], own[8] = r0, r1, r2, r3, r4, r5, r6, r7, r8
        here[0], here[1], here[2] = ox, oy, oz
        m, x, y, z = body[MASS], body[COM], body[COM + 1], body[COM + 2]
        x, y, z = ox + r0 * x + r1 * y + r2 * z, oy + r3 * x + r4 * y + r5 * z, oz + r6 * x + r7 * y + r8 * z
        out[0], out[1], out[2], out[3] = m, m * x, m * y, m * z
        xx, yy, zz = body[INERTIA], body[INERTIA + 1], body[INERTIA + 2]
        xy, xz, yz = body[INERTIA + 3], body[INERTIA + 4], body[INERTIA + 5]
        a0, a1, a2 = xx * r0 + xy * r1 + xz * r2, xy * r0 + yy * r1 + yz * r2, xz * r0 + yz * r1 + zz * r2
        a3, a4, a5 = xx * r3 + xy * r4 + xz * r5, xy * r3 + yy * r4 + yz * r5, xz * r3 + yz * r4 + zz * r5
        a6, a7, a8 = xx * r6 + xy * r7 + xz * r8, xy * r6 + yy * r7 + yz * r8, xz * r6 + yz * r7 + zz * r8
        out[4] = r0 * a0 + r1 * a1 + r2 * a2 + m * (y * y + z * z)
        out[5] = r3 * a3 + r4 * a4 + r5 * a5 + m * (x * x + z * z)
        out[6] = r6 * a6 + r7 * a7 + r8 * a8 + m * (x * x + y * y)
        out[7] = r0 * a3 + r1 * a4 + r2 * a5 - m * x * y
        out[8] = r0 * a6 + r1 * a7 + r2 * a8 - m * x * z
        out[9] = r3 * a6 + r4 * a7 + r5 * a8 - m * y * z


@njit(error_model="numpy", inline="always")
def _momentum(inertia, v, out):
    """Write what a body of that inertia, moving so, has: moment of momentum and momentum."""
    m, hx, hy, hz = inertia[0], inertia[1], inertia[2], inertia[3]
    wx, wy, wz, vx, vy, vz = v[0], v[1], v[2], v[3], v[4], v[5]
    out[0] = inertia[4] * wx + inertia[7] * wy + inertia[8] * wz + hy * vz - hz * vy
    out[1] = inertia[7] * wx + inertia[5] * wy + inertia[9] * wz + hz * vx - hx * vz
    out[2] = inertia[8] * wx + inertia[9] * wy + inertia[6] * wz + hx * vy - hy * vx
    out[3] = m * vx - (hy * wz - hz * wy)
    out[4] = m * vy - (hz * wx - hx * wz)
    out[5] = m * vz - (hx * wy - hy * wx)


@njit(error_model="numpy", inline="always")
def inertia_matrix(shape, armature, axes, inertias, composite, force, out):
    """Write the inertia of a tree, (V, V), both halves of it.

    Args:
        shape: See `Shape`.
        armature: Of each joint, (V,).
        axes, inertias: See `place`.
        composite, force: Scratch, (B, 10) and (6,).
        out: Out.
    """
    for b in range(len(inertias)):
        for k in range(10):
            composite[b, k] = inertias[b, k]
    for b in range(len(inertias) - 1, 0, -1):
        p = shape.parents[b]
        if p > 0:
            for k in range(10):
                composite[p, k] += composite[b, k]
    for i in range(len(axes)):
        for j in range(i + 1):
            out[i, j] = 0.0
        _momentum(composite[shape.carriers[i]], axes[i], force)
        j = i
        while j >= 0:
            s = 0.0
            for k in range(6):
                s += axes[j, k] * force[k]
            out[i, j] = s
            j = shape.above[j]
        out[i, i] += armature[i]
        for j in range(i):
            out[j, i] = out[i, j]


@njit(error_model="numpy", inline="always")
def inertial_forces(shape, gravity, bodies, axes, inertias, v, moving, changing, forces, out):
    """Write what joints have to exert for the tree to move on at these velocities against gravity, (V,).

    Args:
        shape: See `Shape`.
        gravity: (3,), m/s2; of it a body bears a share by itself (MuJoCo's `gravcomp`), see `bodies`.
        bodies: Their numbers, (B, .).
        axes, inertias: See `place`.
        v: Velocities of the joints, (V,).
        moving, changing, forces: Scratch, (B, 6).
        out: Out.
    """
    for k in range(6):
        moving[0, k] = 0.0
        changing[0, k] = 0.0 if k < 3 else -gravity[k - 3]
        forces[0, k] = 0.0
    for b in range(1, len(inertias)):
        p = shape.parents[b]
        u, a, f = moving[b], changing[b], forces[b]
        for k in range(6):
            u[k], a[k] = moving[p, k], changing[p, k]
        for j in range(shape.first[b], shape.first[b] + shape.count[b]):
            s, rate = axes[j], v[j]
            a[0] += rate * (u[1] * s[2] - u[2] * s[1])
            a[1] += rate * (u[2] * s[0] - u[0] * s[2])
            a[2] += rate * (u[0] * s[1] - u[1] * s[0])
            a[3] += rate * (u[1] * s[5] - u[2] * s[4] + u[4] * s[2] - u[5] * s[1])
            a[4] += rate * (u[2] * s[3] - u[0] * s[5] + u[5] * s[0] - u[3] * s[2])
            a[5] += rate * (u[0] * s[4] - u[1] * s[3] + u[3] * s[1] - u[4] * s[0])
            for k in range(6):
                u[k] += rate * s[k]
        _momentum(inertias[b], u, f)
        lx, ly, lz, px, py, pz = f[0], f[1], f[2], f[3], f[4], f[5]
        _momentum(inertias[b], a, f)
        f[0] += u[1] * lz - u[2] * ly + u[4] * pz - u[5] * py
        f[1] += u[2] * lx - u[0] * lz + u[5] * px - u[3] * pz
        f[2] += u[0] * ly - u[1] * lx + u[3] * py - u[4] * px
        f[3] += u[1] * pz - u[2] * py
        f[4] += u[2] * px - u[0] * pz
        f[5] += u[0] * py - u[1] * px
        if bodies[b, HELD] != 0.0:
            gx, gy, gz = bodies[b, HELD] * gravity[0], bodies[b, HELD] * gravity[1], bodies[b, HELD] * gravity[2]
            m, hx, hy, hz = inertias[b, 0], inertias[b, 1], inertias[b, 2], inertias[b, 3]
            f[0] += hy * gz - hz * gy
            f[1] += hz * gx - hx * gz
            f[2] += hx * gy - hy * gx
            f[3] += m * gx
            f[4] += m * gy
            f[5] += m * gz
    for b in range(len(inertias) - 1, 0, -1):
        p = shape.parents[b]
        for j in range(shape.first[b], shape.first[b] + shape.count[b]):
            s = 0.0
            for k in range(6):
                s += axes[j, k] * forces[b, k]
            out[j] = s
        for k in range(6):
            forces[p, k] += forces[b, k]
