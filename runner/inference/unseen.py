"""Start states of episodes that were not fitted, with explanations at the parameters that they have."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from runner.inference.contender import Contender
from runner.inference.foretold import excesses
from runner.inference.least_squares import NONE, Fit, Fitter
from runner.inference.start_draws import improved_starts
from runner.recording import Span
from runner.settings import SETTINGS

VALUES_AT_ONCE = 1_000_000  # measured ones whose start states are fitted together: some hundred megabytes


def unseen(contender: Contender, fitter: Fitter, held_out: Sequence[int], nominal: Fit | None) -> Fit:
    """Return a contender at its parameters with the start states of other episodes fitted."""
    explanation, x = contender.fit.explanation, contender.fit.x
    held = _holding(contender, fitter)
    best = held.fit(NONE, held_out, near=nominal)
    # where the body spins fast, a descent of the start states may end in a local minimum: from two sides, save where
    # nothing is left to be gained, or stretches are so short that their ends answer to their starts in proportion
    gains = nominal is not None and best.total >= nominal.total
    if gains and fitter.measured.excess(best.total, held_out) > SETTINGS.search.near_excess:
        best = min(best, held.fit(NONE, held_out), key=lambda f: f.total)
    if held.until_hit(held_out):
        starts = improved_starts(held, held_out, best.starts)
        best = held.fit(NONE, held_out, starts=starts, iterations=0)
    # what is replayed much worse than all that was fitted may begin where it did not: a motion forgets its start. Of
    # the nominal model no start is known to be a good one, and what it misses from a bad one would be called the gap.
    usual = float(excesses(contender.fit, fitter).max()) if nominal is not None else 0.0
    worst = max(usual, SETTINGS.search.near_excess)
    off = np.flatnonzero(excesses(best, fitter) > worst)
    if not len(off):
        return fitter.fit(explanation, held_out, x=x, near=best, iterations=0)
    starts = best.starts.copy()
    for k in off:
        starts[k] = _grown_start(held, best.episodes[k], starts[k])
    return fitter.fit(explanation, held_out, x=x, starts=starts, iterations=0)


def _holding(contender: Contender, fitter: Fitter) -> Fitter:
    """Return a fitter of start states alone: with a contender's effects at its parameters in the model."""
    return replace(fitter, held=contender.fit.explanation.make(contender.fit.x, fitter.context))


def unstuck(leaders: Sequence[Contender], there: Mapping[int, Fit], fitter: Fitter) -> dict[int, Fit]:
    """Return unseen episodes, by the identity of each leader's fit, with starts sought anew where others leave less.

    What is about to rest is held by friction or just not: a descent from the start that suits another explanation may
    end on the wrong side of that, some tens of log units behind. Where much is left, `unseen` has looked already.
    """
    least, out = np.min([t.loss for t in there.values()], axis=0), dict(there)
    stuck, near = SETTINGS.held_out.stuck_loss, SETTINGS.search.near_excess
    for c in leaders:
        fit = there[id(c.fit)]
        behind = [
            k
            for k, e in enumerate(fit.episodes)
            if fit.loss[k] > least[k] + stuck and fitter.measured.excess(float(fit.loss[k]), [e]) < near
        ]
        held = _holding(c, fitter)
        found = {k: held.fit(NONE, [fit.episodes[k]]) for k in behind}
        better = {k: f.starts[0] for k, f in found.items() if f.total < fit.loss[k]}
        if better:
            starts = np.array([better.get(k, start) for k, start in enumerate(fit.starts)])
            out[id(c.fit)] = fitter.fit(c.fit.explanation, fit.episodes, x=c.fit.x, starts=starts, iterations=0)
    return out


def _grown_start(held: Fitter, episode: int, start: np.ndarray) -> np.ndarray:
    """Return an episode's start state, (S,), fitted to longer and longer parts of it; the old one if that is better.

    A mechanism that turns over forgets where it began: fitted to the whole at once, the start ends in a local minimum.
    """
    samples = len(held.measured.values[episode])
    lengths = [max(round(s * samples), SETTINGS.breakaway.min_samples) for s in SETTINGS.held_out.growing_shares]
    parts = [held.parts([Span(episode, 0, length)]) for length in lengths]
    grown = parts[0].first_starts([0])
    for part in parts:
        grown = part.fit(NONE, [0], starts=grown).starts
    before, after = (held.loss(NONE, np.empty(0), s, [episode]) for s in (start[None], grown))
    return grown[0] if after < before else start


def start_states(contender: Contender, fitter: Fitter, episodes: Sequence[int]) -> dict[int, np.ndarray]:
    """Return start states (S,), by which nothing is chosen, of stretches, with a contender at its parameters."""
    held, starts = _holding(contender, fitter), dict[int, np.ndarray]()
    for some in portions(fitter, episodes):
        fit = held.fit(NONE, some, iterations=SETTINGS.held_out.rough_steps, polish=False)
        starts |= zip(fit.episodes, fit.starts, strict=True)
    return starts


def portions(fitter: Fitter, episodes: Sequence[int]) -> list[list[int]]:
    """Part stretches into portions that memory allows; none of them depends on another."""
    out, count = list[list[int]](), np.inf
    for e in episodes:
        size = fitter.measured.values[e].size
        if count + size > VALUES_AT_ONCE:
            out.append([])
            count = 0
        out[-1].append(e)
        count += size
    return out
