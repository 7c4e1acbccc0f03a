"""Bodies and scenes for the tests of the scene, in every combination of freedom and floor contact."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest
from drive import COMBINATIONS, STEP_S, make, set_planar, wait

from runner.physics.scene import (
    BodyConfig,
    Dof,
    FloorContact,
    Scene,
)

CUBE = BodyConfig(mass_kg=3.0, friction=0.5)
ODD = BodyConfig(2.0, 0.4, half_size_m=(0.5, 0.4, 0.3), com_m=(0.1, -0.07, 0.05), inertia_kg_m2=(0.3, 0.35, 0.45))
NATIVE = COMBINATIONS[1:]
FULL = mujoco.mjtState.mjSTATE_FULLPHYSICS.value
INTEGRATION = mujoco.mjtState.mjSTATE_INTEGRATION.value
USERDATA = mujoco.mjtState.mjSTATE_USERDATA.value


def each(combinations: list[tuple[Dof, FloorContact]]) -> pytest.MarkDecorator:
    names = [f"{dof.name}-{contact.name}" for dof, contact in combinations]
    return pytest.mark.parametrize(("dof", "contact"), combinations, ids=names)


def towards(angle_rad: float, size: float) -> np.ndarray:
    return size * np.array([math.cos(angle_rad), math.sin(angle_rad), 0.0])


def settled(dof: Dof, contact: FloorContact, body: BodyConfig = CUBE, timestep_s: float = STEP_S) -> Scene:
    scene = make(body, dof=dof, contact=contact, timestep_s=timestep_s)
    wait(scene, 0.2)
    return scene


def height(dof: Dof, body: BodyConfig) -> float:
    """Where to push: level with the CoM; a body that can tip at the floor, or it would."""
    return -body.half_size_m[2] if dof is Dof.free else 0.0


def moving(dof: Dof, contact: FloorContact, body: BodyConfig = ODD) -> Scene:
    """A body in the middle of a motion, turned, off the origin."""
    scene = make(body, dof=dof, contact=contact)
    if dof is Dof.free:
        scene.data.qpos[:] = [0.3, -0.2, 1.0, *(np.array([0.8, 0.3, -0.2, 0.4]) / np.sqrt(0.93))]
        scene.data.qvel[:] = [0.4, 0.2, -0.3, 1.0, -2.0, 1.5]
    else:
        set_planar(scene, (0.3, -0.2, 0.8, 0.5, -0.4, 2.0))
    mujoco.mj_forward(scene.model, scene.data)
    return scene
