"""An oracle that was told which effects there are, and fits their parameters: how far the gap can be closed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from runner.diagnosis.pipeline import close, split
from runner.effects import EFFECTS, AbstractEffect, AxisFriction, ViscousFilm
from runner.errors import ResultError
from runner.inference.evidence import clip, directions, joined, promise, surroundings, survey
from runner.inference.least_squares import NONE, Fit, Fitter
from runner.inference.multiple_shooting import begun
from runner.noise.measured import Measured, materially_different, measure, refine
from runner.recording import Recording
from runner.systems.planar_box.simulator import Effects, Run, Simulator, context_of

# Mean square in noises that the true effects should not leave, of episodes so long; and the length of their pieces.
STUCK, SHORTEST_S, PIECE_S = 1.5, 1.5, 0.75
# Variants of an effect that an answer's `true` speaks of; where it doesn't, another is meant.
SPECIAL: dict[tuple[str, str], type[AbstractEffect]] = {
    ("acts", "film"): ViscousFilm,
    ("flow", "scaled"): AxisFriction,
}


def kinds_of(effects: Sequence[Mapping[str, Any]]) -> list[type[AbstractEffect]]:
    """Return the classes of planted effects; of several variants the one that `true` speaks of.

    Raises:
        ResultError: If an effect is not in the vocabulary.
    """
    out = []
    for effect in effects:
        variants = EFFECTS.get(effect["name"])
        if not variants:
            raise ResultError(f"answers: no effect '{effect['name']}' in the vocabulary.")
        told = [SPECIAL[said] for said in effect.get("true", {}).items() if SPECIAL.get(said) in variants]
        plain = [k for k in variants if k not in SPECIAL.values()]
        out.append((told or plain)[0])
    return out


def oracle_closed(
    recording: Recording, effects: Sequence[Mapping[str, Any]], unseen: Sequence[int] | None = None
) -> tuple[float, float]:
    """Fit the effects that are known to be there and return how far that closes the gap on the held-out episodes.

    Args:
        recording: Of a case.
        effects: What was planted in it.
        unseen: Numbers of the episodes that the diagnosis held out; None: those that it does as a rule.

    Returns:
        The share of the closable mean square that is closed, and how much is closable, in squared noises.
    """
    kinds = kinds_of(effects)
    numbers = [e.index for e in recording.episodes]
    fitted, held_out = split(numbers)
    if unseen is not None:
        held_out = tuple(k for k, number in enumerate(numbers) if number in unseen)
        fitted = tuple(k for k in range(len(numbers)) if k not in held_out)
    simulator, context = Simulator(recording, grid=8, threads=1), context_of(recording)
    measured = measure(recording)
    nominal = Fitter(simulator, measured, context).fit(NONE, fitted, iterations=8)
    measured = refine(measured, recording, _left(nominal, (), simulator, measured))
    fit = _fit(Fitter(simulator, measured, context), kinds, fitted)
    again = refine(measured, recording, _left(fit, fit.explanation.make(fit.x, context), simulator, measured))
    if materially_different(measured, again):
        measured, fit = again, _fit(Fitter(simulator, again, context), kinds, fitted)
    fitter, found = Fitter(simulator, measured, context), fit.explanation.make(fit.x, context)
    before = fitter.fit(NONE, held_out)
    after = Fitter(simulator, measured, context, found).fit(NONE, held_out)
    table = close(before, after, measured, fitter, found, pd.DataFrame())
    closable = float(np.mean((table.table["before"] / table.table["noise"]) ** 2)) - 1.0
    return table.closable_closed, closable


def _fit(fitter: Fitter, kinds: Sequence[type[AbstractEffect]], episodes: Sequence[int]) -> Fit:
    """Fit one effect after the other, each from where it promises most, all so far together."""
    every = [d for d in directions(fitter.context) if d.kind in kinds]
    fit, left = fitter.fit(NONE, episodes, iterations=8), list(kinds)
    while left:
        offers = promise(surroundings(fit, survey(fitter, fit, every)), 1.0)
        kind = max(left, key=lambda k: offers[k][0])
        left.remove(kind)
        explanation, x = joined(fit, kind, clip(kind, offers[kind][1], fitter.context))
        fit = fitter.fit(explanation, episodes, x=x, near=fit, iterations=40)
    if fit.total > STUCK * fitter.measured.count(episodes) and fitter.longest_s(episodes) > SHORTEST_S:
        # in a hollow, as a descent over a long time may end: from pieces
        spans = fitter.pieces(PIECE_S, episodes)
        if not spans:
            return fit
        short = _fit(fitter.parts(spans), kinds, range(len(spans)))
        again = fitter.fit(short.explanation, episodes, x=short.x, starts=begun(short, spans, fit), iterations=40)
        fit = min(fit, again, key=lambda f: f.total)
    return fit


def _left(fit: Fit, effects: Effects, simulator: Simulator, measured: Measured) -> dict[int, np.ndarray]:
    return {
        e: simulator.predict(e, [Run(effects, start)])[0] - measured.values[e]
        for e, start in zip(fit.episodes, fit.starts, strict=True)
    }
