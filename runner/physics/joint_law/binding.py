"""The law of joints as MuJoCo's passive callback.

For a hinge or slide with velocity v, position q and the numbers of `record`, the law does two things.

It sets the limit of the joint's dry friction for this step,

    F = frictionloss (1 + excess exp(-(|v| / excess_speed)^excess_power)) + load_share * load
    load = |tau_drive - tau_load| / 2

in the rows of MuJoCo's own friction constraint, which exist since before the callback, and are solved after it: so
friction stays implicit, a joint truly sticks, and only its limit is that of the start of the step. The excess is
Stribeck's (Armstrong-Helouvry et al. 1994, eq. 5). The load is the torque that the gear passes on, taken as the mean of
what acts on its two sides, as in the load-dependent models of Duclusaud et al. 2025 (Rhoban/bam; they leave out the
half): the drive's actuators, against gravity, inertial forces other than the joint's own acceleration, springs and
applied forces on the load. A torque held at rest is a load of just that torque.

And it adds forces: a constant, the difference between directions, a ripple over position, a push for some time.
Friction that differs by direction, F (1 +- dry_difference / 2), is exactly the mean friction with a constant force of
-F dry_difference / 2, moving and at rest; the viscous difference is -1/2 viscous_difference damping |v|.

Both are taken at the start of the step, as MuJoCo takes all passive forces. In a model whose steps are to be of second
order (`passive.SECOND_ORDER`) the speed is that of the step's middle, v + (h / 2) a, with the acceleration a of the
step before: otherwise friction that falls with speed lags behind by half a step.

A row's limit is written from the model's `frictionloss`, so a second call of the step changes nothing. A joint without
a row (its `frictionloss` is zero) has no dry friction to change.
"""

from __future__ import annotations

import ctypes
import functools
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np
from numba import carray, cfunc, njit, types

from runner.physics import engine_memory, passive
from runner.physics.engine_memory import (
    BIG,
    DATA_BYTES,
    MODEL_BYTES,
    as_pointer,
    double,
    doubles,
    integer,
    ints,
    load_engine,
    offset_of,
    offset_of_array,
)
from runner.physics.joint_law.law import added, limit_at
from runner.physics.joint_law.record import COLUMN, MAGIC, SIZE
from runner.storage.numba_cache import fingerprint

LOAD_SHARE, DRIVE_AFTER = COLUMN["load_share"], COLUMN["drive_after"]
SECOND_ORDER = passive.SECOND_ORDER
FRICTION_OF_DOF = int(mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF)

# taken when this is imported: the files may be others by the time that something is compiled
SOURCES = fingerprint(engine_memory.__file__, passive.__file__, *Path(__file__).parent.glob("*.py"))

_actuation = types.ExternalFunction("mj_fwdActuation", types.void(types.uint64, types.uint64))
_inverse = types.ExternalFunction("mj_rne", types.void(types.uint64, types.uint64, types.int32, types.uint64))


class JointLawOffsets(NamedTuple):
    """Where this MuJoCo build keeps what the law reads and writes: bytes from the start of mjModel or mjData."""

    nuser_jnt: int
    njnt: int
    timestep: int
    jnt_user: int
    jnt_qposadr: int
    jnt_dofadr: int
    dof_frictionloss: int
    dof_damping: int
    time: int
    rows: int  # of equality and of friction, two int32
    qpos: int
    qvel: int
    o_margin: int
    qacc_warmstart: int
    qfrc_passive: int
    qfrc_applied: int
    qfrc_actuator: int
    qfrc_bias: int
    qfrc_spring: int
    qfrc_gravcomp: int
    efc_type: int
    efc_id: int
    efc_frictionloss: int
    map_efc2iefc: int
    iefc_frictionloss: int
    sources: int  # a fingerprint of the text that was compiled


@functools.cache
def measured() -> JointLawOffsets:
    """Return where this MuJoCo build keeps it, told from a model whose numbers and counts are like no others."""
    # 20 joints, of which there are as many as of nothing else
    slides = "".join(
        f"""<body pos="{i} 0 0"><joint name="j{i}" type="slide" frictionloss="1"/><joint type="slide" axis="1 0 0"/>
        <geom size=".1" mass="1"/></body>"""
        for i in range(9)
    )
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><size nuser_jnt="7919"/>
        <option timestep="0.00123456789" o_margin="{passive.SECOND_ORDER}"/><worldbody>{slides}
        <body><freejoint/><geom size=".1"/></body><body><joint type="ball"/><geom size=".1"/></body></worldbody>
        <equality><joint joint1="j0"/><joint joint1="j1"/><joint joint1="j2"/></equality>
        <actuator><general joint="j0" dyntype="integrator"/></actuator></mujoco>"""
    )
    data = mujoco.MjData(model)
    data.time = 0.00198765432101
    mujoco.mj_forward(model, data)
    m, d = model._address, data._address

    def of_model(name: str) -> int:
        return offset_of_array(m, getattr(model, name), MODEL_BYTES)

    def of_data(name: str) -> int:
        return offset_of_array(d, getattr(data, name), DATA_BYTES)

    return JointLawOffsets(
        nuser_jnt=offset_of(m, 7919, 4000),
        njnt=offset_of(m, 20, 400),
        timestep=offset_of(m, 0.00123456789, 4000),
        jnt_user=of_model("jnt_user"),
        jnt_qposadr=of_model("jnt_qposadr"),
        jnt_dofadr=of_model("jnt_dofadr"),
        dof_frictionloss=of_model("dof_frictionloss"),
        dof_damping=of_model("dof_damping"),
        time=offset_of(d, 0.00198765432101),
        rows=_of_ints(d, (data.ncon, data.ne, data.nf, data.nl, data.nefc)) + 4,
        qpos=of_data("qpos"),
        qvel=of_data("qvel"),
        o_margin=offset_of(m, passive.SECOND_ORDER, 4000),
        qacc_warmstart=of_data("qacc_warmstart"),
        qfrc_passive=of_data("qfrc_passive"),
        qfrc_applied=of_data("qfrc_applied"),
        qfrc_actuator=of_data("qfrc_actuator"),
        qfrc_bias=of_data("qfrc_bias"),
        qfrc_spring=of_data("qfrc_spring"),
        qfrc_gravcomp=of_data("qfrc_gravcomp"),
        efc_type=of_data("efc_type"),
        efc_id=of_data("efc_id"),
        efc_frictionloss=of_data("efc_frictionloss"),
        map_efc2iefc=of_data("map_efc2iefc"),
        iefc_frictionloss=of_data("iefc_frictionloss"),
        sources=SOURCES,
    )


def _of_ints(address: int, wanted: tuple[int, ...]) -> int:
    """Return where a struct holds these 32-bit ints in a row."""
    size = DATA_BYTES // ctypes.sizeof(ctypes.c_int32)
    raw = np.ctypeslib.as_array((ctypes.c_int32 * size).from_address(address))
    hits = np.flatnonzero(np.all([raw[i : size - len(wanted) + i] == w for i, w in enumerate(wanted)], axis=0))
    if len(hits) != 1:
        raise RuntimeError(f"mujoco {mujoco.__version__}: counts of constraints were not found; pin mujoco==3.17.0.")
    return 4 * int(hits[0])


@njit(error_model="numpy")
def row_of(rows, efc_type, efc_id, d, dof):
    """Return the row of a degree of freedom's dry friction in the step that is being made, -1 without one.

    Args:
        rows, efc_type, efc_id: Where these are kept, see `JointLawOffsets`.
        d: Address of mjData.
        dof: Number of the degree of freedom.
    """
    counts = carray(as_pointer(types.uint64(d + rows)), (2,), types.int32)
    kind, of = ints(d, efc_type, BIG), ints(d, efc_id, BIG)
    for row in range(counts[0], counts[0] + counts[1]):
        if kind[row] == FRICTION_OF_DOF and of[row] == dof:
            return row
    return -1


@njit(error_model="numpy")
def _bound_friction(at, d, dof, limit):
    """Set the limit of a degree of freedom's dry friction in the step that is being made."""
    row = row_of(at.rows, at.efc_type, at.efc_id, d, dof)
    if row >= 0:
        doubles(d, at.efc_frictionloss, BIG)[row] = limit
        # constraints of separate islands are solved from copies, which have been made by now
        if integer(d, at.map_efc2iefc) != 0:
            doubles(d, at.iefc_frictionloss, BIG)[ints(d, at.map_efc2iefc, BIG)[row]] = limit


@njit(error_model="numpy")
def _load(at, m, d, dof, drive):
    """Return the load on a joint's gear: mean of what acts on its two sides. Reads what `_evaluate` has computed."""
    against = doubles(d, at.qfrc_spring, BIG)[dof] + doubles(d, at.qfrc_gravcomp, BIG)[dof]
    against += doubles(d, at.qfrc_applied, BIG)[dof] - doubles(d, at.qfrc_bias, BIG)[dof]
    return 0.5 * abs(doubles(d, at.qfrc_actuator, BIG)[drive] - against)


@njit(error_model="numpy")
def _evaluate(at, m, d):
    """Compute forces of the actuators and of gravity and speed; the step does so again, after the callback."""
    _actuation(m, d)
    _inverse(m, d, 0, types.uint64(carray(as_pointer(types.uint64(d + at.qfrc_bias)), (1,), types.uint64)[0]))


def _compile(at: JointLawOffsets):
    """Compile the callback for these offsets. They stand in its closure, so that numba's cache tells builds apart."""

    @cfunc("void(uint64, uint64)", cache=True)
    def joint_law(m, d):
        nuser = integer(m, at.nuser_jnt)
        if nuser < SIZE:
            return
        evaluated = False
        users = doubles(m, at.jnt_user, BIG)
        for joint in range(integer(m, at.njnt)):
            record = users[(joint + 1) * nuser - SIZE : (joint + 1) * nuser]
            if record[0] != MAGIC:
                continue
            dof = ints(m, at.jnt_dofadr, BIG)[joint]
            q = doubles(d, at.qpos, BIG)[ints(m, at.jnt_qposadr, BIG)[joint]]
            v = doubles(d, at.qvel, BIG)[dof]
            if double(m, at.o_margin) == SECOND_ORDER:
                v += 0.5 * double(m, at.timestep) * doubles(d, at.qacc_warmstart, BIG)[dof]
            dry = doubles(m, at.dof_frictionloss, BIG)[dof]

            limit = limit_at(record, dry, v)
            if record[LOAD_SHARE] != 0.0:
                if not evaluated:
                    _evaluate(at, m, d)
                    evaluated = True
                limit += record[LOAD_SHARE] * _load(at, m, d, dof, dof + int(record[DRIVE_AFTER]))
            if limit != dry:
                _bound_friction(at, d, dof, limit)

            damping, step = doubles(m, at.dof_damping, BIG)[dof], double(m, at.timestep)
            force = added(record, dry, damping, q, v, double(d, at.time), step)
            doubles(d, at.qfrc_passive, BIG)[dof] += force

    return joint_law


@functools.cache
def install() -> None:
    """Give the law of joints to MuJoCo, once per process. The first call on a machine compiles it (a second or two)."""
    load_engine()
    passive.install(_compile(measured()))
