"""Mass, inertia and centre of mass of a body can be changed while it moves."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
from drive import COMBINATIONS, STEP_S, make, pose, set_push, twist, wait
from scenes import CUBE, INTEGRATION, ODD, each

from runner.physics.scene import (
    BodyConfig,
    Dof,
    FloorContact,
)

OTHER = replace(ODD, mass_kg=4.5, com_m=(-0.15, 0.1, -0.1), inertia_kg_m2=(0.7, 0.9, 1.1))


@each(COMBINATIONS)
def test_body_changed_while_running_moves_like_one_built_so(dof: Dof, contact: FloorContact) -> None:
    """After a change of mass, CoM and inertia in mid-motion, the motion is that of a body built so, to the bit."""
    changed, built = make(ODD, dof=dof, contact=contact), make(OTHER, dof=dof, contact=contact)
    for scene in (changed, built):
        scene.data.qvel[:2] = 0.6, 0.3
        set_push(scene, (3.0, 2.0, 0), (0.2, 0.1, -0.2))
    wait(changed, 0.2)
    before = changed.data.qpos.copy(), changed.data.qvel.copy()
    changed.set_inertial("b0", mass_kg=4.5, com_m=np.array(OTHER.com_m), inertia_kg_m2=np.array(OTHER.inertia))
    np.testing.assert_array_equal(changed.data.qpos, before[0])
    np.testing.assert_array_equal(changed.data.qvel, before[1])
    state = np.empty(mujoco.mj_stateSize(changed.model, INTEGRATION))
    mujoco.mj_getState(changed.model, changed.data, state, INTEGRATION)
    mujoco.mj_setState(built.model, built.data, state, INTEGRATION)
    for scene in (changed, built):
        wait(scene, 1.0)
    np.testing.assert_array_equal(changed.data.qpos, built.data.qpos)
    np.testing.assert_array_equal(changed.data.qvel, built.data.qvel)
    unchanged = make(ODD, dof=dof, contact=contact)
    mujoco.mj_setState(unchanged.model, unchanged.data, state, INTEGRATION)
    wait(unchanged, 1.0)
    assert np.abs(unchanged.data.qpos - built.data.qpos).max() > 1e-3


@each(COMBINATIONS)
def test_each_inertial_number_counts(dof: Dof, contact: FloorContact) -> None:
    """Mass alone, CoM alone or inertia alone changes the motion as F = m a and M = I alpha about the CoM say."""
    body = BodyConfig(3.0, 0.0, com_m=(0.1, 0.05, 0.0), inertia_kg_m2=(0.4, 0.4, 0.5))
    scene = make(body, dof=dof, contact=contact)
    rate = lambda: (twist(scene)[0], twist(scene)[1], twist(scene)[5])  # noqa: E731
    number = scene.body("b0").body_id
    for mass, com, inertia in (
        (3.0, (0.1, 0.05), 0.5),
        (6.0, (0.1, 0.05), 0.5),
        (6.0, (0, 0.2), 0.5),
        (6.0, (0, 0.2), 1),
    ):
        scene.set_inertial(
            "b0", mass_kg=mass, com_m=np.array([*com, 0.0]), inertia_kg_m2=np.array([0.6, 0.6, inertia]) if inertia == 1
            else None,
        )  # fmt: skip
        scene.data.qvel[:] = 0
        scene.data.qpos[scene.body("b0").qpos_adr :] = scene.model.qpos0
        scene.data.xfrc_applied[number] = [2.0, -1.0, 0, 0, 0, 0.3]
        wait(scene, STEP_S)
        turning = 0.3 / inertia
        want = (2 / mass + turning * com[1], -1 / mass - turning * com[0], turning)
        np.testing.assert_allclose(np.array(rate()) / STEP_S, want, atol=2e-3)


def test_changing_a_body_leaves_the_other_alone() -> None:
    """Two bodies in one scene do not touch, and a change of one is none of the other."""
    alone, both = make(CUBE), make(CUBE, ODD)
    both.set_inertial("b1", mass_kg=9.0)
    for scene in (alone, both):
        set_push(scene, (20.0, 3.0, 0), (0, 0.3, 0))
        wait(scene, 1.0)
    assert pose(alone)[0] > 0.1
    np.testing.assert_array_equal(pose(both), pose(alone))
    np.testing.assert_array_equal(pose(both, "b1"), [0, 0, 0.3, 1, 0, 0, 0])
