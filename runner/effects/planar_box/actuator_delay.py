"""A push that comes late."""

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
class ActuatorDelay(Delay):
    """The command takes effect `delay_s` late."""

    name: ClassVar[str] = "actuator_delay"
    label: ClassVar[str] = "a push that comes late"
    commonness: ClassVar[int] = 0
    confounded: ClassVar[tuple[Confounded, ...]] = confounded_with("observation_delay")

    def __post_init__(self) -> None:
        check_range("actuator_delay.delay_s", self.delay_s, 0.0, 100.0, unit="s")

    @classmethod
    def phrase(cls, of: Values, beliefs: Beliefs, target: str | None = None) -> Phrase:
        return Phrase(
            "the push comes later than commanded",
            f"by {of.show('delay_s', 'ms', 1e3)}",
            f"Delay every command by {number(1e3 * of['delay_s'])} ms.",
            "Compare the time stamps of a command and of the first motion after it, filmed with one clock in view.",
        )
