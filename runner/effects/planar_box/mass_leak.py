"""Mass that changes during an episode."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

from runner.effects.base import Parameter, Phrase, Vector
from runner.effects.planar_box.base import Beliefs, Context, PlanarEffect, Target, effect
from runner.effects.wording import Values, number
from runner.errors import check_range


@effect
@dataclass(frozen=True)
class MassLeak(PlanarEffect):
    """Mass and inertia times (1 - `share_per_s` * t), t from the start of the episode."""

    name: ClassVar[str] = "mass_leak"
    label: ClassVar[str] = "a mass that changes during the episode"
    share_per_s: float

    def __post_init__(self) -> None:
        check_range("mass_leak.share_per_s", self.share_per_s, -1.0, 1.0, unit="1/s")

    def edit_model(self, target: Target) -> None:
        target.dry_friction["mass_leak"] = self.share_per_s

    @classmethod
    def parameters(cls, context: Context) -> tuple[Parameter, ...]:
        return (Parameter("share_per_s", "1/s", 0.03, -0.3, 0.12),)

    @classmethod
    def from_vector(cls, x: Vector, context: Context) -> Self:
        return cls(x[0])

    @classmethod
    def phrase(cls, of: Values, beliefs: Beliefs, target: str | None = None) -> Phrase:
        word = "loses" if of["share_per_s"] > 0 else "gains"
        return Phrase(
            f"the object {word} mass during an episode",
            f"{of.show('share_per_s', '%', -100)} of it per second",
            f"Let the mass change by {number(-100 * of['share_per_s'])} % per second from the start of an episode.",
            "Weigh the object before and after an episode.",
        )
