"""An oracle that was told which effects there are, and fits their parameters: how far the gap can be closed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from runner.diagnosis.closure import close
from runner.diagnosis.score import full_name
from runner.diagnosis.split import split
from runner.effects.base import Effects
from runner.effects.vocabulary import Candidate, Vocabulary
from runner.errors import ResultError
from runner.inference.evidence import clip, directions, joined, normal_equations, predicted_gain, sensitivities
from runner.inference.least_squares import NONE, Fit, Fitter
from runner.inference.multiple_shooting import begun
from runner.noise.measured import Measured, materially_different, measure, refine
from runner.systems.base import AbstractSystem
from runner.systems.simulator import AbstractSimulator, Run

# Mean square in noises that the true effects should not leave, of episodes so long; and the length of their pieces.
STUCK, SHORTEST_S, PIECE_S = 1.5, 1.5, 0.75


def candidates_of(effects: Sequence[Mapping[str, Any]], vocabulary: Vocabulary) -> list[Candidate]:
    """Return the candidates of planted effects; of several variants the one that `true` speaks of.

    Raises:
        ResultError: If an effect is not in the vocabulary.
    """
    out = []
    for effect in effects:
        name = full_name(effect)
        variants = [c for c in vocabulary.by_name.get(name, ()) if c in vocabulary.candidates]
        if not variants:
            raise ResultError(f"answers: no effect '{name}' in the vocabulary.")
        said = effect.get("true", {}).items()
        told = [c for c in variants if c.effect.spoken_of in said]
        plain = [c for c in variants if c.effect.spoken_of is None]
        out.append((told or plain)[0])
    return out


def oracle_closed(
    system: AbstractSystem, effects: Sequence[Mapping[str, Any]], unseen: Sequence[int] | None = None
) -> tuple[float, float]:
    """Fit the effects that are known to be there and return how far that closes the gap on the held-out episodes.

    Args:
        system: Of a case.
        effects: What was planted in it.
        unseen: Numbers of the episodes that the diagnosis held out; None: those that it does as a rule.

    Returns:
        The share of the closable mean square that is closed, and how much is closable, in squared noises.
    """
    wanted = candidates_of(effects, system.vocabulary)
    numbers = [e.index for e in system.recording.episodes]
    fitted, held_out = split(numbers)
    if unseen is not None:
        held_out = tuple(k for k, number in enumerate(numbers) if number in unseen)
        fitted = tuple(k for k in range(len(numbers)) if k not in held_out)
    simulator, context = system.simulator(threads=1), system.context
    measured = measure(system)
    nominal = Fitter(system, simulator, measured).fit(NONE, fitted, iterations=8)
    measured = refine(measured, system, _left(nominal, (), simulator, measured))
    fit = _fit(Fitter(system, simulator, measured), wanted, fitted)
    again = refine(measured, system, _left(fit, fit.explanation.make(fit.x, context), simulator, measured))
    if materially_different(measured, again):
        measured, fit = again, _fit(Fitter(system, simulator, again), wanted, fitted)
    fitter, found = Fitter(system, simulator, measured), fit.explanation.make(fit.x, context)
    before = fitter.fit(NONE, held_out)
    after = Fitter(system, simulator, measured, found).fit(NONE, held_out)
    starts = {e: (b, a) for e, b, a in zip(held_out, before.starts, after.starts, strict=True)}
    table = close(starts, measured, fitter, found, pd.DataFrame())
    closable = float(np.mean((table.table["before"] / table.table["noise"]) ** 2)) - 1.0
    return table.closable_closed, closable


def _fit(fitter: Fitter, wanted: Sequence[Candidate], episodes: Sequence[int]) -> Fit:
    """Fit one effect after the other, each from where it promises most, all so far together."""
    every = [d for d in directions(fitter.system) if d.candidate in wanted]
    fit, left = fitter.fit(NONE, episodes, iterations=8), list(wanted)
    while left:
        offers = predicted_gain(normal_equations(fit, sensitivities(fitter, fit, every)), 1.0)
        candidate = max(left, key=lambda c: offers[c][0])
        left.remove(candidate)
        explanation, x = joined(fit, candidate, clip(candidate, offers[candidate][1], fitter.context))
        fit = fitter.fit(explanation, episodes, x=x, near=fit, iterations=40)
    if fit.total > STUCK * fitter.measured.count(episodes) and fitter.longest_s(episodes) > SHORTEST_S:
        # in a hollow, as a descent over a long time may end: from pieces
        spans = fitter.pieces(PIECE_S, episodes)
        if not spans:
            return fit
        short = _fit(fitter.parts(spans), wanted, range(len(spans)))
        again = fitter.fit(short.explanation, episodes, x=short.x, starts=begun(short, spans, fit), iterations=40)
        fit = min(fit, again, key=lambda f: f.total)
    return fit


def _left(fit: Fit, effects: Effects, simulator: AbstractSimulator, measured: Measured) -> dict[int, np.ndarray]:
    return {
        e: simulator.predict(e, [Run(effects, start)])[0] - measured.values[e]
        for e, start in zip(fit.episodes, fit.starts, strict=True)
    }
