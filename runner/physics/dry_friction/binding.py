"""Dry friction as MuJoCo's `mjcb_passive`: compiled once, given to the engine once per process."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import NamedTuple

import mujoco
from numba import carray, cfunc, types

from runner.physics import borrowed as borrowing
from runner.physics import engine_memory, passive
from runner.physics.borrowed import borrowed
from runner.physics.dry_friction.planar import Engine, hand_over, step_planar
from runner.physics.dry_friction.points import room_for
from runner.physics.dry_friction.push import push_free, push_upright
from runner.physics.dry_friction.record import COLUMN, FREE, MAGIC, STRIDE, UPRIGHT
from runner.physics.engine_memory import as_pointer, double, doubles, integer, ints, offset_of
from runner.storage.numba_cache import fingerprint

JOINTS, POINTS = COLUMN["joints"], COLUMN["points"]

# taken when this is imported: the files may be others by the time that something is compiled
SOURCES = fingerprint(engine_memory.__file__, borrowing.__file__, *Path(__file__).parent.glob("*.py"))


class FrictionOffsets(NamedTuple):
    """Where this build of MuJoCo keeps what the callback reads, bytes from the start of `mjModel` or `mjData`."""

    nuser_body: int
    nbody: int
    timestep: int
    gravity: int
    time: int
    body_user: int
    body_mass: int
    body_inertia: int
    body_ipos: int
    body_iquat: int
    dof_damping: int
    body_dofadr: int
    body_jntadr: int
    jnt_qposadr: int
    qpos: int
    qvel: int
    xfrc_applied: int
    userdata: int
    qfrc_applied: int
    qfrc_passive: int
    sources: int  # no offset: `fingerprint` of the files that the callback is compiled from


def _measure() -> FrictionOffsets:
    """Find the fields in a model and its data that hold numbers which nothing else there has."""
    xml = (
        """<mujoco><size nuser_body="7919" nuserdata="6007"/><option timestep="0.00123456789"/><worldbody>
    """
        + 16 * """<body><joint type="slide"/><joint axis="0 1 0"/><geom size=".1"/></body>"""
        + "</worldbody></mujoco>"
    )
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    data.time = 0.00198765432101
    m, d = model._address, data._address

    def of_model(name: str) -> int:
        return offset_of(m, getattr(model, name).ctypes.data)

    def of_data(name: str) -> int:
        return offset_of(d, getattr(data, name).ctypes.data)

    return FrictionOffsets(
        nuser_body=offset_of(m, 7919, 4000),
        nbody=offset_of(m, 17, 4000),
        timestep=offset_of(m, 0.00123456789, 4000),
        gravity=model.opt.gravity.ctypes.data - m,
        time=offset_of(d, 0.00198765432101),
        body_user=of_model("body_user"),
        body_mass=of_model("body_mass"),
        body_inertia=of_model("body_inertia"),
        body_ipos=of_model("body_ipos"),
        body_iquat=of_model("body_iquat"),
        dof_damping=of_model("dof_damping"),
        body_dofadr=of_model("body_dofadr"),
        body_jntadr=of_model("body_jntadr"),
        jnt_qposadr=of_model("jnt_qposadr"),
        qpos=of_data("qpos"),
        qvel=of_data("qvel"),
        xfrc_applied=of_data("xfrc_applied"),
        userdata=of_data("userdata"),
        qfrc_applied=of_data("qfrc_applied"),
        qfrc_passive=of_data("qfrc_passive"),
        sources=SOURCES,
    )


def _compile(at: FrictionOffsets):
    """Compile the callback for these offsets. They stand in its closure, so that numba's cache tells builds apart."""

    @cfunc("void(uint64, uint64)", cache=True)
    def dry_friction(m, d):
        nuser = integer(m, at.nuser_body)
        if nuser < STRIDE:
            return
        big = 1 << 30
        records = doubles(m, at.body_user, big)
        for body in range(1, integer(m, at.nbody)):
            record = records[body * nuser : (body + 1) * nuser]
            if record[0] != MAGIC:
                continue
            dof = ints(m, at.body_dofadr, big)[body]
            qadr = ints(m, at.jnt_qposadr, big)[ints(m, at.body_jntadr, big)[body]]
            kind = record[JOINTS]
            qpos = doubles(d, at.qpos, big)
            user = doubles(d, at.userdata, big)
            passive = doubles(d, at.qfrc_passive, big)
            if kind == FREE:
                push_free(record, dof, qadr, qpos, user, passive)
            elif kind == UPRIGHT:
                push_upright(record, dof, qadr, qpos, user, passive)
            else:
                engine = Engine(
                    timestep=double(m, at.timestep),
                    gravity=carray(as_pointer(types.uint64(m + at.gravity)), (3,), types.float64),
                    time=double(d, at.time),
                    body_mass=doubles(m, at.body_mass, big),
                    body_inertia=doubles(m, at.body_inertia, big),
                    body_ipos=doubles(m, at.body_ipos, big),
                    body_iquat=doubles(m, at.body_iquat, big),
                    dof_damping=doubles(m, at.dof_damping, big),
                    qpos=qpos,
                    qvel=doubles(d, at.qvel, big),
                    xfrc_applied=doubles(d, at.xfrc_applied, big),
                    userdata=user,
                    qfrc_applied=doubles(d, at.qfrc_applied, big),
                    qfrc_passive=passive,
                )
                room = room_for(int(record[POINTS]))
                end, lever, inertia = step_planar(record, body, dof, qadr, engine, borrowed(room))
                hand_over(engine, body, dof, lever, inertia, end)
                room[0] = 0.0  # its last use: until here it is not given back

    return dry_friction


@functools.cache
def install() -> None:
    """Give dry friction to MuJoCo, once per process. The first call on a machine compiles it (some seconds)."""
    passive.install(_compile(_measure()))
