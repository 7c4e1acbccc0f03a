"""A push is a force at a point of the body, in every combination of freedom and floor contact."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
from drive import COMBINATIONS, STEP_S, pose, set_push, twist, wait
from scenes import ODD, each, moving

from runner.physics.scene import (
    Dof,
    FloorContact,
    Scene,
    push_columns,
)


def apply_force(scene: Scene, force: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Generalised force of a force at a point of the body, by MuJoCo, (nv,)."""
    body, data = scene.body("b0").body_id, scene.data
    place = data.xpos[body] + data.xmat[body].reshape(3, 3) @ point
    out = np.zeros(scene.model.nv)
    mujoco.mj_applyFT(scene.model, data, force, np.zeros(3), place, body, out)
    return out


@each(COMBINATIONS)
def test_push_is_a_force_at_a_point_of_the_body(dof: Dof, contact: FloorContact) -> None:
    """A push acts like `mj_applyFT` at the same point of the turned body, whose moment is about the true CoM."""
    force, point = np.array([4.0, -3.0, 2.5]), np.array([0.3, -0.2, 0.25])
    scene = moving(dof, contact, replace(ODD, friction=0.0))
    scene.data.qvel[:] = 0.0
    mujoco.mj_forward(scene.model, scene.data)
    without = scene.data.qfrc_smooth.copy()
    set_push(scene, force, point)
    mujoco.mj_forward(scene.model, scene.data)
    got = scene.data.qfrc_smooth - without
    np.testing.assert_allclose(got, apply_force(scene, force, point), atol=1e-4)


@each(COMBINATIONS)
def test_push_turns_with_the_body(dof: Dof, contact: FloorContact) -> None:
    """Over half a second of turning, the point goes with the body and the force keeps its direction in the world."""
    force, point = np.array([4.0, -3.0, 0.5]), np.array([0.3, -0.2, 0.25])
    body = replace(ODD, friction=0.0) if contact is FloorContact.patch else ODD
    pushed, applied = moving(dof, contact, body), moving(dof, contact, body)
    set_push(pushed, force, point)
    for _ in range(round(0.5 / STEP_S)):
        wait(pushed, STEP_S)
        mujoco.mj_kinematics(applied.model, applied.data)
        mujoco.mj_comPos(applied.model, applied.data)
        applied.data.qfrc_applied[:] = apply_force(applied, force, point)
        wait(applied, STEP_S)
    assert abs(twist(pushed)[5]) > 0.05
    np.testing.assert_allclose(pose(pushed), pose(applied), atol=1e-9)
    np.testing.assert_allclose(twist(pushed), twist(applied), atol=1e-8)


def test_push_columns_are_linear() -> None:
    """Columns hold the force and p x F^T; the mean of two commands is that of their columns."""
    columns = push_columns(np.array([[1.0, 2, 3], [3, 0, 1]]), np.array([4.0, 5, 6]))
    np.testing.assert_array_equal(columns[0], [1, 2, 3, 4, 8, 12, 5, 10, 15, 6, 12, 18])
    np.testing.assert_array_equal(push_columns([2, 1, 2], [4, 5, 6]), columns.mean(axis=0))
