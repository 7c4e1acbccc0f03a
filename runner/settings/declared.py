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


def declared(stage: Any) -> Iterator[Declared]:
    """Go through the numbers of a stage of the settings."""
    for one in fields(stage):
        yield Declared(one.name, getattr(stage, one.name), one.metadata["unit"], one.metadata["reason"])
