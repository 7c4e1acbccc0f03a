"""Copies of one body, each with its own parameters and state, stepped side by side by `mujoco.batch.Batch`.

A planar body under dry friction has five parameters that its motion depends on. They are handled as a vector x of
numbers of order one, in which steps and uncertainties compare:

    x = (log mass, com_x / half_x, com_y / half_y, log yaw inertia about the CoM, log friction)

A state is (x, y, yaw, vx, vy, wz) as MuJoCo holds it, so that a copy with the true parameters and state moves as the
remote does, bit by bit.
"""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
from mujoco.batch import Batch

from runner.errors import ConfigError
from runner.physics import dry_friction
from runner.physics.scene import BodyConfig, Dof, FloorContact, SceneConfig, build
from runner.teleop.parameters import PARAMETERS

LABELS = ("mass", "CoM x", "CoM y", "yaw inertia", "friction")
MASS, COM_X, COM_Y, INERTIA, FRICTION = range(5)
SIZE = len(PARAMETERS)
STATE = 6
_LOG = np.array([True, False, False, True, True])
# of the vector: what is beyond counts as at the bound, such as a CoM that is outside the base
_BOUND = np.array([14.0, 0.99, 0.99, 14.0, 14.0])
_LEAST_FRICTION = 1e-6  # its logarithm is needed
_AT_REST = 1e-10  # m/s, rad/s: below it, and unpushed, nothing moves any more
_BODY = "body"


def to_vector(body: BodyConfig) -> np.ndarray:
    """Return the parameters of a body as a vector, (5,)."""
    return from_values(
        np.array([body.mass_kg, *body.com_m[:2], body.inertia[2], max(body.friction, _LEAST_FRICTION)]),
        body.half_size_m,
    )


def from_values(values: np.ndarray, half_size_m: tuple[float, float, float]) -> np.ndarray:
    """Return the vector (..., 5) of physical values (..., 5) in the order of `PARAMETERS`."""
    scaled = values / _scale(half_size_m)
    return np.where(_LOG, np.log(np.where(_LOG, scaled, 1.0)), scaled)


def to_values(x: np.ndarray, half_size_m: tuple[float, float, float]) -> np.ndarray:
    """Return physical values (..., 5), SI units, in the order of `PARAMETERS`, from vectors (..., 5)."""
    return np.where(_LOG, np.exp(np.where(_LOG, x, 0.0)), x) * _scale(half_size_m)


def errors(x: np.ndarray, true_x: np.ndarray) -> np.ndarray:
    """Return errors (..., 5): relative for mass, inertia and friction; of the CoM as share of the half size."""
    return np.where(_LOG, np.expm1(np.where(_LOG, x - true_x, 0.0)), x - true_x)


def _scale(half_size_m: tuple[float, float, float]) -> np.ndarray:
    return np.array([1.0, half_size_m[0], half_size_m[1], 1.0, 1.0])


class Copies:
    """A planar body, as often as needed; nothing is remembered from one call to the next.

    Args:
        scene: Must be planar, with `contact=patch`.
        body: What is not in the vector: size, height of the CoM.
        threads: Of the batch.

    Raises:
        ConfigError: If the scene is another.
    """

    def __init__(self, scene: SceneConfig, body: BodyConfig, threads: int = 1) -> None:
        if scene.dof is not Dof.planar or scene.contact is not FloorContact.patch:
            raise ConfigError(
                "scene: estimating all parameters needs scene.dof=planar and scene.contact=patch, "
                f"got {scene.dof.value} and {scene.contact.value}."
            )
        self.scene, self.body, self.half_size_m = scene, body, body.half_size_m
        self.simulated_s = 0.0  # so much has been simulated, for benchmarks
        self._threads = threads
        # compiled with its CoM off the centre: else MuJoCo takes the two for the same, until a slow `mj_setConst`
        off = replace(body, com_m=(0.01 * body.half_size_m[0], 0.01 * body.half_size_m[1], body.com_m[2]))
        root = build(scene, {_BODY: off})
        self._model = mujoco.MjModel.from_xml_string(root.to_xml_string(), root.get_assets())
        self._body_id = self._model.body(_BODY).id
        self._capacity = 0

    def _reserve(self, count: int) -> None:
        if count <= self._capacity:
            return
        self._capacity = max(16, count)
        batch = Batch(self._model, self._capacity, self._threads)
        self._batch = batch
        self._q, self._v, self._user = (batch.bind(name) for name in ("qpos", "qvel", "userdata"))
        self._mass, self._ipos, self._inertia, self._record = (
            batch.expand(f"body_{name}")[:, self._body_id] for name in ("mass", "ipos", "inertia", "user")
        )

    def run(self, x: np.ndarray, state: np.ndarray, pushes: np.ndarray) -> np.ndarray:
        """Return the states (k, 6) after some physics steps.

        Args:
            x: Parameters, (k, 5).
            state: Where each starts, (k, 6).
            pushes: Over the steps, for all (n, 12) or for each (k, n, 12); see `scene.push_columns`.

        Raises:
            FloatingPointError: If a state is not finite.
        """
        k = len(x)
        self._reserve(k)
        values = to_values(np.clip(x, -_BOUND, _BOUND), self.half_size_m)
        self._mass[:k] = values[:, MASS]
        self._ipos[:k, :2] = values[:, COM_X : COM_Y + 1]
        # only the moment about the vertical moves a planar body
        self._inertia[:k] = values[:, INERTIA, None]
        self._record[:k, dry_friction.COLUMN["mu"]] = values[:, FRICTION]
        self._q[:k], self._v[:k] = state[:, :3], state[:, 3:]
        n = pushes.shape[-2]
        alike = pushes.ndim == 2
        differ = (np.diff(pushes, axis=-2) != 0).any(axis=-1 if alike else (0, -1))
        begins = [0, *(np.flatnonzero(differ) + 1).tolist()] if n else []
        ends = [*begins[1:], n] if n else []
        for begin, end in zip(begins, ends, strict=True):
            push = pushes[..., begin, :]
            pushed = push.any(axis=-1) | (np.abs(self._v[:k]) > _AT_REST).any(axis=-1)
            self._user[:k, : dry_friction.PUSH_SIZE] = push
            moving = np.flatnonzero(pushed)
            if len(moving):
                self._batch.step(moving, nstep=end - begin)
                self.simulated_s += len(moving) * (end - begin) * self.scene.timestep_s
        out = np.hstack([self._q[:k], self._v[:k]])
        if not np.isfinite(out).all():
            raise FloatingPointError("a copy of the body blew up")
        return out
