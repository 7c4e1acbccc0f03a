"""The same bits, however a scene is run; models of others are left alone."""

from __future__ import annotations

import threading
from dataclasses import replace

import mujoco
import numpy as np
from drive import COMBINATIONS, STEP_S, make, set_push, wait
from mujoco import rollout
from mujoco.batch import Batch
from scenes import CUBE, FULL, ODD, USERDATA, each

from runner.physics import dry_friction
from runner.physics.scene import (
    Dof,
    FloorContact,
    Scene,
    push_columns,
)


def run_in_rollout(scene: Scene, columns: np.ndarray, threads: int = 1) -> np.ndarray:
    """States of a scene from rest under pushes on `b0`, (n, nstate)."""
    model = scene.model
    data = [mujoco.MjData(model) for _ in range(threads)]
    state = np.empty(mujoco.mj_stateSize(model, FULL))
    mujoco.mj_getState(model, mujoco.MjData(model), state, FULL)
    control = np.zeros((threads, len(columns), model.nuserdata))
    control[:, :, : dry_friction.PUSH_SIZE] = columns
    states, _ = rollout.rollout(
        [model] * threads, data, np.tile(state, (threads, 1)), control, control_spec=USERDATA, chunk_size=1
    )
    for other in states[1:]:
        np.testing.assert_array_equal(other, states[0])
    return states[0]


@each(COMBINATIONS)
def test_all_ways_to_step_give_the_same_bits(dof: Dof, contact: FloorContact) -> None:
    """A loop of mj_step, Physics.step(n), mujoco.rollout and mujoco.batch.Batch agree bit for bit."""
    pushes = np.repeat(
        push_columns([[12, 4, 0], [-3, 14, 0], [0, 0, 0]], [[0, 0.3, -0.2], [0.2, 0, -0.1], [0, 0, 0]]), 40, 0
    )
    make_it = lambda: make(ODD, CUBE, dof=dof, contact=contact)  # noqa: E731
    loop = make_it()
    for push in pushes:
        loop.data.userdata[: dry_friction.PUSH_SIZE] = push
        mujoco.mj_step(loop.model, loop.data)
    want = np.r_[loop.data.time, loop.data.qpos, loop.data.qvel]
    assert np.abs(loop.data.qpos).max() > 0.02

    physics = make_it()
    for push in pushes[::40]:
        physics.data.userdata[: dry_friction.PUSH_SIZE] = push
        physics.physics.step(40)
    np.testing.assert_array_equal(np.r_[physics.data.time, physics.data.qpos, physics.data.qvel], want)

    np.testing.assert_array_equal(run_in_rollout(make_it(), pushes, 2)[-1, : len(want)], want)

    batch = Batch(make_it().model, 3, 2)
    for push in pushes[::40]:
        batch.bind("userdata")[:, : dry_friction.PUSH_SIZE] = push
        batch.step(nstep=40)
    for qpos, qvel in zip(batch.bind("qpos"), batch.bind("qvel"), strict=True):
        np.testing.assert_array_equal(np.r_[qpos, qvel], want[1:])


@each([(Dof.planar, FloorContact.patch), (Dof.free, FloorContact.corners)])
def test_batch_of_different_bodies(dof: Dof, contact: FloorContact) -> None:
    """In a batch with its own mass, inertia and friction per simulation, each moves like a model of its own."""
    bodies = [replace(CUBE, mass_kg=m, friction=mu) for m, mu in ((1.0, 0.2), (3.0, 0.5), (7.0, 0.3))]
    models = [make(b, dof=dof, contact=contact).model for b in bodies]
    batch = Batch(models[0], 3, 2)
    for name in ("body_mass", "body_inertia", "body_user", "pair_friction"):
        if getattr(models[0], name).size:
            batch.expand(name)[...] = [getattr(m, name) for m in models]
    batch.set_const()
    batch.bind("userdata")[:, : dry_friction.PUSH_SIZE] = push_columns([20, 5, 0], [0, 0.2, -0.3])
    batch.step(nstep=200)
    for body, qpos in zip(bodies, batch.bind("qpos"), strict=True):
        alone = make(body, dof=dof, contact=contact)
        set_push(alone, (20, 5, 0), (0, 0.2, -0.3))
        wait(alone, 200 * STEP_S)
        np.testing.assert_array_equal(qpos, alone.data.qpos)


FOREIGN = """<mujoco><size nuser_body="3" nuserdata="5"/><worldbody><body pos="0 0 1" user="1 2 3"><freejoint/>
<geom size=".1"/></body><body pos="1 0 1"><joint axis="0 1 0" damping=".1"/><geom size=".1" pos="0.3 0 0"/></body>
</worldbody></mujoco>"""


def test_models_without_a_record_are_left_alone() -> None:
    """A model of somebody else moves to the bit as without compiled friction; so does one that uses user data."""
    make(CUBE)
    callback = mujoco.get_mjcb_passive()
    ends = []
    for active in (callback, None):
        mujoco.set_mjcb_passive(active)
        model = mujoco.MjModel.from_xml_string(FOREIGN)
        data = mujoco.MjData(model)
        mujoco.mj_step(model, data, 200)
        ends.append(data.qpos.copy())
    mujoco.set_mjcb_passive(callback)
    np.testing.assert_array_equal(*ends)
    assert mujoco.get_mjcb_passive() is not None


def test_several_models_in_several_threads() -> None:
    """Two models that differ in friction and one without, stepped by threads at the same time: the bits of each."""
    pushes = np.tile(push_columns([19.0, 4.0, 0], [0, 0.3, 0.1]), (960, 1))
    scenes = [
        make(CUBE),
        make(ODD, stribeck=0.5, film=1.0, grid=5),
        make(ODD, dof=Dof.free, contact=FloorContact.corners),
    ]
    foreign = mujoco.MjModel.from_xml_string(FOREIGN)

    def run_foreign() -> np.ndarray:
        data = mujoco.MjData(foreign)
        mujoco.mj_step(foreign, data, 2000)
        return data.qpos.copy()

    tasks = [lambda s=s: run_in_rollout(s, pushes, 2) for s in scenes] + [run_foreign]
    alone = [task() for task in tasks]
    together: dict[int, np.ndarray] = {}

    def work(i: int) -> None:
        for _ in range(3):
            together[i] = tasks[i]()

    threads = [threading.Thread(target=work, args=(i,)) for i in range(len(tasks))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for i, want in enumerate(alone):
        np.testing.assert_array_equal(together[i], want)
    assert abs(alone[0][-1, 1] - alone[1][-1, 1]) > 1e-3


def test_installing_twice_keeps_one_law() -> None:
    """Friction is given to the engine once per process: a second scene does not compile or replace it."""
    make(CUBE)
    before = mujoco.get_mjcb_passive()
    dry_friction.install()
    make(ODD)
    assert mujoco.get_mjcb_passive() == before
