"""What the results of a command belong to, and what its rows say of that."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from runner.commands import Command
from runner.storage.provenance import digest, in_a_row, program
from runner.storage.run_status import Belongs


def belongs_to(name: str, command: Command[Any], value: Any, config: Mapping[str, Any]) -> Belongs:
    """Return what the results of a command with this config belong to.

    Args:
        name: Of the command.
        command: The command.
        value: Its dataclass.
        config: The same as plain containers.

    Raises:
        RunnerError: If something that it reads can't be read.
    """
    inputs = {} if command.inputs is None else dict(command.inputs(value))
    return Belongs(name, digest({k: v for k, v in config.items() if k not in command.aside}), inputs)


def sweep_belongs(name: str, overrides: Sequence[str]) -> Belongs:
    """Return what the results of a sweep belong to: its settings, save for who does its runs."""
    return Belongs(name, digest([o for o in overrides if not o.lstrip("+~").startswith("hydra")]))


def job_provenance(name: str, command: Command[Any], value: Any, config: Mapping[str, Any]) -> dict[str, Any]:
    """Return the columns of one job of a sweep; `value` is None where the config could not be built.

    Raises:
        RunnerError: If something that it reads can't be read.
    """
    if value is None:
        return provenance(Belongs(name, digest({k: v for k, v in config.items() if k not in command.aside})))
    return provenance(belongs_to(name, command, value, config))


def provenance(belongs: Belongs) -> dict[str, Any]:
    """Return columns that say what makes a result, and what it belongs to."""
    hashes = {f"{key}_hash": value for key, value in belongs.input_hashes.items()}
    return {**in_a_row(program()), "config_hash": belongs.config_hash, **hashes}
