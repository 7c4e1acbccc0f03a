"""The shapes of a mechanism's bodies, for figures and logs."""

from __future__ import annotations

import mujoco
import numpy as np

from runner.numerics.arrays import FloatArray
from runner.systems.drawing import DrawnBody, Shape

VISIBLE_GROUPS = 3  # MuJoCo's viewer shows groups 0, 1 and 2
LINE_RADIUS = 0.01  # of a body without shapes, as a share of the model's extent
KINDS = {
    int(mujoco.mjtGeom.mjGEOM_BOX): "box",
    int(mujoco.mjtGeom.mjGEOM_SPHERE): "ellipsoid",
    int(mujoco.mjtGeom.mjGEOM_CYLINDER): "cylinder",
    int(mujoco.mjtGeom.mjGEOM_CAPSULE): "capsule",
    int(mujoco.mjtGeom.mjGEOM_ELLIPSOID): "ellipsoid",
    int(mujoco.mjtGeom.mjGEOM_MESH): "box",
}
SIZES = {"box": 3, "ellipsoid": 3, "cylinder": 2, "capsule": 2}


def drawn_bodies(model: mujoco.MjModel) -> tuple[DrawnBody, ...]:
    """Return the bodies that have a shape, those that don't as lines to the joints that follow."""
    out = []
    for body in range(1, model.nbody):
        shapes = [s for g in _geoms(model, body) if (s := _shape(model, g)) is not None]
        if not shapes:
            shapes = _lines(model, body)
        if shapes:
            out.append(DrawnBody(model.body(body).name, tuple(shapes)))
    return tuple(out)


def _geoms(model: mujoco.MjModel, body: int) -> list[int]:
    """Return the geoms of a body that a viewer shows; if it would show none, all."""
    first = int(model.body_geomadr[body])
    every = list(range(first, first + int(model.body_geomnum[body])))
    seen = [g for g in every if int(model.geom_group[g]) < VISIBLE_GROUPS and model.geom_rgba[g, 3] > 0]
    return seen or every


def _shape(model: mujoco.MjModel, geom: int) -> Shape | None:
    """Return a geom as a shape on its body; a mesh as the box around it, planes and height fields not at all."""
    kind = KINDS.get(int(model.geom_type[geom]))
    if kind is None:
        return None
    position, quaternion = np.array(model.geom_pos[geom]), np.array(model.geom_quat[geom])
    size = np.array(model.geom_size[geom])
    if int(model.geom_type[geom]) == int(mujoco.mjtGeom.mjGEOM_SPHERE):
        size = np.full(3, size[0])
    if int(model.geom_type[geom]) == int(mujoco.mjtGeom.mjGEOM_MESH):
        middle, size = np.array(model.geom_aabb[geom, :3]), np.array(model.geom_aabb[geom, 3:])
        shift = np.empty(3)
        mujoco.mju_rotVecQuat(shift, middle, quaternion)
        position = position + shift
    return _placed(kind, size[: SIZES[kind]], position, quaternion)


def _placed(kind: str, size: np.ndarray, position: np.ndarray, quaternion: np.ndarray) -> Shape:
    x, y, z = map(float, position)
    qw, qx, qy, qz = map(float, quaternion)
    return Shape(kind, tuple(map(float, size)), (x, y, z), (qw, qx, qy, qz))


def _lines(model: mujoco.MjModel, body: int) -> list[Shape]:
    """Return thin capsules from a body's origin to its children's, or to its centre of mass."""
    ends = [np.array(model.body_pos[b]) for b in range(1, model.nbody) if int(model.body_parentid[b]) == body]
    ends = ends or [np.array(model.body_ipos[body])]
    radius = LINE_RADIUS * max(float(model.stat.extent), 1e-3)
    out = []
    for end in ends:
        length = float(np.linalg.norm(end))
        if length > radius:
            quaternion = np.empty(4)
            mujoco.mju_quatZ2Vec(quaternion, end)
            out.append(_placed("capsule", np.array([radius, length / 2]), end / 2, quaternion))
    return out


def body_poses(model: mujoco.MjModel, positions: FloatArray) -> dict[str, FloatArray]:
    """Return the pose of each body that is drawn, x, y, z, qw, qx, qy, qz, (T, 7), at positions (T, nq)."""
    data = mujoco.MjData(model)
    poses = np.empty((len(positions), model.nbody, 7))
    for k, position in enumerate(positions):
        data.qpos[:] = position
        mujoco.mj_kinematics(model, data)
        poses[k, :, :3], poses[k, :, 3:] = data.xpos, data.xquat
    return {body.name: poses[:, model.body(body.name).id] for body in drawn_bodies(model)}
