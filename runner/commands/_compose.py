"""Composing a command's config with Hydra, and saying in one line what was wrong with it."""

from __future__ import annotations

import re
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hydra import initialize_config_dir
from hydra.core.config_loader import ConfigLoader
from hydra.core.global_hydra import GlobalHydra  # holds the loader, which alone composes several values for a key
from hydra.core.object_type import ObjectType
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf

from runner import config
from runner.commands import Command, module
from runner.commands._trust import check_hydra, check_launcher, check_sources, check_values, of_launcher
from runner.errors import ConfigError

# no files and no logging of Hydra's own beside the results
QUIET = ("hydra.output_subdir=null", "hydra/job_logging=none", "hydra/hydra_logging=none")


def config_dir() -> Path:
    """Return the folder of the YAML files: inside the package where it was installed, beside it in a checkout."""
    package = Path(config.__file__).resolve().parent
    return next(folder for folder in (package / "conf", package.parent / "conf") if folder.is_dir())


@dataclass(frozen=True)
class Composer:
    """Composes the config of one command."""

    name: str
    loader: ConfigLoader

    def compose(self, overrides: Sequence[str], *, mode: RunMode = RunMode.RUN) -> DictConfig:
        """Return the composed config, with Hydra's own below `hydra`.

        Raises:
            ConfigError: If it sets what could run something, or takes values from the environment.
        """
        check_sources(overrides)
        _check_twice(overrides)
        composed = self.loader.load_configuration(
            self.config_name, [*QUIET, *overrides], mode, validate_sweep_overrides=mode is RunMode.RUN
        )
        check_hydra(composed, _reference(self.loader, of_launcher(overrides)))
        check_values(composed)
        return composed

    def bare(self, overrides: Sequence[str], *, place: str) -> DictConfig:
        """Return Hydra's own config alone, which a launcher works with, of a sweep in a folder.

        Args:
            overrides: Of the sweep; those of the launcher are taken.
            place: The folder, as Hydra takes it literally.
        """
        return _bare(self.loader, (*of_launcher(overrides), f"hydra.sweep.dir={place}", "hydra.sweep.subdir=."))

    @property
    def config_name(self) -> str:
        """The YAML file of the command, or its schema alone where there is no file."""
        name = module(self.name)
        return name if (config_dir() / f"{name}.yaml").is_file() else f"schema_{name}"

    def groups(self) -> dict[str, tuple[str, ...]]:
        """Return the config groups that the command's YAML file chooses from, and their options."""
        file = config_dir() / f"{self.config_name}.yaml"
        defaults = OmegaConf.select(OmegaConf.load(file), "defaults", default=[]) if file.is_file() else []
        found: dict[str, tuple[str, ...]] = {}
        for group in (str(g) for entry in defaults if isinstance(entry, DictConfig) for g in entry):
            if not group.startswith("override "):
                names = self.loader.get_group_options(group, ObjectType.CONFIG)
                found[group] = tuple(sorted(n for n in names if not n.startswith("schema_")))
        return found


def _check_twice(overrides: Sequence[str]) -> None:
    """Refuse a list of parts that names one twice: the second would take the place of the first without a word.

    Raises:
        ConfigError: Naming it.
    """
    for override in overrides:
        found = re.fullmatch(r"([\w/]+)=\[([\w, ]*)\]", override)
        named = [] if found is None else [n for part in found[2].split(",") if (n := part.strip())]
        twice = next((n for n in named if named.count(n) > 1 and not re.fullmatch(r"\d+", n)), None)
        if found is not None and twice is not None:
            raise ConfigError(f"{found[1]}: '{twice}' is named twice, allowed: once.")


def _bare(loader: ConfigLoader, overrides: Sequence[str]) -> DictConfig:
    composed = loader.load_configuration(None, [*QUIET, *overrides], RunMode.MULTIRUN)
    check_launcher(composed)
    return composed


def _reference(loader: ConfigLoader, overrides: tuple[str, ...]) -> DictConfig:
    """Return Hydra's own config alone: of the same places and launcher it is the same, whichever command is run."""
    key = (*((p.provider, p.path) for p in loader.get_search_path().get_path()), *overrides)
    if key not in _REFERENCES:
        _REFERENCES[key] = _bare(loader, overrides)
    return _REFERENCES[key]


_REFERENCES: dict[tuple[object, ...], DictConfig] = {}


@contextmanager
def composer(name: str, command: Command[Any]) -> Generator[Composer]:
    """Start Hydra for a command, with the schemas of everything that its module imported."""
    config.store_schemas(module(name), command.config)
    with initialize_config_dir(str(config_dir()), job_name="runner", version_base="1.3"):
        yield Composer(name, GlobalHydra.instance().config_loader())


def without_hydra(composed: DictConfig) -> DictConfig:
    """Return the command's own part of a composed config."""
    own = composed.copy()
    OmegaConf.set_readonly(own, False)
    OmegaConf.set_struct(own, False)
    own.pop("hydra", None)
    return own
