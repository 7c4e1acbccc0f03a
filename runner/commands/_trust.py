"""What of Hydra's own settings may be set, and by whom, so that no file of somebody else's runs anything.

A config, a sweep or a results folder may come from anywhere. Hydra instantiates whatever `_target_` stands below
`hydra.callbacks`, builds log handlers from names, sets variables of the environment, imports packages as sources of
configs; a launcher starts programs. So of Hydra's own keys a file may set which values are swept and that there is a
sweep, and nothing else; the launcher is chosen and set on the command line. Below the command's own keys there are
classes of `runner.config` alone, see `config.build`, and values that are written there or taken from other keys.
"""

from __future__ import annotations

import re
import secrets
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override
from hydra.errors import HydraException
from omegaconf import DictConfig, OmegaConf

from runner.errors import ConfigError

FREE = ("mode", "searchpath", "sweeper.params")
FILLED_IN = ("overrides", "runtime", "job.override_dirname", "job.config_name")  # by Hydra, in every composition
TARGET = "_target_"
LAUNCHERS = {
    "hydra._internal.core_plugins.basic_launcher.BasicLauncher",
    "hydra_plugins.hydra_joblib_launcher.joblib_launcher.JoblibLauncher",
    "hydra_plugins.hydra_submitit_launcher.submitit_launcher.LocalLauncher",
    "hydra_plugins.hydra_submitit_launcher.submitit_launcher.SlurmLauncher",
    "hydra_plugins.runner_ray_launcher.RayLauncher",
}
SOURCE = "file://"
RESOLVER = re.compile(r"\$\{[^{}:]*:")  # `${oc.env:HOME}`; a key has no colon
SUBMITIT = "${hydra.sweep.dir}/.submitit/%j"  # the default of its launchers


def check_sources(overrides: Sequence[str]) -> None:
    """Refuse configs from anywhere but folders, before one is loaded: of a package, the code would be run.

    Raises:
        ConfigError: Naming the source.
    """
    for override in overrides:
        if "hydra.searchpath" in override:
            places = OverridesParser.create().parse_override(override).value()
            for place in places if isinstance(places, list) else [places]:
                if "://" in str(place) and not str(place).startswith(SOURCE):
                    raise ConfigError(
                        f"hydra.searchpath: must be folders, as in [{SOURCE}/home/me/conf], got '{place}'."
                    )


def check_hydra(composed: DictConfig, bare: DictConfig) -> None:
    """Refuse a config that changes more of Hydra's own than it may.

    Args:
        composed: The config, with Hydra's own below `hydra`.
        bare: Hydra's own alone, with the launcher of the command line.

    Raises:
        ConfigError: Naming the first key that is not as in `bare`.
    """
    found, plain = _leaves(composed.hydra), _leaves(bare.hydra)
    for key in sorted(found.keys() | plain.keys()):
        if found.get(key) == plain.get(key) or _below(key, (*FREE, *FILLED_IN)):
            continue
        if _below(key, ("launcher",)):
            raise ConfigError(f"hydra.{key}: a launcher starts programs, so it is set on the command line alone.")
        allowed = ", ".join(f"'hydra.{name}'" for name in ("launcher", *FREE))
        raise ConfigError(f"hydra.{key}: can't be set, so that no file runs anything; of Hydra's own {allowed} can.")


def check_values(composed: DictConfig) -> None:
    """Refuse values that are taken from elsewhere than from other keys: the environment would stand in the results.

    Raises:
        ConfigError: Naming the key and the value.
    """
    swept = OmegaConf.select(composed, "hydra.sweeper.params")
    own = {key: value for key, value in composed.items_ex(resolve=False) if key != "hydra"}
    for key, value in {**_leaves(own), **_leaves(swept, "hydra.sweeper.params")}.items():
        if isinstance(value, str) and RESOLVER.search(value):
            raise ConfigError(f"{key}: '{value}' is taken from elsewhere than from a key, as '${{start.mass_kg}}' is.")


def check_launcher(bare: DictConfig) -> None:
    """Refuse a launcher that is not known, and classes within its settings.

    Raises:
        ConfigError: Naming the key and the class.
    """
    for key, value in _leaves(bare.hydra.launcher).items():
        if key.rpartition(".")[2] == TARGET and (key != TARGET or value not in LAUNCHERS):
            raise ConfigError(f"hydra.launcher.{key}: '{value}' is none of the launchers that are known.")


def of_launcher(overrides: Sequence[str]) -> tuple[str, ...]:
    """Return the settings of the launcher."""
    return tuple(o for o in overrides if o.lstrip("+~").startswith(("hydra/launcher", "hydra.launcher")))


def read_nothing_kept(bare: DictConfig) -> None:
    """Let submitit keep its files where nobody can have put any: it unpickles what it finds under the name of a job."""
    if _leaves(bare.hydra.launcher).get("submitit_folder") == SUBMITIT:
        bare.hydra.launcher.submitit_folder = SUBMITIT.replace("%j", f"{secrets.token_hex(8)}/%j")


def check_kept(name: str, file: Path, kept: Sequence[str], typed: Sequence[str]) -> None:
    """Refuse what a sweep's folder says of Hydra unless it can't run anything, or was typed again.

    Raises:
        ConfigError: With the setting, and how to say it again.
    """
    for setting in kept:
        try:
            harmless = _harmless(OverridesParser.create().parse_override(setting))
        except HydraException as error:
            said = str(error).splitlines()[0]
            raise ConfigError(f"resume: '{file}' holds no settings of a sweep: '{setting}': {said}.") from None
        if setting not in typed and not harmless:
            again = shlex.join(["runner", *name.split(), f"resume={file.parent}", setting])
            raise ConfigError(f"resume: '{file}' sets '{setting}', which may run programs; if you trust it: {again}")


def _harmless(override: Override) -> bool:
    key = override.key_or_group
    if not key.startswith("hydra"):
        return True
    plain = override.package is None and not override.is_sweep_override()
    value = override.value()
    if key == "hydra/launcher":
        return plain and str(value).isidentifier()
    if key.startswith("hydra.launcher."):
        return plain and isinstance(value, bool | int | float | None)
    return plain and _below(key, ("hydra.mode", "hydra.sweeper.params"))


def _below(key: str, names: Sequence[str]) -> bool:
    return any(key == name or key.startswith(f"{name}.") for name in names)


def _leaves(node: Any, prefix: str = "") -> dict[str, Any]:
    """Return the values of a config by their full keys; an empty section is a value."""
    plain = OmegaConf.to_container(node, resolve=False) if OmegaConf.is_config(node) else node
    if not isinstance(plain, Mapping) or not plain:
        return {prefix: plain}
    return {k: v for key, value in plain.items() for k, v in _leaves(value, f"{prefix}.{key}".lstrip(".")).items()}
