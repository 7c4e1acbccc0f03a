"""Motions of planar bodies that nothing takes hold of but dry friction and pushes, without the engine around the law.

The law gives the velocity at the end of a step itself (`planar.step_planar`). Of MuJoCo's step there is then nothing
left but Euler's rule for the position, and its other stages, in which nothing happens, take three quarters of the time.
This is the same law, from the same numbers of the same models, and gives what `mujoco.rollout` gives, to rounding.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path

import mujoco
import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from runner.physics.dry_friction.planar import Engine, step_planar
from runner.physics.dry_friction.points import room_for
from runner.physics.dry_friction.record import COLUMN, MAGIC, PLANAR, STRIDE
from runner.storage.numba_cache import fingerprint

SOURCES = fingerprint(*Path(__file__).parent.glob("*.py"))  # see `binding`
MAGIC_AT, JOINTS, POINTS = COLUMN["magic"], COLUMN["joints"], COLUMN["points"]


def is_all_that_acts(model: mujoco.MjModel) -> bool:
    """Whether a model is one planar body that nothing but dry friction, dampers of its joints and pushes act on."""
    without = int(mujoco.mjtDisableBit.mjDSBL_CONTACT) | int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    return bool(
        model.nbody == 2
        and model.nv == PLANAR
        and model.nuser_body >= STRIDE
        and model.body_user[1, MAGIC_AT] == MAGIC
        and model.body_user[1, JOINTS] == PLANAR
        and model.opt.disableflags & without == without
        and model.opt.integrator == mujoco.mjtIntegrator.mjINT_EULER
        and not model.ntendon
        and not model.nu
        and not model.jnt_stiffness.any()
    )


def rollout(
    models: Sequence[mujoco.MjModel],
    start: NDArray[np.float64],
    controls: NDArray[np.float64],
    which: ArrayLike,
    threads: int = 1,
) -> NDArray[np.float64]:
    """Simulate many motions, each with a model and a start of its own.

    Args:
        models: One for each of R motions, of all of which friction `is_all_that_acts`, with steps of one length.
        start: Time, position (3), velocity (3) at the start, (R, 7).
        controls: What the engine's `userdata` is at each step, (C, n, USERDATA_SIZE).
        which: Which of those each motion has, (R,).
        threads: How many share the work.

    Returns:
        Position and velocity after each step, (R, n, 6).
    """
    # a model of many motions is looked into once: each view of its arrays takes some microseconds to make
    numbers = [np.empty((len(models), k)) for k in (models[0].nuser_body, 1, 3, 3, 4, 3, 3)]
    known: dict[int, int] = {}
    for i, m in enumerate(models):
        before = known.setdefault(id(m), i)
        if before != i:
            for array in numbers:
                array[i] = array[before]
            continue
        own = (m.body_user[1], m.body_mass[1], m.body_inertia[1], m.body_ipos[1], m.body_iquat[1], m.dof_damping)
        for array, value in zip(numbers, (*own, m.opt.gravity), strict=True):
            array[i] = value
    which = np.asarray(which, np.int64)
    out = np.empty((len(models), controls.shape[1], 6))
    simulate, step_s = _compiled(), float(models[0].opt.timestep)

    def part(some: slice) -> None:
        simulate(*(array[some] for array in numbers), step_s, start[some], controls, which[some], out[some])

    if threads == 1 or len(models) == 1:
        part(slice(None))
        return out
    edges = np.linspace(0, len(models), min(threads, len(models)) + 1).round().astype(int)
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(part, map(slice, edges[:-1], edges[1:])))
    return out


@cache
def _compiled():
    """Compile the loop over motions and steps; the sources stand in its closure, so that numba's cache follows them."""
    sources = SOURCES

    @njit(error_model="numpy", cache=True, nogil=True)
    def simulate(records, mass, inertia, ipos, iquat, damping, gravity, step_s, start, control, which, out):
        assert sources
        nothing, passive = np.zeros(6), np.zeros(3)
        qpos, qvel, user = np.empty(3), np.empty(3), np.empty(control.shape[2])
        for r in range(len(records)):
            time = start[r, 0]
            qpos[:], qvel[:] = start[r, 1:4], start[r, 4:7]
            room = room_for(int(records[r, POINTS]))
            for k in range(control.shape[1]):
                user[:] = control[which[r], k]
                for d in range(3):
                    passive[d] = -damping[r, d] * qvel[d]
                engine = Engine(
                    timestep=step_s,
                    gravity=gravity[r],
                    time=time,
                    body_mass=mass[r],
                    body_inertia=inertia[r],
                    body_ipos=ipos[r],
                    body_iquat=iquat[r],
                    dof_damping=damping[r],
                    qpos=qpos,
                    qvel=qvel,
                    xfrc_applied=nothing,
                    userdata=user,
                    qfrc_applied=nothing,
                    qfrc_passive=passive,
                )
                end, _, _ = step_planar(records[r], 0, 0, 0, engine, room)
                for d in range(3):
                    qvel[d] = end[d]
                    qpos[d] += step_s * end[d]
                    out[r, k, d], out[r, k, 3 + d] = qpos[d], qvel[d]
                time += step_s

    return simulate
