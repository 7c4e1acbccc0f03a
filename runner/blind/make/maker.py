"""What makes cases of one kind of system: a second physics, what can be planted in it, and the files of a case."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np

from runner.errors import ConfigError

BANDS: dict[str, tuple[float, float]] = {"subtle": (1.6, 3.0), "moderate": (4.0, 7.0), "strong": (10.0, 30.0)}
PAIR_BANDS: dict[str, tuple[float, float]] = {"moderate": (4.0, 7.0), "strong": (10.0, 16.0)}
# drawn once, by chance: which kinds outside the vocabulary no tuning set ever has
RESERVING_SEED = 7266190451735842317


class Purpose(Enum):
    """What a set is for: to be scored, with every kind of effect outside the vocabulary, or to tune by, with half."""

    SEALED = "sealed"
    TUNING = "tuning"


@dataclass(frozen=True)
class CasePlan:
    """One case to make: what kind, which effects at which severity (drawn beforehand, so that a set is balanced)."""

    kind: str  # single, pair, null, unknown
    wanted: tuple[tuple[str, str], ...]  # (effect, severity)
    seed: tuple[int, ...]


class AbstractMaker(ABC):
    """Makes cases of one kind of system; plain data, so that processes can be given one."""

    @property
    @abstractmethod
    def system(self) -> str:
        """Its name, as `runner blind make system=` has it."""

    @property
    @abstractmethod
    def vocabulary(self) -> Sequence[str]:
        """Names of what can be planted that a verdict has a word for, without targets."""

    @property
    @abstractmethod
    def outside(self) -> Sequence[str]:
        """Names of what can be planted that it has none for."""

    @property
    @abstractmethod
    def together_alike(self) -> Sequence[set[str]]:
        """Pairs that are one effect to any such data, or that write the same field."""

    @property
    def before(self) -> Sequence[str]:
        """Which of a pair is planted first: those that others are relative to."""
        return ()

    @property
    def attempts(self) -> int:
        """How often everything is drawn anew until a case can be had, and another pair after that."""
        return 40

    def make(self, plan: CasePlan, folder: Path) -> dict[str, Any]:
        """Write one case into its folder and return its answer; of a pair that can't be had together, another's.

        Raises:
            ConfigError: If nothing that could be drawn reaches the planned severity.
        """
        generator = np.random.default_rng(plan.seed)
        for _ in range(self.attempts if plan.kind == "pair" else 1):
            for _ in range(self.attempts):
                answer = self.try_to_make(plan, folder, generator)
                if answer is not None:
                    return answer
            if plan.kind == "pair":
                plan = replace(plan, wanted=self.pair(generator))
        raise ConfigError(
            f"blind.effect: no sensible size of {plan.wanted} reaches its severity in {self.attempts} tries."
        )

    def pair(self, g: np.random.Generator) -> tuple[tuple[str, str], ...]:
        """Draw two effects that can be told apart, each with its severity, in the order in which they are planted."""
        names, pair = list(self.vocabulary), list[str]()
        while len(pair) < 2 or set(pair) in self.together_alike:
            pair = [names[int(i)] for i in g.choice(len(names), 2, replace=False)]
        pair.sort(key=lambda name: name not in self.before)
        return tuple((name, str(s)) for name, s in zip(pair, g.choice(list(PAIR_BANDS), 2), strict=True))

    @abstractmethod
    def try_to_make(self, plan: CasePlan, folder: Path, g: np.random.Generator) -> dict[str, Any] | None:
        """Draw one case; write it and return its answer, or none where what is planned can't be had with it."""

    @abstractmethod
    def settings(self) -> Mapping[str, Any]:
        """Return what else cases depend on, as plain data: an interrupted set is taken up with the same alone."""

    def check_ready(self) -> None:
        """Check that what it needs is installed.

        Raises:
            ConfigError: If not, with what to install.
        """

    def with_roughness(self, roughness: float) -> AbstractMaker:
        """Return the same maker of worlds that are so far from what their owners believe.

        Raises:
            ConfigError: If its worlds have no such setting.
        """
        raise ConfigError(f"roughness: cases of '{self.system}' have none, got {roughness:g}.")

    def outside_for(self, purpose: Purpose) -> list[str]:
        """Return the effects without a word that sets of a purpose have."""
        reserved = self.reserved if purpose is Purpose.TUNING else frozenset()
        return [name for name in self.outside if name not in reserved]

    @property
    def reserved(self) -> frozenset[str]:
        """The half of the effects without a word that no tuning set has, the same half in all of them."""
        order = np.random.default_rng(RESERVING_SEED).permutation(len(self.outside))
        return frozenset(self.outside[int(i)] for i in order[: (len(order) + 1) // 2])
