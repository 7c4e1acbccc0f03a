"""Where a body stands in the model's arrays, and what its state means in the world."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from runner.errors import ConfigError
from runner.physics import dry_friction


@dataclass(frozen=True)
class BodyHandle:
    """Where one body stands in the model's arrays.

    `joints` is `PLANAR` (x, y, yaw), `UPRIGHT` (x, y, z, yaw) or `FREE` (position, quaternion).
    `push_adr` is the start of its block in `mjData.userdata`: 12 numbers of push, then `OUT_SIZE` of output.
    """

    name: str
    body_id: int
    qpos_adr: int
    dof_adr: int
    push_adr: int
    joints: int
    rest_height_m: float  # of the body frame above the floor

    @property
    def nq(self) -> int:
        """Number of positions."""
        return 7 if self.joints == dry_friction.FREE else self.joints

    @property
    def nv(self) -> int:
        """Number of velocities."""
        return self.joints

    def planar_columns(self) -> tuple[tuple[int, int, int], tuple[int, int, int]]:
        """Return where x, y, yaw stand in qpos and vx, vy, wz in qvel; not for a free body.

        Raises:
            ConfigError: If the body is free: its yaw is no entry of qpos.
        """
        if self.joints == dry_friction.FREE:
            raise ConfigError(f"body '{self.name}' is free: its yaw follows from a quaternion, use `pose`.")
        q, v, last = self.qpos_adr, self.dof_adr, self.joints - 1
        return (q, q + 1, q + last), (v, v + 1, v + last)

    def difference(self, start: np.ndarray, end: np.ndarray) -> np.ndarray:
        """Return the way from one of the body's positions (nq,) to another, per degree of freedom, (nv,)."""
        if self.joints != dry_friction.FREE:
            return end - start
        out = np.empty(6)
        out[:3] = end[:3] - start[:3]
        mujoco.mju_subQuat(out[3:], end[3:], start[3:])
        return out

    def move(self, position: np.ndarray, way: np.ndarray) -> None:
        """Move one of the body's positions (nq,), in place, along a `difference` (nv,)."""
        if self.joints != dry_friction.FREE:
            position += way
        else:
            position[:3] += way[:3]
            mujoco.mju_quatIntegrate(position[3:], way[3:], 1.0)

    def pose(self, qpos: np.ndarray) -> np.ndarray:
        """Return position and quaternion (w first) of the body frame in the world, (..., 7), from qpos (..., nq)."""
        q = qpos[..., self.qpos_adr : self.qpos_adr + self.nq]
        if self.joints == dry_friction.FREE:
            return q.copy()
        out = np.zeros((*q.shape[:-1], 7))
        out[..., :2] = q[..., :2]
        out[..., 2] = self.rest_height_m + (q[..., 2] if self.joints == dry_friction.UPRIGHT else 0.0)
        out[..., 3], out[..., 6] = np.cos(q[..., -1] / 2), np.sin(q[..., -1] / 2)
        return out

    def twist(self, qpos: np.ndarray, qvel: np.ndarray) -> np.ndarray:
        """Return the velocity of the body frame's origin and the angular velocity, world axes, (..., 6)."""
        v = qvel[..., self.dof_adr : self.dof_adr + self.nv]
        out = np.zeros((*v.shape[:-1], 6))
        if self.joints == dry_friction.FREE:
            out[..., :3] = v[..., :3]
            out[..., 3:] = rotate(qpos[..., self.qpos_adr + 3 : self.qpos_adr + 7], v[..., 3:])
            return out
        out[..., : self.joints - 1] = v[..., :-1]
        out[..., 5] = v[..., -1]
        return out


def rotate(quaternion: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Turn vectors (..., 3) by unit quaternions (..., 4), w first."""
    w, u = quaternion[..., :1], quaternion[..., 1:]
    t = 2.0 * np.cross(u, vector)
    return vector + w * t + np.cross(u, t)


def handles(model: mujoco.MjModel, names: list[str]) -> dict[str, BodyHandle]:
    """Return the handles of bodies that have a friction record, by name."""
    out = {}
    for name in names:
        body = model.body(name)
        view = dry_friction.FrictionView(model, body.id)
        joint = int(model.body_jntadr[body.id])
        joints = int(view["joints"])
        out[name] = BodyHandle(
            name=name,
            body_id=body.id,
            qpos_adr=int(model.jnt_qposadr[joint]),
            dof_adr=int(model.jnt_dofadr[joint]),
            push_adr=int(view["push_adr"]),
            joints=joints,
            rest_height_m=float(model.body_pos[body.id][2]),
        )
    return out
