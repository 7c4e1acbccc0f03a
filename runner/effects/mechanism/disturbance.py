"""A force on a joint that nobody commanded, for some time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import mujoco
import numpy as np

from runner.effects.base import Parameter, Phrase, Vector
from runner.effects.mechanism import parts
from runner.effects.mechanism.base import MechanismEffect, Scope, effect
from runner.effects.wording import Values
from runner.errors import check_range


@effect
@dataclass(frozen=True)
class Disturbance(MechanismEffect):
    """A constant `force` acts on a joint, N m or N, from one time of each episode until another.

    Time is that of mjData: a simulator starts it with the time since the episode began. Fitted by force, beginning and
    duration.
    """

    name: ClassVar[str] = "disturbance"
    label: ClassVar[str] = "a force that nobody commanded"
    of_joint: ClassVar = {"force": parts.force_unit}
    commonness: ClassVar[int] = 3
    target: str
    force: float
    from_s: float
    until_s: float

    def __post_init__(self) -> None:
        check_range("disturbance.force", self.force, -1e9, 1e9, unit="N m")
        check_range("disturbance.from_s", self.from_s, -1e9, 1e9, unit="s")
        check_range("disturbance.until_s", self.until_s, self.from_s, 1e9, unit="s")

    def edit_model(self, model: mujoco.MjModel) -> None:
        law = parts.law_of(model, self.target)
        law["push"], law["push_from"], law["push_until"] = self.force, self.from_s, self.until_s

    @classmethod
    def applies(cls, scope: Scope) -> bool:
        return parts.is_axis(scope.model, scope.target)

    @classmethod
    def parameters(cls, context: Scope) -> tuple[Parameter, ...]:
        force, whole = parts.typical_force(context), context.length_s
        return (
            Parameter("force", parts.force_unit(context.model, context.target), 0.3 * force, -10 * force, 10 * force),
            Parameter("from_s", "s", 0.3 * whole, 0.0, whole, may_rest=True),
            Parameter("duration_s", "s", 0.3 * whole, 0.0, whole, may_rest=True),
        )

    @classmethod
    def from_vector(cls, x: Vector, context: Scope) -> Self:
        begin = float(x[1])
        return cls(str(context.target), float(x[0]), begin, begin + max(float(x[2]), 0.0))

    @classmethod
    def starts(cls, context: Scope) -> np.ndarray:
        force, whole = cls.parameters(context)[0].scale, context.length_s
        return np.array(
            [[sign * force, part * whole, 0.25 * whole] for part in (0.0, 0.25, 0.5, 0.75) for sign in (-1.0, 1.0)]
        )

    @classmethod
    def elsewhere(cls, x: Vector, context: Scope) -> np.ndarray:
        """Return pushes of the same impulse, around the same time, that last half as long and twice as long.

        A joint that swings forgets how a long push was shared out, so that a fit may end in one that lasts too long.
        """
        force, begin, duration = x
        middle = begin + 0.5 * duration
        longer = [(share, max(middle - 0.5 * share * duration, 0.0)) for share in (0.5, 2.0)]
        # one that began as the long one did, too: the beginning is what a motion shows best
        longer.append((0.5, begin))
        return np.array([[force / share, at, share * duration] for share, at in longer])

    @classmethod
    def phrase(cls, of: Values, beliefs: Scope, target: str | None = None) -> Phrase:
        unit = parts.force_unit(beliefs.model, target)
        applied = parts.attribute(of["force"])
        return Phrase(
            f"joint '{target}' is pushed by something that is not in the log, for some time",
            f"{of.show('force', unit)} from {of.show('from_s', 's')} until {of.show('until_s', 's')}",
            f"Apply qfrc_applied = {applied} {unit} to joint '{target}' during that time, or compare the rest alone.",
            "Look at a video of that time: a hand, a cable, an obstacle.",
        )
