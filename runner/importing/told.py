"""What was done to the samples of a log, told once for all columns and episodes of which it is true."""

from __future__ import annotations

import re
from collections.abc import Collection
from dataclasses import dataclass, field

SEVERAL = re.compile(r"(?<![\w.,])1 (sample|episode|row)s\b(?: (were|are|have|begin|follow)\b)?")
OF_ONE = {"were": "was", "are": "is", "have": "has", "begin": "begins", "follow": "follows"}


@dataclass
class _Event:
    """How often something happened to a column, and the largest size of it."""

    count: int = 0
    largest: float = 0.0


@dataclass
class Told:
    """Sentences, each with the columns that it is true of and what happened to each of them."""

    events: dict[str, dict[str, _Event]] = field(default_factory=dict)

    def add(self, sentence: str, count: int, size: float = 0.0, *, column: str = "") -> None:
        """Note something that happened `count` times.

        Args:
            sentence: In it `{names}` are the columns, `{n}` is the count, `{largest}` the largest size.
            count: Nothing is noted of 0.
            size: Of what happened.
            column: To which it happened; "": to the log.
        """
        if count:
            event = self.events.setdefault(sentence, {}).setdefault(column, _Event())
            event.count += count
            event.largest = max(event.largest, size)

    def sentences(self) -> list[str]:
        """Return all notes."""
        return [
            SEVERAL.sub(_of_one, sentence.replace("{n}", _span([e.count for e in events.values()])))
            .replace("{names}", ", ".join(f"'{column}'" for column in events))
            .replace("{largest}", f"{max(e.largest for e in events.values()):.4g}")
            for sentence, events in self.events.items()
        ]


def _of_one(several: re.Match[str]) -> str:
    """Return `1 sample was` for `1 samples were`."""
    return f"1 {several[1]}" + (f" {OF_ONE[several[2]]}" if several[2] else "")


def _span(values: Collection[int]) -> str:
    """Return a number, or what several are between."""
    low, high = min(values), max(values)
    return f"{low}" if low == high else f"{low} to {high}"
