"""Handles of a scene's bodies, and settings that are refused."""

from __future__ import annotations

import math
from collections.abc import Callable

import mujoco
import numpy as np
import pytest
from drive import COMBINATIONS, make, pose, twist, wait
from scenes import CUBE, ODD, each

from runner.errors import ConfigError
from runner.physics import dry_friction
from runner.physics.scene import (
    BodyConfig,
    Dof,
    FloorContact,
    SceneConfig,
    box_inertia,
    check_inertia,
    rotate,
)


@each(COMBINATIONS)
def test_handles_say_where_a_body_is(dof: Dof, contact: FloorContact) -> None:
    """Pose and velocity of a body, by its handle, are those of MuJoCo; the second body has its own places."""
    scene = make(CUBE, ODD, dof=dof, contact=contact)
    rng = np.random.default_rng(1)
    data = scene.data
    data.qvel[:] = rng.normal(size=scene.model.nv)
    wait(scene, 0.05)
    mujoco.mj_forward(scene.model, data)
    velocity = np.zeros(6)
    for name in ("b0", "b1"):
        body = scene.body(name)
        np.testing.assert_allclose(pose(scene, name)[:3], data.xpos[body.body_id], atol=1e-12)
        np.testing.assert_allclose(pose(scene, name)[3:], data.xquat[body.body_id], atol=1e-12)
        mujoco.mj_objectVelocity(scene.model, data, mujoco.mjtObj.mjOBJ_XBODY, body.body_id, velocity, 0)
        np.testing.assert_allclose(twist(scene, name), [*velocity[3:], *velocity[:3]], atol=1e-12)
    assert scene.body("b1").push_adr == dry_friction.USERDATA_SIZE
    assert (scene.body("b0").nq, scene.body("b0").nv) == ((7, 6) if dof is Dof.free else (scene.body("b0").joints,) * 2)
    many = np.stack([data.qpos, data.qpos * 0 + scene.model.qpos0])
    np.testing.assert_array_equal(scene.body("b0").pose(many)[0], pose(scene))


def test_rotate_turns_like_mujoco() -> None:
    """Vectors turn by quaternions as in MuJoCo."""
    rng = np.random.default_rng(2)
    quaternions = rng.normal(size=(5, 4))
    quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
    vectors, want = rng.normal(size=(5, 3)), np.empty(3)
    for q, v, got in zip(quaternions, vectors, rotate(quaternions, vectors), strict=True):
        mujoco.mju_rotVecQuat(want, v, q)
        np.testing.assert_allclose(got, want, atol=1e-12)


def test_box_inertia_is_that_of_mujoco() -> None:
    """A uniform box has the inertia that MuJoCo gives to its geom."""
    half = (0.5, 0.2, 0.1)
    xml = f'<mujoco><worldbody><body><freejoint/><geom type="box" size="{half[0]} {half[1]} {half[2]}" mass="3"/>'
    model = mujoco.MjModel.from_xml_string(xml + "</body></worldbody></mujoco>")
    np.testing.assert_allclose(sorted(box_inertia(3.0, half)), sorted(model.body_inertia[1]))


@pytest.mark.parametrize(
    ("build_it", "message"),
    [
        (lambda: SceneConfig(timestep_s=0.5), r"scene\.timestep_s: .*\[1e-05, 0\.02\] s, got 0\.5"),
        (lambda: SceneConfig(dof=Dof.free), r"scene\.contact: 'patch' .* choose 'corners' or 'feet'"),
        (lambda: SceneConfig(grid=1), r"scene\.grid: .* \[2, 16\], got 1"),
        (lambda: SceneConfig(gravity_m_s2=math.nan), r"scene\.gravity_m_s2: .* got nan"),
        (lambda: BodyConfig(0.0, 0.5), r"mass_kg: .* \]0, 1e\+06\] kg, got 0\.0"),
        (lambda: BodyConfig(1.0, -0.1), r"friction: .* \[0, 10\], got -0\.1"),
        (lambda: BodyConfig(1.0, 0.5, com_m=(0.6, 0, 0)), r"com_m\[0\]: .*\(inside the body\), got 0\.6"),
        (lambda: BodyConfig(1.0, 0.5, inertia_kg_m2=(1.0, 0.1, 0.1)), r"inertia_kg_m2: no body has these moments"),
        (lambda: check_inertia("remote.inertia", (1.0, -1.0, 1.0)), r"remote\.inertia\[1\]: .* got -1\.0"),
        (lambda: make(CUBE).body("bo"), r"no body 'bo' in the scene\. Valid: 'b0'\. Did you mean 'b0'\?"),
        (
            lambda: make(CUBE, dof=Dof.free, contact=FloorContact.feet).body("b0").planar_columns(),
            r"body 'b0' is free: its yaw follows from a quaternion",
        ),
    ],
)
def test_wrong_settings_are_refused(build_it: Callable[[], object], message: str) -> None:
    """A wrong setting is one line that names the key, the value and what is allowed."""
    with pytest.raises(ConfigError, match=message) as caught:
        build_it()
    assert "\n" not in str(caught.value)
