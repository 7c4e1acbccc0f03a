"""A command that takes effect late."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import mujoco
import numpy as np

from runner.effects.base import Confounded, Parameter, Phrase, Stage, Vector
from runner.effects.mechanism.base import Command, MechanismEffect, Scope, effect
from runner.effects.wording import Values
from runner.errors import check_range

LINEAR = 1  # MuJoCo's `interp`, of a command between two steps
SHORTER = 10.0  # a replay of a corrected model may need steps so many times as short as those of its file
SAMPLES = np.array([1.0, 4.0, 16.0])  # delays, in sample periods, at which is looked what one does


def shifted(column: np.ndarray, before: float, delay_s: float, step_s: float) -> np.ndarray:
    """Return means over steps (n,) of a command that comes late (or early: then its end is held).

    A part of a step is shared between two: exact for a command that changes at steps.
    """
    steps = delay_s / step_s
    whole = int(np.floor(steps + 1e-9))
    part = max(steps - whole, 0.0) if abs(steps - round(steps)) > 1e-9 else 0.0
    index = np.arange(len(column)) - whole

    def at(i: np.ndarray) -> np.ndarray:
        return np.where(i < 0, before, column[np.clip(i, 0, len(column) - 1)])

    return at(index) if part == 0.0 else (1.0 - part) * at(index) + part * at(index - 1)


def looked_at(context: Scope, most_s: float) -> np.ndarray:
    """Return delays at which is looked what one does, (k, 1), the longest half of the most that there may be."""
    return np.minimum(SAMPLES * context.step_s, 0.5 * most_s)[:, None]


@effect
@dataclass(frozen=True)
class ActuatorDelay(MechanismEffect):
    """The command of an actuator takes effect `delay_s` late; a position servo gets its target late."""

    name: ClassVar[str] = "actuator_delay"
    shared: ClassVar[bool] = True
    label: ClassVar[str] = "a command that comes late"
    stage: ClassVar[Stage] = Stage.TIMING
    target_kind: ClassVar[str] = "actuator"
    confounded: ClassVar[tuple[Confounded, ...]] = (
        Confounded(
            "observation_delay",
            "with one actuator, a command that comes late shows the same as a measurement that is late",
            "Hit the mechanism by hand at a time that both clocks know: only a late measurement shows it late.",
        ),
    )
    target: str
    delay_s: float

    def __post_init__(self) -> None:
        check_range("actuator_delay.delay_s", self.delay_s, 0.0, 100.0, unit="s")

    def edit_command(self, command: Command) -> Command:
        if self.delay_s == 0.0:
            return command
        late = shifted(command.columns[self.target], command.before[self.target], self.delay_s, command.step_s)
        return replace(command, columns={**command.columns, self.target: late})

    def edit_written(self, spec: mujoco.MjSpec) -> None:
        """Add to the actuator's own delay, for steps down to a tenth; between two steps the line counts, as here."""
        actuator = next(a for a in spec.actuators if a.name == self.target)
        actuator.delay += self.delay_s
        actuator.nsample = max(actuator.nsample, math.ceil(SHORTER * actuator.delay / spec.option.timestep - 1e-9) + 1)
        actuator.interp = LINEAR

    @classmethod
    def parameters(cls, context: Scope) -> tuple[Parameter, ...]:
        return (Parameter("delay_s", "s", 0.03, 0.0, min(1.0, 0.5 * context.length_s)),)

    @classmethod
    def sizes(cls, context: Scope) -> np.ndarray:
        return looked_at(context, cls.parameters(context)[0].upper)

    @classmethod
    def from_vector(cls, x: Vector, context: Scope) -> Self:
        return cls(str(context.target), max(float(x[0]), 0.0))

    @classmethod
    def phrase(cls, of: Values, beliefs: Scope, target: str | None = None) -> Phrase:
        return Phrase(
            f"what is commanded to actuator '{target}' takes effect late",
            of.show("delay_s", "ms", 1e3),
            f"Send the commands of '{target}' {of['delay_s']:.4g} s later, or set delay=\"{of['delay_s']:.4g}\" on the "
            "actuator and nsample to at least delay / timestep (fewer shorten the delay); mj_initCtrlHistory sets what "
            "is commanded before the first command, else 0.",
            f"Command a step to '{target}' and time the first motion with a fast camera that sees the sender's LED.",
        )
