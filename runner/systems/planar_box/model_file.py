"""The corrected box as MJCF, with all digits."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
from dm_control import mjcf

from runner.errors import ResultError
from runner.storage.writing import write_text
from runner.systems.planar_box.simulator import OBJECT, Simulator
from runner.systems.planar_box.windows import Effects

MODEL = "model.xml"
WARNING = "<!-- Friction is a law of runner's own (numbers in `user`): plain MuJoCo slides freely. -->\n"
# what an effect may change in a compiled model; anything else must be added here and in `_enter`
WRITTEN = ("body_mass", "body_ipos", "body_inertia", "body_user", "dof_damping", "tendon_stiffness", "site_pos")


def write_model(effects: Effects, folder: Path, simulator: Simulator) -> tuple[str, ...]:
    """Write `model.xml` into a folder and return its name; it is compiled again and compared with the simulator's.

    Raises:
        ResultError: If it compiles to another model than the simulator's.
    """
    write_text(folder / MODEL, WARNING + corrected_mjcf(effects, simulator))
    return (MODEL,)


def corrected_mjcf(effects: Effects, simulator: Simulator) -> str:
    """Return MJCF with the corrected numbers in it, all digits.

    Raises:
        ResultError: If it compiles to another model than the simulator's.
    """
    root, model = simulator.mjcf(effects), simulator.model(effects)
    _enter(root, model)
    text = root.to_xml_string(precision=17, filename_with_hash=False)
    again = mujoco.MjModel.from_xml_string(text, root.get_assets())
    for name in (*WRITTEN, "dof_invweight0", "body_invweight0"):
        ours, theirs = np.asarray(getattr(model, name)), np.asarray(getattr(again, name))
        if not np.allclose(ours, theirs, rtol=1e-12, atol=1e-15):
            raise ResultError(f"{MODEL}: '{name}' does not come out as the simulator has it.")
    if not np.allclose(model.opt.gravity, again.opt.gravity, rtol=1e-12, atol=1e-15):
        raise ResultError(f"{MODEL}: the gravity does not come out as the simulator has it.")
    return text


def _enter(root: mjcf.RootElement, model: mujoco.MjModel) -> None:
    """Write the numbers of an edited model into the MJCF that it was compiled from."""
    root.option.gravity = model.opt.gravity.copy()
    body = model.body(OBJECT).id
    element = root.find("body", OBJECT)
    element.user = model.body_user[body].copy()
    element.inertial.mass = float(model.body_mass[body])
    element.inertial.pos = model.body_ipos[body].copy()
    element.inertial.diaginertia = model.body_inertia[body].copy()
    for joint in element.joint:
        joint.damping = float(np.ravel(model.dof_damping[model.joint(joint.name).dofadr[0]])[0])
    for site in root.find_all("site"):
        site.pos = model.site_pos[model.site(site.name).id].copy()
    for tendon in root.tendon.spatial:
        number = model.tendon(tendon.name).id
        tendon.stiffness = float(np.ravel(model.tendon_stiffness[number])[0])
        tendon.springlength = model.tendon_lengthspring[number].copy()
