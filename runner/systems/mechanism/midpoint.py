"""What makes MuJoCo's steps second order where its own are first order: a passive force inside its step.

Three forces of a step are wrong by something proportional to its length h (`models` has the fourth, damping).

Forces that are quadratic in the velocities, Coriolis and centrifugal ones, are taken at the start of the step. They
belong to its middle, where the velocity is v + (h / 2) a, with the acceleration a of the step before (Adams and
Bashforth's second method for these forces alone).

Dry friction F of a joint that turns round within a step is taken as that of after the turn. Before the turn, a share
s = |v| / (h |a|) of the step, it acts the other way: its mean over the step is less by 2 F s. If the joint stops
instead of turning round, it is held for the rest of the step: also then, to this order, that force is right. F is the
limit that the law of joints has set, which may be far from `frictionloss` where a joint turns round.

Free bodies need the first of these as well. As an impact does to a velocity what goes on in no way, the acceleration
is the one that all but contacts gave.

A servo at the limit of its force has no damping, and MuJoCo gives it none. What was taken off the armature for it
(`models`) is given back as a force.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import mujoco
import numpy as np
from numba import carray, cfunc, types

from runner.physics import passive
from runner.physics.engine_memory import (
    BIG,
    DATA_BYTES,
    MODEL_BYTES,
    as_pointer,
    double,
    doubles,
    integer,
    load_engine,
    offset_of,
    offset_of_array,
)
from runner.physics.joint_law.binding import SOURCES, measured, row_of
from runner.physics.joint_law.law import turning, turns
from runner.physics.joint_tree.numbers import USER
from runner.physics.passive import FREE_BODIES, SECOND_ORDER
from runner.storage.numba_cache import fingerprint

_velocities = types.ExternalFunction("mj_comVel", types.void(types.uint64, types.uint64))
_inverse = types.ExternalFunction("mj_rne", types.void(types.uint64, types.uint64, types.int32, types.uint64))


class MidpointOffsets(NamedTuple):
    """Where this MuJoCo build keeps what is read and written: bytes from the start of mjModel or mjData."""

    nv: int
    timestep: int
    o_margin: int
    dof_frictionloss: int
    nu: int
    nuser_actuator: int
    actuator_user: int
    actuator_forcerange: int
    actuator_force: int
    qvel: int
    qacc_warmstart: int
    qacc_smooth: int
    qfrc_passive: int
    qfrc_constraint: int
    qfrc_bias: int
    qfrc_smooth: int
    rows: int  # this and the next three: as the law of joints finds them
    efc_type: int
    efc_id: int
    efc_frictionloss: int
    sources: int  # a fingerprint of the text that was compiled


def _measure() -> MidpointOffsets:
    # 23 degrees of freedom, of which there are as many as of nothing else
    slides = "".join(
        f'<body pos="{i} 0 0"><joint name="j{i}" type="slide" frictionloss="1"/><geom size=".1" mass="1"/></body>'
        for i in range(17)
    )
    motors = "".join(f'<motor joint="j{i % 17}"/>' for i in range(31))  # as many as of nothing else
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><size nuser_actuator="7919"/><option timestep="0.00123456789" o_margin="{SECOND_ORDER}"/>
        <worldbody>{slides}<body><freejoint/><geom size=".1"/></body></worldbody>
        <actuator>{motors}</actuator></mujoco>"""
    )
    data = mujoco.MjData(model)
    m, d, law = model._address, data._address, measured()

    def of_data(name: str) -> int:
        return offset_of_array(d, getattr(data, name), DATA_BYTES)

    return MidpointOffsets(
        nv=offset_of(m, 23, 400),
        nu=offset_of(m, 31, 400),
        nuser_actuator=offset_of(m, 7919, 4000),
        actuator_user=offset_of_array(m, model.actuator_user, MODEL_BYTES),
        actuator_forcerange=offset_of_array(m, model.actuator_forcerange, MODEL_BYTES),
        actuator_force=of_data("actuator_force"),
        timestep=offset_of(m, 0.00123456789, 4000),
        o_margin=offset_of(m, SECOND_ORDER, 4000),
        dof_frictionloss=offset_of_array(m, model.dof_frictionloss, MODEL_BYTES),
        qvel=of_data("qvel"),
        qacc_warmstart=of_data("qacc_warmstart"),
        qacc_smooth=of_data("qacc_smooth"),
        qfrc_passive=of_data("qfrc_passive"),
        qfrc_constraint=of_data("qfrc_constraint"),
        qfrc_bias=of_data("qfrc_bias"),
        qfrc_smooth=of_data("qfrc_smooth"),
        rows=law.rows,
        efc_type=law.efc_type,
        efc_id=law.efc_id,
        efc_frictionloss=law.efc_frictionloss,
        sources=SOURCES ^ fingerprint(__file__),
    )


def _compile(at: MidpointOffsets):
    """Compile the callback for these offsets. They stand in its closure, so that numba's cache tells builds apart."""

    @cfunc("void(uint64, uint64)", cache=True)
    def midpoint(m, d):
        free = double(m, at.o_margin) == FREE_BODIES
        if not free and double(m, at.o_margin) != SECOND_ORDER:
            return
        nv, step = integer(m, at.nv), double(m, at.timestep)
        v, a = doubles(d, at.qvel, BIG), doubles(d, at.qacc_warmstart, BIG)
        passive_force = doubles(d, at.qfrc_passive, BIG)
        dry, constraint = doubles(m, at.dof_frictionloss, BIG), doubles(d, at.qfrc_constraint, BIG)
        known = False  # the acceleration of the step before: a rollout's first has none
        for i in range(nv):
            known = known or a[i] != 0.0
        if not known:
            return
        for i in range(0 if free else nv):
            if dry[i] > 0.0 and turns(constraint[i], v[i], a[i], step):
                row = row_of(at.rows, at.efc_type, at.efc_id, d, i)
                limit = doubles(d, at.efc_frictionloss, BIG)[row] if row >= 0 else dry[i]
                passive_force[i] += turning(dry[i], limit, constraint[i], v[i], a[i], step)
        for k in range(0 if free else integer(m, at.nu)):
            given = doubles(m, at.actuator_user, BIG)[(k + 1) * integer(m, at.nuser_actuator) - USER :]
            if given[0] != 0.0:
                force, limits = doubles(d, at.actuator_force, BIG)[k], doubles(m, at.actuator_forcerange, BIG)
                if force <= limits[2 * k] or force >= limits[2 * k + 1]:
                    passive_force[int(given[1])] -= given[0] * a[int(given[1])]
        if nv > 1:
            # the step computes all of these anew after the callback: until then they serve as scratch
            shown, bias, later = (
                doubles(d, at.qacc_smooth, BIG),
                doubles(d, at.qfrc_bias, BIG),
                doubles(d, at.qfrc_smooth, BIG),
            )
            _inverse(m, d, 0, types.uint64(carray(as_pointer(types.uint64(d + at.qfrc_bias)), (1,), types.uint64)[0]))
            for i in range(nv):
                rate = shown[i] if free else a[i]
                shown[i] = v[i]
                v[i] += 0.5 * step * rate
            _velocities(m, d)
            _inverse(m, d, 0, types.uint64(carray(as_pointer(types.uint64(d + at.qfrc_smooth)), (1,), types.uint64)[0]))
            for i in range(nv):
                v[i] = shown[i]
                passive_force[i] -= later[i] - bias[i]
            _velocities(m, d)

    return midpoint


@functools.cache
def install() -> None:
    """Give the callback to MuJoCo, once per process. The first call on a machine compiles it (a second or two)."""
    load_engine()
    passive.install(_compile(_measure()))


def reserve(spec: mujoco.MjSpec) -> None:
    """Make room in a model that is yet to be compiled; for `user` data of the owner's, too."""
    own = max((len(actuator.userdata) for actuator in spec.actuators), default=0)
    spec.nuser_actuator = max(spec.nuser_actuator, own) + USER


def mark(model: mujoco.MjModel, taken: np.ndarray, *, free: bool) -> None:
    """Let a model's steps be made so; `free`: all of its joints are.

    Args:
        model: Compiled with the room that `reserve` makes.
        taken: What was taken off the armature of its joint for the damping of each actuator, (nu,).
    """
    model.opt.o_margin = FREE_BODIES if free else SECOND_ORDER
    for k in np.flatnonzero(taken):
        if model.actuator_forcelimited[k]:
            model.actuator_user[k, -USER:] = taken[k], model.jnt_dofadr[model.actuator_trnid[k, 0]]
