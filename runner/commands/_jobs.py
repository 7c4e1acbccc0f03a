"""The configs of many jobs, composed in a fraction of the time that Hydra takes for each."""

from __future__ import annotations

import copy
import functools
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from hydra._internal.config_loader_impl import ConfigLoaderImpl
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override, OverrideType
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from runner import config
from runner.commands import Command, Job
from runner.commands._compose import Composer, without_hydra
from runner.commands._explain import explain, explain_value
from runner.errors import RunnerError


@dataclass(frozen=True)
class Composed:
    """The config of one job, and the experiment that was chosen."""

    config: DictConfig
    experiment: str | None


class JobComposer:
    """Composes one config after another. Hydra composes each choice of files once; values are set by its own code.

    A sweep has few choices of files and many values, and a value takes microseconds, a choice tens of milliseconds.
    """

    def __init__(self, composer: Composer) -> None:
        self.composer = composer
        self._chosen = functools.cache(self._choose)
        self._parsed = functools.cache(self._parse)

    def compose(self, overrides: Sequence[str]) -> Composed:
        """Return the config that these settings make, types checked.

        Raises:
            ConfigError: If a setting is wrong.
        """
        try:
            parsed = [self._parsed(o) for o in overrides]
            base = self._chosen(tuple(o for o, p in zip(overrides, parsed, strict=True) if not self._sets_value(p)))
            own = copy.deepcopy(base.config)
            ConfigLoaderImpl._apply_overrides_to_config([p for p in parsed if self._sets_value(p)], own)
        except Exception as error:
            raise explain(error, overrides, self.composer) from error
        return Composed(own, base.experiment)

    def job(self, overrides: Sequence[str], folder: Path, number: int) -> tuple[Composed, Job]:
        """Return the config of a job of a sweep, and what its command is told of it.

        Raises:
            ConfigError: If a setting is wrong.
        """
        composed = self.compose(overrides)
        plain: Any = OmegaConf.to_container(composed.config, resolve=True, enum_to_str=True)
        keys = overridden([self._parsed(o) for o in overrides])
        return composed, Job(folder, plain, keys, number, composed.experiment)

    def _parse(self, override: str) -> Override:
        parser = OverridesParser.create(config_loader=self.composer.hydra.config_loader)
        return parser.parse_override(override)

    def _sets_value(self, override: Override) -> bool:
        name = override.key_or_group
        plain = override.type is OverrideType.CHANGE and override.package is None and not name.startswith("hydra")
        return plain and not self.composer.hydra.config_loader.repository.group_exists(name)

    def _choose(self, overrides: tuple[str, ...]) -> Composed:
        composed = self.composer.compose(overrides)
        own = without_hydra(composed)
        OmegaConf.set_struct(own, True)
        return Composed(own, composed.hydra.runtime.choices.get("experiment"))


def built(command: Command[Any], own: DictConfig, groups: Mapping[str, tuple[str, ...]]) -> Any:
    """Return the dataclass of a composed config.

    Raises:
        ConfigError: If a value is missing or out of its range.
    """
    try:
        return config.build(own, command.config)
    except (RunnerError, OmegaConfBaseException) as error:
        raise explain_value(error, own, dict(groups)) from error


def overridden(parsed: Sequence[Override]) -> dict[str, Any]:
    """Return what was set, `key -> value`, without what is Hydra's own."""
    own = [o for o in parsed if not o.get_key_element().startswith("hydra")]
    return {o.get_key_element(): None if o.is_delete() else o.value() for o in own}


def write_config(folder: Path, name: str, overrides: Sequence[str], plain: Mapping[str, Any]) -> None:
    """Write `config.yaml`, headed by the command that it is of."""
    settings = shlex.join(["runner", *name.split(), *overrides])
    text = yaml.dump(dict(plain), Dumper=yaml.CSafeDumper, sort_keys=False, allow_unicode=True, width=200)
    (folder / "config.yaml").write_text(f"# {settings}\n{text}", encoding="utf-8")
