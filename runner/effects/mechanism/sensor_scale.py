"""A measurement's scale."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar, Self

from runner.effects.base import Parameter, Phrase, Stage, Vector
from runner.effects.mechanism.base import MechanismEffect, Reading, Scope, effect
from runner.effects.wording import Values, number
from runner.errors import check_range


@effect
@dataclass(frozen=True)
class SensorScale(MechanismEffect):
    """A channel shows `ratio` times the true value. Fitted as its log."""

    name: ClassVar[str] = "sensor_scale"
    label: ClassVar[str] = "a measurement that is a multiple of the true value"
    stage: ClassVar[Stage] = Stage.GAIN
    target_kind: ClassVar[str] = "channel"
    of_sensor: ClassVar[bool] = True
    target: str
    ratio: float

    def __post_init__(self) -> None:
        check_range("sensor_scale.ratio", self.ratio, 0.0, 1e3, lower_open=True)

    def edit_reading(self, reading: Reading) -> Reading:
        if self.ratio == 1.0:
            return reading
        return replace(reading, channels={**reading.channels, self.target: self.ratio * reading.channels[self.target]})

    @classmethod
    def applies(cls, scope: Scope) -> bool:
        return scope.signal.get(scope.target or "", 0.0) > 0.0

    @classmethod
    def parameters(cls, context: Scope) -> tuple[Parameter, ...]:
        return (Parameter("log_ratio", "", 0.05, -1.0, 1.0),)

    @classmethod
    def from_vector(cls, x: Vector, context: Scope) -> Self:
        return cls(str(context.target), math.exp(x[0]))

    @classmethod
    def phrase(cls, of: Values, beliefs: Scope, target: str | None = None) -> Phrase:
        return Phrase(
            f"channel '{target}' shows {'more' if of['ratio'] > 1 else 'less'} than there is",
            f"{of.show('ratio')} times the true value",
            f"Divide '{target}' by {number(of['ratio'], 5)} when recording.",
            f"Move by a known amount, such as a whole turn or half a metre, and read '{target}'.",
        )
