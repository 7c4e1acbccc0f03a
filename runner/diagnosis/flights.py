"""What flights alone say, where the answer for all of a recording is none, or another one."""

from __future__ import annotations

from collections.abc import Sequence

from runner.diagnosis.ranking import values_of
from runner.diagnosis.result import Flights, Ranked
from runner.effects.vocabulary import Candidate, spoken
from runner.effects.wording import Values, listed
from runner.inference.contender import Contender
from runner.inference.flown import Flown
from runner.progress import Step, in_noises
from runner.settings import SETTINGS
from runner.systems.base import AbstractSystem
from runner.systems.simulator import AbstractSimulator

CONTACT = (
    "Look at the contact: before the first hit, flights alone say something else. Where the contact is of no interest, "
    "cut the recordings at the first hit and diagnose them again."
)


def flights_alone(flown: Flown | None, ranked: Sequence[Ranked], simulator: AbstractSimulator) -> Flights | None:
    """Return what flights until the first hit say.

    None: there are none, no explanation of them is likelier than all others together, or the answer holds all that they
    say.

    Args:
        flown: Their likeliest explanation, from a search whose fits only begin: what is told of it is fitted here.
        ranked: The explanations of all that was recorded, likeliest first.
        simulator: What is simulated for that counts as simulated by it.
    """
    if flown is None or flown.all_of_it or not flown.probability > SETTINGS.held_out.most:
        return None
    answer, names = ranked[0], set(flown.best.fit.explanation.names)
    unknown = answer.effects == ("unknown",)
    if not unknown and any(names <= set(those) for those in (answer.effects, *answer.equivalent)):
        return None
    own, system = flown.fitter.simulator, flown.fitter.system
    flown.fitter.observer.step(Step.CHECKING, "fitting flights until the first hit")
    before_s = own.simulated_s
    told = flown.finished()
    simulator.simulated_s += own.simulated_s - before_s
    parameters, errors = values_of(told.best, system.context)
    said = _said(told.best, system, parameters, errors)
    what = "What nothing explains comes with the contact" if unknown else "What follows the first hit says otherwise"
    return Flights(
        told.best.fit.explanation.names or ("none",),
        told.probability,
        parameters,
        errors,
        told.noises,
        f"Before the first hit, {said}: that {in_noises(told.noises)}. {what}.",
        CONTACT,
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
