"""How a number is declared: its value, its unit and the reason for it stand in one place."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, fields
from typing import Any, TypeVar

Number = TypeVar("Number", int, float, tuple[float, ...])


def setting(value: Number, unit: str, reason: str) -> Number:
    """Return the field of a dataclass that is a number, or some, with their unit and the reason for them."""
    return field(default=value, metadata={"unit": unit, "reason": reason})


@dataclass(frozen=True)
class Declared:
    """A number as it was declared."""

    name: str
    value: int | float | tuple[float, ...]
    unit: str
    reason: str

    @property
    def text(self) -> str:
        """The value as it is written: several with commas between them."""
        return ", ".join(f"{v:g}" for v in (self.value if isinstance(self.value, tuple) else (self.value,)))


def by_stage(settings: Any) -> Iterator[tuple[str, Declared]]:
    """Go through the numbers of all stages, with the stage that each is of."""
    for stage in fields(settings):
        yield from ((stage.name, one) for one in declared(getattr(settings, stage.name)))


def declared(stage: Any) -> Iterator[Declared]:
    """Go through the numbers of a stage of the settings."""
    for one in fields(stage):
        yield Declared(one.name, getattr(stage, one.name), one.metadata["unit"], one.metadata["reason"])
