"""Measurements that do not belong to the time of their stamp."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from runner.effects.base import Confounded, Parameter, Phrase, Stage, Vector
from runner.effects.mechanism.actuator_delay import looked_at, shifted
from runner.effects.mechanism.base import Command, MechanismEffect, Scope, effect
from runner.effects.wording import Values
from runner.errors import check_range


@effect
@dataclass(frozen=True)
class ObservationDelay(MechanismEffect):
    """The measured state is `delay_s` older than its time stamp; younger, where that is negative.

    The state of the first stamp is then that of `delay_s` before, and goes on under the commands of before: the same as
    all commands that come late, and simulated so.
    """

    name: ClassVar[str] = "observation_delay"
    label: ClassVar[str] = "measurements that are older, or younger, than their time stamps"
    stage: ClassVar[Stage] = Stage.TIMING
    target_kind: ClassVar[str] = ""
    of_sensor: ClassVar[bool] = True
    commonness: ClassVar[int] = 2
    confounded: ClassVar[tuple[Confounded, ...]] = (
        Confounded(
            "actuator_delay",
            "with one actuator, a command that comes late shows the same as a measurement that is late",
            "Hit the mechanism by hand at a time that both clocks know: only a late measurement shows it late.",
        ),
    )
    delay_s: float

    def __post_init__(self) -> None:
        check_range("observation_delay.delay_s", self.delay_s, -100.0, 100.0, unit="s")

    def edit_command(self, command: Command) -> Command:
        if self.delay_s == 0.0:
            return command
        late = {
            name: shifted(column, command.before[name], self.delay_s, command.step_s)
            for name, column in command.columns.items()
        }
        return replace(command, columns=late)

    @classmethod
    def applies(cls, scope: Scope) -> bool:
        return scope.model.nu > 0

    @classmethod
    def parameters(cls, context: Scope) -> tuple[Parameter, ...]:
        most = min(1.0, 0.5 * context.length_s)
        return (Parameter("delay_s", "s", 0.03, -most, most),)

    @classmethod
    def sizes(cls, context: Scope) -> np.ndarray:
        return looked_at(context, cls.parameters(context)[0].upper)

    @classmethod
    def from_vector(cls, x: Vector, context: Scope) -> Self:
        return cls(float(x[0]))

    @classmethod
    def phrase(cls, of: Values, beliefs: Scope, target: str | None = None) -> Phrase:
        older = of["delay_s"] > 0
        return Phrase(
            f"measurements are {'older' if older else 'younger'} than their time stamps",
            # a table shows this beside the label, which says both
            of.show("delay_s", "ms", 1e3, magnitude=True) + ("" if older else " younger"),
            f"Shift the stamps of all channels by {-1e3 * of['delay_s']:+.3g} ms against those of the commands.",
            "Hit the mechanism by hand at a time that both clocks know.",
        )
