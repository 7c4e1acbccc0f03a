"""What there is to choose from, in words: effects, forces, estimators, experiments, systems, formats of logs, numbers.

All of it is read from the things themselves: docstrings, the first line of a file in `conf/`, the methods by which an
effect describes itself. Most of them take their time to import, so only those are that are asked for.
"""

from __future__ import annotations

import inspect
import itertools
from collections.abc import Sequence
from enum import Enum
from pathlib import Path
from typing import Any

from runner.commands._compose import config_dir


class Kind(Enum):
    """What can be listed."""

    effects = "effects"
    forces = "forces"
    estimators = "estimators"
    experiments = "experiments"
    systems = "systems"
    formats = "formats"
    numbers = "numbers"


GROUPS = {Kind.forces: "forces", Kind.estimators: "estimator", Kind.experiments: "experiment"}
Rows = Sequence[tuple[str, ...]]


def listed(kind: Kind, config_dirs: Sequence[Path] = ()) -> tuple[Sequence[str], Rows]:
    """Return heading and rows of what there is of a kind, in folders of configs of the user's own, too."""
    if kind in GROUPS:
        return (GROUPS[kind], "what it is"), [(file.stem, told(file)) for file in files(kind, config_dirs)]
    return {Kind.effects: _effects, Kind.systems: _systems, Kind.formats: _formats, Kind.numbers: _numbers}[kind]()


def _effects() -> tuple[Sequence[str], Rows]:
    from runner.commands._described import labels

    return ("effect", "of", "what differs"), labels()


def _systems() -> tuple[Sequence[str], Rows]:
    from runner.systems.mechanism import system as mechanism
    from runner.systems.planar_box import system as planar_box

    return ("system", "what it is"), [("planar_box", _first(planar_box)), ("mechanism", _first(mechanism))]


def _formats() -> tuple[Sequence[str], Rows]:
    from runner.importing.readers import READERS

    return ("format", "how it is read"), [
        *((ending, _first(reader)) for ending, reader in READERS.items()),
        ("folder", "Of a LeRobot data set, of a bag of ROS 2, or of files of one format."),
    ]


def _numbers() -> tuple[Sequence[str], Rows]:
    from runner.settings import SETTINGS
    from runner.settings.declared import by_stage
    from runner.systems.mechanism.settings import MECHANISM

    every = [*by_stage(SETTINGS), *((f"mechanism.{stage}", one) for stage, one in by_stage(MECHANISM))]
    return ("number", "what it is, and why"), [
        (f"{stage}.{one.name}", f"{one.text} {one.unit}. {one.reason}") for stage, one in every
    ]


def files(kind: Kind, config_dirs: Sequence[Path] = ()) -> list[Path]:
    """Return the files in `conf/` of a kind that is chosen by name, and those in further folders of configs."""
    groups = [folder / GROUPS[kind] for folder in (config_dir(), *config_dirs)] if kind in GROUPS else []
    by_name = {file.stem: file for group in reversed(groups) for file in group.glob("*.yaml")}  # conf/ wins
    return [by_name[name] for name in sorted(by_name)]


def told(file: Path) -> str:
    """Return the comment that a file in `conf/` begins with."""
    lines = [line for line in file.read_text(encoding="utf-8").splitlines() if not line.startswith("# @package")]
    return " ".join(line[1:].strip() for line in itertools.takewhile(lambda line: line.startswith("#"), lines))


def names(config_dirs: Sequence[Path] = ()) -> tuple[str, ...]:
    """Return all names that can be shown."""
    of_files = [file.stem for kind in GROUPS for file in files(kind, config_dirs)]
    return tuple(dict.fromkeys([*(row[0] for row in _effects()[1]), *of_files]))


def _first(thing: Any) -> str:
    return (inspect.getdoc(thing) or "").split("\n\n")[0].replace("\n", " ")
