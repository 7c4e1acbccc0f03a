"""A load that is not spread evenly over the base."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

from runner.effects.base import Parameter, Phrase, Vector
from runner.effects.planar_box.base import Beliefs, Context, PlanarEffect, Target, effect
from runner.effects.wording import Values, number
from runner.errors import check_range


@effect
@dataclass(frozen=True)
class ContactPressure(PlanarEffect):
    """The load is concentrated on the rim (`share` > 0) or in the middle (< 0) of the base."""

    name: ClassVar[str] = "contact_pressure"
    label: ClassVar[str] = "a load concentrated on the rim or in the middle of the base"
    share: float

    def __post_init__(self) -> None:
        check_range("contact_pressure.share", self.share, -50.0, 50.0)

    def edit_model(self, target: Target) -> None:
        target.dry_friction["pressure"] = self.share

    @classmethod
    def parameters(cls, context: Context) -> tuple[Parameter, ...]:
        return (Parameter("share", "", 0.5, -15.0, 8.0),)

    @classmethod
    def from_vector(cls, x: Vector, context: Context) -> Self:
        return cls(x[0])

    @classmethod
    def phrase(cls, of: Values, beliefs: Beliefs, target: str | None = None) -> Phrase:
        where = "the rim" if of["share"] > 0 else "the middle"
        return Phrase(
            f"the load bears on {where} of the base more than believed",
            f"concentration {of.show('share')}, where 0 is even",
            f"Let {where} of the base carry more of the load (`share` {number(of['share'])} in corrected.yaml).",
            "Put the object on carbon paper, or look at the wear of its base.",
        )
