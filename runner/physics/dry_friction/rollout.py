"""Motions of planar bodies that nothing takes hold of but dry friction and pushes, without the engine around the law.

The law gives the velocity at the end of a step itself (`planar.step_planar`). Of MuJoCo's step there is then nothing
left but Euler's rule for the position, and its other stages, in which nothing happens, take three quarters of the time.
This is the same law, from the same numbers of the same models, and gives what `mujoco.rollout` gives, to rounding.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from pathlib import Path

import mujoco
import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from runner.physics import borrowed as borrowing
from runner.physics.borrowed import borrowed
from runner.physics.dry_friction.planar import Engine, step_planar
from runner.physics.dry_friction.points import room_for
from runner.physics.dry_friction.record import COLUMN, MAGIC, OUT_PIN, PLANAR, PUSH_SIZE, STRIDE
from runner.physics.threads import shared
from runner.storage.numba_cache import fingerprint

SOURCES = fingerprint(borrowing.__file__, *Path(__file__).parent.glob("*.py"))  # see `binding`
MAGIC_AT, JOINTS, POINTS, PUSH_ADR = COLUMN["magic"], COLUMN["joints"], COLUMN["points"], COLUMN["push_adr"]
STATE, STATE_AND_PIN = 6, 8  # numbers after each step: position and velocity; and the force of a pin
OWN = 15  # what a motion keeps besides the push: no applied forces (6), those of dampers, position, velocity


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
    controls: NDArray[np.float64],
    start: NDArray[np.float64],
    of: tuple[ArrayLike, ArrayLike],
    threads: int = 1,
    *,
    columns: int = STATE,
) -> NDArray[np.float64]:
    """Simulate many motions, each with a start of its own.

    Args:
        models: Of all of which friction `is_all_that_acts`, with steps of one length.
        controls: What the engine's `userdata` is at each step, (C, n, USERDATA_SIZE).
        start: Time, position (3), velocity (3) at the start of each of R motions, (R, 7).
        of: Which of the models, and which of the controls, each motion has, (R,) each.
        threads: How many share the work.
        columns: Of the answer, `STATE` or `STATE_AND_PIN`.

    Returns:
        Position and velocity after each step, and with `STATE_AND_PIN` the force of a pin on the body during it,
        (R, n, columns).
    """
    numbers = [np.stack(each) for each in zip(*map(_numbers, models), strict=True)]
    of_models, of_controls = (np.asarray(which, np.int64) for which in of)
    # arrays that are laid out in another way would be compiled for anew
    controls, start = np.ascontiguousarray(controls), np.ascontiguousarray(start)
    out = np.empty((len(start), controls.shape[1], columns))
    simulate, step_s = _compiled(), float(models[0].opt.timestep)
    most = int(numbers[0][:, POINTS].max())

    def part(some: slice) -> None:
        memory = room_for(most), np.zeros(OWN + controls.shape[2])
        simulate(tuple(numbers), step_s, controls, start[some], of_models[some], of_controls[some], *memory, out[some])

    shared(part, len(start), threads)
    return out


def _numbers(model: mujoco.MjModel) -> tuple[NDArray[np.float64], ...]:
    """Return what the law takes of a model: record, mass, inertia, its place and axes, dampers, gravity."""
    own = model.body_user[1], model.body_mass[1:], model.body_inertia[1], model.body_ipos[1], model.body_iquat[1]
    return (*own, model.dof_damping, model.opt.gravity)


@cache
def _compiled():
    """Compile the loop over motions and steps; the sources stand in its closure, so that numba's cache follows them."""
    sources = SOURCES

    @njit(error_model="numpy", cache=True, nogil=True)
    def simulate(numbers, step_s, controls, start, of_models, of_controls, room, own, out):
        assert sources
        records, mass, inertia, ipos, iquat, damping, gravity = numbers
        records, mass, inertia, ipos = borrowed(records), borrowed(mass), borrowed(inertia), borrowed(ipos)
        iquat, damping, gravity, room = borrowed(iquat), borrowed(damping), borrowed(gravity), borrowed(room)
        own = borrowed(own)
        nothing, passive, qpos, qvel, user = own[:6], own[6:9], own[9:12], own[12:15], own[15:]
        for r in range(len(start)):
            m, control, time = of_models[r], controls[of_controls[r]], start[r, 0]
            qpos[:], qvel[:] = start[r, 1:4], start[r, 4:7]
            for k in range(len(control)):
                user[:] = control[k]
                for d in range(3):
                    passive[d] = -damping[m, d] * qvel[d]
                engine = Engine(
                    timestep=step_s,
                    gravity=gravity[m],
                    time=time,
                    body_mass=mass[m],
                    body_inertia=inertia[m],
                    body_ipos=ipos[m],
                    body_iquat=iquat[m],
                    dof_damping=damping[m],
                    qpos=qpos,
                    qvel=qvel,
                    xfrc_applied=nothing,
                    userdata=user,
                    qfrc_applied=nothing,
                    qfrc_passive=passive,
                )
                end, _, _ = step_planar(records[m], 0, 0, 0, engine, room)
                for d in range(3):
                    qvel[d] = end[d]
                    qpos[d] += step_s * end[d]
                    out[r, k, d], out[r, k, 3 + d] = qpos[d], qvel[d]
                if out.shape[2] == STATE_AND_PIN:
                    pin = int(records[m, PUSH_ADR]) + PUSH_SIZE + OUT_PIN
                    out[r, k, 6], out[r, k, 7] = user[pin], user[pin + 1]
                time += step_s

    return simulate
