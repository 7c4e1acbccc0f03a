"""Moves the bodies of a scene under pushes given as functions of time, for the tests of the physics."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from runner.physics import dry_friction
from runner.physics.scene import BodyConfig, Dof, FloorContact, Scene, SceneConfig, compile_scene, push_columns

G = 9.81
STEP_S = SceneConfig().timestep_s
COMBINATIONS = [
    (Dof.planar, FloorContact.patch),
    (Dof.planar, FloorContact.feet),
    (Dof.planar, FloorContact.corners),
    (Dof.free, FloorContact.feet),
    (Dof.free, FloorContact.corners),
]
# mean distance of a point of the unit square from its middle
SQUARE_RADIUS = (np.sqrt(2) + np.log(1 + np.sqrt(2))) / 6

Push = Callable[[float], tuple[np.ndarray, np.ndarray]]


def make(
    *bodies: BodyConfig,
    dof: Dof = Dof.planar,
    contact: FloorContact = FloorContact.patch,
    timestep_s: float = STEP_S,
    grid: int = 8,
    **record: Any,
) -> Scene:
    """Return a scene with bodies `b0`, `b1`, ... whose friction record has these values."""
    config = SceneConfig(dof=dof, contact=contact, timestep_s=timestep_s, grid=grid)
    scene = compile_scene(config, {f"b{i}": body for i, body in enumerate(bodies)})
    for name in scene.bodies:
        for key, value in record.items():
            scene.friction(name)[key] = value
    return scene


def set_push(scene: Scene, force_n: ArrayLike, point_m: ArrayLike = (0, 0, 0), name: str = "b0") -> None:
    """Push a body until told otherwise."""
    adr = scene.body(name).push_adr
    scene.data.userdata[adr : adr + dry_friction.PUSH_SIZE] = push_columns(force_n, point_m)


def outputs(scene: Scene, name: str = "b0") -> np.ndarray:
    """Return what friction said of a body in the last step, (OUT_SIZE,)."""
    adr = scene.body(name).push_adr + dry_friction.PUSH_SIZE
    return scene.data.userdata[adr : adr + dry_friction.OUT_SIZE].copy()


def wait(scene: Scene, time_s: float) -> None:
    """Step for this long."""
    mujoco.mj_step(scene.model, scene.data, round(time_s / scene.config.timestep_s))


def pose(scene: Scene, name: str = "b0") -> np.ndarray:
    """Return position and quaternion of a body, (7,)."""
    return scene.body(name).pose(scene.data.qpos)


def twist(scene: Scene, name: str = "b0") -> np.ndarray:
    """Return velocity and angular velocity of a body, world axes, (6,)."""
    return scene.body(name).twist(scene.data.qpos, scene.data.qvel)


def set_planar(scene: Scene, start: ArrayLike, name: str = "b0") -> None:
    """Write x, y, yaw, vx, vy, wz of a body that can't tip."""
    columns = scene.body(name).planar_columns()
    scene.data.qpos[list(columns[0])], scene.data.qvel[list(columns[1])] = np.split(np.asarray(start, float), 2)


@dataclass(frozen=True)
class Track:
    """A motion: times (T,), x, y, yaw and their rates (T, 6), and what friction said in each step (T - 1, OUT_SIZE).

    MuJoCo adds h v(end) to the position, so its positions lead by h v / 2, from the start on (`raw`). `state` has that
    taken off.
    """

    time_s: np.ndarray
    raw: np.ndarray
    out: np.ndarray

    @property
    def state(self) -> np.ndarray:
        """See the class."""
        state = self.raw.copy()
        state[:, :3] -= 0.5 * (self.time_s[1] - self.time_s[0]) * state[:, 3:]
        return state


def play(scene: Scene, duration_s: float, push: Push | None = None, start: ArrayLike = (0.0,) * 6) -> Track:
    """Move a body that can't tip from a state (6,); the push of each step is that of its middle."""
    h = scene.config.timestep_s
    n = round(duration_s / h)
    body = scene.body("b0")
    place, speed = np.split(np.asarray(start, float), 2)
    set_planar(scene, [*(place + 0.5 * h * speed), *speed])
    q, v = (list(c) for c in body.planar_columns())
    model, data = scene.model, scene.data
    raw, out = np.empty((n + 1, 6)), np.empty((n, dry_friction.OUT_SIZE))
    raw[0] = np.r_[data.qpos[q], data.qvel[v]]
    if push is not None:
        pushes = [push((i + 0.5) * h) for i in range(n)]
        columns = push_columns(np.array([p[0] for p in pushes]), np.array([p[1] for p in pushes]))
    else:
        columns = np.tile(data.userdata[body.push_adr : body.push_adr + dry_friction.PUSH_SIZE], (n, 1))
    first = body.push_adr + dry_friction.PUSH_SIZE
    for i in range(n):
        data.userdata[body.push_adr : first] = columns[i]
        mujoco.mj_step(model, data)
        raw[i + 1] = np.r_[data.qpos[q], data.qvel[v]]
        out[i] = data.userdata[first : first + dry_friction.OUT_SIZE]
    return Track(np.arange(n + 1) * h, raw, out)
