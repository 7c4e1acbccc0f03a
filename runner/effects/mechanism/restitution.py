"""Rebound of a body from what it hits."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Self

import mujoco

from runner.effects.base import Parameter, Phrase, Vector
from runner.effects.mechanism import contacts, parts
from runner.effects.mechanism.base import MechanismEffect, Scope, effect
from runner.effects.wording import Values, number
from runner.errors import check_range

LEAST_DAMPED, MOST_DAMPED = 0.02, 4.0  # damping ratios, of nearly all of the speed and of nearly none


@effect
@dataclass(frozen=True)
class Restitution(MechanismEffect):
    """A body leaves an impact with `ratio` of the speed that it came with. Fitted as the drop of the damping ratio.

    MuJoCo's contacts are damped springs; the damping ratio that leaves such a rebound is set, the stiffness is kept.
    `contacts.rebound` has the relation, which holds for an impact through the centre of mass that is short against
    everything else.
    """

    name: ClassVar[str] = "restitution"
    label: ClassVar[str] = "a different rebound"
    target_kind: ClassVar[str] = "body"
    rough_form: ClassVar[bool] = True
    target: str
    ratio: float

    def __post_init__(self) -> None:
        check_range("restitution.ratio", self.ratio, 0.0, 1.0)

    def edit_model(self, model: mujoco.MjModel) -> None:
        damping = contacts.damping_for(self.ratio)
        for contact in contacts.governing(model, self.target):
            if math.isclose(damping, contacts.damping_ratio(contact), rel_tol=1e-9):
                continue
            if contact.solref[0] > 0:
                # stiffness 1 / (time ratio)^2 stays, as it is another effect's
                contact.solref[:] = contact.solref[0] * contact.solref[1] / damping, damping
            else:
                contact.solref[1] = -2.0 * damping * math.sqrt(-contact.solref[0])

    @classmethod
    def applies(cls, scope: Scope) -> bool:
        return contacts.touches(scope.model, scope.target)

    @classmethod
    def parameters(cls, context: Scope) -> tuple[Parameter, ...]:
        believed = contacts.damping_ratio(contacts.believed(context.model, context.target))
        return (Parameter("damping_ratio_drop", "", 0.3, believed - MOST_DAMPED, believed - LEAST_DAMPED),)

    @classmethod
    def from_vector(cls, x: Vector, context: Scope) -> Self:
        believed = contacts.damping_ratio(contacts.believed(context.model, context.target))
        return cls(str(context.target), contacts.rebound(believed - float(x[0])))

    @classmethod
    def phrase(cls, of: Values, beliefs: Scope, target: str | None = None) -> Phrase:
        believed = contacts.believed(beliefs.model, target)
        before = contacts.rebound(contacts.damping_ratio(believed))
        damping = contacts.damping_for(of["ratio"])
        time = believed.solref[0] * believed.solref[1] / damping
        return Phrase(
            f"body '{target}' rebounds {'more' if of['ratio'] > before else 'less'} than in the model",
            f"with {of.show('ratio')} of its speed instead of {number(before)}",
            f'For the geoms of <body name="{target}"> set solref="{parts.attribute(time, damping)}" and a priority '
            "above that of what they touch.",
            f"Drop '{target}' flat from a known height: the root of the ratio of the heights is the rebound.",
        )
