"""What a plant is: one effect, drawn but for its size."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from runner.blind.mechanism.case import Unplanted
from runner.blind.mechanism.draw import Needs
from runner.blind.mechanism.physics import World


@dataclass(frozen=True)
class Plant:
    """One effect, drawn but for its size.

    Args:
        name: Word of the vocabulary, or the name of an effect that the vocabulary does not have.
        target: What it changes; None: the whole, or nothing that a verdict could name.
        largest: Largest size that is physically sensible; sizes are positive, zero is no effect at all.
        edit: World and size to the world with the effect.
        true: World and size to the true values under the names that a verdict has for them, SI units.
        alike: Full names of what no such recording can tell from it.
    """

    name: str
    target: str | None
    largest: float
    edit: Callable[[World, float], World]
    true: Callable[[World, float], dict[str, float]]
    alike: tuple[str, ...] = ()

    @property
    def accept(self) -> list[str]:
        """Full names that count as right for it."""
        return sorted({full(self.name, self.target), *self.alike})


def full(name: str, target: str | None) -> str:
    """Return an effect's name as a verdict has it."""
    return name if target is None else f"{name}[{target}]"


@dataclass(frozen=True)
class Kind:
    """A kind of effect that can be planted.

    Args:
        draw: Draws one for a case; None where the mechanism that was drawn has no place for it.
        needs: What the mechanism must have.
        systems: In which it can be; empty: in all.
    """

    draw: Callable[[Unplanted, np.random.Generator], Plant | None]
    needs: Needs = field(default_factory=Needs)
    systems: tuple[str, ...] = ()


def pick(case: Unplanted, g: np.random.Generator, fits: Callable[[int], Any] = lambda _: True) -> int | None:
    """Draw a joint that fits; None if none does."""
    fitting = [i for i in range(case.count) if fits(i)]
    return int(g.choice(fitting)) if fitting else None
