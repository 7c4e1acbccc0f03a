"""Effects of a mechanism: where they act, and what they may know of it.

An effect has a `target` field where it changes one of several things of a kind: the name of a joint, body, actuator or
channel. It acts at up to four places, each a method that does nothing unless overridden:

    edit_spec     elements that must exist before compiling: a drive behind a joint, a spring (set `structural`)
    edit_model    numbers of the compiled model: mass, damping, gains, the numbers of the compiled joint law
    edit_command  the recorded commands, outside the engine: means over physics steps
    edit_reading  the predicted channels, outside the engine

A structural effect may add joints. `follows` tells a simulator which joint each of them moves with, `edit_start` puts
them where they are when an episode or window begins.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, TypeVar

import mujoco
import numpy as np

from runner.effects.base import AbstractEffect


@dataclass(frozen=True)
class Command:
    """What is sent to the actuators, in their units.

    Args:
        step_s: Length of a physics step.
        columns: Mean over each step of an episode, by actuator: (n,) each.
        before: What was commanded before the episode began, by actuator: 0, or a servo's first target.
    """

    step_s: float
    columns: Mapping[str, np.ndarray]
    before: Mapping[str, float]


@dataclass(frozen=True)
class Reading:
    """What the channels show, on the grid of physics steps: time (n,), and each channel (..., n) by name.

    `held_before` says whether the mechanism was held in the first state until then, as at the start of an episode that
    begins at rest; otherwise it was under way.
    """

    t_s: np.ndarray
    channels: Mapping[str, np.ndarray]
    held_before: bool = False


@dataclass(frozen=True)
class Scope:
    """What may be known of a mechanism, and of one target of it, when an effect is made from a vector.

    Args:
        model: As its owner believes it, compiled; not to be written to.
        target: The name of the joint, body, actuator or channel; None: the whole.
        speed: Typical speed of each joint in the recording (root mean square, by name), rad/s or m/s.
        reach: Half the range that each joint visited, rad or m.
        force: Typical force or torque that moved each joint, N or N m: from inverse dynamics of the recorded motion.
        command: Largest size of each actuator's command, in its unit.
        demand: Largest force that each actuator is asked for, before its gear and any limit, N or N m.
        signal: Standard deviation of each channel over the recording, in its unit.
        length_s: Of the longest episode.
        step_s: Usual time from one sample to the next.
        pushed: Bodies that a recorded force acts on.
    """

    model: mujoco.MjModel
    target: str | None
    speed: Mapping[str, float]
    reach: Mapping[str, float]
    force: Mapping[str, float]
    command: Mapping[str, float]
    demand: Mapping[str, float]
    signal: Mapping[str, float]
    length_s: float
    step_s: float
    pushed: frozenset[str] = frozenset()

    def at(self, target: str | None) -> Scope:
        """Return what is known of a target."""
        return replace(self, target=target)


JointUnit = Callable[[mujoco.MjModel, str | None], str]  # from a model and the name of a joint to a unit


class MechanismEffect(AbstractEffect):
    """A difference between a mechanism and its model; see the module's docstring."""

    target_kind: ClassVar[str] = "joint"  # joint | body | actuator | channel | "" for what has no target
    # numbers whose unit hangs on whether the joint turns, each with what tells it
    of_joint: ClassVar[Mapping[str, JointUnit]] = {}

    @property
    def follows(self) -> Mapping[str, str]:
        """The joints that `edit_spec` adds, each with the one whose position and speed it starts with."""
        return {}

    @property
    def skeleton(self) -> MechanismEffect:
        """The effect as far as it adds elements: those of equal ones are compiled once."""
        return self

    def swings_rad_s(self, model: mujoco.MjModel) -> float:
        """Return the natural frequency of a spring that `edit_spec` has put into a model; 0: there is none."""
        return 0.0

    def edit_spec(self, spec: mujoco.MjSpec) -> None:
        """Add the elements that the effect needs. Names of joints, bodies and actuators must go on meaning the same."""

    def edit_model(self, model: mujoco.MjModel) -> None:
        """Write the effect's numbers into a compiled model that holds the nominal ones (and the spec's elements).

        Its time step is the one that will be simulated, which an effect may change. Derived constants are computed anew
        after all effects (`mj_setConst`); bodies are compiled with `simple="false"`, and `joint_law.reserve` has made
        room.
        """

    def edit_start(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Set positions and speeds of the joints that the effect has added, better than those that they follow.

        `data` has those of all others, the commands and the time of the start; what follows from them is overwritten.
        """

    def edit_command(self, command: Command) -> Command:
        """Return the commands that the actuators really get."""
        return command

    def edit_written(self, spec: mujoco.MjSpec) -> None:
        """Give a model file what MuJoCo itself does of an effect that acts outside the engine here."""

    def edit_reading(self, reading: Reading) -> Reading:
        """Return what the sensors report of what they should."""
        return reading

    @classmethod
    def units(cls, context: Scope) -> Mapping[str, str]:
        """See the base class."""
        told = {name: unit(context.model, context.target) for name, unit in cls.of_joint.items()}
        return {**super().units(context), **told}

    @classmethod
    def applies(cls, scope: Scope) -> bool:
        """Whether the effect can be at work on this target at all: dry friction of a joint that has one, ..."""
        return True


EFFECTS: list[type[MechanismEffect]] = []


E = TypeVar("E", bound=type[MechanismEffect])


def effect(cls: E) -> E:
    """Enter an effect class into the vocabulary of mechanisms."""
    EFFECTS.append(cls)
    return cls
