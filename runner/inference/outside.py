"""What the vocabulary has no word for but engineers have: weighed with the rest, lest it be taken for what has one.

Of what such an effect explains best the verdict is `unknown`. A dead band takes a constant part of every push, which
fewer pushes than one would think tell from a heavier body or more friction; a mean square that hardly exceeds the
noise's is no sign that those are the cause.
"""

from __future__ import annotations

from runner.effects.vocabulary import Vocabulary
from runner.inference.contender import Contender, contend, likeliest_first
from runner.inference.evidence import directions, sensitivities
from runner.inference.least_squares import Explanation, Fitter
from runner.inference.search import Search
from runner.settings import SETTINGS
from runner.systems.base import AbstractSystem


def with_outside(found: Search, fitter: Fitter) -> Search:
    """Add what is not in the vocabulary to the contenders, where it explains about as much as the best of them."""
    best = found.best.fit
    if not best.explanation.candidates:
        return found
    count = fitter.measured.count(best.episodes)
    new: list[Contender] = []
    for candidate in fitter.system.vocabulary.outside:
        steps, patience = SETTINGS.fit.refit_steps, SETTINGS.fit.outside_patience_steps
        alone, begins = Explanation((candidate,)), (best.starts, found.nominal.starts)
        tries = [
            fitter.fit(alone, best.episodes, starts=s, iterations=steps, target=best.total, patience=patience)
            for s in begins
        ]
        fit = min(tries, key=lambda f: f.total)
        if fit.total < best.total + SETTINGS.search.negligible_excess * count and not fit.at_bound.any():
            every = directions(fitter.system)
            around, dispersion = sensitivities(fitter, fit, every), found.best.evidence.dispersion
            new.append(contend(fitter, fit, around, against=SETTINGS.odds.outside_log_odds, dispersion=dispersion))
    return Search(tuple(likeliest_first((*found.contenders, *new))), found.nominal)


def said_of_outside(found: Search, system: AbstractSystem) -> list[str]:
    """Say in a sentence what it is, if something beyond the vocabulary explains a recording best."""
    if not is_outside(found.best, system.vocabulary):
        return []
    fit = found.best.fit
    said = [
        f"{one.label}, {', '.join(f'{name} {value:.3g}' for name, value in one.report().items())}"
        for one in fit.explanation.make(fit.x, system.context)
    ]
    return [f"What is not among the known effects and explains the recording best is {' and '.join(said)}."]


def is_outside(contender: Contender, vocabulary: Vocabulary) -> bool:
    """Whether an explanation holds something that the vocabulary has no word for."""
    return any(c in vocabulary.outside for c in contender.fit.explanation.candidates)
