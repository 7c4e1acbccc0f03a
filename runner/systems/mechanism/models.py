"""Compiled models of a mechanism: as its owner believes it, with what recorded forces and sensors need, and effects.

Integration. MuJoCo steps a velocity first and then the position with the new velocity. Read as a leapfrog, in which
positions run half a step ahead, that is second order in time for forces that depend on the position. Forces
proportional to a velocity it takes at the end of the step (`implicitfast`), which is first order: the damping D of a
joint comes out as D (1 - h D / 2 M). Half of the step times D is therefore taken off the joint's armature: then
(M + h D / 2) (v' - v) = h (f - D v), the trapezoidal rule, which is second order (Crank & Nicolson 1947).

Dry friction. MuJoCo's is a soft constraint: with its default `solreffriction` a joint that should hold creeps, and one
that turns round passes through a viscous band of about `frictionloss` times 10 ms over the inertia. Its owner hardly
believes that. With `hard_friction` joints hold as hard as the step allows.

With `engine_steps` nothing of the first is done: MuJoCo integrates as it does by itself.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from runner.effects.base import Effects, in_stages
from runner.effects.mechanism import ActuatorDelay
from runner.effects.mechanism.base import MechanismEffect
from runner.numerics.arrays import FloatArray
from runner.physics import joint_law, joint_tree
from runner.physics.joint_tree import Tree
from runner.recording.model_form import MechanismRecording
from runner.recording.model_form_mapping import AFFINE_BIAS, AT_JOINT, ForceColumns
from runner.recording.model_form_mjcf import quiet
from runner.systems.mechanism import midpoint
from runner.systems.mechanism.coordinates import FREE, Coordinates

OWN = "runner:"  # what is added to a believed model bears names that begin so
KEPT_COMPILED = 256
KEPT_MODELS, KEPT_BYTES = 2048, 2e8  # of edited ones, whichever is less: a survey of all effects needs hundreds
HARD_S = 0.002  # a time constant of dry friction up to that means: none
HARD_IMPEDANCE = (0.995, 0.999, 0.001, 0.5, 2.0)  # `solimpfriction` of friction that holds: MuJoCo's allow up to 0.9999
LIGHTEST = 0.4  # at most this share of the inertia is taken off for the trapezoidal rule
AXES = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)  # what effects may give dry friction
RK4 = int(mujoco.mjtIntegrator.mjINT_RK4)
FRAME_SENSORS = {
    "position": mujoco.mjtSensor.mjSENS_FRAMEPOS,
    "orientation": mujoco.mjtSensor.mjSENS_FRAMEQUAT,
    "velocity": mujoco.mjtSensor.mjSENS_FRAMELINVEL,
    "angular_velocity": mujoco.mjtSensor.mjSENS_FRAMEANGVEL,
}
# a force at r in body axes is one at the origin and at the three unit points: (1 - x - y - z) o + x ex + y ey + z ez
CORNERS = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])


Signature = tuple[tuple[tuple[type, str | None], ...], tuple[int, ...]]


@dataclass(frozen=True)
class Compiled:
    """A model with the elements that structural effects add, holding the believed numbers otherwise.

    Args:
        spec: What it was compiled from.
        model: The model; not to be written to.
        coordinates: Of its joints.
        data: One per thread.
        signature: Models of one signature can be simulated together.
    """

    spec: mujoco.MjSpec
    model: mujoco.MjModel
    coordinates: Coordinates
    data: tuple[mujoco.MjData, ...]
    signature: Signature


def _signature(effects: Effects, model: mujoco.MjModel) -> Signature:
    """Return which structural effects there are, of what, and how large the model is: some add nothing at zero."""
    return (
        tuple((type(e), getattr(e, "target", None)) for e in effects if e.structural),
        (int(model.nq), int(model.nv), int(model.nbody), int(model.ntendon), int(model.neq)),
    )


class Models:
    """Compiles a recording's model with effects.

    Args:
        recording: The case.
        threads: How many rollouts run side by side.
        hard_friction: Whether joints' dry friction holds, whatever the MJCF's `solreffriction`.
        engine_steps: Whether MuJoCo's integrator is left as it is, first order in the step.
    """

    def __init__(
        self,
        recording: MechanismRecording,
        threads: int,
        *,
        hard_friction: bool = False,
        engine_steps: bool = False,
    ) -> None:
        self._recording, self.threads, self.hard_friction = recording, threads, hard_friction
        joint_law.install()
        midpoint.install()
        self._believed = recording.spec()
        step_s = self._believed.option.timestep
        self.believed_delays = tuple(
            ActuatorDelay(a.name, min(a.delay, a.nsample * step_s))  # too few samples shorten it
            for a in self._believed.actuators
            if a.delay > 0.0 and a.nsample > 0
        )
        self.folder = recording.model_path.parent
        self._compiled: dict[Effects, Compiled] = {}
        self._models: dict[tuple[Effects, float], tuple[mujoco.MjModel, Tree | None]] = {}
        self._contact_time_s: dict[Effects, float] = {}
        model = self.compiled(()).model
        self.file_step_s = float(model.opt.timestep)
        self._kept = max(16, min(KEPT_MODELS, int(KEPT_BYTES / max(model.nbuffer, 1))))
        self.leapfrog = not engine_steps and int(model.opt.integrator) != RK4
        self.believed_coordinates = self.compiled(()).coordinates
        self.qpos0 = np.array(model.qpos0)

    def spec(self, effects: Effects, *, instrumented: bool) -> mujoco.MjSpec:
        """Return the believed MJCF with the elements of structural effects, and with what is only needed here."""
        spec = self._believed.copy()
        if instrumented:
            for actuator in spec.actuators:
                # commands are delayed before they are sent, as a stretch may begin in the middle of an episode
                actuator.delay, actuator.nsample = 0.0, 0
            joint_law.reserve(spec)
            midpoint.reserve(spec)
            for body in spec.bodies[1:]:
                # else an edited mass or centre of mass is silently not used
                body.simple = 0
            for i, force in enumerate(self._recording.mapping.forces):
                _add_force(spec, i, force)
            for kind, body in frame_sensors(self._recording):
                spec.add_sensor(
                    name=f"{OWN}{kind}:{body}",
                    type=FRAME_SENSORS[kind],
                    objtype=mujoco.mjtObj.mjOBJ_XBODY,
                    objname=body,
                )
            for source in self._recording.mapping.sources:
                if source.kind == "actuator":
                    spec.add_sensor(
                        name=f"{OWN}force:{source.target}",
                        type=mujoco.mjtSensor.mjSENS_ACTUATORFRC,
                        objtype=mujoco.mjtObj.mjOBJ_ACTUATOR,
                        objname=source.target,
                    )
        for effect in mechanical(effects):
            if effect.structural:
                effect.edit_spec(spec)
        return spec

    def compiled(self, effects: Effects) -> Compiled:
        """Return the model with the elements of structural effects, compiled once for each set of them."""
        key = tuple(e.skeleton for e in mechanical(effects) if e.structural)
        if key not in self._compiled:
            if len(self._compiled) > KEPT_COMPILED:
                self._compiled.clear()
            with quiet():
                spec = self.spec(key, instrumented=True)
                model = spec.compile()
            signature = _signature(key, model)
            same = next((c for c in self._compiled.values() if c.signature == signature), None)
            data = same.data if same else tuple(mujoco.MjData(model) for _ in range(self.threads))
            self._compiled[key] = Compiled(spec, model, Coordinates(model), data, signature)
        return self._compiled[key]

    def edited(self, effects: Effects, step_s: float | None = None) -> mujoco.MjModel:
        """Return the model with these effects in it, as MuJoCo would take it from a file; None: with its own step."""
        base = self.compiled(effects)
        model = copy.copy(base.model)
        if step_s is not None:
            # some effects are written in another way where the step is long
            model.opt.timestep = step_s
        self.put_in(effects, model)
        mujoco.mj_setConst(model, base.data[0])
        return model

    def put_in(self, effects: Effects, model: mujoco.MjModel) -> None:
        """Write what effects change into a model that has the elements they add, and how dry friction is solved."""
        for effect in in_stages(mechanical(effects)):
            effect.edit_model(model)
        if self.hard_friction:
            harden(model)

    def hardened(self, effects: Effects) -> list[str]:
        """Return the joints of the file whose dry friction holds here, and creeps as the file has it."""
        if not self.hard_friction:
            return []
        own, model = self.compiled(()).model, self.edited(effects)
        names = [own.joint(j).name for j in range(own.njnt) if int(own.jnt_type[j]) in AXES]
        dofs = {name: int(model.joint(name).dofadr[0]) for name in names}
        soft = {name for name in names if own.dof_solref[int(own.joint(name).dofadr[0]), 0] > HARD_S}
        return [name for name in names if name in soft and model.dof_frictionloss[dofs[name]] > 0]

    def contact_time_s(self, effects: Effects) -> float:
        """Return the shortest time constant of a contact, infinite without any: steps must be at most half of it."""
        key = tuple(e for e in mechanical(effects) if type(e).edit_model is not MechanismEffect.edit_model)
        if key not in self._contact_time_s:
            if len(self._contact_time_s) > KEPT_COMPILED:
                self._contact_time_s.clear()
            # no effect lets geoms touch that the file keeps apart: that is known without a copy of the model
            apart = not can_touch(self.compiled(key).model)
            self._contact_time_s[key] = np.inf if apart else shortest_contact_s(self.edited(key))
        return self._contact_time_s[key]

    def model(self, effects: Effects, step_s: float) -> mujoco.MjModel:
        """Return the model with these effects in it, ready to be stepped by `step_s`; not to be written to."""
        return self.with_tree(effects, step_s)[0]

    def with_tree(self, effects: Effects, step_s: float) -> tuple[mujoco.MjModel, Tree | None]:
        """Return that model, and its numbers if it is a tree of joints and no more; see `joint_tree`."""
        key = effects, step_s
        if key not in self._models:
            if len(self._models) > self._kept:
                self._models.clear()
            model = self.edited(effects, step_s)
            _discretise(model, step_s, self.compiled(effects).data[0], leapfrog=self.leapfrog)
            self._models[key] = model, joint_tree.tree_of(model)
        return self._models[key]


def harden(model: mujoco.MjModel) -> None:
    """Let what dry friction joints have hold; see the module's docstring."""
    dry = model.dof_frictionloss > 0
    model.dof_solref[dry], model.dof_solimp[dry] = (HARD_S, 1.0), HARD_IMPEDANCE


def has_soft_friction(model: mujoco.MjModel) -> bool:
    """Whether dry friction that a joint has or may have is so soft that its owner may not have meant it."""
    may_have = np.array(model.dof_frictionloss > 0)
    may_have[model.jnt_dofadr[np.isin(model.jnt_type, AXES)]] = True
    return bool((model.dof_solref[may_have, 0] > HARD_S).any())


def mechanical(effects: Effects) -> Sequence[MechanismEffect]:
    """Return effects as what they are in a mechanism."""
    out: list[MechanismEffect] = []
    for effect in effects:
        if not isinstance(effect, MechanismEffect):
            raise TypeError(f"{type(effect).__name__} is no effect of a mechanism")
        out.append(effect)
    return out


def frame_sensors(recording: MechanismRecording) -> dict[tuple[str, str], None]:
    """Return which quantities of which bodies are measured, each once, in order."""
    return {(s.quantity, s.target): None for s in recording.mapping.sources if s.kind == "body"}


def force_actuators(index: int) -> list[str]:
    """Return the actuators that a recorded force acts through: 4 corners by 3 axes."""
    return [f"{OWN}force{index}:{corner}{axis}" for corner in range(4) for axis in "xyz"]


def force_weights(point: FloatArray, force: FloatArray) -> FloatArray:
    """Return what the actuators of a recorded force are commanded, (T, 12), for points and forces (T, 3)."""
    weight = np.concatenate([1.0 - point.sum(axis=1, keepdims=True), point], axis=1)
    return (weight[:, :, None] * force[:, None, :]).reshape(len(point), 12)


def _add_force(spec: mujoco.MjSpec, index: int, force: ForceColumns) -> None:
    """Add actuators that push a body along the world's axes, at its origin and at a unit along each of its axes."""
    body, names = spec.body(force.body), iter(force_actuators(index))
    world = f"{OWN}world{index}"
    spec.worldbody.add_site(name=world)
    for corner, position in enumerate(CORNERS):
        site = f"{OWN}corner{index}:{corner}"
        body.add_site(name=site, pos=position)
        for axis in range(3):
            gear = np.zeros(6)
            gear[axis] = 1.0
            actuator = spec.add_actuator(name=next(names), target=site, refsite=world, gear=gear)
            actuator.trntype = mujoco.mjtTrn.mjTRN_SITE
            actuator.set_to_motor()
            actuator.ctrllimited = actuator.forcelimited = False


def servo_damping(model: mujoco.MjModel) -> FloatArray:
    """Return the force per velocity of its joint that each actuator damps with, (nu,)."""
    out = np.zeros(model.nu)
    for i in range(model.nu):
        if int(model.actuator_trntype[i]) in AT_JOINT and int(model.actuator_biastype[i]) == AFFINE_BIAS:
            out[i] = max(-model.actuator_biasprm[i, 2] * model.actuator_gear[i, 0] ** 2, 0.0)
    return out


def _discretise(model: mujoco.MjModel, step_s: float, scratch: mujoco.MjData, *, leapfrog: bool) -> None:
    """Set what belongs to the step; see the module's docstring."""
    # a run that diverges must end there, not begin anew
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    time = model.dof_solref[:, 0]
    # dry friction that was meant to be hard is as hard as the step allows; faster than two steps is unstable
    time[(time > 0) & ((time < 2 * step_s) | (time <= HARD_S))] = 2 * step_s
    touching = can_touch(model)
    if not touching:
        # hardly a constraint is left, and what looks for more costs a fifth of a step
        model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT) | int(mujoco.mjtDisableBit.mjDSBL_ISLAND)
    if leapfrog:
        # what turns free bodies gyroscopically `implicitfast` takes at the end of the step, by its derivative
        kind = mujoco.mjtIntegrator.mjINT_EULER if _is_free(model) else mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        model.opt.integrator = int(kind)
        _balance_damping(model, step_s, touching=touching)
        mujoco.mj_setConst(model, scratch)


def _is_free(model: mujoco.MjModel) -> bool:
    """Whether all joints are free: of bodies that fly, and fall on what does not move."""
    return bool((model.jnt_type == FREE).all())


def _balance_damping(model: mujoco.MjModel, step_s: float, *, touching: bool) -> None:
    """Take half of the step times the damping off the armatures, and mark the model for `midpoint`."""
    servo = servo_damping(model)
    if touching:
        # at the limit of its force a servo has no damping, which only `midpoint` can make up for
        servo[np.array(model.actuator_forcelimited, bool)] = 0.0
    dof = [int(model.jnt_dofadr[model.actuator_trnid[i, 0]]) if servo[i] else 0 for i in range(model.nu)]
    damping = np.maximum(model.dof_damping, 0.0)
    np.add.at(damping, dof, servo)
    off = 0.5 * step_s * damping
    # a matrix M less a diagonal D is positive where the trace of M^-1 D is below 1
    lighter = off * model.dof_invweight0
    share = np.minimum(LIGHTEST / np.maximum(lighter, 1e-300), 1.0)
    share *= min(LIGHTEST / max(float(share @ lighter), 1e-300), 1.0)
    model.dof_armature -= share * off
    if _is_free(model) or not touching:
        # what an impact does to the velocity of a joint goes on in no way
        midpoint.mark(model, 0.5 * step_s * servo * share[dof], free=_is_free(model))


def shortest_contact_s(model: mujoco.MjModel) -> float:
    """Return the shortest time constant of a contact in a model, infinite without any."""
    if not can_touch(model):
        return np.inf
    times = np.concatenate([model.geom_solref[:, 0], model.pair_solref[:, 0]])
    return float(times[times > 0].min(initial=np.inf))


def can_touch(model: mujoco.MjModel) -> bool:
    """Whether any two geoms of a model may be in contact: those of one body, or of two that never part, can't be."""
    kinds, partners = np.array(model.geom_contype), np.array(model.geom_conaffinity)
    of = np.array(model.body_weldid)[model.geom_bodyid]
    apart = of[:, None] != of[None, :]
    return model.npair > 0 or model.nflex > 0 or bool((kinds[:, None] & partners[None, :])[apart].any())
