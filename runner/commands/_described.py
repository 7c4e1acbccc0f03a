"""Effects in words: every variant with its priors and its phrase, about a box, an arm or a cube of usual size."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from runner.effects import mechanism, planar_box
from runner.effects.base import AbstractEffect, Parameter, Phrase
from runner.effects.wording import Values
from runner.recording import Nominal

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


def labels() -> list[tuple[str, str, str]]:
    """Return the name of every effect, what it is of, and what differs, sorted."""
    found = [(name, _of(system, cls), cls.label) for name, system, cls in _effects()]
    return list(dict.fromkeys(sorted(found)))


def described(name: str) -> list[Described]:
    """Return every variant of an effect, of all kinds of systems; none: there is no such effect."""
    return [_described(system, cls) for other, system, cls in _effects() if other == name]


def _effects() -> Iterator[tuple[str, str, type[AbstractEffect]]]:
    yield from ((name, BOX, cls) for name, variants in planar_box.EFFECTS.items() for cls in variants)
    yield from ((cls.name, MECHANISM, cls) for cls in mechanism.EFFECTS)


def _of(system: str, cls: type[AbstractEffect]) -> str:
    return "box" if system == BOX else getattr(cls, "target_kind", "") or "mechanism"


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
