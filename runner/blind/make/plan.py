"""What each case of a set is to hold: kinds, effects and severities, drawn beforehand so that a set is balanced."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass

import numpy as np

from runner.blind.plants import OUTSIDE, TOGETHER_ALIKE, VOCABULARY
from runner.errors import ConfigError, check_range

BANDS: dict[str, tuple[float, float]] = {"subtle": (1.6, 3.0), "moderate": (4.0, 7.0), "strong": (10.0, 30.0)}
PAIR_BANDS: dict[str, tuple[float, float]] = {"moderate": (4.0, 7.0), "strong": (10.0, 16.0)}


@dataclass(frozen=True)
class Mix:
    """Shares of the kinds of cases; they are normalised by their sum."""

    singles: float = 0.62
    pairs: float = 0.14
    nulls: float = 0.12
    unknowns: float = 0.12

    def __post_init__(self) -> None:
        for name, share in asdict(self).items():
            check_range(f"blind.mix.{name}", share, 0.0)
        if sum(asdict(self).values()) <= 0.0:
            raise ConfigError("blind.mix: at least one share must be above 0.")


@dataclass(frozen=True)
class CasePlan:
    """One case to make: what kind, which effects at which severity (drawn beforehand, so that a set is balanced)."""

    kind: str  # single, pair, null, unknown
    wanted: tuple[tuple[str, str], ...]  # (effect, severity)
    seed: tuple[int, ...]


def case_names(n: int, seed: int) -> list[str]:
    generator = np.random.default_rng([seed, 99])
    names: dict[str, None] = {}
    while len(names) < n:
        names["r" + generator.bytes(5).hex()] = None
    return list(names)


def plan_cases(n: int, seed: int, mix: Mix) -> list[CasePlan]:
    """Return what each case is to hold: counts by largest remainder, effects and severities from shuffled decks."""
    generator = np.random.default_rng([seed, 1])
    shares = asdict(mix)
    exact = {kind: n * share / sum(shares.values()) for kind, share in shares.items()}
    counts = {kind: math.floor(value) for kind, value in exact.items()}
    for kind in sorted(exact, key=lambda k: counts[k] - exact[k])[: n - sum(counts.values())]:
        counts[kind] += 1
    wanted: list[tuple[str, tuple[tuple[str, str], ...]]] = []
    wanted += [("single", (card,)) for card in _deal(counts["singles"], list(VOCABULARY), list(BANDS), generator)]
    wanted += [
        ("unknown", (card,)) for card in _deal(counts["unknowns"], list(OUTSIDE), ["moderate", "strong"], generator)
    ]
    wanted += [("null", ())] * counts["nulls"]
    names = list(VOCABULARY)
    for _ in range(counts["pairs"]):
        pair: list[str] = []
        while len(pair) < 2 or set(pair) in TOGETHER_ALIKE:
            pair = [names[int(i)] for i in generator.choice(len(names), 2, replace=False)]
        pair.sort(key=lambda name: name != "mass")  # its inertia comes before one of its own
        severities = generator.choice(list(PAIR_BANDS), 2)
        wanted.append(("pair", tuple((name, str(s)) for name, s in zip(pair, severities, strict=True))))
    order = generator.permutation(n)
    return [CasePlan(*wanted[int(i)], seed=(seed, 2, number)) for number, i in enumerate(order)]


def _deal(count: int, names: list[str], severities: list[str], generator: np.random.Generator) -> list[tuple[str, str]]:
    # every name once before any twice, and every severity equally often
    cards: list[tuple[str, str]] = []
    shift = generator.permutation(len(names))
    round_number = 0
    while len(cards) < count:
        order = generator.permutation(len(names))
        cards += [(names[int(i)], severities[int(shift[i] + round_number) % len(severities)]) for i in order]
        round_number += 1
    return cards[:count]
