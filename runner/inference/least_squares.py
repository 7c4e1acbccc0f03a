"""Fit an explanation to recorded episodes: its parameters together with the start state of every episode.

The start states are measured with noise like everything else, so they are unknowns of the fit and not truth. Each
belongs to one episode only; they are eliminated episode by episode (see `runner.inference.variable_projection`).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from runner.effects.base import Effects, Parameter, Scope
from runner.effects.vocabulary import Candidate
from runner.inference.parameters import bounds, difference_steps, on_bound
from runner.inference.variable_projection import (
    Basis,
    Descent,
    Ending,
    FitPoint,
    Problem,
    Residuals,
    Spread,
    finite,
    orthonormal,
    probing_move,
    project,
)
from runner.noise.measured import Measured
from runner.progress import UNOBSERVED, ProgressObserver
from runner.recording import Span
from runner.settings import SETTINGS
from runner.systems.base import AbstractSystem
from runner.systems.simulator import AbstractSimulator, Run


@dataclass(frozen=True)
class Explanation:
    """A set of candidates; a vector of all their parameters makes effects of them."""

    candidates: tuple[Candidate, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """The vocabulary's names, sorted; empty: none."""
        return tuple(sorted({c.name for c in self.candidates}))

    def parameters(self, context: Scope) -> tuple[Parameter, ...]:
        """All parameters in the order of the vector."""
        return tuple(p for c in self.candidates for p in c.parameters(context))

    def parts(self, context: Scope) -> tuple[tuple[Candidate, slice], ...]:
        """Each effect with its part of the vector."""
        counts = np.cumsum([0, *(len(c.parameters(context)) for c in self.candidates)])
        return tuple(
            (c, slice(int(a), int(b))) for c, a, b in zip(self.candidates, counts[:-1], counts[1:], strict=True)
        )

    @property
    def discontinuous(self) -> bool:
        """Whether a push fails to move the body at some values of it, so that the motion hangs on breakaways."""
        return any(c.effect.discontinuous for c in self.candidates)

    def make(self, x: np.ndarray, context: Scope) -> Effects:
        """Make the effects from a vector, in the order in which they are held; how they act hangs not on that."""
        return tuple(effect for c, part in self.parts(context) for effect in c.make(x[part], context))

    def without(self, candidate: Candidate) -> Explanation:
        """Return the others."""
        return Explanation(tuple(c for c in self.candidates if c != candidate))

    def __add__(self, other: Explanation) -> Explanation:
        return Explanation(self.candidates + other.candidates)


NONE = Explanation(())


def amplitudes(candidate: Candidate, part: slice, context: Scope) -> slice:
    """Return what of an effect's part of the vector makes it absent at zero: of what has a place the first numbers."""
    return slice(part.start, part.start + candidate.effect.amplitudes) if candidate.is_placed(context) else part


@dataclass(frozen=True)
class Fit:
    """A fitted explanation.

    Args:
        explanation: Which effects.
        x: Its parameters, (p,).
        starts: Start state of every fitted episode, (E, S).
        episodes: Which episodes those are.
        residual: Whitened residuals, per episode (n,).
        jacobian: Their derivatives by the parameters, the start states projected out, per episode (n, p).
        spread: How many times as uncertain as noise they are.
        basis: Their derivatives by the start states.
        at_bound: Which parameters ended on their bound, (p,).
        converged: Whether the steps came to rest.
    """

    explanation: Explanation
    x: np.ndarray
    starts: np.ndarray
    episodes: tuple[int, ...]
    residual: tuple[np.ndarray, ...]
    jacobian: tuple[np.ndarray, ...]
    spread: Spread
    basis: Basis
    at_bound: np.ndarray
    converged: bool

    @property
    def loss(self) -> np.ndarray:
        """Minus twice the log likelihood of each episode, (E,): the sum of squared whitened residuals as a rule."""
        return self.spread.loss(self.residual)

    @property
    def total(self) -> float:
        """The same of all of them."""
        return float(self.loss.sum())

    def of(self, kept: Sequence[int]) -> Fit:
        """Return the part of some of its episodes, given by their place among them; nothing is fitted anew."""
        residual, jacobian, q, r = (
            tuple(every[k] for k in kept) for every in (self.residual, self.jacobian, self.basis.q, self.basis.r)
        )
        episodes = tuple(self.episodes[k] for k in kept)
        return replace(
            self,
            starts=self.starts[list(kept)],
            episodes=episodes,
            residual=residual,
            jacobian=jacobian,
            spread=self.spread.of(kept),
            basis=Basis(q, r),
        )

    def information(self) -> np.ndarray:
        """J^T J with the start states projected out, (p, p)."""
        weighed = (j.T @ j / d for j, d in zip(self.jacobian, self.spread.dispersion, strict=True))
        return sum(weighed, np.zeros((len(self.x), len(self.x))))


@dataclass(frozen=True)
class Survey:
    """What models have shown from the start states of a fit: of which parts of the recording, with what held in."""

    spans: tuple[Span, ...]
    held: Effects
    fit: Fit
    shown: tuple[np.ndarray, ...]


def are_near(a: Fit, b: Fit, context: Scope) -> bool:
    """Whether two fits hold the same effects at so nearly the same values that others do the same beside both."""
    if a.explanation != b.explanation:
        return False
    size = np.array([p.scale for p in a.explanation.parameters(context)]) + np.abs(b.x)
    return bool((np.abs(a.x - b.x) <= SETTINGS.fit.derivative_reuse * size).all())


@dataclass(frozen=True)
class Fitter:
    """Fits explanations to the episodes of one system's recording; the effects `held` are always in the model.

    `observer` is told of every fit, and of which `part` of what was recorded this is one, "": all of it; `surveys` are
    what surveys have simulated, for whoever asks the same again.
    """

    system: AbstractSystem
    simulator: AbstractSimulator
    measured: Measured
    held: Effects = ()
    observer: ProgressObserver = field(default=UNOBSERVED, compare=False, repr=False)
    part: str = field(default="", compare=False, repr=False)
    surveys: deque[Survey] = field(
        default_factory=lambda: deque(maxlen=SETTINGS.fit.kept_surveys), compare=False, repr=False
    )

    @property
    def context(self) -> Scope:
        """What candidates are told."""
        return self.system.context

    def parts(self, spans: Sequence[Span]) -> Fitter:
        """Return a fitter of parts of the episodes; to it each is an episode, with a start state of its own."""
        return replace(self, simulator=self.simulator.parts(spans), measured=self.measured.parts(spans))

    def with_system(self, system: AbstractSystem) -> Fitter:
        """Return a fitter of the same stretches and noise that simulates another system of the same recording."""
        simulator = system.simulator().parts(self.measured.spans)
        return Fitter(system, simulator, self.measured, self.held, self.observer, self.part)

    def stretched(self, spans: Sequence[Span]) -> Fitter:
        """Return a fitter of these parts of the episodes; of whole episodes, in their order, itself."""
        whole = [Span(e, 0, len(v)) for e, v in enumerate(self.measured.values)]
        return self if list(spans) == whole else self.parts(spans)

    def longest_s(self, episodes: Iterable[int]) -> float:
        """Return how long the longest of some episodes is, in seconds."""
        return max(len(self.measured.values[e]) for e in episodes) / self.system.rate_hz

    def seconds(self, episode: int) -> float:
        """Return how long an episode is; each has a clock of its own."""
        recorded = self.system.recording.episodes[self.measured.spans[episode].episode]
        return (len(self.measured.values[episode]) - 1) * recorded.step_s

    def up_to(self, seconds: float) -> Fitter:
        """Return a fitter of the first so many seconds of every episode, at least two samples."""
        return self.parts(self.beginnings(seconds, range(len(self.measured.values))))

    def beginnings(self, seconds: float, episodes: Iterable[int]) -> list[Span]:
        """Return the first so many seconds of some episodes, at least two samples."""
        most = max(2, int(seconds * self.system.rate_hz * (1 + 1e-9)) + 1)
        return [Span(e, 0, min(len(self.measured.values[e]), most)) for e in episodes]

    def until_hit(self, episodes: Iterable[int]) -> list[Span]:
        """Return what of some episodes is before their first hit, where that is enough to tell a start; see `Scatter`.

        None of an object that hits nothing.
        """
        scatter, least = self.measured.scatter, 2 * SETTINGS.fit.min_start_samples
        if scatter is None:
            return []
        before = [Span(e, 0, int((~scatter.begun(e)).sum())) for e in episodes]
        return [s for s in before if s.end >= least]

    def pieces(self, seconds: float, episodes: Sequence[int]) -> list[Span]:
        """Cut episodes into equal pieces of about so many seconds; what has hardly been measured is left out."""
        spans = []
        for e in episodes:
            n = len(self.measured.values[e])
            count = max(1, round(self.seconds(e) / seconds))
            edges = np.linspace(0, n, count + 1).round().astype(int)
            spans += [Span(e, int(a), int(b)) for a, b in pairwise(edges)]
        own = self.system.initial.channels
        there = np.any([self.measured.valid[e][:, own].any(axis=0) for e in episodes], axis=0)
        counts = [self.measured.counted(s.episode)[s.begin : s.end, own][:, there].sum(axis=0) for s in spans]
        return [s for s, n in zip(spans, counts, strict=True) if (n >= SETTINGS.fit.min_start_samples).all()]

    def first_starts(self, episodes: Sequence[int]) -> np.ndarray:
        """Return rough start states from the first samples, (E, S)."""
        return np.array([self.system.initial.guess(self.measured, e) for e in episodes])

    def whitened(self, asked: Sequence[tuple[int, Sequence[Run]]]) -> list[np.ndarray]:
        """Return whitened residuals of several simulations of each of some episodes, (len(runs), n) of each."""
        asked = [(e, [Run(self.held + run.effects, run.start) for run in runs]) for e, runs in asked]
        values, each = self.measured.values, self.simulator.predict_each(asked)
        return [
            self.measured.whiten(e, shown - values[e]).reshape(len(shown), values[e].size)
            for (e, _), shown in zip(asked, each, strict=True)
        ]

    def loss(self, explanation: Explanation, x: np.ndarray, starts: np.ndarray, episodes: Sequence[int]) -> float:
        """Return minus twice the log likelihood at given unknowns, see `Fit.total`; infinite where the motion is."""
        return float(self.losses([explanation.make(x, self.context)], starts, episodes)[0])

    def losses(self, models: Sequence[Effects], starts: np.ndarray, episodes: Sequence[int]) -> np.ndarray:
        """Return the loss of each of several models, (M,), at the same start states (E, S)."""
        asked = [(e, [Run(m, start) for m in models]) for e, start in zip(episodes, starts, strict=True)]
        return np.sum(self._left(asked), axis=0)

    def _left(self, asked: Sequence[tuple[int, Sequence[Run]]]) -> np.ndarray:
        """Return the loss of as many simulations of each of some episodes, (E, runs); infinite where the motion is."""
        each = [
            self.spread(list(rows), [e] * len(rows)).loss(list(rows))
            for (e, _), rows in zip(asked, self.whitened(asked), strict=True)
        ]
        return np.where(np.isfinite(each), each, np.inf)

    def changes(self, base: Effects, runs: Sequence[Effects], fit: Fit) -> list[np.ndarray]:
        """Return how the whitened prediction changes from `base` to each run, per episode (n, len(runs)).

        Simulated from the start states of `fit`, whose derivatives are projected out, where need be more coarsely than
        fits are.
        """
        out = []
        for k, (e, shown) in enumerate(zip(fit.episodes, self._surveyed((base, *runs), fit), strict=True)):
            rows = self.measured.whiten(e, shown - self.measured.values[e]).reshape(len(shown), -1)
            out.append(project(finite(rows[1:] - rows[0]).T, fit.basis.q[k]))
        return out

    def _surveyed(self, models: Sequence[Effects], fit: Fit) -> tuple[np.ndarray, ...]:
        """Return what models show from the start states of a fit, per episode (len(models), T, C).

        With another account of the noise a fit hardly moves: what was simulated around it before still holds.
        """
        spans = tuple(self.measured.spans[e] for e in fit.episodes)
        for known in self.surveys:
            if known.spans == spans and known.held == self.held and are_near(known.fit, fit, self.context):
                return known.shown
        with self.simulator.survey() as simulator:
            each = zip(fit.episodes, fit.starts, strict=True)
            shown = simulator.predict_each([(e, [Run(self.held + m, start) for m in models]) for e, start in each])
        self.surveys.append(Survey(spans, self.held, fit, tuple(shown)))
        return self.surveys[-1].shown

    def fit(
        self,
        explanation: Explanation,
        episodes: Sequence[int],
        *,
        x: np.ndarray | None = None,
        near: Fit | None = None,
        starts: np.ndarray | None = None,
        target: float = np.inf,
        patience: int = 0,
        iterations: int = SETTINGS.fit.max_steps,
        tolerance: float = SETTINGS.fit.tolerance_loss,
        polish: bool = True,
        kept: Sequence[int] = (),
    ) -> Fit:
        """Fit an explanation; stops when a step gains less than `tolerance` in the loss (more where the fit is bad).

        Steps that don't lower the loss are not taken, so that a fit can't come out worse than it went in.

        Args:
            explanation: What to fit.
            episodes: Which episodes.
            x: Where to start, (p,); None: zero, the effect absent.
            near: A fit of the same episodes whose start states, and their derivatives, are a good beginning.
            starts: Start states that are a better one, (E, S).
            target: A loss that others have reached; a fit that won't come near it is not finished.
            patience: So many steps are taken before that is judged.
            iterations: At most so many steps.
            tolerance: In units of the loss (2 log likelihood).
            polish: Whether the start states' derivatives are taken anew where the steps come to rest; without, a fit
                is not called converged.
            kept: Positions of parameters that stay where they begin.
        """
        self.observer.fitting(explanation.names or tuple(e.full_name for e in self.held))
        parameters = explanation.parameters(self.context)
        begin = np.zeros(len(parameters)) if x is None else x
        free = tuple(replace(p, lower=begin[i], upper=begin[i]) if i in kept else p for i, p in enumerate(parameters))
        basis = None
        if starts is None:
            starts = self.first_starts(episodes) if near is None else near.starts
            basis = None if near is None else near.basis

        problem = _Problem(self, explanation, episodes)
        point = _first_point(problem, free, x, starts, basis)
        count = self.measured.count(episodes)
        jumps = self.measured.hits(episodes)
        descent = Descent(free, problem, count, target, patience, tolerance, polish, jumps)
        point = descent.down(point, iterations)
        return Fit(
            explanation,
            point.x,
            point.starts,
            tuple(episodes),
            tuple(point.residual),
            point.projected(),
            point.spread,
            point.basis,
            on_bound(parameters, point.x),
            # where derivatives are stale it is not known whether nothing more is to be gained
            converged=point.ending is Ending.RESTED and point.fresh,
        )

    def best_starts(
        self, effects: Effects, starts: np.ndarray, episodes: Sequence[int]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return which of each episode's start states, (E, K, S), or the measured one leaves least, and its loss.

        Returns:
            (E, S) and (E,).
        """
        shown = [self.simulator.seen_start(self.held + effects, s) for s in self.first_starts(episodes)]
        tried = [np.vstack([some, own]) for some, own in zip(starts, shown, strict=True)]
        left = self._left([(e, [Run(effects, s) for s in of]) for e, of in zip(episodes, tried, strict=True)])
        best = left.argmin(axis=1)
        return np.array([of[k] for of, k in zip(tried, best, strict=True)]), left.min(axis=1)

    def spread(self, residual: Sequence[np.ndarray], episodes: Sequence[int]) -> Spread:
        """Return how uncertain whitened residuals (n,) of some episodes are."""
        if not np.isfinite(self.measured.odd_from):
            return Spread.none(len(episodes))
        counts = np.array([self.measured.count([e]) for e in episodes])
        return Spread.beyond(self.measured.odd_from, np.array([r @ r for r in residual]), counts)


@dataclass(frozen=True)
class _Problem:
    """What a fit of an explanation to some episodes goes down."""

    fitter: Fitter
    explanation: Explanation
    episodes: Sequence[int]

    def residuals(self, x: np.ndarray, starts: np.ndarray) -> Residuals:
        """See `Problem`."""
        effects = self.explanation.make(x, self.fitter.context)
        each = zip(self.episodes, starts, strict=True)
        residual = [rows[0] for rows in self.fitter.whitened([(e, [Run(effects, start)]) for e, start in each])]
        return Residuals(residual, self.fitter.spread(residual, self.episodes))

    def linearise(
        self, x: np.ndarray, starts: np.ndarray, basis: Basis | None, *, checked: bool, there: Residuals | None = None
    ) -> FitPoint:
        """See `Problem`."""
        fitter, at = self.fitter, self.explanation.make(x, self.fitter.context)
        own = fitter.system.initial.steps
        each = list(np.diag(own))
        steps = difference_steps(self.explanation.parameters(fitter.context), x, fitter.system.difference_share)
        beside = [self.explanation.make(x + d, fitter.context) for d in np.diag(steps)]
        if checked and fitter.measured.scatter is not None:
            basis = None  # what a start does through a hit is taken over far more than its standard error
        known: list[tuple[np.ndarray, np.ndarray] | None] = [None] * len(starts)
        if basis is not None:
            known = list(zip(basis.q, basis.r, strict=True))
        moves = [each if of is None else [probing_move(of[1])] if checked else [] for of in known]
        here = [] if there is not None else [at]
        runs = [[*(Run(f, s) for f in (*here, *beside)), *_moved(at, s, m)] for s, m in zip(starts, moves, strict=True)]
        rows = fitter.whitened(list(zip(self.episodes, runs, strict=True)))
        residual = [of[0] for of in rows] if there is None else there.each
        parts = [np.split(of[len(here) :] - left, [len(x)]) for of, left in zip(rows, residual, strict=True)]
        by_x, by_move = [by for by, _ in parts], [by for _, by in parts]
        stale = [k for k, of in enumerate(known) if of and checked and not _foretold(*of, moves[k][0], by_move[k][0])]
        anew = fitter.whitened([(self.episodes[k], _moved(at, starts[k], each)) for k in stale])
        for k, of in zip(stale, anew, strict=True):
            known[k], by_move[k] = None, of - residual[k]
        jacobian = [(finite(of) / steps[:, None]).T for of in by_x]
        by_starts = [
            of or orthonormal((finite(move) / own[:, None]).T) for of, move in zip(known, by_move, strict=True)
        ]
        around = Basis(tuple(q for q, _ in by_starts), tuple(r for _, r in by_starts))
        spread = fitter.spread(residual, self.episodes) if there is None else there.spread
        return FitPoint(x, starts, residual, jacobian, spread, around, fresh=basis is None or checked)

    def best(self, x: np.ndarray, starts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See `Problem`."""
        return self.fitter.best_starts(self.explanation.make(x, self.fitter.context), starts, self.episodes)


def _moved(effects: Effects, start: np.ndarray, moves: Sequence[np.ndarray]) -> list[Run]:
    return [Run(effects, start + move) for move in moves]


def _foretold(q: np.ndarray, r: np.ndarray, move: np.ndarray, shown: np.ndarray) -> bool:
    """Whether derivatives q r by a start, (n, S) and (S, S), foretell what a move of it (S,) does, (n,)."""
    foretold = q @ (r @ move)
    return bool(np.linalg.norm(shown - foretold) <= SETTINGS.fit.stale_share * np.linalg.norm(foretold))


def _first_point(
    problem: Problem,
    parameters: Sequence[Parameter],
    x: np.ndarray | None,
    starts: np.ndarray,
    basis: Basis | None,
) -> FitPoint:
    """Return where a fit begins: at `x`, or nearer to the effect's absence where the motion diverges there."""
    low, high = bounds(parameters)
    x = np.clip(np.zeros(len(parameters)) if x is None else np.asarray(x, float), low, high)
    point = problem.linearise(x, starts, basis, checked=False)
    for _ in range(SETTINGS.fit.divergence_halvings):
        if np.isfinite(point.total):
            break
        # where the motion diverges there is no way down
        x = np.clip(0.5 * x, low, high)
        point = problem.linearise(x, starts, basis, checked=False)
    return point
