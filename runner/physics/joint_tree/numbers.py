"""What is taken of a compiled model: its shape, which many share, and the numbers of each.

The numbers are MuJoCo's own, as effects have left them, in tables with a row for each body, joint, actuator and tendon.
All joints have one degree of freedom, so that joint, coordinate and degree of freedom have one number.
"""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np

from runner.numerics.arrays import FloatArray
from runner.physics.joint_law.record import SIZE
from runner.physics.passive import SECOND_ORDER

MOST_JOINTS = 16  # inertia is solved as a full matrix: of more, MuJoCo's sparse one is as fast
USER = 2  # numbers of an actuator, at the end of its `user` data: what its damping took off the armature; of which dof
_Disable = mujoco.mjtDisableBit
# what does not matter where nothing touches, and what tells how sensors are read or constraints are begun
INDIFFERENT = (
    _Disable.mjDSBL_CONTACT,
    _Disable.mjDSBL_EQUALITY,
    _Disable.mjDSBL_WARMSTART,
    _Disable.mjDSBL_FILTERPARENT,
    _Disable.mjDSBL_SENSOR,
    _Disable.mjDSBL_MIDPHASE,
    _Disable.mjDSBL_EULERDAMP,
    _Disable.mjDSBL_AUTORESET,
    _Disable.mjDSBL_NATIVECCD,
    _Disable.mjDSBL_ISLAND,
)
AXES = (int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE))
AT_JOINT = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
GAINS = (int(mujoco.mjtGain.mjGAIN_FIXED), int(mujoco.mjtGain.mjGAIN_AFFINE))
BIASES = (int(mujoco.mjtBias.mjBIAS_NONE), int(mujoco.mjtBias.mjBIAS_AFFINE))
WRAP_JOINT = int(mujoco.mjtWrap.mjWRAP_JOINT)


def _columns(**widths: int) -> tuple[dict[str, int], int]:
    """Return where in a table each of its entries begins, and how wide it is."""
    edges = [0, *np.cumsum(list(widths.values())).tolist()]
    return dict(zip(widths, edges[:-1], strict=True)), edges[-1]


BODY, _ = _columns(pos=3, turned=1, frame=9, mass=1, com=3, inertia=6, held=1)
JOINT, _ = _columns(
    anchor=3, axis=3, zero=1, stiffness=1, spring=1, limited=1, range=2, margin=1, solref=2, solimp=5,
    act_limited=1, act_range=2, armature=1, damping=1, friction=1, inverse=1, friction_solref=2, friction_solimp=5,
    law=SIZE,
)  # fmt: skip
ACTUATOR, _ = _columns(
    affine_gain=1, gain=3, affine_bias=1, bias=3, ctrl_limited=1, ctrl_range=2, force_limited=1, force_range=2, gear=1,
    taken=1,
)  # fmt: skip
# the coefficients of its joints follow
TENDON, TENDON_SIZE = _columns(
    stiffness=1, damping=1, spring=2, limited=1, range=2, margin=1, solref=2, solimp=5, inverse=1
)


class Shape(NamedTuple):
    """What models of one shape share: int64 arrays.

    parents: Of each body, (B,); 0 is the world.
    first: The first joint of each body, (B,), and `count`, how many it has.
    hinge: Whether a joint is one, or a slide, (V,).
    above: The joint that each is carried by, (V,); -1: none.
    driven: The joint that each actuator drives, (U,).
    carriers: The body that each joint moves, (V,).
    """

    parents: np.ndarray
    first: np.ndarray
    count: np.ndarray
    hinge: np.ndarray
    above: np.ndarray
    driven: np.ndarray
    carriers: np.ndarray


class Numbers(NamedTuple):
    """The numbers of a model, or of M of one shape: step and gravity, (4,), and tables, see `BODY` to `TENDON`."""

    head: FloatArray
    bodies: FloatArray
    joints: FloatArray
    actuators: FloatArray
    tendons: FloatArray


class Tree(NamedTuple):
    """A model that is a tree of joints, and no more."""

    shape: Shape
    numbers: Numbers


def tree_of(model: mujoco.MjModel) -> Tree | None:
    """Return what is to be stepped of a model; None: there is more to it than `is_all_that_acts` says."""
    return Tree(_shape(model), _numbers(model)) if is_all_that_acts(model) else None


def is_all_that_acts(model: mujoco.MjModel) -> bool:
    """Whether a model is hinges and slides, motors and servos on them, and springs between them: it touches nothing."""
    off = int(model.opt.disableflags)
    for bit in INDIFFERENT:
        off &= ~int(bit)
    return bool(
        0 < model.nv <= MOST_JOINTS
        and model.nv == model.nq == model.njnt
        and np.isin(model.jnt_type, AXES).all()
        and model.opt.integrator == mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        and model.opt.o_margin == SECOND_ORDER
        and model.opt.disableflags & int(_Disable.mjDSBL_CONTACT)
        and not off
        and not model.opt.enableflags
        and not (model.opt.density or model.opt.viscosity)
        and not (model.neq or model.nflex or model.nplugin or model.na or model.nmocap)
        and not model.jnt_actgravcomp.any()
        and not (model.jnt_stiffnesspoly.any() or model.dof_dampingpoly.any())
        and _are_plain_actuators(model)
        and _are_plain_tendons(model)
    )


def _are_plain_actuators(model: mujoco.MjModel) -> bool:
    return bool(
        np.isin(model.actuator_trntype, AT_JOINT).all()
        and np.isin(model.actuator_gaintype, GAINS).all()
        and np.isin(model.actuator_biastype, BIASES).all()
        and not (model.actuator_dyntype.any() or model.actuator_delay.any() or model.actuator_dampingpoly.any())
        and not (model.actuator_damping.any() or model.actuator_armature.any())
        and (model.actuator_ctrladr == np.arange(model.nu)).all()
    )


def _are_plain_tendons(model: mujoco.MjModel) -> bool:
    return bool(
        np.isin(model.wrap_type, WRAP_JOINT).all()
        and not (model.tendon_frictionloss.any() or model.tendon_armature.any() or model.tendon_actfrclimited.any())
        and not (model.tendon_stiffnesspoly.any() or model.tendon_dampingpoly.any())
    )


def _shape(model: mujoco.MjModel) -> Shape:
    each = (
        model.body_parentid,
        np.maximum(model.body_jntadr, 0),
        model.body_jntnum,
        model.jnt_type == AXES[1],
        model.dof_parentid,
        model.actuator_trnid[:, 0],
        model.jnt_bodyid,
    )
    return Shape(*(np.ascontiguousarray(a, np.int64) for a in each))


def _numbers(m: mujoco.MjModel) -> Numbers:
    frames, principal = _rotations(m.body_quat), _rotations(m.body_iquat)
    inertia = np.einsum("bik,bk,bjk->bij", principal, m.body_inertia, principal)
    upper = inertia[:, (0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)]
    laws = m.jnt_user[:, m.jnt_user.shape[1] - SIZE :]
    taken = m.actuator_user[:, -USER] if m.nu else np.empty(0)
    tendons = np.zeros((m.ntendon, m.nv))
    for t in range(m.ntendon):
        for w in range(m.tendon_adr[t], m.tendon_adr[t] + m.tendon_num[t]):
            tendons[t, m.wrap_objid[w]] += m.wrap_prm[w]
    return Numbers(
        np.hstack([m.opt.timestep, m.opt.gravity]),
        np.column_stack([
            m.body_pos, m.body_quat[:, 0] != 1.0, frames.reshape(-1, 9), m.body_mass, m.body_ipos, upper,
            m.body_gravcomp,
        ]),
        np.column_stack([
            m.jnt_pos, m.jnt_axis, m.qpos0, m.jnt_stiffness, m.qpos_spring, m.jnt_limited, m.jnt_range, m.jnt_margin,
            m.jnt_solref, m.jnt_solimp, m.jnt_actfrclimited, m.jnt_actfrcrange, m.dof_armature, m.dof_damping,
            m.dof_frictionloss, m.dof_invweight0, m.dof_solref, m.dof_solimp, laws,
        ]),
        np.column_stack([
            m.actuator_gaintype == GAINS[1], m.actuator_gainprm[:, :3], m.actuator_biastype == BIASES[1],
            m.actuator_biasprm[:, :3], m.actuator_ctrllimited, m.actuator_ctrlrange, m.actuator_forcelimited,
            m.actuator_forcerange, m.actuator_gear[:, 0], taken,
        ]),
        np.column_stack([
            m.tendon_stiffness, m.tendon_damping, m.tendon_lengthspring, m.tendon_limited, m.tendon_range,
            m.tendon_margin, m.tendon_solref_lim, m.tendon_solimp_lim, m.tendon_invweight0, tendons,
        ]),
    )  # fmt: skip


def _rotations(quaternions: np.ndarray) -> FloatArray:
    """Return the matrices of unit quaternions (B, 4), scalar first: (B, 3, 3)."""
    out = np.empty((len(quaternions), 9))
    for matrix, quaternion in zip(out, quaternions, strict=True):
        mujoco.mju_quat2Mat(matrix, quaternion)
    return out.reshape(-1, 3, 3)
