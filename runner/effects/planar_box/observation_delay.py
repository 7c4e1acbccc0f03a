"""A measurement that is older than its time stamp."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from runner.effects.base import Confounded, Parameter, Phrase, Stage, Vector
from runner.effects.planar_box.base import Beliefs, Context, Motion, PlanarEffect, ahead, effect, late
from runner.effects.wording import Values, number
from runner.errors import check_range


@effect
@dataclass(frozen=True)
class ObservationDelay(PlanarEffect):
    """The measured state is `delay_s` older than its time stamp.

    The state at the first time stamp is then that of `delay_s` before any command: for an observer it is the same as
    a command that comes late, and is simulated so.
    """

    name: ClassVar[str] = "observation_delay"
    label: ClassVar[str] = "a measurement that is older than its time stamp"
    stage: ClassVar[Stage] = Stage.TIMING
    of_sensor: ClassVar[bool] = True
    confounded: ClassVar[tuple[Confounded, ...]] = (
        Confounded(
            "actuator_delay",
            "all that is measured comes later after the command, by the same time",
            "Add an event that is timed by itself, such as an impact or a second sensor: only a late measurement "
            "shifts it.",
        ),
    )
    delay_s: float

    def __post_init__(self) -> None:
        check_range("observation_delay.delay_s", self.delay_s, 0.0, 100.0, unit="s")

    def edit_command(self, columns: np.ndarray, step_s: float) -> np.ndarray:
        return late(columns, self.delay_s, step_s)

    def edit_pin(self, path: np.ndarray, step_s: float) -> np.ndarray:
        return late(path, self.delay_s, step_s, before=path[0])

    def edit_measurement(self, motion: Motion) -> Motion:
        return ahead(motion, self.delay_s)

    @classmethod
    def parameters(cls, context: Context) -> tuple[Parameter, ...]:
        return (Parameter("delay_s", "s", 0.08, 0.0, 1.0),)

    @classmethod
    def from_vector(cls, x: Vector, context: Context) -> Self:
        return cls(max(x[0], 0.0))

    @classmethod
    def phrase(cls, of: Values, beliefs: Beliefs, target: str | None = None) -> Phrase:
        return Phrase(
            "the measured state is older than its time stamp",
            f"by {of.show('delay_s', 'ms', 1e3)}",
            f"Delay the simulated measurement by {number(1e3 * of['delay_s'])} ms, or correct the time stamps.",
            "Measure the latency of the tracker with a motion whose time is known.",
        )
