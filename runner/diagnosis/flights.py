"""What flights alone say, where the answer for all of a recording is none, or another one."""

from __future__ import annotations

from collections.abc import Sequence

from runner.diagnosis.ranking import values_of
from runner.diagnosis.result import Flights, Ranked
from runner.effects.vocabulary import Candidate, spoken
from runner.effects.wording import Values, listed, probability
from runner.inference.contender import Contender
from runner.inference.flown import Flown
from runner.progress import in_noises
from runner.settings import SETTINGS
from runner.systems.base import AbstractSystem

CONTACT = (
    "look at the contact, or, where that is of no interest, cut the recordings at the first hit and go on with those."
)


def flights_alone(flown: Flown | None, ranked: Sequence[Ranked]) -> Flights | None:
    """Return what flights until the first hit say; None: there are none, or the answer holds all that they say.

    Args:
        flown: Their likeliest explanation.
        ranked: The explanations of all that was recorded, likeliest first.
    """
    if flown is None or flown.all_of_it or flown.probability < SETTINGS.probability.noteworthy:
        return None
    answer, names = ranked[0], set(flown.best.fit.explanation.names)
    unknown = answer.effects == ("unknown",)
    if not unknown and any(names <= set(those) for those in (answer.effects, *answer.equivalent)):
        return None
    best, system = flown.finished(), flown.fitter.system
    parameters, errors = values_of(best, system.context)
    said = _said(best, system, parameters, errors)
    lead = f"Before the first hit, {said} (probability {probability(flown.probability)}): "
    what = "What nothing explains comes with the contact" if unknown else "What follows the first hit says otherwise"
    return Flights(
        best.fit.explanation.names or ("none",),
        flown.probability,
        parameters,
        errors,
        flown.noises,
        f"{lead}that {in_noises(flown.noises)}. {what}: {CONTACT}",
    )


def _said(best: Contender, system: AbstractSystem, parameters: dict, errors: dict) -> str:
    candidates = best.fit.explanation.candidates
    if not candidates:
        return "in flights alone, the model as believed will do"

    def one(c: Candidate) -> str:
        told = c.effect.phrase(Values(parameters[c.name], errors[c.name]), system.beliefs, c.target)
        amount = told.amount_of_all if c.targets and told.amount_of_all else told.amount
        return f"{spoken(c.name)} ({amount})" if amount else spoken(c.name)

    order = sorted(candidates, key=lambda c: best.fit.explanation.names.index(c.name))
    return f"flights alone are explained by {listed([one(c) for c in order])}"
