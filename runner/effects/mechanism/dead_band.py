"""A band of commands without effect."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from runner.effects.base import Parameter, Phrase, Stage, Vector
from runner.effects.mechanism.actuator_gain import LINEAR_BIASES
from runner.effects.mechanism.base import Command, MechanismEffect, Scope, effect
from runner.effects.wording import Values
from runner.errors import check_range


@effect
@dataclass(frozen=True)
class DeadBand(MechanismEffect):
    """Of every command `width` is lost, and one that is smaller does nothing; in the command's unit, N m or N.

    Of an actuator whose command is a force: a servo's target has no zero that a band could lie about.
    """

    name: ClassVar[str] = "dead_band"
    label: ClassVar[str] = "a band of commands without effect"
    stage: ClassVar[Stage] = Stage.DEAD_BAND
    target_kind: ClassVar[str] = "actuator"
    commonness: ClassVar[int] = 2
    target: str
    width: float

    def __post_init__(self) -> None:
        check_range("dead_band.width", self.width, 0.0, 1e12, unit="N m")

    def edit_command(self, command: Command) -> Command:
        if self.width == 0.0:
            return command
        column = command.columns[self.target]
        passed = np.sign(column) * np.maximum(abs(column) - self.width, 0.0)
        return replace(command, columns={**command.columns, self.target: passed})

    @classmethod
    def applies(cls, scope: Scope) -> bool:
        actuator = scope.model.actuator(scope.target).id
        force = int(scope.model.actuator_biastype[actuator]) == LINEAR_BIASES[0]
        return force and scope.command.get(scope.target or "", 0.0) > 0.0

    @classmethod
    def parameters(cls, context: Scope) -> tuple[Parameter, ...]:
        largest = context.command[str(context.target)]
        return (Parameter("width", "", 0.05 * largest, 0.0, 0.95 * largest),)

    @classmethod
    def from_vector(cls, x: Vector, context: Scope) -> Self:
        return cls(str(context.target), max(float(x[0]), 0.0))

    @classmethod
    def starts(cls, context: Scope) -> np.ndarray:
        scale = cls.parameters(context)[0].scale
        return np.array([[0.5 * scale], [2 * scale]])

    @classmethod
    def units(cls, context: Scope) -> Mapping[str, str]:
        return {"width": f"unit of {context.target}"}

    @classmethod
    def phrase(cls, of: Values, beliefs: Scope, target: str | None = None) -> Phrase:
        return Phrase(
            f"small commands to actuator '{target}' do nothing",
            f"{of.show('width')} of every command is lost, in its unit",
            f"Before sending a command u to '{target}', replace it by sign(u) max(|u| - {of['width']:.4g}, 0).",
            f"Raise the command to '{target}' slowly and note at which value its current begins.",
        )
