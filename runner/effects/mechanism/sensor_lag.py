"""A measurement that is filtered."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from runner.effects.base import Parameter, Phrase, Stage, Vector
from runner.effects.mechanism.base import MechanismEffect, Reading, Scope, effect
from runner.effects.wording import Values
from runner.errors import check_range
from runner.numerics.recursive_filter import filtered


@effect
@dataclass(frozen=True)
class SensorLag(MechanismEffect):
    """A channel follows the true value with a first-order lag, exact for a value that is linear over each step.

    Before the first sample it has followed a steady change, or a steady value where the mechanism was held until then
    (`Reading.held_before`).
    """

    name: ClassVar[str] = "sensor_lag"
    label: ClassVar[str] = "a measurement that is filtered"
    stage: ClassVar[Stage] = Stage.TIMING
    target_kind: ClassVar[str] = "channel"
    of_sensor: ClassVar[bool] = True
    target: str
    time_constant_s: float

    def __post_init__(self) -> None:
        check_range("sensor_lag.time_constant_s", self.time_constant_s, 0.0, 100.0, unit="s")

    def edit_reading(self, reading: Reading) -> Reading:
        true = reading.channels[self.target]
        if self.time_constant_s < 1e-6 or true.shape[-1] < 2:
            return reading
        tau, step = self.time_constant_s, float(reading.t_s[1] - reading.t_s[0])
        decay = math.exp(-step / tau)
        rise = (tau / step) * (1 - decay)
        # y[k+1] = decay y[k] + (rise - decay) x[k] + (1 - rise) x[k+1]
        behind = np.zeros(true.shape[:-1]) if reading.held_before else tau * (true[..., 1] - true[..., 0]) / step
        start = true[..., 0] - behind
        shown = filtered(true, 1 - rise, rise - decay, decay, start - (1 - rise) * true[..., 0])
        return replace(reading, channels={**reading.channels, self.target: shown})

    @classmethod
    def applies(cls, scope: Scope) -> bool:
        return scope.signal.get(scope.target or "", 0.0) > 0.0

    @classmethod
    def parameters(cls, context: Scope) -> tuple[Parameter, ...]:
        return (Parameter("time_constant_s", "s", 0.03, 0.0, min(1.0, 0.5 * context.length_s)),)

    @classmethod
    def from_vector(cls, x: Vector, context: Scope) -> Self:
        return cls(str(context.target), max(float(x[0]), 0.0))

    @classmethod
    def phrase(cls, of: Values, beliefs: Scope, target: str | None = None) -> Phrase:
        return Phrase(
            f"channel '{target}' follows the true value with a lag, as a filter makes it",
            f"time constant {of.show('time_constant_s', 'ms', 1e3)}",
            f"Look for a low-pass filter of {0.16 / max(of['time_constant_s'], 1e-9):.3g} Hz on '{target}' and record "
            "what comes before it, or filter the simulated value alike.",
            f"Stop the mechanism suddenly and see how long '{target}' goes on.",
        )
