"""A scene that can be stepped."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import mujoco
import numpy as np
from dm_control import mjcf

from runner.errors import ConfigError, nearest
from runner.physics import dry_friction
from runner.physics.scene.build import build
from runner.physics.scene.config import BodyConfig, SceneConfig
from runner.physics.scene.handle import BodyHandle, handles


@dataclass(frozen=True)
class Scene:
    """A compiled scene: dm-control's `physics`, its raw `model` and `data`, and the handles of its bodies."""

    config: SceneConfig
    physics: mjcf.Physics
    bodies: Mapping[str, BodyHandle]
    _scratch: mujoco.MjData = field(repr=False)

    @property
    def model(self) -> mujoco.MjModel:
        """The raw MuJoCo model."""
        return self.physics.model.ptr

    @property
    def data(self) -> mujoco.MjData:
        """The raw MuJoCo data."""
        return self.physics.data.ptr

    def body(self, name: str) -> BodyHandle:
        """Return the handle of a body.

        Raises:
            ConfigError: If there is none of that name.
        """
        if name not in self.bodies:
            raise ConfigError(f"no body '{name}' in the scene. {nearest(name, self.bodies)}")
        return self.bodies[name]

    def friction(self, name: str) -> dry_friction.FrictionView:
        """Return the friction record of a body."""
        return dry_friction.FrictionView(self.model, self.body(name).body_id)

    def set_inertial(
        self,
        name: str,
        *,
        mass_kg: float | None = None,
        com_m: np.ndarray | None = None,
        inertia_kg_m2: np.ndarray | None = None,
    ) -> None:
        """Change a body's mass, CoM (body axes, (3,)) or diagonal inertia (about the CoM, (3,)) while running."""
        set_inertial(
            self.model,
            self._scratch,
            self.body(name).body_id,
            mass_kg=mass_kg,
            com_m=com_m,
            inertia_kg_m2=inertia_kg_m2,
        )


def set_inertial(
    model: mujoco.MjModel,
    scratch: mujoco.MjData,
    body_id: int,
    *,
    mass_kg: float | None = None,
    com_m: np.ndarray | None = None,
    inertia_kg_m2: np.ndarray | None = None,
) -> None:
    """Write inertial properties and what MuJoCo derives from them.

    `mj_setConst` overwrites the state of the data it is given, hence the `scratch` data.
    """
    if mass_kg is not None:
        model.body_mass[body_id] = mass_kg
    if com_m is not None:
        model.body_ipos[body_id] = com_m
    if inertia_kg_m2 is not None:
        model.body_inertia[body_id] = inertia_kg_m2
    mujoco.mj_setConst(model, scratch)


def compile_scene(scene: SceneConfig, bodies: Mapping[str, BodyConfig]) -> Scene:
    """Build and compile a scene; `legacy_step` is off, so that a step is exactly MuJoCo's `mj_step`."""
    physics = mjcf.Physics.from_mjcf_model(build(scene, bodies))
    physics.legacy_step = False
    return Scene(scene, physics, handles(physics.model.ptr, list(bodies)), mujoco.MjData(physics.model.ptr))
