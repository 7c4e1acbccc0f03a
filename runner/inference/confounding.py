"""What could be taken for what: how far other effects would have done to this recording what an effect did.

The sensitivities around the fitted explanation say what is alike: in the metric of the noise and of the simulator's
own small errors, start states and the other effects of the explanation being free. Dry friction makes sensitivities
rough, so what is alike is tried: the fitted model stands in for reality, without noise, and the rival is fitted to it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from runner.effects.base import Scope
from runner.inference.evidence import Evidence, NormalEquations, clip
from runner.inference.least_squares import Explanation, Fit, Fitter, amplitudes
from runner.inference.warm_start import Key, key_of
from runner.settings import SETTINGS
from runner.systems.base import AbstractSystem
from runner.systems.simulator import Run


@dataclass(frozen=True)
class Rival:
    """An effect that could stand for another.

    Args:
        effect: An effect of the explanation.
        rival: One that is not in it.
        alike: Share of what the effect does to the recording, in squares, that the rival would do as well, 0 to 1.
        log_odds: Natural log odds that a recording like this one is expected to give against the rival; from a trial
            where it is alike, otherwise from the sensitivities.
        instead: The explanation with the rival in the effect's place, fitted to what the fitted model does; None: it
            has not been tried.
        one: Whether the two are two words for one motion, see `are_one`.
    """

    effect: str
    rival: str
    alike: float
    log_odds: float
    instead: Fit | None = field(default=None, repr=False, compare=False)
    one: bool = False

    @property
    def confounded(self) -> bool:
        """Whether such data can't tell the two apart."""
        return self.log_odds < SETTINGS.odds.told_apart_log_odds


def are_one(a: Fit, b: Fit, context: Scope) -> bool:
    """Whether two fits that differ in one effect have two words for one motion of what was recorded.

    What they predict differs by so little that no recording like this one tells them apart, and by next to nothing of
    what either effect does, by its derivatives: two causes that are merely alike part by more, however small they are.
    Both are of the same episodes with the same noise.
    """
    apart = sum(float(((p - q) ** 2).sum()) for p, q in zip(a.residual, b.residual, strict=True))
    return _are_one(a, b, apart, context)


def _are_one(a: Fit, b: Fit, apart: float, context: Scope) -> bool:
    """The same of fits whose motions are apart by that sum of squares, in noises."""
    own, other = (set(f.explanation.candidates) for f in (a, b))
    if len(own - other) != 1 or len(other - own) != 1:
        return False
    done = []
    for fit, only in ((a, own - other), (b, other - own)):
        part = next(p for c, p in fit.explanation.parts(context) if c in only)
        done.append(sum(float(((j[:, part] @ fit.x[part]) ** 2).sum()) for j in fit.jacobian))
    odds = SETTINGS.odds
    return 0.5 * apart < odds.told_apart_log_odds and apart < odds.one_motion_share * min(done)


def rivals(around: NormalEquations, evidence: Evidence, fitter: Fitter, known: Iterable[Fit] = ()) -> tuple[Rival, ...]:
    """Return the rivals of every effect of a fit, the most alike first.

    `known` are other fits of the same recording: one with a rival in an effect's place has found where to begin.
    """
    screened = _screened(around, evidence, fitter.system)
    tried = [r for r in screened[: SETTINGS.odds.confounded_trials] if r.alike > SETTINGS.odds.confounded_min_alike]
    found = {key_of(f.explanation): f for f in known}
    return tuple(_tried(r, around.fit, fitter, found) if r in tried else r for r in screened)


def _tried(rival: Rival, fit: Fit, fitter: Fitter, found: Mapping[Key, Fit]) -> Rival:
    """Return a rival with its log odds: half of what it leaves, in squared noises, of what the fitted model does."""
    context = fitter.context
    effects = fit.explanation.make(fit.x, context)
    values = list(fitter.measured.values)
    each = [(e, [Run(effects, start)]) for e, start in zip(fit.episodes, fit.starts, strict=True)]
    for (e, _), shown in zip(each, fitter.simulator.predict_each(each), strict=True):
        values[e] = shown[0]
    stand_in = replace(fitter, measured=replace(fitter.measured, values=tuple(values)))
    fits = []
    for candidate in fitter.system.vocabulary.by_name[rival.rival]:
        others = tuple(c for c in fit.explanation.candidates if c.name != rival.effect)
        explanation = Explanation((*others, candidate))
        x = [value for c, part in fit.explanation.parts(context) if c in others for value in fit.x[part]]
        starts = candidate.starts(context)
        # two signs: around zero dry friction may hide the way
        first = starts[0] if len(starts) else 0.1 * np.array([p.scale for p in candidate.parameters(context)])
        begins = [np.concatenate([x, clip(candidate, start, context)]) for start in (first, -first)]
        if known := found.get(key_of(explanation)):
            by_candidate = {c: known.x[part] for c, part in known.explanation.parts(context)}
            begins.insert(0, np.concatenate([by_candidate[c] for c in explanation.candidates]))
        for begin in begins:
            # only the one that comes nearest counts
            nearest = min((f.total for f in fits), default=np.inf)
            fits.append(
                stand_in.fit(
                    explanation,
                    fit.episodes,
                    x=begin,
                    near=fit,
                    target=nearest,
                    patience=SETTINGS.fit.patience_steps,
                    iterations=SETTINGS.fit.warm_steps,
                )
            )
    instead = min(fits, key=lambda f: f.total)
    one = _are_one(fit, instead, instead.total, context)
    return replace(rival, log_odds=0.5 * instead.total, instead=instead, one=one)


def _screened(around: NormalEquations, evidence: Evidence, system: AbstractSystem) -> tuple[Rival, ...]:
    context = system.context
    gram = around.gram.sum(axis=0)[:-1, :-1]
    explanation, x = around.fit.explanation, around.fit.x
    p = len(x)
    level = system.mismatch_levels[int(np.argmax(evidence.level))]
    spread = np.array([d.mismatch * level for d in around.directions])
    out = []
    for candidate, own in explanation.parts(context):
        move = np.zeros(len(gram))
        moved = amplitudes(candidate, own, context)  # a place and a width do nothing without one
        move[moved] = x[moved]
        scale = np.array([d.scale for d in explanation.parameters(context)])
        for rival, members in around.by_candidate.items():
            free = np.concatenate([SETTINGS.fit.flat_prior * scale, spread])
            free[own] = 0.0
            free[p + np.array(members)] = 0.0
            best = (0.0, 1.0)
            for group in around.ways[rival]:
                total, left = _left(gram, move, p + np.array(group), free)
                if total > 0 and left / total < best[1]:
                    best = total, left / total
            total, share = best
            if total > 0:
                out.append(Rival(candidate.name, rival.name, float(1 - share), float(0.5 * total * share)))
    alike: dict[tuple[str, str], Rival] = {}
    for r in sorted(out, key=lambda r: r.log_odds):
        if r.effect != r.rival:
            alike.setdefault((r.effect, r.rival), r)
    return tuple(sorted(alike.values(), key=lambda r: -r.alike))


def _left(gram: np.ndarray, move: np.ndarray, rival: np.ndarray, free: np.ndarray) -> tuple[float, float]:
    """Return the squared length of a move, and of what a rival leaves of it; `free` spreads are integrated out."""
    columns = np.zeros((len(gram), 1 + len(rival)))
    columns[:, 0] = move
    columns[rival, 1 + np.arange(len(rival))] = 1.0
    image = gram @ columns
    inner = cho_factor(np.eye(len(gram)) + free[:, None] * gram * free, lower=True)
    scaled = free[:, None] * image
    metric = columns.T @ image - scaled.T @ cho_solve(inner, scaled)
    total = float(metric[0, 0])
    ridge = metric[1:, 1:] + 1e-2 * np.eye(len(rival))
    left = total - float(metric[0, 1:] @ np.linalg.solve(ridge, metric[1:, 0]))
    return max(total, 0.0), max(left, 0.0)
