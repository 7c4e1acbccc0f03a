"""The commands of `runner`: one module each, found by its name, described by its docstring.

A module `runner/commands/gap.py` is the command `runner gap`; `blind_make.py` is `runner blind make`. The first line
of its docstring is its line in `runner --help`, the rest is shown by `runner gap --help`. It holds

    COMMAND = Command(config=GapConfig, main=main)

where `GapConfig` is a frozen dataclass (the schema) and `main(config, job)` does the work. Values other than the
schema's defaults stand in `conf/gap.yaml`, which must begin with `defaults: [schema_gap, _self_]`; without that file
the defaults are the schema's own.
"""

from __future__ import annotations

import ast
import gc
import importlib
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

C = TypeVar("C", bound="DataclassInstance")
DEFAULT = "run"


@dataclass(frozen=True)
class Job:
    """One execution of a command.

    Attributes:
        folder: Where its results go; exists. None for a command that keeps none.
        config: The resolved config as plain containers (what `config.yaml` in the folder holds).
        overrides: What the user, or the sweep, set: `key -> value`, values typed as in YAML.
        number: Place in the sweep, from 0; None outside a sweep.
        experiment: The experiment that was chosen, None if there was none to choose.
        provenance: Columns that say what makes the result: versions, commit, hashes of the config and of what is read.
        config_dirs: Folders of configs that are looked in beside `conf/`.
        spread: Makes calls, each in a process of the launcher that was asked for, and waits for them; None: none was.
    """

    folder: Path | None
    config: Mapping[str, Any] = field(default_factory=dict)
    overrides: Mapping[str, Any] = field(default_factory=dict)
    number: int | None = None
    experiment: str | None = None
    provenance: Mapping[str, Any] = field(default_factory=dict)
    config_dirs: tuple[Path, ...] = ()
    spread: Callable[[Sequence[Callable[[], object]]], None] | None = None

    @property
    def about(self) -> dict[str, Any]:
        """What a row says of the job in front: its experiment, its place in the sweep, and what was set."""
        number = {} if self.number is None else {"job": self.number}
        plain = {k: v if isinstance(v, bool | int | float | str) else str(v) for k, v in self.overrides.items()}
        return {"experiment": self.experiment} | number | plain

    @property
    def results(self) -> Path:
        """The results folder of a command that keeps results."""
        if self.folder is None:
            raise ValueError("This command was declared without a results folder.")
        return self.folder


@dataclass(frozen=True)
class Command(Generic[C]):
    """What the command line must know of a command.

    Attributes:
        config: Frozen dataclass, the schema of the command's config.
        main: Does the work; returns the exit code, None for 0. Raises RunnerError for what a user can put right.
        keeps: Name of the folder below `results/` for what it writes (`results/<keeps>/<timestamp>/`, or
            `results/<experiment>/<timestamp>/` where an experiment was chosen); None: no folder, `out` is an
            ordinary key of the command, if it has one.
        positional: Key that bare arguments are for: `runner gap DIR` is `runner gap recording=DIR`. Where the key is
            a list, any number of arguments.
        batch: Does many jobs of a sweep at once, with so many threads (0: one per core), and returns for each its row,
            with a `status`, "done" where it went well, and a `reason`, or the exception it ended with. Without it
            the jobs of a sweep are done one after another by `main`, and their rows are those of the
            `summary.parquet` that it leaves, if it does.
        finish: Called with the folder of a sweep when all its jobs have ended.
        inputs: Returns a hash of each thing that a config has it read, by name: a folder that holds results of other
            things is refused. Raises RunnerError where one can't be read.
        again: What a user does with the same command after an interruption, "Go on with" or "Begin again with"; "": no
            such command.
        aside: Keys that say where and how fast, not what: results for other values of them may share a folder.
    """

    config: type[C]
    main: Callable[[C, Job], int | None]
    keeps: str | None = None
    positional: str | None = None
    batch: Callable[[Sequence[tuple[C, Job]], int], Sequence[Mapping[str, Any] | Exception]] | None = None
    finish: Callable[[Path], None] | None = None
    inputs: Callable[[C], Mapping[str, str]] | None = None
    aside: tuple[str, ...] = ()
    again: str = ""


def names() -> tuple[str, ...]:
    """Return the names of all commands, the default one first."""
    return tuple(sorted(_sources(), key=lambda name: (name != DEFAULT, name)))


def _sources() -> dict[str, Path]:
    return {p.stem.replace("_", " "): p for folder in __path__ for p in Path(folder).glob("[a-z]*.py")}


def load(name: str) -> Command[Any]:
    """Import the module of a command."""
    with _without_collecting():
        return importlib.import_module(f"{__name__}.{module(name)}").COMMAND


@contextmanager
def _without_collecting() -> Generator[None]:
    """Keep Python from looking for what may go: what imports make stays, and looks take a seventh of the time."""
    collecting = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collecting:
            gc.enable()


def module(name: str) -> str:
    """Return the module's name of a command: `blind_make` of `blind make`."""
    return name.replace(" ", "_")


def description(name: str) -> str:
    """Return the docstring of a command's module, without importing it."""
    return ast.get_docstring(ast.parse(_sources()[name].read_text(encoding="utf-8"))) or ""
