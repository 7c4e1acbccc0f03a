"""An actuator that follows its command with a lag."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from runner.effects.base import Parameter, Phrase, Stage, Vector, longer_than_commands
from runner.effects.mechanism.base import Command, MechanismEffect, Scope, effect
from runner.effects.wording import Values
from runner.errors import check_range
from runner.numerics.recursive_filter import filtered


@effect
@dataclass(frozen=True)
class ActuatorLag(MechanismEffect):
    """What an actuator gets follows its command with a first-order lag, exact for a command held over a step."""

    name: ClassVar[str] = "actuator_lag"
    shared: ClassVar[bool] = True
    label: ClassVar[str] = "an actuator that follows with a lag"
    stage: ClassVar[Stage] = Stage.TIMING
    target_kind: ClassVar[str] = "actuator"
    target: str
    time_constant_s: float

    def __post_init__(self) -> None:
        check_range("actuator_lag.time_constant_s", self.time_constant_s, 0.0, 100.0, unit="s")

    def edit_command(self, command: Command) -> Command:
        if self.time_constant_s < 1e-6:
            return command
        column, before = command.columns[self.target], command.before[self.target]
        decay = math.exp(-command.step_s / self.time_constant_s)
        after = before + filtered(column - before, 1 - decay, 0.0, decay)
        at_start = np.concatenate([[before], after[:-1]])
        mean = column + (at_start - column) * (self.time_constant_s / command.step_s) * (1 - decay)
        return replace(command, columns={**command.columns, self.target: mean})

    @classmethod
    def parameters(cls, context: Scope) -> tuple[Parameter, ...]:
        return (Parameter("time_constant_s", "s", 0.03, 0.0, min(2.0, context.length_s)),)

    @classmethod
    def sizes(cls, context: Scope) -> np.ndarray:
        return longer_than_commands(*cls.parameters(context))

    @classmethod
    def from_vector(cls, x: Vector, context: Scope) -> Self:
        return cls(str(context.target), max(float(x[0]), 0.0))

    @classmethod
    def phrase(cls, of: Values, beliefs: Scope, target: str | None = None) -> Phrase:
        return Phrase(
            f"actuator '{target}' follows its command with a lag",
            f"time constant {of.show('time_constant_s', 'ms', 1e3)}",
            f'Set dyntype="filterexact" dynprm="{of["time_constant_s"]:.4g}" on actuator \'{target}\'.',
            f"Command a step to '{target}' and record its current: it reaches 63 % after that time.",
        )
