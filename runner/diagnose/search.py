"""Search for the explanation: none, one effect, or several by forward selection with a beam.

Around the fits so far every further effect promises a gain (a linear model, one batch of simulations). The promising
ones are fitted; a fit that falls hopelessly behind is not finished. Explanations are then compared by evidence.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from runner.diagnose.evidence import (
    LEVELS,
    Evidence,
    Survey,
    clip,
    directions,
    evidence,
    joined,
    promise,
    surroundings,
    survey,
)
from runner.diagnose.fit import NONE, Fit, Fitter
from runner.effects.base import EFFECTS, AbstractEffect

MOST_EFFECTS = 3
BEAM = 2
CANDIDATES = 4  # fitted per explanation in the beam, from the second effect on
SURVEYED = 7  # explanations of one size that are compared by evidence
ONE_MORE = 5.0  # log prior odds against each further effect
NEAR = 1000.0  # log odds within which an explanation is worth adding to
TWINS = ({"mass", "actuator_gain"}, {"floor_tilt", "wind"}, {"actuator_delay", "observation_delay"})


@dataclass(frozen=True)
class Contender:
    """A fitted explanation and its evidence; `log_posterior` includes the prior odds against many effects."""

    fit: Fit
    evidence: Evidence
    log_posterior: float
    promises: dict[type[AbstractEffect], tuple[float, np.ndarray]] = field(repr=False)


@dataclass(frozen=True)
class Search:
    """All contenders, likeliest first, and fits that fell behind (their loss is an upper bound)."""

    contenders: tuple[Contender, ...]
    behind: tuple[Fit, ...]
    nominal: Fit

    @property
    def best(self) -> Contender:
        """The likeliest."""
        return self.contenders[0]


def search(fitter: Fitter, episodes: Sequence[int], *, most: int = MOST_EFFECTS) -> Search:
    """Fit and compare explanations of up to `most` effects on these episodes."""
    every = directions(fitter.context)
    nominal = fitter.fit(NONE, episodes)
    contenders = [_contend(fitter, nominal, survey(fitter, nominal, every))]
    behind: list[Fit] = []
    beam, seen = contenders[:1], {NONE.kinds}
    for size in range(1, most + 1):
        fits: list[Fit] = []
        target = np.inf if size == 1 else min(c.fit.total for c in contenders)
        for contender in beam:
            offers = _offers(contender, fitter)
            if size > 1:
                offers = [o for o in offers if o[0] > 2 * ONE_MORE][:CANDIDATES]
            for _, kind, vector in offers:
                explanation, x = joined(contender.fit, kind, vector)
                key = tuple(sorted(explanation.kinds, key=lambda k: k.__name__))
                if key not in seen:
                    seen.add(key)
                    fits.append(fitter.fit(explanation, episodes, x=x, near=contender.fit, target=target))
                    target = min(target, fits[-1].total)
        if not fits:
            break
        fits.sort(key=lambda f: f.total)
        around_best = survey(fitter, fits[0], every)
        new = [_contend(fitter, fit, around_best) for fit in fits[:SURVEYED]]
        behind += fits[SURVEYED:]
        best = max(c.log_posterior for c in contenders)
        contenders += new
        new.sort(key=lambda c: -c.log_posterior)
        if size > 1 and new[0].log_posterior < best:
            break
        beam = [c for c in new[:BEAM] if c.log_posterior > new[0].log_posterior - NEAR]
    contenders.sort(key=lambda c: -c.log_posterior)
    return Search(tuple(contenders), tuple(behind), nominal)


def _offers(contender: Contender, fitter: Fitter) -> list[tuple[float, type[AbstractEffect], np.ndarray]]:
    """Every effect that is not in yet, nor told apart from one that is, most promising first, with a start vector."""
    held = set(contender.fit.explanation.names)
    out = []
    for name, kinds in EFFECTS.items():
        if name in held or any(name in twins and twins & held for twins in TWINS):
            continue
        for kind in kinds:
            if kind in contender.promises:
                gain, vector = contender.promises[kind]
                out.append((gain, kind, clip(kind, vector, fitter.context)))
    return sorted(out, key=lambda o: -o[0])


def _contend(fitter: Fitter, fit: Fit, known: Survey) -> Contender:
    around = surroundings(fit, known)
    found = evidence(around, fitter.context)
    level = LEVELS[int(np.argmax(found.level))]
    size = len(fit.explanation.kinds)
    return Contender(fit, found, found.log - ONE_MORE * size, promise(around, level))
