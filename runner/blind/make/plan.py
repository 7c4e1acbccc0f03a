"""What each case of a set is to hold: kinds, effects and severities, drawn beforehand so that a set is balanced."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass

import numpy as np

from runner.blind.make.maker import BANDS, AbstractMaker, CasePlan, Purpose
from runner.errors import ConfigError, check_range

# streams of random numbers: a tuning set has no case in common with the sealed set of the same seed
STREAM = {Purpose.SEALED: 1, Purpose.TUNING: 3}
CASES = {Purpose.SEALED: 2, Purpose.TUNING: 4}


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


def case_names(n: int, seed: int) -> list[str]:
    generator = np.random.default_rng([seed, 99])
    names: dict[str, None] = {}
    while len(names) < n:
        names["r" + generator.bytes(5).hex()] = None
    return list(names)


def plan_cases(n: int, seed: int, mix: Mix, maker: AbstractMaker, purpose: Purpose = Purpose.SEALED) -> list[CasePlan]:
    """Return what each case is to hold: counts by largest remainder, effects and severities from shuffled decks."""
    generator = np.random.default_rng([seed, STREAM[purpose]])
    shares = asdict(mix)
    exact = {kind: n * share / sum(shares.values()) for kind, share in shares.items()}
    counts = {kind: math.floor(value) for kind, value in exact.items()}
    for kind in sorted(exact, key=lambda k: counts[k] - exact[k])[: n - sum(counts.values())]:
        counts[kind] += 1
    wanted: list[tuple[str, tuple[tuple[str, str], ...]]] = []
    wanted += [("single", (card,)) for card in _deal(counts["singles"], list(maker.vocabulary), list(BANDS), generator)]
    outside = maker.outside_for(purpose)
    wanted += [("unknown", (card,)) for card in _deal(counts["unknowns"], outside, ["moderate", "strong"], generator)]
    wanted += [("null", ())] * counts["nulls"]
    wanted += [("pair", maker.pair(generator)) for _ in range(counts["pairs"])]
    order = generator.permutation(n)
    return [CasePlan(*wanted[int(i)], seed=(seed, CASES[purpose], number)) for number, i in enumerate(order)]


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
