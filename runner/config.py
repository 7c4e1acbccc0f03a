"""Configuration: frozen dataclasses are the schema, small YAML files in `conf/` are the values, Hydra composes both.

A section is a plain frozen dataclass whose `__post_init__` checks its ranges. One that is chosen by name (a force
sequence, an estimator, an effect) is registered, and a YAML file of that name stands on top of its schema:

    @registered("forces")                       # conf/forces/ramp.yaml:
    @dataclass(frozen=True)                     #   defaults: [schema_ramp, _self_]
    class Ramp(AbstractForces):                 #   slope_n_s: 2.0
        slope_n_s: float
        def __post_init__(self) -> None:
            check_range("slope_n_s", self.slope_n_s, 0.0, 100.0, unit="N/s")

The dataclass of a whole command names its sections by type; sections that are chosen by name have an abstract type.
Types are checked by OmegaConf on composing, ranges by the dataclasses when `build` makes them, before anything runs.
Beyond `build` there are dataclasses only.

`build` is used in place of `hydra.utils.instantiate` because it makes tuples of lists, checks their length, names the
full key in front of every error, and constructs nothing but classes that a schema names.
"""

from __future__ import annotations

import dataclasses
import functools
import inspect
import operator
import re
import types
import typing
from collections.abc import Callable, Mapping
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from runner.errors import ConfigError, RunnerError, nearest

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

T = TypeVar("T", bound="DataclassInstance")
TARGET = "_target_"

_REGISTERED: dict[tuple[str, str], type[DataclassInstance]] = {}
_TARGETS: dict[str, type[DataclassInstance]] = {}
_STORED: dict[tuple[str | None, str], type] = {}  # what Hydra has been given


def registered(group: str, name: str | None = None) -> Callable[[type[T]], type[T]]:
    """Return a decorator that offers a dataclass as `schema_<name>` in a config group.

    Args:
        group: Folder below `conf/`, such as `forces`.
        name: Name of the option; by default the class's name in snake case (`HalfCosine` is `half_cosine`).
    """

    def decorate(cls: type[T]) -> type[T]:
        _REGISTERED[group, name or snake_case(cls.__name__)] = cls
        _TARGETS[target_of(cls)] = cls
        return cls

    return decorate


def snake_case(name: str) -> str:
    """Return a class's name as it is written in YAML: `HalfCosine` is `half_cosine`."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name).lower()


def target_of(cls: type) -> str:
    """Return what `_target_` is for a class."""
    return f"{cls.__module__}.{cls.__qualname__}"


def options(group: str) -> tuple[str, ...]:
    """Return the names registered in a group."""
    return tuple(sorted(name for g, name in _REGISTERED if g == group))


@functools.cache
def schema(cls: type[DataclassInstance]) -> type:
    """Return the OmegaConf schema of a frozen dataclass: the same fields, mutable, and `_target_`.

    Fields of an abstract class may hold any option of their group; nested dataclasses become nested schemas. A field
    without a default is mandatory.

    Raises:
        TypeError: If a field has a type that OmegaConf can't check (a `Literal`: use an Enum).
    """
    target = target_of(cls)
    _TARGETS[target] = cls
    hints = typing.get_type_hints(cls)
    fields: list[tuple[str, Any, Any]] = [(TARGET, str, dataclasses.field(default=target))]
    for field in dataclasses.fields(cls):
        if field.init:
            hint = _schema_type(hints[field.name], f"{target}.{field.name}")
            fields.append((field.name, hint, _schema_default(field, hints[field.name])))
    return dataclasses.make_dataclass(cls.__name__, fields)


def _schema_type(hint: Any, where: str) -> Any:
    origin, args = typing.get_origin(hint), typing.get_args(hint)
    if origin is typing.Literal:
        raise TypeError(f"{where}: use an Enum in place of {hint}, which OmegaConf can't check.")
    if origin in (typing.Union, types.UnionType):
        parts = tuple(_schema_type(a, where) for a in args)
        if typing.Any in parts:
            return Any
        return functools.reduce(operator.or_, parts)
    if origin is tuple:
        return types.GenericAlias(tuple, tuple(a if a is Ellipsis else _schema_type(a, where) for a in args))
    if origin in (list, dict):
        return types.GenericAlias(origin, tuple(_schema_type(a, where) for a in args))
    if inspect.isclass(hint) and dataclasses.is_dataclass(hint) and not _is_abstract(hint):
        return schema(hint)
    if hint in (int, float, str, bool, bytes, Path, type(None), Any):
        return hint
    if inspect.isclass(hint) and issubclass(hint, Enum):
        return hint
    return Any


_hints = functools.cache(typing.get_type_hints)


def _is_abstract(cls: type) -> bool:
    return inspect.isabstract(cls) or cls.__name__.startswith("Abstract")


def _schema_default(field: dataclasses.Field[Any], hint: Any) -> Any:
    from omegaconf import MISSING

    if inspect.isclass(hint) and _is_abstract(hint) and field.default is not None:
        return dataclasses.field(default=MISSING)  # an option takes its place; it could not replace another option
    if field.default is not dataclasses.MISSING:
        value = field.default
    elif field.default_factory is not dataclasses.MISSING:
        value = field.default_factory()
    elif inspect.isclass(hint) and dataclasses.is_dataclass(hint) and not _is_abstract(hint):
        return dataclasses.field(default_factory=schema(hint))
    else:
        return dataclasses.field(default=MISSING)
    if isinstance(value, (str, int, float, bool, Path, Enum, type(None))):
        return dataclasses.field(default=value)
    return dataclasses.field(default_factory=lambda: _schema_value(value))


def _schema_value(value: Any) -> Any:
    """Return a default in the schema's own terms."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return schema(type(value))(
            **{f.name: _schema_value(getattr(value, f.name)) for f in dataclasses.fields(value) if f.init}
        )
    if isinstance(value, (tuple, list)):
        return [_schema_value(v) for v in value]
    if isinstance(value, Mapping):
        return {k: _schema_value(v) for k, v in value.items()}
    return value


def store_schemas(name: str, root: type[DataclassInstance]) -> None:
    """Give Hydra the schema of a command (`schema_<name>`) and of every class that was registered."""
    from hydra.core.config_store import ConfigStore

    store = ConfigStore.instance()
    # Hydra copies all schemas with each list of places that it makes, to write to the list alone: half a second where
    # a command tells of all its groups. What is loaded from the store is a copy anyway.
    vars(store).setdefault("__deepcopy__", lambda _memo: store)
    wanted = {(None, f"schema_{name}"): schema(root)}
    wanted |= {(group, f"schema_{option}"): schema(cls) for (group, option), cls in _REGISTERED.items()}
    for (group, called), node in wanted.items():
        if _STORED.get((group, called)) is not node:  # Hydra copies each
            store.store(group=group, name=called, node=node, provider="runner")
            _STORED[group, called] = node


def restored(plain: Any, cls: type[DataclassInstance]) -> Any:
    """Return plain containers of a file as `build` wants them: types checked, names in place of which enums stand.

    Args:
        plain: What `config.yaml` of a results folder holds.
        cls: The dataclass of the whole.

    Raises:
        ConfigError: Naming the full key of the first value of another type.
    """
    schema(cls)
    return _restored(plain, cls, "")


def _restored(value: Any, cls: Any, key: str) -> Any:
    from omegaconf import OmegaConf
    from omegaconf.errors import OmegaConfBaseException

    if not isinstance(value, dict):
        return value
    known = _TARGETS.get(str(value[TARGET])) if TARGET in value else cls
    if not (inspect.isclass(known) and dataclasses.is_dataclass(known)):  # by name, as effects and estimators are
        return {k: _restored(v, None, f"{key}.{k}") for k, v in value.items()}
    node = OmegaConf.structured(schema(known))
    out: dict[str, Any] = {}
    for name, part in value.items():
        place = f"{key}.{name}".lstrip(".")
        hint = _hints(known).get(str(name))
        if isinstance(part, dict) or name == TARGET or hint is None:
            out[str(name)] = _restored(part, hint, place)
            continue
        try:
            node[name] = part
            checked: Any = OmegaConf.to_container(node, resolve=False)
            out[str(name)] = checked[name]
        except (OmegaConfBaseException, ValueError) as error:
            raise ConfigError(f"{place}: {' '.join(str(error).split('full_key')[0].split())}") from None
    return out


def build(config: Any, cls: type[T]) -> T:
    """Make the frozen dataclass, and all dataclasses in it, from a composed config.

    Args:
        config: A DictConfig, or nested plain containers, with `_target_` where a section was chosen by name.
        cls: The dataclass of the whole.

    Raises:
        ConfigError: Naming the full key of the first value that is missing, unknown or out of range.
    """
    from omegaconf import OmegaConf

    if OmegaConf.is_config(config):
        config = OmegaConf.to_container(config, resolve=True, throw_on_missing=True)
    schema(cls)
    return _build(config, cls, "")


def _build(value: Any, hint: Any, key: str) -> Any:
    origin, args = typing.get_origin(hint), typing.get_args(hint)
    if isinstance(value, dict) and origin is not dict and (TARGET in value or _is_section(hint)):
        return _build_section(value, hint, key)
    if origin in (typing.Union, types.UnionType):
        chosen = [a for a in args if a is not type(None)]
        return value if value is None else _build(value, chosen[0] if len(chosen) == 1 else Any, key)
    if (origin is dict and not isinstance(value, dict)) or (_is_section(hint) and not isinstance(value, dict)):
        raise ConfigError(f"{key}: must be a section of keys, got {value!r}.")
    if isinstance(value, dict):
        inner = args[1] if origin is dict else Any
        return {k: _build(v, inner, f"{key}.{k}" if key else str(k)) for k, v in value.items()}
    if origin is tuple and isinstance(value, (list, tuple)):
        repeated = len(args) == 2 and args[1] is Ellipsis
        if not repeated and len(value) != len(args):
            raise ConfigError(f"{key}: must be a list of {len(args)} values, got {value!r}.")
        hints = [args[0]] * len(value) if repeated else args
        return tuple(_build(v, h, f"{key}[{i}]") for i, (v, h) in enumerate(zip(value, hints, strict=True)))
    if isinstance(value, list):
        return [_build(v, args[0] if args else Any, f"{key}[{i}]") for i, v in enumerate(value)]
    return value


def _is_section(hint: Any) -> bool:
    return inspect.isclass(hint) and (dataclasses.is_dataclass(hint) or _is_abstract(hint))


def _build_section(value: dict[str, Any], hint: Any, key: str) -> Any:
    target = value.get(TARGET)
    if target is not None and not isinstance(target, str):
        raise ConfigError(f"{key + '.' if key else ''}{TARGET}: must be the name of a class, got {target!r}.")
    cls = hint if target is None else _TARGETS.get(target)
    if cls is None:
        raise ConfigError(f"{key + '.' if key else ''}{TARGET}: no class '{target}' is registered.")
    if _is_section(hint) and not issubclass(cls, hint):
        raise ConfigError(f"{key + '.' if key else ''}{TARGET}: must be of {hint.__name__}, got '{target}'.")
    if target is None and not dataclasses.is_dataclass(hint):
        raise ConfigError(f"{key}: says nothing of which {cls.__name__} it is; choose one of its group.")
    hints = _hints(cls)
    start = f"{key}." if key else ""
    own = {f.name: f for f in dataclasses.fields(cls) if f.init}
    for name in value.keys() - own.keys() - {TARGET}:
        raise ConfigError(f"{start}{name}: no such key. {nearest(str(name), own)}")
    for name, field in own.items():
        if name not in value and field.default is field.default_factory is dataclasses.MISSING:
            raise ConfigError(f"{start}{name}: a value is needed.")
    fields = {k: _build(v, hints.get(k, Any), start + str(k)) for k, v in value.items() if k != TARGET}
    try:
        return cls(**fields)
    except RunnerError as error:
        raise type(error)(with_key(key, str(error))) from error


def with_key(key: str, message: str) -> str:
    """Return the message with the section's key in front, unless it begins with the section's name already."""
    head = re.split(r"[.\[:]", message, maxsplit=1)[0]
    return message if not key or head == key.split(".")[0] else f"{key}.{message}"
