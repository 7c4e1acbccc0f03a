"""The ways in which effects can move a prediction, and how far they do beside a fit.

Which effect promises to explain what a fit leaves, and what any simulator may have slightly wrong, is asked of the same
directions: one batch of simulations answers both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from runner.effects.base import AbstractEffect, Effects, Scope
from runner.effects.vocabulary import Candidate
from runner.inference.least_squares import Explanation, Fit, Fitter
from runner.inference.parameters import difference_steps
from runner.inference.process_noise import pushed
from runner.settings import SETTINGS
from runner.systems.base import AbstractSystem


@dataclass(frozen=True)
class Direction:
    """One way in which an effect can move the prediction: from a vector, by a step of one entry or to another vector.

    Args:
        candidate: The effect.
        origin: The vector that it is seen from; None: without the effect.
        vector: The vector that it goes to.
        per: How much of the unit amplitude that is; the column is divided by it.
        mismatch: Standard deviation that the simulator's own error has in this direction, in units of the amplitude.
        texture: Whether it is one of many that span the workspace: an effect at one place leaves errors at the others.
        asked: Whether the effect may be named; otherwise it is mismatch and nothing else.
        whole: Whether it is an amount of the whole effect, rather than the derivative by one of its parameters.
    """

    candidate: Candidate
    vector: np.ndarray
    per: float
    mismatch: float
    texture: bool = False
    asked: bool = True
    whole: bool = False

    @property
    def key(self) -> tuple[Candidate, bytes]:
        """What makes it the same direction in two surveys."""
        return self.candidate, self.vector.tobytes()


def form_share(candidate: Candidate) -> float:
    """Return what any simulator has wrong in the direction of an effect, as a share of its usual size."""
    odds = SETTINGS.odds
    return odds.rough_form_share if candidate.effect.rough_form else odds.mismatch_share


def directions(system: AbstractSystem) -> list[Direction]:
    """Return the directions of all effects of a system, amplitudes in units of each parameter's `scale`."""
    out = []
    for candidate in (*system.vocabulary, *system.vocabulary.uncertain):
        parameters = candidate.parameters(system.context)
        starts = candidate.starts(system.context)
        if len(starts):
            texture = candidate.effect.texture
            mismatch = SETTINGS.odds.texture_share if texture else 0.0
            out += [Direction(candidate, start, 1.0, mismatch, texture, whole=True) for start in starts]
            continue
        # the amplitude of what is shown by an amount is still in units of `scale`
        sizes = candidate.sizes(system.context)
        out += [Direction(candidate, size, size[0] / parameters[0].scale, 0.0, whole=True) for size in sizes]
        steps = difference_steps(parameters, np.zeros(len(parameters)), system.difference_share)
        for i, parameter in enumerate(parameters):
            vector = np.eye(len(parameters))[i] * steps[i]
            # what all of a kind share is a sum of directions that have their mismatch already
            mismatch = 0.0 if candidate.targets else form_share(candidate)
            per, asked = float(steps[i] / parameter.scale), candidate not in system.vocabulary.uncertain
            out.append(Direction(candidate, vector, per, mismatch, asked=asked))
    return out


@dataclass(frozen=True)
class Sensitivities:
    """How the whitened prediction moves in every direction, per episode (n, d), seen from one set of effects.

    `pushed` is how it answers forces, per episode (n, m), see `runner.inference.process_noise`; empty: not known.
    """

    directions: tuple[Direction, ...]
    columns: tuple[np.ndarray, ...]
    pushed: tuple[np.ndarray, ...] = ()


def sensitivities(fitter: Fitter, fit: Fit, every: Sequence[Direction], *, process: bool = False) -> Sensitivities:
    """Simulate all directions around a fit, and what a force does to it if `process` is to be integrated out.

    An amount of a whole effect that the fit holds on the same target is none beside it, and is left out.
    """
    base = fit.explanation.make(fit.x, fitter.context)
    others = tuple(
        d
        for d in every
        if d.candidate not in fit.explanation.candidates
        and not (d.whole and any(d.candidate.overlaps(c) for c in fit.explanation.candidates))
    )
    runs = [moved_along(d, fit.explanation, fit.x, fitter.context) for d in others]
    per = np.array([d.per for d in others])
    columns = tuple(c / per for c in fitter.changes(base, runs, fit))
    return Sensitivities(others, columns, pushed(fitter, fit) if process else ())


def moved_along(direction: Direction, explanation: Explanation, x: np.ndarray, context: Scope) -> Effects:
    """Return the effects of an explanation at x, (p,), moved along a direction.

    Where one of them is of the same kind and on the same target, as damping of one joint beside that of all, the number
    that it has there moves: an effect that was added would take its place, as if it were not there.
    """
    held: dict[tuple[type[AbstractEffect], str | None], tuple[np.ndarray, Effects]] = {}
    for candidate, part in explanation.parts(context):
        held |= {(c.effect, c.target): (x[part], c.make(x[part], context)) for c in candidate.each}
    for c in direction.candidate.each:
        before, _ = held.get((c.effect, c.target), (np.zeros(len(direction.vector)), ()))
        vector = before + direction.vector
        held[c.effect, c.target] = vector, c.make(vector, context)
    return tuple(effect for _, effects in held.values() for effect in effects)
