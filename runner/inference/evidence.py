"""How well each explanation accounts for a recording, once the simulator's own small errors are allowed for.

No model is exact: surfaces have texture, sizes are off by a little. With the noise of a good sensor, errors of a tenth
of a percent are many standard errors, and a comparison that takes the model for exact will find an "effect" in every
recording. So every explanation is granted a small share of everything else: along each direction in which any
effect would move the prediction, a Gaussian amplitude of a standard deviation of `OddsSettings.mismatch_share * level`
times the effect's usual size (`rough_form_share` where engines differ in the law itself), and a texture of the
workspace of the same kind; and a force that nothing foretells (see `runner.inference.process_noise`), where it is
known what one does. Those amplitudes, and the start states, are integrated out (a Gaussian integral; Kennedy & O'Hagan
2001 in the linear case), and so are the explanation's own parameters (Laplace).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from runner.effects.base import Scope
from runner.effects.vocabulary import Candidate
from runner.inference.directions import Direction
from runner.inference.least_squares import Explanation, Fit
from runner.inference.normal_equations import NormalEquations
from runner.inference.parameters import bounds, is_out_of_range
from runner.settings import SETTINGS
from runner.systems.base import AbstractSystem


@dataclass(frozen=True)
class Evidence:
    """What a fit's normal equations say of it.

    Args:
        log: Log evidence, up to a constant that all explanations of a recording share.
        level: Log evidence of each of the system's mismatch levels.
        loss: Sum of squared residuals after the mismatch has taken its part, at level 1: what the simulator is trusted
            with beforehand.
        covariance: Of the parameters as they were fitted, by plain least squares, (p, p): the mismatch has moved them
            by what it looks like to them, so that it counts in full (the "sandwich" of White 1982); so do episodes that
            differ. Zero along what the data do not tell: nothing moves it.
        by_prior: What the width of the prior adds to that, (p, p): all there is of what the data do not tell.
        dispersion: How many times as uncertain as noise residuals were taken for.
        process: Standard deviation that the force that nothing foretells has at least, in units of the usual one, by
            this explanation alone; 0 where it is not known what a force does.
        scales: Log evidence of each of its scales, (L,).
        left: Sum of squared residuals after all mismatch has taken its part, at what is likeliest.
    """

    log: float
    level: np.ndarray
    loss: float
    covariance: np.ndarray
    by_prior: np.ndarray
    dispersion: float
    process: float
    scales: np.ndarray
    left: float


def log_densities(fit: Fit, context: Scope) -> np.ndarray:
    """Log prior density of each parameter, (p,): heavy-tailed in each amplitude, even over places and logarithms."""
    out = []
    for candidate, part in fit.explanation.parts(context):
        scattered = candidate.is_placed(context)
        for k, (p, value) in enumerate(zip(candidate.parameters(context), fit.x[part], strict=True)):
            if scattered and k > 0:
                out.append(-np.log(p.upper - p.lower))
            else:
                # Student's t with three degrees of freedom; one-sided amplitudes have twice the density
                z = value / p.scale
                density = 0.3675525969 / p.scale * (1 + z * z / 3) ** -2
                out.append(np.log(density * (2.0 if p.lower == 0 else 1.0)))
    return np.array(out)


def evidence(
    around: NormalEquations,
    system: AbstractSystem,
    known: np.ndarray | None = None,
    *,
    dispersion: float = 1.0,
    scales: np.ndarray | None = None,
) -> Evidence:
    """Integrate the mismatch and the parameters out.

    A parameter that may rest on its bound stays there; any other one there makes the explanation impossible.

    Args:
        around: The fit amid the directions of mismatch.
        system: What was recorded; how large the mismatch is, is not known beforehand: its levels are equally likely.
        known: Covariance of the parameters from elsewhere, (p, p): they may move so far only. None: their prior.
        dispersion: How many times as uncertain residuals are as noise is; see `contender.dispersion_of`.
        scales: How likely each scale of process noise is, (L,); None: all are equally likely.
    """
    fit, whole = around.fit, len(around.fit.x)
    context, levels = system.context, system.mismatch_levels
    if is_out_of_range(fit.explanation.parameters(context), fit.x):
        nothing = np.full((whole, whole), np.nan)
        nowhere = np.full(len(levels), -np.inf)
        return Evidence(
            -np.inf, nowhere, float(fit.total), nothing, nothing, dispersion, 0.0, nowhere, float(fit.total)
        )
    free = np.flatnonzero(~fit.at_bound)
    total, amid = around.gram.sum(axis=0), around.amid_process
    keep = np.concatenate([free, np.arange(whole, len(total))])
    p, spread = len(free), np.array([d.mismatch for d in around.directions])
    every_density = log_densities(fit, context)
    density = every_density[free]
    # a parameter that the data don't tell: as uncertain as its prior is wide, so that it neither gains nor loses
    width = np.diag(2 * np.pi * np.exp(2 * density))
    if known is not None:
        width = width + np.linalg.pinv(known[np.ix_(free, free)])

    def by_level(gram: np.ndarray) -> np.ndarray:
        """Log evidence and loss of each level, (2, levels)."""
        terms = _Terms.of(gram[np.ix_(keep, keep)] / dispersion, around.volume / dispersion, p, spread)
        return np.array([terms.integrated(level, density, width) for level in levels]).T

    plain = by_level(total)
    logs, losses = plain[:1], plain[1:]
    if amid:
        each = np.array([by_level(one.gram) for one in amid])
        logs, losses = each[:, 0] - np.array([[one.cost] for one in amid]), each[:, 1]
    shares = np.full(len(logs), 1.0 / len(logs)) if scales is None or not amid else scales
    with np.errstate(divide="ignore"):
        weighed = logs + np.log(shares)[:, None]
    scale, level = np.unravel_index(int(np.argmax(weighed)), logs.shape)
    own, rest = free, whole + np.flatnonzero(spread > 0)
    h_oo = total[np.ix_(own, own)] / dispersion
    inverse = np.linalg.inv(h_oo + width)
    moved = total[np.ix_(own, rest)] / dispersion * (spread[spread > 0] * levels[level])
    by_prior = np.diag(np.exp(-2 * every_density) / (2 * np.pi))  # of what rests on its bound: all of its prior
    covariance = by_prior.copy()
    scores = h_oo + moved @ moved.T
    if amid and not system.episodes_differ:
        scores += amid[scale].scores[np.ix_(free, free)] / dispersion
    if system.episodes_differ:
        # that is as they are seen to scatter, whatever makes them
        scores += _between_episodes(around.gram[:, free, -1] / dispersion)
    covariance[np.ix_(free, free)] = inverse @ scores @ inverse
    by_prior[np.ix_(free, free)] = inverse @ width @ inverse
    by_scale = np.logaddexp.reduce(logs, axis=1) - np.log(len(levels))
    every_level = np.logaddexp.reduce(weighed, axis=0)
    process = _at_least(by_scale, [one.scale for one in amid])
    return Evidence(
        float(np.logaddexp.reduce(every_level) - np.log(len(levels))),
        every_level,
        float(plain[1, levels.index(1.0)]) * dispersion,
        covariance,
        by_prior,
        dispersion,
        process * float(np.sqrt(dispersion)),
        by_scale,
        float(losses[scale, level]) * dispersion,
    )


def _at_least(logs: np.ndarray, scales: Sequence[float]) -> float:
    """Return the smallest scale that is not much less likely than the likeliest, between those that were tried.

    Where the data tell nothing of a force, that is the smallest of all.
    """
    if not scales:
        return 0.0
    enough = float(logs.max()) - SETTINGS.process.sure_log_odds
    first = int(np.argmax(logs >= enough))
    if first == 0 or not np.isfinite(logs[first - 1]):
        return float(scales[first])
    share = (enough - logs[first - 1]) / (logs[first] - logs[first - 1])
    return float(np.exp(np.interp(share, [0.0, 1.0], np.log([scales[first - 1], scales[first]]))))


@dataclass(frozen=True)
class _Terms:
    """Inner products of a fit's own derivatives (o), the directions of mismatch (r), and its residual (g, rr).

    Directions are in units of their mismatch at level 1, along the axes of their own inner products, `size`.
    """

    h_oo: np.ndarray
    h_or: np.ndarray
    size: np.ndarray
    g_o: np.ndarray
    g_r: np.ndarray
    rr: float

    @classmethod
    def of(cls, total: np.ndarray, volume: float, p: int, spread: np.ndarray) -> _Terms:
        """Return those of a matrix of own derivatives, directions of these standard deviations, and the residual."""
        rest = np.flatnonzero(spread > 0)
        unit, rest = spread[rest], p + rest
        size, axes = np.linalg.eigh(unit[:, None] * total[np.ix_(rest, rest)] * unit)
        along = axes.T @ (unit[:, None] * total[rest])
        own, right = along[:, :p].T, along[:, -1]
        return cls(total[:p, :p], own, np.maximum(size, 0.0), total[:p, -1], right, float(total[-1, -1]) + volume)

    def integrated(self, level: float, density: np.ndarray, width: np.ndarray) -> tuple[float, float]:
        """Integrate the mismatch of a level and the parameters out: log evidence, and the loss that is left.

        `density` and `width` are log densities of the parameters' priors, (p,), and their precisions, (p, p).
        """
        p, inner = len(density), 1.0 + level**2 * self.size
        shrunk = level**2 / inner
        schur, g = self.h_oo - (self.h_or * shrunk) @ self.h_or.T, self.g_o - self.h_or @ (shrunk * self.g_r)
        loss, volume = self.rr - float(shrunk @ self.g_r**2), -0.5 * float(np.log(inner).sum())
        if p:
            schur = schur + width
            loss -= float(g @ np.linalg.solve(schur, g))
            volume += 0.5 * p * np.log(2 * np.pi) - 0.5 * float(np.linalg.slogdet(schur).logabsdet)
            volume += float(density.sum())
        return volume - 0.5 * loss, loss


def by_form(candidate: Candidate, context: Scope) -> np.ndarray:
    """Return the variance of an effect's parameters as its law is only roughly the true one, (p,): 0 where it is.

    The data are of another law, in which the same number does the same to a share of the effect's usual size alone.
    """
    share = SETTINGS.odds.rough_form_share if candidate.effect.rough_form else 0.0
    return np.array([(share * p.scale) ** 2 for p in candidate.parameters(context)])


def _between_episodes(slopes: np.ndarray) -> np.ndarray:
    """Return how much the slopes of the loss of single episodes, (E, p), scatter in sum: (p, p).

    What a hit leaves is alike from one sample to the next, so that an episode is one voice and not as many as it has
    samples: the clusters of Liang and Zeger (1986).
    """
    count = len(slopes)
    off = slopes - slopes.mean(axis=0)
    return off.T @ off * count / max(count - 1, 1)


def predicted_gain(around: NormalEquations, level: float) -> dict[Candidate, tuple[float, np.ndarray]]:
    """Return, for every effect that a fit does not hold, the loss it would take off and a vector to start from.

    In the linear model around the fit, beside the mismatch at this level. Effects with scattered starts offer the
    best one; the others a step of all their parameters from zero.
    """
    p, ridge = len(around.fit.x), SETTINGS.fit.information_ridge
    total = around.gram.sum(axis=0)
    inner, right = total[:-1, :-1], total[:-1, -1]
    # own parameters are free, everything else has its mismatch
    spread = np.concatenate(
        [np.full(p, SETTINGS.fit.flat_prior), np.array([d.mismatch for d in around.directions]) * level]
    )
    out: dict[Candidate, tuple[float, np.ndarray]] = {}
    for candidate, members in around.by_candidate.items():
        index = p + np.array(members)
        free = spread.copy()
        free[index] = 0.0  # it must not be explained away by its own mismatch
        factor = cho_factor(free[:, None] * inner * free + np.eye(len(free)), lower=True)
        scaled = free[:, None] * np.column_stack([inner[:, index], right])
        solved = free[:, None] * cho_solve(factor, scaled)
        h = inner[np.ix_(index, index)] - inner[index] @ solved[:, :-1]
        g = right[index] - inner[index] @ solved[:, -1]
        offers = []
        for way in around.ways[candidate]:
            at = [members.index(m) for m in way]
            if not around.directions[way[0]].whole:
                step = -np.linalg.solve(h[np.ix_(at, at)] + ridge * np.eye(len(at)), g[at])
                offers.append((float(-g[at] @ step), moved_by(around.directions, way, step)))
            else:
                (k,) = at
                if candidate.effect.switch:
                    amplitude, gain = np.ones(()), -2.0 * g[k] - h[k, k]
                else:
                    amplitude, gain = trusted(-g[k] / (h[k, k] + ridge)), g[k] ** 2 / (h[k, k] + ridge)
                offers.append((float(gain), moved_by(around.directions, way, amplitude[None])))
        out[candidate] = max(offers, key=lambda o: o[0])
    return out


def trusted(amplitudes: np.ndarray) -> np.ndarray:
    """Return amplitudes in units of the prior, no larger than a linear model is trusted with."""
    return np.clip(amplitudes, -SETTINGS.fit.trust_radius, SETTINGS.fit.trust_radius)


def moved_by(every: Sequence[Direction], way: Sequence[int], amplitudes: np.ndarray) -> np.ndarray:
    """Return the vector of an effect that has moved by amplitudes in the directions of one way."""
    if every[way[0]].whole:
        vector = every[way[0]].vector.copy()
        vector[0] *= amplitudes[0] / every[way[0]].per
        return vector
    return np.asarray(amplitudes) * np.array([np.max(np.abs(every[m].vector)) / abs(every[m].per) for m in way])


def clip(candidate: Candidate, vector: np.ndarray, context: Scope) -> np.ndarray:
    """Return the nearest vector that an effect allows."""
    low, high = bounds(candidate.parameters(context))
    return np.clip(vector, low, high)


def joined(fit: Fit, candidate: Candidate, vector: np.ndarray) -> tuple[Explanation, np.ndarray]:
    """Return a fit's explanation with one more effect, and the vector that starts it."""
    return fit.explanation + Explanation((candidate,)), np.concatenate([fit.x, vector])
