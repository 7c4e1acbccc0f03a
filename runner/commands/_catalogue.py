"""What there is to choose from, in words: effects, forces, estimators, experiments, systems, formats of logs, numbers.

All of it is read from the things themselves: docstrings, the first line of a file in `conf/`, the methods by which an
effect describes itself.
"""

from __future__ import annotations

import inspect
import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from runner.commands._compose import config_dir
from runner.effects import mechanism, planar_box
from runner.effects.base import AbstractEffect, Parameter, Phrase
from runner.effects.wording import Values
from runner.importing.readers import READERS
from runner.recording import Nominal
from runner.settings import SETTINGS
from runner.settings.declared import by_stage
from runner.systems.mechanism import system as mechanism_system
from runner.systems.mechanism.settings import MECHANISM as OF_MECHANISMS
from runner.systems.planar_box import system as planar_box_system

BOX, MECHANISM = "planar_box", "mechanism"
# words, values and priors of effects need something that they are about
BOX_EXAMPLE = "a box of 3 kg on a floor with friction 0.3 that is pushed with 20 N within 2 m"
ARM_EXAMPLE = "an arm whose elbow moves by ±1 rad at 1 rad/s with 1 N m"
ARM = """<mujoco><worldbody><body name="upper"><joint name="shoulder" axis="0 1 0"/>
<inertial pos="0 0 -.15" mass="1" diaginertia=".01 .01 .01"/><body name="forearm" pos="0 0 -.3">
<joint name="elbow" axis="0 1 0" damping=".05" frictionloss=".1" armature=".01"/>
<inertial pos="0 0 -.15" mass=".5" diaginertia=".005 .005 .005"/></body></body></worldbody>
<actuator><motor name="shoulder" joint="shoulder"/><position name="elbow" joint="elbow" kp="10" kv="1"/></actuator>
</mujoco>"""
CUBE_EXAMPLE = "a cube of 1 kg and 10 cm that is tossed onto a table"
CUBE = """<mujoco><worldbody><geom type="plane" size="1 1 1"/><body name="cube" pos="0 0 1"><freejoint name="cube"/>
<geom type="box" size=".05 .05 .05" mass="1" friction="0.3" priority="1"/></body></worldbody></mujoco>"""
TARGETS = {"joint": "elbow", "body": "forearm", "actuator": "elbow", "channel": "q_elbow", "": None}


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
Rows = list[tuple[str, ...]]


@dataclass(frozen=True)
class Described:
    """A variant of an effect.

    Args:
        effect: The class.
        system: The kind of system that it may be at work in.
        target: What it changes one of: joint, body, actuator, channel; "": there is nothing to choose.
        example: What the priors and the phrase are about.
        parameters: As they are fitted.
        phrase: In words, with values of usual size.
    """

    effect: type[AbstractEffect]
    system: str
    target: str
    example: str
    parameters: tuple[Parameter, ...]
    phrase: Phrase

    @property
    def named(self) -> str:
        """How a verdict names it."""
        return f"{self.effect.name}[{self.target.upper()}]" if self.target else self.effect.name


def listed(kind: Kind, config_dirs: Sequence[Path] = ()) -> tuple[Sequence[str], Rows]:
    """Return heading and rows of what there is of a kind, in folders of configs of the user's own, too."""
    if kind is Kind.effects:
        found: Rows = [(name, _of(system, cls), cls.label) for name, system, cls in _effects()]
        return ("effect", "of", "what differs"), list(dict.fromkeys(sorted(found)))
    if kind is Kind.systems:
        modules = {BOX: planar_box_system, MECHANISM: mechanism_system}
        return ("system", "what it is"), [(name, _first(module)) for name, module in modules.items()]
    if kind is Kind.formats:
        return ("format", "how it is read"), [
            *((ending, _first(reader)) for ending, reader in READERS.items()),
            ("folder", "Of a LeRobot data set, of a bag of ROS 2, or of files of one format."),
        ]
    if kind is Kind.numbers:
        every = [*by_stage(SETTINGS), *((f"{MECHANISM}.{stage}", one) for stage, one in by_stage(OF_MECHANISMS))]
        return ("number", "what it is, and why"), [
            (f"{stage}.{one.name}", f"{one.text} {one.unit}. {one.reason}") for stage, one in every
        ]
    return (GROUPS[kind], "what it is"), [(file.stem, told(file)) for file in files(kind, config_dirs)]


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
    return tuple(dict.fromkeys([*sorted({name for name, _, _ in _effects()}), *of_files]))


def described(name: str) -> list[Described]:
    """Return every variant of an effect, of all kinds of systems; none: there is no such effect."""
    return [_described(system, cls) for other, system, cls in _effects() if other == name]


def _effects() -> Iterator[tuple[str, str, type[AbstractEffect]]]:
    yield from ((name, BOX, cls) for name, variants in planar_box.EFFECTS.items() for cls in variants)
    yield from ((cls.name, MECHANISM, cls) for cls in mechanism.EFFECTS)


def _of(system: str, cls: type[AbstractEffect]) -> str:
    return "box" if system == BOX else getattr(cls, "target_kind", "") or "mechanism"


def _first(thing: Any) -> str:
    return (inspect.getdoc(thing) or "").split("\n\n")[0].replace("\n", " ")


def _described(system: str, cls: type[AbstractEffect]) -> Described:
    beliefs: Any
    context: Any
    if system == BOX:
        half = (0.5, 0.5, 0.5)
        beliefs, target, of, example = Nominal(half, 3.0, 0.3, 9.81, 60.0), "", None, BOX_EXAMPLE
        context = planar_box.Context(3.0, 0.3, half, 9.81)
    else:
        target = str(getattr(cls, "target_kind", ""))
        beliefs, example = _arm(), ARM_EXAMPLE
        of = TARGETS[target]
        of_arm = not issubclass(cls, mechanism.MechanismEffect) or cls.applies(beliefs.at(of))
        if target in ("body", "") and not of_arm:
            beliefs, example = _cube(), CUBE_EXAMPLE
            of = "cube" if target else None
        context = beliefs.at(of)
    parameters, starts = cls.parameters(context), cls.starts(context)
    x = starts[len(starts) // 2] if len(starts) else np.array([p.scale for p in parameters])
    x = np.clip(x, [p.lower for p in parameters], [p.upper for p in parameters])
    values = Values(cls.from_vector(x, context).report(), {})
    return Described(cls, system, target, example, parameters, cls.phrase(values, beliefs, of))


def _arm() -> mechanism.Scope:
    joints = {"shoulder": 1.0, "elbow": 1.0}
    return _scope(ARM, joints, {"q_elbow": 1.0})


def _cube() -> mechanism.Scope:
    return _scope(CUBE, {}, {"x": 1.0})


def _scope(xml: str, joints: dict[str, float], signal: dict[str, float]) -> mechanism.Scope:
    return mechanism.Scope(
        model=mujoco.MjModel.from_xml_string(xml),
        target=None,
        speed=joints,
        reach=joints,
        force=joints,
        command=joints,
        demand=joints,
        signal=signal,
        length_s=5.0,
        step_s=0.01,
    )
