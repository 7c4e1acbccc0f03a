"""How well each explanation accounts for a recording, once the simulator's own small errors are allowed for.

No model is exact: surfaces have texture, sizes are off by a little. With the noise of a good sensor, errors of a tenth
of a percent are many standard errors, and a comparison that takes the model for exact will find an "effect" in every
recording. So every explanation is granted a small share of everything else: along each direction in which any
effect would move the prediction, a Gaussian amplitude of a standard deviation of `OddsSettings.mismatch_share * level`
times the effect's usual size (`rough_form_share` where engines differ in the law itself), and a texture of the
workspace of the same kind. Those amplitudes, and the start states, are integrated out (a Gaussian integral; Kennedy &
O'Hagan 2001 in the linear case), and so are the explanation's own parameters (Laplace).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.special import softmax

from runner.effects.base import AbstractEffect, Effects, Scope
from runner.effects.vocabulary import Candidate
from runner.inference.least_squares import Explanation, Fit, Fitter
from runner.inference.parameters import bounds, difference_steps, is_possible
from runner.settings import SETTINGS
from runner.systems.base import AbstractSystem


@dataclass(frozen=True)
class Direction:
    """One way in which an effect can move the prediction: from where it is absent, or from what a fit has, to a vector.

    Args:
        candidate: The effect.
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
    """How the whitened prediction moves in every direction, per episode (n, d), seen from one set of effects."""

    directions: tuple[Direction, ...]
    columns: tuple[np.ndarray, ...]


def sensitivities(fitter: Fitter, fit: Fit, every: Sequence[Direction]) -> Sensitivities:
    """Simulate all directions around a fit.

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
    return Sensitivities(others, tuple(c / per for c in fitter.changes(base, runs, fit)))


def least_errors(fit: Fit, around: Sensitivities, fitter: Fitter) -> np.ndarray:
    """Return the own errors of a simulator that is as right as any may be, of each channel, in squared noises, (C,).

    Off in the direction of every effect by the least of the levels of mismatch, see `AbstractSystem.mismatch_levels`.
    """
    mismatch = min(fitter.system.mismatch_levels) * np.array([d.mismatch for d in around.directions])
    channels = len(fitter.system.channels)
    errors = [((columns * mismatch) ** 2).sum(axis=1).reshape(-1, channels).sum(axis=0) for columns in around.columns]
    counts = np.sum([fitter.measured.counted(e).sum(axis=0) for e in fit.episodes], axis=0)
    return np.sum(errors, axis=0) / np.maximum(counts, 1)


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


@dataclass(frozen=True)
class NormalEquations:
    """A fit amid the directions of a survey.

    `gram` holds, per fitted episode, the inner products of [own derivatives (p) | directions (d) | residual (1)],
    (E, p + d + 1, p + d + 1), with the start states projected out, in units of what residuals scatter by; `volume` is
    what that costs, see `Spread`. `total` is what the fit leaves with its start states as they are.
    """

    fit: Fit
    directions: tuple[Direction, ...]
    gram: np.ndarray
    volume: float
    total: float

    @property
    def by_candidate(self) -> dict[Candidate, list[int]]:
        """The positions of each effect's directions among `directions`, in order, of those that may be named."""
        out: dict[Candidate, list[int]] = {}
        for i, direction in enumerate(self.directions):
            if direction.asked:
                out.setdefault(direction.candidate, []).append(i)
        return out

    @property
    def ways(self) -> dict[Candidate, list[list[int]]]:
        """The same, in groups of what moves together: the derivatives of an effect, or an amount of the whole of it."""
        out = {}
        for candidate, members in self.by_candidate.items():
            derivatives = [m for m in members if not self.directions[m].whole]
            out[candidate] = [*([derivatives] if derivatives else []), *([m] for m in members if m not in derivatives)]
        return out


def normal_equations(fit: Fit, *known: Sensitivities) -> NormalEquations:
    """Set a fit amid the directions of surveys made around it or near it; of each direction the first counts.

    Those of its own effects are left out, save for the texture of the workspace.
    """
    chosen: dict[tuple[Candidate, bytes], tuple[Sensitivities, int]] = {}
    for one in known:
        for i, d in enumerate(one.directions):
            if d.texture or d.candidate not in fit.explanation.candidates:
                chosen.setdefault(d.key, (one, i))
    gram = []
    episodes = zip(fit.jacobian, fit.residual, fit.basis.q, fit.spread.dispersion, strict=True)
    for k, (jacobian, residual, q, dispersion) in enumerate(episodes):
        columns = [one.columns[k][:, i] for one, i in chosen.values()]
        whole = np.column_stack([jacobian, *columns, residual])
        whole = whole - q @ (q.T @ whole)
        gram.append(whole.T @ whole / dispersion)
    every = tuple(one.directions[i] for one, i in chosen.values())
    return NormalEquations(fit, every, np.array(gram), float(fit.spread.volume.sum()), fit.total)


def together(a: NormalEquations, b: NormalEquations) -> NormalEquations:
    """Set a fit amid what further episodes say as well, at the same parameters; only directions that both have."""
    p = len(a.fit.x)
    first = {d.key: i for i, d in enumerate(a.directions)}
    shared = [(first[d.key], j) for j, d in enumerate(b.directions) if d.key in first]
    gram = []
    for around, chosen in ((a, [i for i, _ in shared]), (b, [j for _, j in shared])):
        keep = np.array([*range(p), *(p + i for i in chosen), around.gram.shape[1] - 1])
        gram.append(around.gram[:, keep[:, None], keep])
    every = tuple(a.directions[i] for i, _ in shared)
    return NormalEquations(a.fit, every, np.concatenate(gram), a.volume + b.volume, a.total + b.total)


@dataclass(frozen=True)
class Evidence:
    """What a fit's normal equations say of it.

    Args:
        log: Log evidence, up to a constant that all explanations of a recording share.
        level: Log evidence of each of the system's mismatch levels.
        loss: Sum of squared residuals after the mismatch has taken its part, at level 1: what the simulator is trusted
            with beforehand.
        left: The same after only numbers that every owner has slightly wrong and nobody asks for have taken theirs, see
            `Vocabulary.uncertain`: what is left to be explained.
        covariance: Of the parameters as they were fitted, by plain least squares, (p, p): the mismatch has moved them
            by what it looks like to them, so that it counts in full (the "sandwich" of White 1982); so do episodes that
            differ. How large it is is known no better than its levels are likely: its variance is the mean over them.
            Zero along what the data do not tell: nothing moves it.
        by_prior: What the width of the prior adds to that, (p, p): all there is of what the data do not tell.
        dispersion: How many times as uncertain as noise residuals were taken for.
    """

    log: float
    level: np.ndarray
    loss: float
    left: float
    covariance: np.ndarray
    by_prior: np.ndarray
    dispersion: float


def log_densities(fit: Fit, context: Scope) -> np.ndarray:
    """Log prior density of each parameter, (p,): heavy-tailed in amplitudes as a rule, even over places and ranges."""
    out = []
    for candidate, part in fit.explanation.parts(context):
        scattered = candidate.is_placed(context)
        for k, (p, value) in enumerate(zip(candidate.parameters(context), fit.x[part], strict=True)):
            if scattered and k >= candidate.effect.amplitudes:
                out.append(-np.log(p.upper - p.lower))
            else:
                # Student's t with three degrees of freedom, or a normal; one-sided amplitudes have twice the density
                z = value / p.scale
                shape = (
                    -0.5 * z * z - 0.9189385332 if p.light_tailed else np.log(0.3675525969) - 2 * np.log1p(z * z / 3)
                )
                out.append(shape - np.log(p.scale) + (np.log(2.0) if p.lower == 0 else 0.0))
    return np.array(out)


def evidence(
    around: NormalEquations, system: AbstractSystem, known: np.ndarray | None = None, *, dispersion: float = 1.0
) -> Evidence:
    """Integrate the mismatch and the parameters out.

    A parameter that may rest on its bound stays there; any other one there makes the explanation impossible.

    Args:
        around: The fit amid the directions of mismatch.
        system: What was recorded; how large the mismatch is, is not known beforehand: its levels are equally likely.
        known: Covariance of the parameters from elsewhere, (p, p): they may move so far only. None: their prior.
        dispersion: How many times as uncertain residuals are as noise is; see `contender.dispersion_of`.
    """
    fit, whole = around.fit, len(around.fit.x)
    context, levels = system.context, system.mismatch_levels
    if not is_possible(fit, context):
        nothing = np.full((whole, whole), np.nan)
        left = around.total
        return Evidence(-np.inf, np.full(len(levels), -np.inf), left, left, nothing, nothing, dispersion)
    free = np.flatnonzero(~fit.at_bound)
    total = around.gram.sum(axis=0) / dispersion
    keep = np.concatenate([free, np.arange(whole, len(total))])
    total, p = total[np.ix_(keep, keep)], len(free)
    spread = np.array([d.mismatch for d in around.directions])
    mismatch = np.flatnonzero(spread > 0)
    nobody_asks = np.flatnonzero([spread[i] > 0 and not d.asked for i, d in enumerate(around.directions)])
    h_oo, h_or = total[:p, :p], total[:p, p + mismatch]
    total[-1, -1] += around.volume / dispersion
    every_density = log_densities(fit, context)
    density = every_density[free]
    # a parameter that the data don't tell: as uncertain as its prior is wide, so that it neither gains nor loses
    width = np.diag(2 * np.pi * np.exp(2 * density))
    if known is not None:
        width = width + np.linalg.pinv(known[np.ix_(free, free)])
    integrated = [_integrated(total, width, mismatch, spread[mismatch] * level) for level in levels]
    logs = [log + (density.sum() if p else 0.0) for log, _ in integrated]
    taken = 0.0
    if len(nobody_asks):
        # as plain squares are, from which it is told how uncertain residuals are; a prediction stays as it is
        moving = (total, width) if known is None else (total[p:, p:], np.empty((0, 0)))
        without, less = (
            _integrated(dispersion * moving[0], moving[1], which, spread[which])[1]
            for which in (np.empty(0, int), nobody_asks)
        )
        taken = without - less
    inverse = np.linalg.inv(h_oo + width)
    # the likeliest level alone would be a toss between one and many times as much where several are about as likely
    moved = h_or * (spread[mismatch] * np.sqrt(softmax(logs) @ np.square(levels)))
    by_prior = np.diag(np.exp(-2 * every_density) / (2 * np.pi))  # of what rests on its bound: all of its prior
    covariance = by_prior.copy()
    scores = h_oo + moved @ moved.T
    if system.episodes_differ:
        scores += _between_episodes(around.gram[:, free, -1] / dispersion)
    covariance[np.ix_(free, free)] = inverse @ scores @ inverse
    by_prior[np.ix_(free, free)] = inverse @ width @ inverse
    return Evidence(
        float(np.logaddexp.reduce(logs) - np.log(len(levels))),
        np.array(logs),
        integrated[levels.index(1.0)][1] * dispersion,
        around.total - taken,
        covariance,
        by_prior,
        dispersion,
    )


def _integrated(total: np.ndarray, width: np.ndarray, which: np.ndarray, spread: np.ndarray) -> tuple[float, float]:
    """Return the log evidence, less the density of the parameters, and the loss once some directions have their part.

    Args:
        total: Inner products of [parameters (p) | directions (d) | residual (1)].
        width: Precision of the parameters beforehand, (p, p).
        which: Positions of those directions among all, (m,).
        spread: Standard deviations of their amplitudes, (m,).
    """
    p = len(width)
    rest = p + which
    # in amplitudes of unit prior variance
    inner = cho_factor(np.eye(len(spread)) + spread[:, None] * total[np.ix_(rest, rest)] * spread, lower=True)
    cross = spread[:, None] * total[np.ix_(rest, np.arange(p))]  # (m, p)
    slope = spread * total[rest, -1]
    solved = cho_solve(inner, np.column_stack([cross, slope]))
    loss, volume = float(total[-1, -1] - slope @ solved[:, p]), 0.0
    if p:
        schur = total[:p, :p] - cross.T @ solved[:, :p] + width
        g = total[:p, -1] - cross.T @ solved[:, p]
        loss -= float(g @ np.linalg.solve(schur, g))
        volume = 0.5 * p * np.log(2 * np.pi) - 0.5 * float(np.linalg.slogdet(schur).logabsdet)
    return -0.5 * loss - float(np.log(np.diag(inner[0])).sum()) + volume, loss


def by_data(found: Evidence, fit: Fit, context: Scope) -> np.ndarray:
    """Return the covariance of a fit's parameters that is stated for it, (p, p), less what the prior adds."""
    out = SETTINGS.probability.mismatch_error_factor**2 * found.covariance
    for candidate, part in fit.explanation.parts(context):
        out[part, part] += np.diag(by_form(candidate, context))
    return out


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
        direction = every[way[0]]
        vector = direction.vector.copy()
        vector[: direction.candidate.effect.amplitudes] *= amplitudes[0] / direction.per
        return vector
    return np.asarray(amplitudes) * np.array([np.max(np.abs(every[m].vector)) / abs(every[m].per) for m in way])


def clip(candidate: Candidate, vector: np.ndarray, context: Scope) -> np.ndarray:
    """Return the nearest vector that an effect allows."""
    low, high = bounds(candidate.parameters(context))
    return np.clip(vector, low, high)


def joined(fit: Fit, candidate: Candidate, vector: np.ndarray) -> tuple[Explanation, np.ndarray]:
    """Return a fit's explanation with one more effect, and the vector that starts it."""
    return fit.explanation + Explanation((candidate,)), np.concatenate([fit.x, vector])
