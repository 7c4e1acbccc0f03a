"""A push that is a multiple of the commanded one."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from runner.effects.base import Confounded, Parameter, Phrase, Stage, Vector
from runner.effects.planar_box.base import Beliefs, Context, PlanarEffect, effect
from runner.effects.wording import Values, number
from runner.errors import check_range


@effect
@dataclass(frozen=True)
class ActuatorGain(PlanarEffect):
    """The real force is `gain` times the commanded one. Fitted as its log."""

    name: ClassVar[str] = "actuator_gain"
    label: ClassVar[str] = "a real force that is a multiple of the commanded one"
    stage: ClassVar[Stage] = Stage.GAIN
    of_command: ClassVar[bool] = True
    confounded: ClassVar[tuple[Confounded, ...]] = (
        Confounded(
            "mass",
            "friction and inertia grow with the mass, so that the force per mass alone moves the object",
            "Push with a known weight added to the object: a wrong mass shrinks in proportion, a wrong force gain "
            "stays.",
        ),
    )
    gain: float

    def __post_init__(self) -> None:
        check_range("actuator_gain.gain", self.gain, 0.0, 100.0)

    def edit_command(self, columns: np.ndarray, step_s: float) -> np.ndarray:
        return self.gain * columns

    @classmethod
    def parameters(cls, context: Context) -> tuple[Parameter, ...]:
        return (Parameter("log_gain", "", 0.15, -1.6, 1.6),)

    @classmethod
    def from_vector(cls, x: Vector, context: Context) -> Self:
        return cls(math.exp(x[0]))

    @classmethod
    def phrase(cls, of: Values, beliefs: Beliefs, target: str | None = None) -> Phrase:
        word = "stronger" if of["gain"] > 1 else "weaker"
        return Phrase(
            f"the push is {word} than commanded",
            f"{of.show('gain')} times the command",
            f"Multiply every commanded force by {number(of['gain'], 4)}.",
            "Push against a force gauge and compare with the command.",
        )
