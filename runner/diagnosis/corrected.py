"""The corrected model on disk: `model.xml`, the MJCF that holds the corrected numbers, and `corrected.yaml`.

`model.xml` holds everything that acts inside the engine. Effects on the command or on the measurement act outside it;
`corrected.yaml` names all of them:

    effects:
      friction: {mu: 0.27}
      wind: {force_n: 0.4, direction_rad: 1.2}
    units: {friction: {mu: ''}, wind: {force_n: N, direction_rad: rad}}
    model: model.xml

Where one name of the vocabulary has several variants, the parameters' names tell which is meant.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, Field, fields
from pathlib import Path
from typing import Annotated, Any

import mujoco
import numpy as np
import yaml
from dm_control import mjcf
from pydantic import BaseModel, StrictFloat, ValidationError

from runner.effects import EFFECTS, AbstractEffect
from runner.errors import ConfigError, ResultError, nearest
from runner.storage.checked import dotted, must, refusal
from runner.storage.writing import write_text, write_yaml
from runner.systems.planar_box.simulator import OBJECT, Effects, Simulator

FILE = "corrected.yaml"
MODEL = "model.xml"
WARNING = "<!-- Friction is a law of runner's own (numbers in `user`): plain MuJoCo slides freely. -->\n"
UNITS = {
    "_kg": "kg",
    "_rad": "rad",
    "_s": "s",
    "_m": "m",
    "_n": "N",
    "_m_s": "m/s",
    "_per_s": "1/s",
    "_n_per_m": "N/m",
    "_n_s_per_m": "N s/m",
    "_n_m_s": "N m s",
    "_n_s2_per_m2": "N s2/m2",
}
# what an effect may change in a compiled model; anything else must be added here and in `_written`
WRITTEN = ("body_mass", "body_ipos", "body_inertia", "body_user", "dof_damping", "tendon_stiffness", "site_pos")


def unit(parameter: str) -> str:
    """Return the unit that a parameter's name ends on, "" for a pure number."""
    endings = [ending for ending in UNITS if parameter.endswith(ending)]
    return UNITS[max(endings, key=len)] if endings else ""


def write_corrected(folder: str | Path, effects: Effects, simulator: Simulator) -> Path:
    """Write `model.xml` and `corrected.yaml` into a folder, which is made if need be, and return the latter's path.

    The MJCF is compiled again and compared with the model that the simulator runs.

    Raises:
        ResultError: If a name of the vocabulary is there twice (the file has one entry for each), or if the written
            model is another one than the simulator's.
    """
    folder = Path(folder)
    names = [e.name for e in effects]
    twice = sorted({n for n in names if names.count(n) > 1})
    if twice:
        raise ResultError(f"{folder / FILE}: '{twice[0]}' can be written once only, the model holds two of it.")
    folder.mkdir(parents=True, exist_ok=True)
    write_text(folder / MODEL, WARNING + corrected_mjcf(effects, simulator))
    parameters = {e.name: {f.name: float(getattr(e, f.name)) for f in fields(e)} for e in effects}  # type: ignore[arg-type]
    content = {
        "effects": parameters,
        "units": {name: {key: unit(key) for key in values} for name, values in parameters.items()},
        "model": MODEL,
    }
    path = folder / FILE
    write_yaml(path, content)
    return path


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


_Values = Annotated[dict[str, Annotated[StrictFloat, must("be a number")]], must("be {parameter: value}")]


class _Corrected(BaseModel):
    effects: dict[str, _Values] | None


def read_corrected(path: str | Path) -> Effects:
    """Return the effects that `corrected.yaml` names.

    Args:
        path: The file, or the folder that holds it.

    Raises:
        ResultError: If there is no such file, or it is no YAML of that form.
        ConfigError: If an effect or a parameter does not exist, one is missing, or a value is out of range.
    """
    path = Path(path)
    path = path / FILE if path.is_dir() else path
    if not path.is_file():
        raise ResultError(f"{path}: no such file; a corrected model is the '{FILE}' that a diagnosis writes.")
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ResultError(f"{path}: no YAML: {str(error).splitlines()[0]}.") from error
    try:
        effects = _Corrected.model_validate(content).effects or {}
    except ValidationError as error:
        place, text = refusal(error)
        if len(place) > 1:
            raise ConfigError(f"{path}: {dotted(place)}: {text}") from None
        raise ResultError(
            f"{path}: must hold 'effects: {{name: {{parameter: value}}}}', as a diagnosis's corrected.yaml does."
        ) from None
    return tuple(_effect(path, name, values) for name, values in effects.items())


def _effect(path: Path, name: str, values: Mapping[str, float]) -> AbstractEffect:
    if name not in EFFECTS:
        raise ConfigError(f"{path}: effects.{name}: no such effect. {nearest(name, EFFECTS)}")
    variants = EFFECTS[name]
    fitting = [v for v in variants if _accepts(v, set(values))]
    if not fitting:
        known = sorted({f.name for v in variants for f in _fields(v)})
        odd = sorted(set(values) - set(known))
        if odd:
            raise ConfigError(f"{path}: effects.{name}.{odd[0]}: no such parameter. {nearest(odd[0], known)}")
        wanted = " or ".join(", ".join(f"'{f.name}'" for f in _fields(v)) for v in variants)
        raise ConfigError(
            f"{path}: effects.{name}: must have {wanted}, got {', '.join(map(repr, values)) or 'nothing'}."
        )
    try:
        return fitting[0](**values)
    except ConfigError as error:
        raise ConfigError(f"{path}: effects.{error}") from error


def _fields(cls: type[AbstractEffect]) -> tuple[Field[Any], ...]:
    return fields(cls)  # type: ignore[arg-type]


def _accepts(cls: type[AbstractEffect], names: set[str]) -> bool:
    needed = {f.name for f in _fields(cls) if f.default is MISSING and f.default_factory is MISSING}
    return needed <= names <= {f.name for f in _fields(cls)}
