"""Joint coordinates of a model: positions that may hold quaternions, and their changes in tangent coordinates."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from runner.numerics.arrays import FloatArray
from runner.systems.mechanism import quaternions

FREE, BALL = int(mujoco.mjtJoint.mjJNT_FREE), int(mujoco.mjtJoint.mjJNT_BALL)
HINGE, SLIDE = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)
POSITIONS = {FREE: 7, BALL: 4, HINGE: 1, SLIDE: 1}
VELOCITIES = {FREE: 6, BALL: 3, HINGE: 1, SLIDE: 1}


@dataclass(frozen=True)
class Joint:
    """A joint: where its numbers stand among the positions (`q`) and the velocities (`v`) of a model.

    `called` is what a reader knows it by: a free joint has no parts that could be pointed at, its body has.
    """

    name: str
    kind: int
    q: slice
    v: slice
    called: str


class Coordinates:
    """Positions and velocities of a compiled model, by joint. Turns are in body axes, as MuJoCo's velocities are."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self.nq, self.nv = model.nq, model.nv
        joints = []
        for i in range(model.njnt):
            kind, q, v = int(model.jnt_type[i]), int(model.jnt_qposadr[i]), int(model.jnt_dofadr[i])
            name = model.joint(i).name
            called = (model.body(int(model.jnt_bodyid[i])).name or name) if kind == FREE else name
            joints.append(Joint(name, kind, slice(q, q + POSITIONS[kind]), slice(v, v + VELOCITIES[kind]), called))
        self.joints = tuple(joints)
        self.by_name = {joint.name: joint for joint in joints}
        simple = [j for j in joints if j.kind in (HINGE, SLIDE)]
        free = [j for j in joints if j.kind == FREE]
        # numbers that simply add, and quaternions with the turn that belongs to them
        self._q = np.array([j.q.start for j in simple] + [j.q.start + i for j in free for i in range(3)], dtype=int)
        self._v = np.array([j.v.start for j in simple] + [j.v.start + i for j in free for i in range(3)], dtype=int)
        self._turns = [(j.q.stop - 4, j.v.stop - 3) for j in joints if j.kind in (FREE, BALL)]

    @property
    def turning(self) -> bool:
        """Whether there are positions that are no numbers which simply add."""
        return bool(self._turns)

    def moved(self, position: FloatArray, change: FloatArray) -> FloatArray:
        """Return positions (..., nq) moved by tangent coordinates (..., nv)."""
        position = np.broadcast_to(position, (*np.broadcast_shapes(position.shape[:-1], change.shape[:-1]), self.nq))
        out = position.copy()
        out[..., self._q] += change[..., self._v]
        for q, v in self._turns:
            turned = quaternions.multiply(position[..., q : q + 4], quaternions.exponential(change[..., v : v + 3]))
            out[..., q : q + 4] = turned / np.linalg.norm(turned, axis=-1, keepdims=True)
        return out

    def difference(self, position: FloatArray, reference: FloatArray) -> FloatArray:
        """Return the tangent coordinates (..., nv) that move a reference to positions (..., nq)."""
        out = np.zeros((*np.broadcast_shapes(position.shape[:-1], reference.shape[:-1]), self.nv))
        out[..., self._v] = position[..., self._q] - reference[..., self._q]
        for q, v in self._turns:
            turn = quaternions.multiply(quaternions.inverse(reference[..., q : q + 4]), position[..., q : q + 4])
            out[..., v : v + 3] = quaternions.logarithm(turn)
        return out

    def dof_names(self) -> tuple[tuple[str, str, str], ...]:
        """Return a name for each degree of freedom, (nv,): of a table's column, its unit, and in words."""
        out = []
        for joint in self.joints:
            at = f"{'on' if joint.kind == FREE else 'at'} '{joint.called}'"
            turns = [(f"tau_{joint.name}{a}", "N m", f"torque {at}{w}") for a, w in _axes(joint, "own")]
            pushes = [(f"f_{joint.name}{a}", "N", f"force {at}{w}") for a, w in _axes(joint, "world")]
            out += {FREE: pushes + turns, BALL: turns, HINGE: turns, SLIDE: pushes}[joint.kind]
        return tuple(out)


def _axes(joint: Joint, frame: str) -> list[tuple[str, str]]:
    if joint.kind in (HINGE, SLIDE):
        return [("", "")]
    return [(f"_{axis}", f" about its own {axis}" if frame == "own" else f" along {axis}") for axis in "xyz"]
