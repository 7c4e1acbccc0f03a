"""Composing a command's config with Hydra, and saying in one line what was wrong with it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hydra import initialize_config_dir
from hydra.core.config_loader import ConfigLoader
from hydra.core.global_hydra import GlobalHydra
from hydra.core.object_type import ObjectType
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf

from runner import config
from runner.commands import Command, module

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
        """Return the composed config, with Hydra's own below `hydra`."""
        # not `hydra.compose`, which refuses several values for a key: those of a sweep
        return self.loader.load_configuration(
            self.config_name, [*QUIET, *overrides], mode, validate_sweep_overrides=mode is RunMode.RUN
        )

    def bare(self, overrides: Sequence[str]) -> DictConfig:
        """Return Hydra's own config below `hydra` and nothing else: what a launcher works with."""
        return self.loader.load_configuration(None, [*QUIET, *overrides], RunMode.MULTIRUN)

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


@contextmanager
def composer(name: str, command: Command[Any]) -> Iterator[Composer]:
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
