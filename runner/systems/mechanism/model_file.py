"""The corrected model as MJCF, and what plain MuJoCo needs besides for the law of joints."""

from __future__ import annotations

import copy
import shutil
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TypeGuard

import mujoco
import numpy as np

from runner.effects.base import AbstractEffect, Effects, corrected_here
from runner.effects.mechanism import Command, MechanismEffect
from runner.errors import ResultError
from runner.numerics.arrays import FloatArray
from runner.physics import joint_law
from runner.physics.joint_law import SIZE, JointLaw, written_law
from runner.recording.model_form_mjcf import quiet
from runner.storage.writing import own_folder, replacing, write_text
from runner.systems.mechanism.models import OWN, Models, shortest_contact_s
from runner.systems.mechanism.simulator import SHORTEST_STEP_S

MODEL = "model.xml"
LAW = "model.py"
DIGITS = 1e-5  # what MuJoCo writes is rounded to six digits
LOOK_S = 0.5  # so long both are simulated
DRIVE_HZ = 2.0
CONTACT = tuple(
    f"geom_{name}"
    for name in (
        "condim",
        "contype",
        "conaffinity",
        "priority",
        "friction",
        "solmix",
        "solref",
        "solimp",
        "margin",
        "gap",
    )
)


def write_model(models: Models, effects: Effects, folder: Path) -> tuple[str, ...]:
    """Write `model.xml` with the effects that MJCF can express, and return the names of the files.

    Friction and forces that MuJoCo's joints lack are numbers in `user`, for which `model.py` is written: `written_law`,
    a callback. Effects on commands and readings are not part of a model, but for what MuJoCo itself can do of them: a
    comment names those that are left out. What is off in the recording and not in the machine (a sensor, the clock) is
    left out too: who sets the recording right would correct it twice.

    Raises:
        ResultError: If what was written moves otherwise than the edited model.
    """
    inside = tuple(e for e in effects if expressible(models, e))
    by_law = needing_law(models, inside)
    with quiet():
        spec = models.spec(inside, instrumented=False)
        own = [list(joint.userdata) for joint in spec.joints]
        if by_law:
            joint_law.reserve(spec)
        model = spec.compile()
        models.put_in(inside, model)
        if models.contact_time_s(inside) < min(models.contact_time_s(()), 2 * model.opt.timestep):
            # MuJoCo softens contacts whose time constant is below two steps
            model.opt.timestep = max(0.5 * shortest_contact_s(model), SHORTEST_STEP_S)
        try:
            spec.copy_back(model)
        except ValueError as error:
            raise ResultError(f"{MODEL}: the corrected numbers can't be written: {error}") from None
        if by_law:
            _copy_law(spec, model, own)
        _copy_geoms(spec, model)
        written = tuple(e for e in effects if is_written(e))
        for effect in written:
            effect.edit_written(spec)
        text = spec.to_xml()
    late = [a for a in spec.actuators if a.delay > 0.0]
    left = left_out(models, effects)
    lines = [
        *([_of_left(left)] if left else []),
        *([_of_law(by_law)] if by_law else []),
        *([_of_delays(late)] if written and late else []),
        *corrected_here(e for e in effects if e not in left),
    ]
    path = folder / MODEL
    write_text(path, "".join(f"<!-- {line} -->\n" for line in lines) + text)
    if by_law:
        write_text(folder / LAW, Path(written_law.__file__).read_text(encoding="utf-8"))
    assets = _copy_assets(spec, models.folder, folder)
    _check(models, inside, written, path)
    return (MODEL, *([LAW] if by_law else []), *assets)


def expressible(models: Models, effect: AbstractEffect) -> bool:
    """Whether an effect changes the machine, and by nothing but what MuJoCo's elements and the law of joints have."""
    if effect.of_sensor:
        return False
    edited = models.edited((effect,))
    if any(len(set(edited.dof_damping[j.v])) > 1 for j in models.believed_coordinates.joints):
        return False
    cls = type(effect)
    return issubclass(cls, MechanismEffect) and (
        cls.edit_model is not MechanismEffect.edit_model or cls.edit_spec is not MechanismEffect.edit_spec
    )


def needing_law(models: Models, effects: Effects) -> list[AbstractEffect]:
    """Return the effects that change the law of joints, which plain MuJoCo has not."""
    return [
        e
        for e in effects
        if np.any(models.compiled((e,)).model.jnt_user[:, -SIZE:] != models.edited((e,)).jnt_user[:, -SIZE:])
    ]


def is_written(effect: AbstractEffect) -> TypeGuard[MechanismEffect]:
    """Whether an effect acts outside the engine here, and MuJoCo has an attribute that does the same."""
    return isinstance(effect, MechanismEffect) and type(effect).edit_written is not MechanismEffect.edit_written


def left_out(models: Models, effects: Effects) -> list[AbstractEffect]:
    """Return the effects that the written model does not have."""
    return [e for e in effects if not expressible(models, e) and not is_written(e)]


def _of_left(left: Sequence[AbstractEffect]) -> str:
    """Return which effects the written model does not have, and why where that is not plain."""
    recorded = [e.full_name for e in left if e.of_sensor]
    said = [e.full_name for e in left if not e.of_sensor]
    of = "which is" if len(recorded) == 1 else "which are"
    return " ".join(
        f"Not expressed here: {names}."
        for names in (", ".join(said), recorded and f"{', '.join(recorded)}, {of} of the recording, not of the machine")
        if names
    )


def _of_law(by_law: Sequence[AbstractEffect]) -> str:
    """Return what has to be done about effects that act by the law of joints."""
    return (
        f"Only with {LAW}, beside this file: {', '.join(e.full_name for e in by_law)}. In Python: import model; "
        f'm = model.load("{MODEL}")'
    )


def _of_delays(late: Sequence[mujoco.MjsActuator]) -> str:
    """Return what has to be known of actuators that are late."""
    told = ", ".join(f"'{a.name}' {a.delay:g} s" for a in late)
    return (
        f"Commands come late: {told}. Until then those from before the first step count, which are 0 unless "
        "mj_initCtrlHistory sets them; a timestep below a tenth of this one needs more nsample."
    )


def _copy_law(spec: mujoco.MjSpec, model: mujoco.MjModel, own: Sequence[Sequence[float]]) -> None:
    """Write the law of joints after the numbers that their owner has there, under the tag that `written_law` looks for.

    The compiled law has another tag: it would act on the written model a second time.
    """
    for joint, numbers in zip(spec.joints, own, strict=True):
        law = JointLaw(model, joint.id)
        joint.userdata = [*numbers]
        if law.present:
            room = [0.0] * (model.nuser_jnt - SIZE - len(numbers))
            joint.userdata = [*numbers, *room, written_law.TAG, *(law[name] for name in written_law.FIELDS)]


def _copy_geoms(spec: mujoco.MjSpec, model: mujoco.MjModel) -> None:
    """Write the numbers of geoms that MuJoCo's own copying leaves out: whole ones of contacts, and those of media."""
    for geom in spec.geoms:
        geom.priority, geom.condim = int(model.geom_priority[geom.id]), int(model.geom_condim[geom.id])
        if model.geom_fluid[geom.id, 0] > 0:
            geom.fluid_coefs = model.geom_fluid[geom.id, 1:6]


def _copy_assets(spec: mujoco.MjSpec, source: Path, folder: Path) -> tuple[str, ...]:
    """Copy the files that a model refers to, meshes and textures, to where the written one looks for them."""
    named = [(spec.compiler.meshdir, e.file) for kind in (spec.meshes, spec.hfields, spec.skins) for e in kind]
    named += [(spec.compiler.texturedir, e.file) for e in spec.textures]
    out = []
    for directory, file in named:
        name = Path(directory) / file
        if file and (source / name).is_file():
            with replacing(own_folder(folder, str(name.parent)) / name.name) as part:
                shutil.copyfile(source / name, part)
            out.append(str(name))
    return tuple(dict.fromkeys(out))


def _check(models: Models, effects: Effects, delays: Sequence[MechanismEffect], path: Path) -> None:
    """Simulate both, plainly, from the reference position, driven by sines, and compare the motion.

    What was written has the law of joints from the package's own text, and between two halves of a step: MuJoCo's
    callback belongs to the whole process, and what is in the folder is not executed.
    """
    try:
        with quiet():
            written = mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        raise ResultError(f"{MODEL}: does not compile: {error}") from None
    edited = models.edited(effects)
    edited.opt.timestep = written.opt.timestep  # which harder contacts have shortened
    late = (*models.believed_delays, *delays)
    name = _moves_otherwise(written, edited, late)
    if name is not None and _touches(edited):
        # links that are inside each other at the reference position burst apart, and the sixth digit decides how:
        # contact is compared by its numbers, and motion without it
        free = [copy.copy(written), copy.copy(edited)]
        for model in free:
            model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        name = _moves_otherwise(free[0], free[1], late) if _same_contact(written, edited) else name
    if name is not None:
        raise ResultError(f"{MODEL}: joint '{name}' does not move as it does in the simulation.")


def _moves_otherwise(written: mujoco.MjModel, edited: mujoco.MjModel, late: Sequence[MechanismEffect]) -> str | None:
    """Return the first joint whose motion differs by more than rounding explains; None: there is none.

    `late` are effects on commands that the written model has in it, and the edited one has not.
    """
    driven = {_called(edited, a): a for a in range(edited.nu) if not edited.actuator(a).name.startswith(OWN)}
    sent = {name: _sine(edited, a) for name, a in driven.items()}
    command = Command(edited.opt.timestep, sent, dict.fromkeys(sent, 0.0))
    for effect in late:
        command = effect.edit_command(command)
    step = _step_with_law if (written.jnt_user == written_law.TAG).any() else mujoco.mj_step
    # a written model has the same actuators, in the same order
    one, other = (
        _moved(model, {a: columns[name] for name, a in driven.items()}, step)
        for model, columns in ((written, sent), (edited, command.columns))
    )
    for name, motion in other.items():
        size = np.abs(motion).max() + 1.0
        apart = name not in one or one[name].shape != motion.shape
        if apart or np.abs(one[name] - motion).max() > 1e2 * DIGITS * size:
            return name
    return None


def _touches(model: mujoco.MjModel) -> bool:
    """Whether anything is in contact at the reference position."""
    data = mujoco.MjData(model)
    with quiet():
        mujoco.mj_forward(model, data)
    return data.ncon > 0


def _same_contact(written: mujoco.MjModel, edited: mujoco.MjModel) -> bool:
    """Whether all numbers of geoms that govern contact are the same but for rounding."""
    return all(
        getattr(written, name).shape == getattr(edited, name).shape
        and np.allclose(getattr(written, name), getattr(edited, name), rtol=DIGITS, atol=DIGITS)
        for name in CONTACT
    )


def _called(model: mujoco.MjModel, actuator: int) -> str:
    """Return the name of an actuator, or its number where it has none."""
    return model.actuator(actuator).name or f"{OWN}{actuator}"


def _sine(model: mujoco.MjModel, actuator: int) -> FloatArray:
    """Return a command to an actuator, (n,)."""
    t_s = model.opt.timestep * np.arange(max(1, round(LOOK_S / model.opt.timestep)))
    limit = model.actuator_forcerange[actuator, 1] if model.actuator_forcelimited[actuator] else 1.0
    return 0.1 * min(limit, 1.0) * np.sin(2 * np.pi * DRIVE_HZ * t_s + actuator)


def _step_with_law(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Make a step as `mj_step` does where `written_law.passive` is the callback."""
    mujoco.mj_step1(model, data)
    written_law.passive(model, data)
    mujoco.mj_step2(model, data)


def _moved(
    model: mujoco.MjModel, commands: Mapping[int, FloatArray], step: Callable[[mujoco.MjModel, mujoco.MjData], None]
) -> dict[str, FloatArray]:
    """Return the positions of every joint in a plain simulation, by name, (n, ...), under these commands, (n,) each."""
    data = mujoco.MjData(model)
    names = [model.joint(j).name for j in range(model.njnt)]
    out: dict[str, list[FloatArray]] = {name: [] for name in names}
    sent = np.column_stack(list(commands.values())) if commands else np.zeros((round(LOOK_S / model.opt.timestep), 0))
    with quiet():
        for command in sent:
            data.ctrl[list(commands)] = command
            step(model, data)
            for name in names:
                out[name].append(np.array(data.joint(name).qpos))
    return {name: np.array(values) for name, values in out.items()}
