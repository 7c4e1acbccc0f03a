"""A measurement's zero."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, Self

from runner.effects.base import Parameter, Phrase, Stage, Vector
from runner.effects.mechanism.base import MechanismEffect, Reading, Scope, effect
from runner.effects.wording import Values
from runner.errors import check_range


@effect
@dataclass(frozen=True)
class SensorOffset(MechanismEffect):
    """A channel shows the true value plus `offset`, in its unit."""

    name: ClassVar[str] = "sensor_offset"
    label: ClassVar[str] = "a measurement whose zero is off"
    stage: ClassVar[Stage] = Stage.APPLICATION
    target_kind: ClassVar[str] = "channel"
    of_sensor: ClassVar[bool] = True
    target: str
    offset: float

    def __post_init__(self) -> None:
        check_range("sensor_offset.offset", self.offset, -1e12, 1e12)

    def edit_reading(self, reading: Reading) -> Reading:
        if self.offset == 0.0:
            return reading
        return replace(reading, channels={**reading.channels, self.target: reading.channels[self.target] + self.offset})

    @classmethod
    def applies(cls, scope: Scope) -> bool:
        return scope.signal.get(scope.target or "", 0.0) > 0.0

    @classmethod
    def parameters(cls, context: Scope) -> tuple[Parameter, ...]:
        signal = context.signal[str(context.target)]
        return (Parameter("offset", "", 0.1 * signal, -5 * signal, 5 * signal),)

    @classmethod
    def from_vector(cls, x: Vector, context: Scope) -> Self:
        return cls(str(context.target), float(x[0]))

    @classmethod
    def units(cls, context: Scope) -> Mapping[str, str]:
        return {"offset": f"unit of {context.target}"}

    @classmethod
    def phrase(cls, of: Values, beliefs: Scope, target: str | None = None) -> Phrase:
        return Phrase(
            f"the zero of channel '{target}' is off",
            f"it shows {of.show('offset')} too much, in its unit",
            f"Subtract {of['offset']:.4g} from '{target}' when recording, or shift the ref of its joint.",
            f"Bring the mechanism to a posture that is known, such as a stop, and read '{target}'.",
        )
