"""The configs of many jobs, composed in a fraction of the time that Hydra takes for each."""

from __future__ import annotations

import functools
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from pathlib import Path, PurePath
from typing import Any

import yaml
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override, OverrideType
from omegaconf import DictConfig, OmegaConf, ValueNode
from yaml.cyaml import CSafeDumper

from runner.commands import Job
from runner.commands._compose import Composer, without_hydra
from runner.commands._explain import explain, node_at
from runner.storage.writing import write_text

CONFIG = "config.yaml"
MANY = 200
Plain = dict[str, Any]


@dataclass(frozen=True)
class Composed:
    """The config of one job as plain containers, and the experiment that was chosen.

    Attributes:
        values: As `config.build` wants it.
        shown: As it is written down, names in place of enums.
        experiment: None if there was none to choose.
    """

    values: Plain
    shown: Plain
    experiment: str | None


@dataclass(frozen=True)
class _Chosen:
    """What a choice of files makes; `tree` is None where values depend on each other, so that none is set alone."""

    tree: DictConfig | None
    composed: Composed


class JobComposer:
    """Composes one config after another. Hydra composes each choice of files once; then values are set in a copy.

    A sweep has few choices of files and many values. A value is checked by the very node of OmegaConf that holds it,
    in microseconds; a choice takes Hydra tens of milliseconds. What is not simply a value goes through Hydra.
    """

    def __init__(self, composer: Composer) -> None:
        self.composer = composer
        self._chosen = functools.cache(self._choose)
        self._parsed = functools.cache(self._parse)
        self._groups = functools.cache(composer.loader.list_groups)

    def compose(self, overrides: Sequence[str]) -> Composed:
        """Return the config that these settings make, types checked.

        Raises:
            ConfigError: If a setting is wrong.
        """
        try:
            parsed = [self._parsed(o) for o in overrides]
            chosen = self._chosen(tuple(o for o, p in zip(overrides, parsed, strict=True) if not self._sets_value(p)))
            out = self._set([p for p in parsed if self._sets_value(p)], chosen)
            return out or self._chosen(tuple(overrides)).composed
        except Exception as error:
            raise explain(error, overrides, self.composer) from error

    def job(self, overrides: Sequence[str], folder: Path, number: int) -> tuple[Plain, Job]:
        """Return the config of a job of a sweep, as `config.build` wants it, and what its command is told of it.

        Raises:
            ConfigError: If a setting is wrong.
        """
        composed = self.compose(overrides)
        keys = overridden([self._parsed(o) for o in overrides])
        return composed.values, Job(folder, composed.shown, keys, number, composed.experiment)

    def _parse(self, override: str) -> Override:
        return OverridesParser.create(config_loader=self.composer.loader).parse_override(override)

    def _sets_value(self, override: Override) -> bool:
        name = override.key_or_group
        plain = override.type is OverrideType.CHANGE and override.package is None and not name.startswith("hydra")
        parent, _, last = name.rpartition("/")
        return plain and last not in self._groups(parent)

    def _choose(self, overrides: tuple[str, ...]) -> _Chosen:
        config = self.composer.compose(overrides)
        own = without_hydra(config)
        values: Any = OmegaConf.to_container(own, resolve=True)
        shown: Any = OmegaConf.to_container(own, resolve=True, enum_to_str=True)
        alone = OmegaConf.to_container(own, resolve=False) == values  # no value is taken from another one
        composed = Composed(values, shown, config.hydra.runtime.choices.get("experiment"))
        return _Chosen(own if alone else None, composed)

    def _set(self, overrides: Sequence[Override], chosen: _Chosen) -> Composed | None:
        """Return the config with these values set, None where it takes Hydra to do so."""
        values, shown = chosen.composed.values, chosen.composed.shown
        for override in overrides:
            node = node_at(chosen.tree, override.key_or_group) if chosen.tree is not None else None
            value = override.value()
            if not isinstance(node, ValueNode) or isinstance(value, dict | list) or "${" in str(value):
                return None
            checked = node.validate_and_convert(value)
            path = override.key_or_group.split(".")
            values = _with(values, path, checked)
            shown = _with(shown, path, checked.name if isinstance(checked, Enum) else checked)
        return Composed(values, shown, chosen.composed.experiment)


class ConfigWriter:
    """Writes one `config.yaml` after another as `write_config` does, without putting a section in words twice."""

    def __init__(self, name: str) -> None:
        self.name = name
        self._texts: dict[int, tuple[Any, str]] = {}

    def write(self, folder: Path, overrides: Sequence[str], shown: Mapping[str, Any]) -> None:
        """Write the config of one job."""
        sections = "".join(self._text(k, v) for k, v in shown.items())
        write_text(folder / CONFIG, heading(self.name, overrides) + sections)

    def _text(self, key: str, section: Any) -> str:
        if not isinstance(section, dict):
            return yaml_text({key: section})
        known = self._texts.get(id(section))
        if known is None:
            # held, so that no other section takes its place in memory; only those that come again stay long
            known = self._texts[id(section)] = (section, yaml_text({key: section}))
            if len(self._texts) > MANY:
                self._texts.pop(next(iter(self._texts)))
        return known[1]


def _with(tree: Plain, path: Sequence[str], value: Any) -> Plain:
    """Return the tree with another value; what lies beside the path is shared."""
    head, *rest = path
    return {**tree, head: _with(tree[head], rest, value) if rest else value}


def overridden(parsed: Sequence[Override]) -> dict[str, Any]:
    """Return what was set, `key -> value`, without what is Hydra's own."""
    own = [o for o in parsed if not o.get_key_element().startswith("hydra")]
    return {o.get_key_element(): None if o.is_delete() else o.value() for o in own}


def write_config(folder: Path, name: str, overrides: Sequence[str], shown: Mapping[str, Any]) -> None:
    """Write `config.yaml`, headed by the command that it is of."""
    write_text(folder / CONFIG, heading(name, overrides) + yaml_text(shown))


def heading(name: str, overrides: Sequence[str]) -> str:
    """Return the first line of a `config.yaml`."""
    return f"# {shlex.join(['runner', *name.split(), *overrides])}\n"


class _Dumper(CSafeDumper):
    """Writes paths as text."""


_Dumper.add_multi_representer(PurePath, lambda dumper, path: dumper.represent_str(str(path)))


def yaml_text(shown: Mapping[str, Any]) -> str:
    """Return plain containers as YAML, in their own order."""
    return yaml.dump(dict(shown), Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=200)
