"""A recording's clock."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Self

import mujoco

from runner.effects.base import Parameter, Phrase, Vector
from runner.effects.mechanism.base import MechanismEffect, Scope, effect
from runner.effects.wording import Values, number
from runner.errors import check_range


@effect
@dataclass(frozen=True)
class ClockScale(MechanismEffect):
    """The recording's clock shows `ratio` seconds in a true second: above 1 it runs fast. Fitted as the log.

    Commands and channels have the one clock. Each physics step, a fixed part of the time between stamps, lasts
    1 / `ratio` of its length.
    """

    name: ClassVar[str] = "clock_scale"
    label: ClassVar[str] = "a clock that runs fast or slow"
    target_kind: ClassVar[str] = ""
    of_sensor: ClassVar[bool] = True
    commonness: ClassVar[int] = 2
    ratio: float

    def __post_init__(self) -> None:
        check_range("clock_scale.ratio", self.ratio, 0.01, 100.0)

    def edit_model(self, model: mujoco.MjModel) -> None:
        model.opt.timestep /= self.ratio

    @classmethod
    def parameters(cls, context: Scope) -> tuple[Parameter, ...]:
        # of samples that are counted by a nominal rate; quartz is a hundred times as good
        return (Parameter("log_ratio", "", 0.02, -0.5, 0.5, light_tailed=True),)

    @classmethod
    def from_vector(cls, x: Vector, context: Scope) -> Self:
        return cls(math.exp(x[0]))

    @classmethod
    def phrase(cls, of: Values, beliefs: Scope, target: str | None = None) -> Phrase:
        return Phrase(
            f"the recording's clock runs {'fast' if of['ratio'] > 1 else 'slow'}",
            f"it shows {of.show('ratio')} s in a second",
            f"Divide the times of the recording by {number(of['ratio'], 5)}.",
            "Record for ten minutes beside a clock that is right.",
        )
