"""Which way of solving the believed model the recording speaks for, where a simulator has more than one.

What a solver adds of its own, such as a joint that creeps where dry friction should hold it, is no property of the
machine, yet an explanation would be taken for it: an inertia, a delay. So before a search, and once more with what it
has found, the same explanation is fitted to the same model solved otherwise.

Before the search nothing explains the recording as yet, and what another way of solving takes off may be the doing of
what is missing. With what was found the choice is made anew: to be given up the way that the model has it has to leave
more by what an effect is worth, and to come back it only has to leave less.
"""

from __future__ import annotations

from runner.inference.contender import least_gain
from runner.inference.least_squares import Fit, Fitter
from runner.settings import SETTINGS
from runner.systems.base import AbstractSystem


def better_solved(fitter: Fitter, fit: Fit, as_believed: str) -> AbstractSystem | None:
    """Return the system solved so that a fitted explanation leaves less, if any.

    By what an effect would be worth; solved as the model has it, by more than descents leave open.

    Args:
        fitter: Of the fit; with another account of the noise perhaps.
        fit: What was found so far.
        as_believed: How the model has it, see `AbstractSystem.solved`.
    """
    if not as_believed:
        return None
    left = fitter.loss(fit.explanation, fit.x, fit.starts, fit.episodes)
    for system in fitter.system.solved_otherwise():
        worth = SETTINGS.fit.tolerance_loss
        if system.solved != as_believed:
            worth = least_gain(fitter.measured.count(fit.episodes))
        other = fitter.with_system(system)
        # where the model has nothing that is solved otherwise, neither is it with other parameters
        if other.loss(fit.explanation, fit.x, fit.starts, fit.episodes) != left:
            again = other.fit(fit.explanation, fit.episodes, x=fit.x, starts=fit.starts)
            system.simulator().simulated_s += other.simulator.simulated_s
            if again.total < left - worth:
                return system
    return None
