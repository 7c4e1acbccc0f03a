"""A measurement that is older than its time stamp."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from runner.effects.base import Confounded, Phrase
from runner.effects.planar_box.base import Beliefs, effect
from runner.effects.planar_box.delay import Delay, confounded_with
from runner.effects.wording import Values, number
from runner.errors import check_range


@effect
@dataclass(frozen=True)
class ObservationDelay(Delay):
    """The measured state is `delay_s` older than its time stamp.

    The state at the first time stamp is then that of `delay_s` before any command: for an observer it is the same as
    a command that comes late, and is simulated so.
    """

    name: ClassVar[str] = "observation_delay"
    label: ClassVar[str] = "a measurement that is older than its time stamp"
    of_sensor: ClassVar[bool] = True
    confounded: ClassVar[tuple[Confounded, ...]] = confounded_with("actuator_delay")

    def __post_init__(self) -> None:
        check_range("observation_delay.delay_s", self.delay_s, 0.0, 100.0, unit="s")

    @classmethod
    def phrase(cls, of: Values, beliefs: Beliefs, target: str | None = None) -> Phrase:
        return Phrase(
            "the measured state is older than its time stamp",
            f"by {of.show('delay_s', 'ms', 1e3)}",
            f"Delay the simulated measurement by {number(1e3 * of['delay_s'])} ms, or correct the time stamps.",
            "Measure the latency of the tracker with a motion whose time is known.",
        )
