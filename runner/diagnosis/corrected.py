"""The corrected model on disk: the model file that holds the corrected numbers, and `corrected.yaml`.

The model file holds everything that acts inside the engine. Effects on the command or on the measurement act outside
it; `corrected.yaml` names all of them:

    effects:
      friction: {mu: 0.27}
      wind: {force_n: 0.4, direction_rad: 1.2}
    units: {friction: {mu: ''}, wind: {force_n: N, direction_rad: rad}}
    model: [model.xml]
    solved: how what a simulator can solve in more than one way was solved, if there is such

In a mechanism the names have targets: `joint_friction[elbow]: {...}`. Where one name of the vocabulary has several
variants, the parameters' names tell which is meant.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import MISSING, Field, fields
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, StrictFloat, ValidationError

from runner.diagnosis.result import Ranked
from runner.effects.base import AbstractEffect, Effects
from runner.effects.vocabulary import Vocabulary
from runner.errors import ConfigError, ResultError, nearest
from runner.importing.signals import nearest_of
from runner.storage.checked import dotted, must, refusal
from runner.storage.naming import folder_name
from runner.storage.reading import file_of
from runner.storage.writing import write_yaml
from runner.storage.yaml_text import YamlError, read_yaml
from runner.systems.base import AbstractSystem

FILE = "corrected.yaml"


def write_corrected(folder: str | Path, effects: Effects, system: AbstractSystem) -> Path:
    """Write model and `corrected.yaml` into a folder, which is made if need be, and return the latter's path.

    Raises:
        ResultError: If a name of the vocabulary is there twice (the file has one entry for each), or if the written
            model is another one than the simulator's.
    """
    folder = Path(folder)
    names = [e.full_name for e in effects]
    twice = sorted({n for n in names if names.count(n) > 1})
    if twice:
        raise ResultError(f"{folder / FILE}: '{twice[0]}' can be written once only, the model holds two of it.")
    folder.mkdir(parents=True, exist_ok=True)
    files = system.write_model(effects, folder)
    content = {
        "effects": {e.full_name: {f.name: float(getattr(e, f.name)) for f in _fields(type(e))} for e in effects},
        "units": {e.full_name: _units(e, system) for e in effects},
        "model": list(files),
        **({"solved": system.solved} if system.is_solved(effects) else {}),
    }
    path = folder / FILE
    write_yaml(path, content)
    return path


def folder_of(names: Sequence[str]) -> str:
    """Return what the folder is called in which the model that is corrected by other effects stands."""
    return f"or_{folder_name(names)}"


def write_equals(folder: Path, ranked: Ranked, system: AbstractSystem) -> list[str]:
    """Write the models that are corrected by what fits as well, each into a folder of its own: a test tells which.

    Returns:
        Which of them could not be written, and why, a sentence each.
    """
    failed = list[str]()
    for names, (parameters, errors) in ranked.equal_numbers.items():
        told = [
            (next(v for v in system.vocabulary.by_name[name] if _accepts(v.effect, set(values))), values)
            for name, values in parameters.items()
        ]
        effects = tuple(one.with_values(values) for candidate, values in told for one in candidate.each)
        try:
            write_corrected(folder / folder_of(names), system.as_told(effects, errors), system)
        except ResultError as error:
            failed.append(f"The model with {' + '.join(names)} in it was not written. {error}")
    return failed


_Values = Annotated[dict[str, Annotated[StrictFloat, must("be a number")]], must("be {parameter: value}")]


class _Corrected(BaseModel):
    effects: dict[str, _Values] | None
    solved: Annotated[str, must("be text")] = ""


def corrected_file(path: str | Path) -> Path:
    """Return the file of a corrected model: the path itself, or the file in that folder.

    Raises:
        ResultError: If there is no such file.
    """
    path = file_of(path, FILE)
    if not path.is_file():
        raise ResultError(f"{path}: no such file; a corrected model is the '{FILE}' that a diagnosis writes.")
    return path


def read_corrected(path: str | Path, system: AbstractSystem) -> tuple[Effects, AbstractSystem]:
    """Return the effects that `corrected.yaml` names, and the system solved as that was in which they were found.

    Args:
        path: The file, or the folder that holds it.
        system: What they are for. Where the file says nothing of how it is solved, it is returned as it is.

    Raises:
        ResultError: If there is no such file, or it is no YAML of that form.
        ConfigError: If an effect or a parameter does not exist, one is missing, or a value is out of range; or if the
            system can't be solved so.
    """
    path = corrected_file(path)
    told = _read(path)
    effects = tuple(_effect(path, name, values, system.vocabulary) for name, values in (told.effects or {}).items())
    return effects, _solved(path, told.solved, system)


def _solved(path: Path, told: str, system: AbstractSystem) -> AbstractSystem:
    if not told or told == system.solved:
        return system
    ways = {s.solved: s for s in (system, *system.solved_otherwise())}
    if told not in ways:
        raise ConfigError(f"{path}: solved: allowed of this model: {' or '.join(map(repr, ways))}, got {told!r}.")
    return ways[told]


def _read(path: Path) -> _Corrected:
    try:
        content = read_yaml(path)
    except YamlError as error:
        raise ResultError(f"{path}: no YAML:{error}") from None
    try:
        return _Corrected.model_validate(content)
    except ValidationError as error:
        place, text = refusal(error)
        if len(place) > 1:
            raise ConfigError(f"{path}: {dotted(place)}: {text}") from None
        raise ResultError(
            f"{path}: must hold 'effects: {{name: {{parameter: value}}}}', as a diagnosis's corrected.yaml does."
        ) from None


def _effect(path: Path, name: str, values: Mapping[str, float], vocabulary: Vocabulary) -> AbstractEffect:
    if name not in vocabulary.each_by_name:
        raise ConfigError(
            f"{path}: effects.{name}: no such effect of this recording; is this the corrected model of another one? "
            f"{nearest_of(name, vocabulary.each_by_name)}"
        )
    candidates = vocabulary.each_by_name[name]
    variants = [c.effect for c in candidates]
    fitting = [c for c in candidates if _accepts(c.effect, set(values))]
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
        return fitting[0].with_values(values)
    except ConfigError as error:
        raise ConfigError(f"{path}: effects.{error}") from error


def _units(effect: AbstractEffect, system: AbstractSystem) -> dict[str, str]:
    units = system.vocabulary.units(effect.full_name, system.context)
    return {f.name: units[f.name] for f in _fields(type(effect))}


def _fields(cls: type[AbstractEffect]) -> tuple[Field[Any], ...]:
    return tuple(f for f in fields(cls) if f.name != "target")


def _accepts(cls: type[AbstractEffect], names: set[str]) -> bool:
    needed = {f.name for f in _fields(cls) if f.default is MISSING and f.default_factory is MISSING}
    return needed <= names <= {f.name for f in _fields(cls)}
