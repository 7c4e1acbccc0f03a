"""Where the fit of an explanation begins: near one that was fitted, or where an earlier look left it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from runner.effects.base import Effects
from runner.effects.vocabulary import Candidate
from runner.inference.contender import least_gain
from runner.inference.least_squares import Explanation, Fit, Fitter
from runner.inference.variable_projection import hopeless
from runner.settings import SETTINGS

Key = tuple[Candidate, ...]


@dataclass(frozen=True)
class WarmStart:
    """Where a fit may begin: an explanation, its parameters, (p,), start states, (E, S), and the loss there."""

    explanation: Explanation
    x: np.ndarray
    starts: np.ndarray
    total: float


@dataclass(frozen=True)
class Beginning:
    """What an earlier look left.

    Args:
        seeds: Where to begin, by effects.
        ruled_out: Single effects that are not to be tried alone again.
        short: Those single effects of what hits something that leave much of a flight which others explain.
        answered: Whether they are what has been told as the best so far: it is, until they are fitted again.
    """

    seeds: dict[Key, WarmStart] = field(default_factory=dict)
    ruled_out: frozenset[Key] = frozenset()
    short: frozenset[Key] = frozenset()
    answered: bool = False


def key_of(explanation: Explanation) -> Key:
    """Return an explanation's effects in an order of their own."""
    return tuple(sorted(explanation.candidates, key=lambda c: c.key))


def where_to_begin(
    fitter: Fitter, explanation: Explanation, x: np.ndarray, near: Fit, seed: WarmStart | None
) -> dict[str, Any]:
    """Return where to begin a fit: from what is near, or from the seed where that leaves less.

    And in no steps where none of an effect is best of all sizes, as the linear model has promised.
    """
    if seed is None:
        new = explanation.candidates[-1]
        sizes = new.scan(fitter.context)
        if len(sizes):
            begin = _scanned(fitter, explanation, x, near, sizes)
            rests = begin[_size_of_last(explanation, fitter)] == 0.0
            return {"x": begin, "near": near} | ({"iterations": 0} if rests else {})
        if new.is_placed(fitter.context) and not new.effect.switch:
            # the amplitude that a linear model promises may overshoot; none of it is the fit that is near
            first = len(x) - len(new.parameters(fitter.context))
            amplitude = slice(first, first + new.effect.amplitudes)
            for _ in range(3):
                if fitter.loss(explanation, x, near.starts, near.episodes) < near.total:
                    break
                x = x.copy()
                x[amplitude] /= 4
        return {"x": x, "near": near}
    seeded = _in_order(seed, explanation, fitter)
    by = [fitter.loss(explanation, v, s, near.episodes) for v, s in ((x, near.starts), (seeded, seed.starts))]
    return {"x": seeded, "starts": seed.starts} if by[1] < by[0] else {"x": x, "near": near}


def _scanned(fitter: Fitter, explanation: Explanation, x: np.ndarray, near: Fit, sizes: np.ndarray) -> np.ndarray:
    """Return the parameters with the size of the last effect that leaves least at the start states of a fit nearby.

    Of some sizes (K,), ascending, as a survey shows them, and of finer ones about the best of them; not where the
    least of them, which is next to none of the effect, is best and worse than none.
    """
    place = _size_of_last(explanation, fitter)

    def with_each(some: np.ndarray) -> list[Effects]:
        return [explanation.make(_with(x, place, size), fitter.context) for size in some]

    with fitter.simulator.survey() as simulator:
        surveying = replace(fitter, simulator=simulator)
        left = _raced(surveying, with_each(sizes), near)
        i = int(np.argmin(left))
        # a model that is built otherwise differs by rounding and steps, which is no gain
        least = least_gain(fitter.measured.count(near.episodes))
        if i == 0 and left[0] >= surveying.loss(near.explanation, near.x, near.starts, near.episodes) - least:
            return x
    finer = np.linspace(sizes[max(i - 1, 0)], sizes[min(i + 1, len(sizes) - 1)], SETTINGS.fit.scanned_sizes)
    among = np.array([x[place], *finer])
    return _with(x, place, float(among[np.argmin(_raced(fitter, with_each(among), near))]))


def _raced(fitter: Fitter, models: Sequence[Effects], near: Fit) -> np.ndarray:
    """Return the loss of each of several models, (M,), at the start states of a fit nearby; infinite where it is out.

    Episode by episode, without those that are as far behind the best by then as no descent makes up for: soft springs
    and low limits miss an episode as badly as the next.
    """
    left, count = np.zeros(len(models)), 0
    for k, e in enumerate(near.episodes):
        running = np.flatnonzero(np.isfinite(left))
        left[running] += fitter.losses([models[i] for i in running], near.starts[[k]], [e])
        count += fitter.measured.count([e])
        left[left > hopeless(float(left.min()), count)] = np.inf
    return left


def _size_of_last(explanation: Explanation, fitter: Fitter) -> int:
    """Return where in the vector the size of the last effect stands."""
    return explanation.parts(fitter.context)[-1][1].start


def _with(x: np.ndarray, place: int, value: float) -> np.ndarray:
    """Return a copy of a vector with one entry replaced."""
    out = x.copy()
    out[place] = value
    return out


def over_edges(fitter: Fitter, fit: Fit, without: Fit) -> Fit:
    """Fit anew from other sizes of the last effect, at some of which the motion jumps, as long as that gains.

    Descents end where a push just starts the body, or just doesn't.
    """
    limits, count = SETTINGS.fit, fitter.measured.count(fit.episodes)
    if fit.total - count > (1.0 - limits.restart_min_share) * (without.total - count):
        return fit
    place = _size_of_last(fit.explanation, fitter)
    for _ in range(limits.max_restarts):
        sizes = [_with(fit.x, place, fit.x[place] * by) for by in limits.restart_factors]
        tries = [
            fitter.fit(fit.explanation, fit.episodes, x=x, near=fit, iterations=limits.restart_steps, polish=False)
            for x in sizes
        ]
        best = min(tries, key=lambda f: f.total)
        if best.total - count > (1.0 - limits.restart_gain) * (fit.total - count):
            break
        fit = best
    return fit


def _in_order(seed: WarmStart, explanation: Explanation, fitter: Fitter) -> np.ndarray:
    """Return a seed's parameters in the order of an explanation of the same effects."""
    parts = dict(seed.explanation.parts(fitter.context))
    return np.concatenate([seed.x[parts[c]] for c in explanation.candidates])
