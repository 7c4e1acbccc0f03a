"""Pushes from rest on a hanging or standing body, simulated and measured."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
import scipy
from dm_control import mjcf
from mujoco import rollout

from runner.errors import check_range, check_vector
from runner.estimation.space.inertial import Inertial, write_inertial
from runner.physics.forces import Push, push_means
from runner.physics.scene import BodyConfig, SceneConfig, build, push_columns
from runner.studies.plumb_line import LIFT_M
from runner.systems.planar_box.simulator import FULL, USERDATA
from runner.teleop.experiment import REMOTE
from runner.teleop.link import NoiseConfig

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Part:
    """A box of the compound object: its half size, its centre in the object's frame, its density."""

    half_size_m: Vector
    centre_m: Vector
    density_kg_m3: float

    def __post_init__(self) -> None:
        check_vector("half_size_m", self.half_size_m, 3, unit="m", limit=100.0)
        for i, half in enumerate(self.half_size_m):
            check_range(f"half_size_m[{i}]", half, 0.0, 100.0, unit="m", lower_open=True)
        check_vector("centre_m", self.centre_m, 3, unit="m", limit=100.0)
        check_range("density_kg_m3", self.density_kg_m3, 0.0, 1e5, unit="kg/m3", lower_open=True)


@dataclass(frozen=True)
class Poke:
    """A push from rest: a force, world axes, at a point, body axes, for a time; hung from a point, None: standing."""

    force_n: Vector
    point_m: Vector
    push_s: float = 0.4
    hung_m: Vector | None = None

    def __post_init__(self) -> None:
        check_vector("force_n", self.force_n, 3, unit="N", limit=1e6)
        check_vector("point_m", self.point_m, 3, unit="m", limit=100.0)
        check_range("push_s", self.push_s, 1e-3, 100.0, unit="s")


HUNG = tuple(
    Poke(force, point, hung_m=hung)
    for hung, points in (
        ((0.5, 0.0, 0.0), ((0.0, 0.5, 0.0), (-0.5, 0.0, 0.0), (0.0, -0.5, 0.0))),
        ((0.0, 0.5, 0.0), ((0.0, 0.0, -0.5), (0.5, 0.0, 0.0), (-0.5, 0.0, 0.0))),
        ((0.0, 0.0, 0.5), ((0.0, 0.5, 0.0), (0.0, 0.0, -0.5), (0.5, 0.0, 0.0))),
    )
    for force, point in zip(((6.0, 0.0, 0.0), (0.0, 6.0, 0.0), (0.0, 0.0, 6.0)), points, strict=True)
)
# to test with, on the floor: at the height of the base and above, at an edge, at a corner
STANDING = {
    "low": Poke((35.0, 0.0, 0.0), (-0.5, 0.1, -0.45)),
    "middle": Poke((36.0, 0.0, 0.0), (-0.5, 0.0, 0.0)),
    "top": Poke((27.0, 0.0, 0.0), (-0.5, 0.0, 0.5)),
    "top, aside": Poke((0.0, 26.0, 0.0), (-0.3, -0.5, 0.5)),
    "top corner": Poke((-20.0, 20.0, 0.0), (0.5, -0.5, 0.5)),
}


def compound_mjcf(scene: SceneConfig, friction: float, half_size_m: Vector, parts: Sequence[Part]) -> mjcf.RootElement:
    """Return the MJCF of the compound object; MuJoCo makes its mass, centre and inertia of the geoms."""
    shell = BodyConfig(mass_kg=1.0, friction=friction, half_size_m=half_size_m)
    root = build(scene, {REMOTE: shell})
    body = root.find("body", REMOTE)
    body.inertial.remove()
    for geom in body.find_all("geom"):
        geom.mass = 0.0
    for i, part in enumerate(parts):
        body.add(
            "geom", name=f"part{i}", type="box", size=part.half_size_m, pos=part.centre_m, density=part.density_kg_m3,
            contype=0, conaffinity=0,
        )  # fmt: skip
    return root


class PokeSimulator:
    """Pushes from rest, simulated for any bodies, sampled at the update rate.

    Args:
        scene: Free, on corners or feet.
        root: Of a model with one body, whose inertial parameters are replaced; changed.
        pokes: One for each episode; all hung, or all standing.
        duration_s: Of each; the push begins after `lead_s`.
        rate_hz: Of the samples.
    """

    def __init__(
        self, scene: SceneConfig, root: mjcf.RootElement, pokes: Sequence[Poke], *, duration_s: float, lead_s: float,
        rate_hz: float,
    ) -> None:  # fmt: skip
        if pokes[0].hung_m is not None:
            root.find("body", REMOTE).pos = (0.0, 0.0, LIFT_M)
        for i, poke in enumerate(pokes):
            if poke.hung_m is not None:
                root.equality.add("connect", name=f"point{i}", body1=REMOTE, anchor=poke.hung_m, active="false")
        self.model = mujoco.MjModel.from_xml_string(root.to_xml_string(), root.get_assets())
        self.body_id = self.model.body(REMOTE).id
        self._data, self._scratch = mujoco.MjData(self.model), mujoco.MjData(self.model)
        self._every = round(1 / rate_hz / scene.timestep_s)
        steps = round(duration_s * rate_hz) * self._every
        times = np.arange(steps) * scene.timestep_s
        self.control = np.zeros((len(pokes), steps, self.model.nuserdata))
        for row, poke in zip(self.control, pokes, strict=True):
            force, point = push_means(
                [Push(lead_s, lead_s + poke.push_s, poke.force_n, poke.point_m)], times, scene.timestep_s
            )
            columns = push_columns(force, point)
            row[:, : columns.shape[1]] = columns
        self.simulated_s = 0.0

    def run(self, bodies: Sequence[Inertial]) -> np.ndarray:
        """Return positions (x, y, z, quaternion) and velocities of all episodes, (len(bodies), episodes, n, 13)."""
        models = []
        episodes, steps, _ = self.control.shape
        for body in bodies:
            model = copy.copy(self.model)
            write_inertial(model, self._scratch, self.body_id, body)
            for k in range(episodes):
                one = copy.copy(model) if model.neq else model
                one.eq_active0[k : k + 1] = True
                models.append(one)
        start = np.empty(mujoco.mj_stateSize(self.model, FULL))
        mujoco.mj_resetData(self.model, self._data)
        mujoco.mj_getState(self.model, self._data, start, FULL)
        states, _ = rollout.rollout(
            models,
            self._data,
            np.tile(start, (len(models), 1)),
            np.tile(self.control, (len(bodies), 1, 1)),
            control_spec=USERDATA,
        )
        self.simulated_s += len(models) * steps * self.model.opt.timestep
        sampled = states[:, self._every - 1 :: self._every, 1:14]
        return sampled.reshape(len(bodies), episodes, -1, 13)


def differences(motion: np.ndarray, measured: np.ndarray) -> np.ndarray:
    """Return motion less measurement, (..., 12): position, turning (body axes), velocity, angular velocity."""
    turn = _rotation(np.broadcast_to(measured, motion.shape)).inv() * _rotation(motion)
    angle = turn.as_rotvec().reshape(*motion.shape[:-1], 3)
    moved, faster = motion[..., :3] - measured[..., :3], motion[..., 7:] - measured[..., 7:]
    return np.concatenate([moved, angle, faster], axis=-1)


def _rotation(motion: np.ndarray) -> scipy.spatial.transform.Rotation:
    return scipy.spatial.transform.Rotation.from_quat(motion[..., 3:7].reshape(-1, 4), scalar_first=True)


def with_noise(motion: np.ndarray, noise: NoiseConfig, rng: np.random.Generator) -> np.ndarray:
    """Return measurements of motions (..., 13) with noise."""
    draw = noise.draws(motion[..., 0].size, 3, 3, rng).reshape(*motion.shape[:-1], 12)
    out = motion.copy()
    out[..., :3] += draw[..., :3]
    turned = _rotation(motion) * scipy.spatial.transform.Rotation.from_rotvec(draw[..., 3:6].reshape(-1, 3))
    out[..., 3:7] = turned.as_quat(scalar_first=True).reshape(*motion.shape[:-1], 4)
    out[..., 7:] += draw[..., 6:]
    return out
