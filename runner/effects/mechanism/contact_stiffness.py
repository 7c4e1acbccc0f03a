"""Stiffness of a body's contacts."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Self

import mujoco

from runner.effects.base import Parameter, Phrase, Vector
from runner.effects.mechanism import contacts, parts
from runner.effects.mechanism.base import MechanismEffect, Scope, effect
from runner.effects.wording import Values
from runner.errors import check_range


@effect
@dataclass(frozen=True)
class ContactStiffness(MechanismEffect):
    """Contacts of a body are `ratio` times as stiff, their damping ratio unchanged. Fitted as its log.

    MuJoCo's time constant of a contact goes with the inverse root of its stiffness.
    """

    name: ClassVar[str] = "contact_stiffness"
    label: ClassVar[str] = "a different stiffness of contact"
    target_kind: ClassVar[str] = "body"
    rough_form: ClassVar[bool] = True
    target: str
    ratio: float

    def __post_init__(self) -> None:
        check_range("contact_stiffness.ratio", self.ratio, 0.0, 1e6, lower_open=True)

    def edit_model(self, model: mujoco.MjModel) -> None:
        for contact in contacts.governing(model, self.target):
            if contact.solref[0] > 0:
                contact.solref[0] /= math.sqrt(self.ratio)
            else:
                contact.solref[:] *= (self.ratio, math.sqrt(self.ratio))

    @classmethod
    def applies(cls, scope: Scope) -> bool:
        return contacts.touches(scope.model, scope.target)

    @classmethod
    def parameters(cls, context: Scope) -> tuple[Parameter, ...]:
        return (Parameter("log_stiffness_ratio", "", 1.0, -4.0, 6.0),)

    @classmethod
    def from_vector(cls, x: Vector, context: Scope) -> Self:
        return cls(str(context.target), math.exp(x[0]))

    @classmethod
    def phrase(cls, of: Values, beliefs: Scope, target: str | None = None) -> Phrase:
        solref = contacts.believed(beliefs.model, target).solref
        ratio = of["ratio"]
        wanted = (
            (solref[0] / math.sqrt(ratio), solref[1])
            if solref[0] > 0
            else (solref[0] * ratio, solref[1] * math.sqrt(ratio))
        )
        return Phrase(
            f"contacts of body '{target}' are {'stiffer' if ratio > 1 else 'softer'} than in the model",
            f"{of.show('ratio')} times as stiff",
            f'For the geoms of <body name="{target}"> set solref="{parts.attribute(*wanted)}" and a priority '
            "above that of what they touch; the time step must be at most half of the first number.",
            f"Film an impact of '{target}' at a high rate: how long it lasts tells its stiffness.",
        )
