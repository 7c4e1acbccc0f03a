"""Fit an explanation to recorded episodes: its parameters together with the start state of every episode.

The start states are measured with noise like everything else, so they are unknowns of the fit and not truth. Each
belongs to one episode only; they are eliminated episode by episode (variable projection, Golub & Pereyra 1973), and
what is left is a small bounded least-squares problem: Levenberg-Marquardt steps by `scipy.optimize.lsq_linear`.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import lsq_linear

from runner.effects.base import Effects, Parameter, Scope
from runner.effects.vocabulary import Candidate
from runner.noise.measured import Measured
from runner.systems.base import AbstractSimulator, AbstractSystem, Run, Span

HALVINGS = 6  # of a beginning at which the motion diverges
BEHIND = 0.05  # squared noises by which a fit may be behind what others have reached, and is finished all the same
FEWEST = 5  # samples of each channel that is measured at all that a piece of an episode must have


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
        """Make the effects from a vector, in the order in which they act."""
        return tuple(c.make(x[part], context) for c, part in self.parts(context))

    def __add__(self, other: Explanation) -> Explanation:
        return Explanation(self.candidates + other.candidates)


NONE = Explanation(())


def amplitudes(candidate: Candidate, part: slice, context: Scope) -> slice:
    """Return what of an effect's part of the vector makes it absent at zero: the first if it has a place or a range."""
    return slice(part.start, part.start + 1) if len(candidate.starts(context)) else part


@dataclass(frozen=True)
class Basis:
    """Derivatives of the whitened residuals by the start states, per episode: orthonormal (n, S), triangle (S, S)."""

    q: tuple[np.ndarray, ...]
    r: tuple[np.ndarray, ...]


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
    basis: Basis
    at_bound: np.ndarray
    converged: bool

    @property
    def loss(self) -> np.ndarray:
        """Sum of squared whitened residuals of each episode, (E,)."""
        return np.array([r @ r for r in self.residual])

    @property
    def total(self) -> float:
        """Sum of squared whitened residuals."""
        return float(self.loss.sum())

    def information(self) -> np.ndarray:
        """J^T J with the start states projected out, (p, p)."""
        return sum((j.T @ j for j in self.jacobian), np.zeros((len(self.x), len(self.x))))


@dataclass(frozen=True)
class _Point:
    """Where a fit stands: its unknowns, the residuals and their raw derivatives there."""

    x: np.ndarray
    starts: np.ndarray
    residual: list[np.ndarray]
    jacobian: list[np.ndarray]
    basis: Basis
    fresh: bool  # whether the basis was taken at this point

    @property
    def total(self) -> float:
        return float(sum(r @ r for r in self.residual))


@dataclass(frozen=True)
class Fitter:
    """Fits explanations to the episodes of one system's recording; the effects `held` are always in the model."""

    system: AbstractSystem
    simulator: AbstractSimulator
    measured: Measured
    held: Effects = ()

    @property
    def context(self) -> Scope:
        """What candidates are told."""
        return self.system.context

    def parts(self, spans: Sequence[Span]) -> Fitter:
        """Return a fitter of parts of the episodes; to it each is an episode, with a start state of its own."""
        return replace(self, simulator=self.simulator.parts(spans), measured=self.measured.parts(spans))

    def longest_s(self, episodes: Iterable[int]) -> float:
        """Return how long the longest of some episodes is, in seconds."""
        return max(len(self.measured.values[e]) for e in episodes) / self.system.rate_hz

    def up_to(self, seconds: float) -> Fitter:
        """Return a fitter of the first so many seconds of every episode, at least two samples."""
        most = max(2, int(seconds * self.system.rate_hz * (1 + 1e-9)) + 1)
        return self.parts([Span(e, 0, min(len(v), most)) for e, v in enumerate(self.measured.values)])

    def pieces(self, seconds: float, episodes: Sequence[int]) -> list[Span]:
        """Cut episodes into equal pieces of about so many seconds; what has hardly been measured is left out."""
        spans = []
        for e in episodes:
            n = len(self.measured.values[e])
            count = max(1, round((n - 1) / self.system.rate_hz / seconds))
            edges = np.linspace(0, n, count + 1).round().astype(int)
            spans += [Span(e, int(a), int(b)) for a, b in pairwise(edges)]
        there = np.any([self.measured.valid[e].any(axis=0) for e in episodes], axis=0)
        return [
            s for s in spans if (self.measured.counted(s.episode)[s.begin : s.end, there].sum(axis=0) >= FEWEST).all()
        ]

    def first_starts(self, episodes: Sequence[int]) -> np.ndarray:
        """Return rough start states from the first samples, (E, S)."""
        return np.array([self.system.initial.guess(self.measured, e) for e in episodes])

    def whitened(self, episode: int, runs: Sequence[Run]) -> np.ndarray:
        """Return whitened residuals of several simulations of one episode, (len(runs), n)."""
        runs = [Run(self.held + run.effects, run.start) for run in runs]
        predicted = self.simulator.predict(episode, runs)
        return self.measured.whiten(episode, predicted - self.measured.values[episode]).reshape(len(runs), -1)

    def loss(self, explanation: Explanation, x: np.ndarray, starts: np.ndarray, episodes: Sequence[int]) -> float:
        """Return the sum of squared whitened residuals at given unknowns; infinite where the motion is."""
        run = explanation.make(x, self.context)
        rows = [self.whitened(e, [Run(run, start)])[0] for e, start in zip(episodes, starts, strict=True)]
        total = float(sum(r @ r for r in rows))
        return total if np.isfinite(total) else np.inf

    def changes(self, base: Effects, runs: Sequence[Effects], fit: Fit) -> list[np.ndarray]:
        """Return how the whitened prediction changes from `base` to each run, per episode (n, len(runs)).

        Simulated from the start states of `fit`, whose derivatives are projected out.
        """
        out = []
        for k, e in enumerate(fit.episodes):
            rows = self.whitened(e, [Run(effects, fit.starts[k]) for effects in (base, *runs)])
            out.append(_project(_finite(rows[1:] - rows[0]).T, fit.basis.q[k]))
        return out

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
        iterations: int = 15,
        tolerance: float = 0.3,
        polish: bool = True,
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
        """
        parameters = explanation.parameters(self.context)
        low, high = bounds(parameters)
        x = np.clip(np.zeros(len(parameters)) if x is None else np.asarray(x, float), low, high)
        basis = None
        if starts is None:
            starts = self.first_starts(episodes) if near is None else near.starts
            basis = None if near is None else near.basis
        point = self._linearise(explanation, x, starts, episodes, basis)
        for _ in range(HALVINGS):
            if np.isfinite(point.total):
                break
            # where the motion diverges there is no way down: nearer to the effect's absence there is
            x = np.clip(0.5 * x, low, high)
            point = self._linearise(explanation, x, starts, episodes, basis)
        damping, converged = 1e-4, False
        count = self.measured.count(episodes)
        behind = False
        for iteration in range(iterations):
            dx, ds, promised = self._step(point, parameters, damping)
            excess = max(point.total - count, 0.0)
            enough = tolerance + 2e-3 * excess
            hopeless = target + 0.5 * max(target - count, 0.0) + BEHIND * count + 100.0
            if iteration > patience and point.total - 3 * promised > hopeless:
                behind = True
                break
            if promised < enough:
                if point.fresh or not polish:
                    converged = point.fresh
                    break
                point = self._linearise(explanation, point.x, point.starts, episodes, None)
                continue
            # the start states' derivatives change slowly: keep them while they predict well
            trial = self._linearise(explanation, point.x + dx, point.starts + ds, episodes, point.basis)
            gain = point.total - trial.total
            if np.isfinite(trial.total) and gain > 0:
                if gain < 0.6 * promised and gain > enough:
                    trial = self._linearise(explanation, trial.x, trial.starts, episodes, None)
                point = trial
                damping = max(damping / (10 if gain > 0.6 * promised else 1), 1e-8)
            elif not point.fresh:
                point = self._linearise(explanation, point.x, point.starts, episodes, None)
            else:
                damping = max(damping * 20, 1e-2)
                if damping > 1e7:
                    break
        if not point.fresh and not behind and polish:
            point = self._linearise(explanation, point.x, point.starts, episodes, None)
        return Fit(
            explanation,
            point.x,
            point.starts,
            tuple(episodes),
            tuple(point.residual),
            tuple(_project(j, q) for j, q in zip(point.jacobian, point.basis.q, strict=True)),
            point.basis,
            on_bound(parameters, point.x),
            converged,
        )

    def _linearise(
        self, explanation: Explanation, x: np.ndarray, starts: np.ndarray, episodes: Sequence[int], basis: Basis | None
    ) -> _Point:
        parameters = explanation.parameters(self.context)
        steps = difference_steps(parameters, x)
        effects = [explanation.make(x + d, self.context) for d in (np.zeros(len(x)), *np.diag(steps))]
        residual, jacobian, qs, rs = [], [], [], []
        for k, e in enumerate(episodes):
            runs = [Run(f, starts[k]) for f in effects]
            if basis is None:
                runs += [Run(effects[0], starts[k] + d) for d in np.diag(self.system.initial.steps)]
            rows = self.whitened(e, runs)
            residual.append(rows[0])
            jacobian.append((_finite(rows[1 : len(effects)] - rows[0]) / steps[:, None]).T)
            if basis is None:
                by_start = (_finite(rows[len(effects) :] - rows[0]) / self.system.initial.steps[:, None]).T
                q, r = _orthonormal(by_start)
                qs.append(q)
                rs.append(r)
        fresh = basis is None
        return _Point(x, starts, residual, jacobian, Basis(tuple(qs), tuple(rs)) if basis is None else basis, fresh)

    @staticmethod
    def _step(point: _Point, parameters: Sequence[Parameter], damping: float) -> tuple[np.ndarray, np.ndarray, float]:
        """Return a step of the parameters (p,), of the start states (E, S), and the gain in the loss it promises."""
        episodes = list(zip(point.residual, point.jacobian, point.basis.q, point.basis.r, strict=True))
        p = len(point.x)
        dx = np.zeros(p)
        if p:
            # with the start states projected out, each episode is p + 1 rows of the same normal equations
            small = [
                np.asarray(np.linalg.qr(_project(np.column_stack([j, r]), q), mode="r")) for r, j, q, _ in episodes
            ]
            matrix = np.vstack([s[:, :p] for s in small])
            right = -np.concatenate([s[:, p] for s in small])
            size = np.array([q.scale for q in parameters])
            matrix = matrix * size
            ridge = np.sqrt(damping * (matrix**2).sum(axis=0) + 1e-9)
            low, high = bounds(parameters)
            # at most a few prior widths at a time: beyond that the linear model says nothing
            lower, upper = np.maximum((low - point.x) / size, -4.0), np.minimum((high - point.x) / size, 4.0)
            solved = lsq_linear(
                np.vstack([matrix, np.diag(ridge)]),
                np.concatenate([right, np.zeros(p)]),
                (lower, np.maximum(upper, lower + 1e-9)),
                method="bvls",
            )
            dx = np.clip(point.x + solved.x * size, low, high) - point.x
        ds, promised = [], 0.0
        for r, j, q, t in episodes:
            moved = r + j @ dx
            along = q.T @ moved
            ds.append(-solve_triangular(t, along, check_finite=False) / (1 + damping))
            left = moved - q @ along
            promised += float(r @ r) - float(left @ left)
        return dx, np.array(ds), promised


def _finite(changes: np.ndarray) -> np.ndarray:
    """Return changes (k, n), nothing where the motion diverges: from there no direction can be told."""
    return np.where(np.isfinite(changes).all(axis=1, keepdims=True), changes, 0.0)


def _orthonormal(columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the QR decomposition of columns (n, S): (n, S) and (S, S).

    A start that nothing measured depends on (the speed of what begins at rest) has a column of zeros: it stays where
    it is, and takes nothing out of the others.
    """
    live = np.linalg.norm(columns, axis=0) > 0
    if live.all():
        return np.linalg.qr(columns)
    q, r = np.zeros_like(columns), np.eye(columns.shape[1])
    q[:, live], r[np.ix_(live, live)] = np.linalg.qr(columns[:, live])
    return q, r


def _project(columns: np.ndarray, basis: np.ndarray) -> np.ndarray:
    """Take out of columns (n, k) what an orthonormal basis (n, S) spans."""
    return columns - basis @ (basis.T @ columns)


def bounds(parameters: Sequence[Parameter]) -> tuple[np.ndarray, np.ndarray]:
    """Return lower and upper bounds, each (p,)."""
    return np.array([p.lower for p in parameters]), np.array([p.upper for p in parameters])


def on_bound(parameters: Sequence[Parameter], x: np.ndarray) -> np.ndarray:
    """Return which parameters are on one of their bounds, (p,)."""
    low, high = bounds(parameters)
    width = np.maximum(high - low, 1e-12)
    return (x - low < 1e-6 * width) | (high - x < 1e-6 * width)


def is_out_of_range(parameters: Sequence[Parameter], x: np.ndarray) -> bool:
    """Whether the data push an effect out of its range: it is absent, or is not what is going on."""
    return bool((on_bound(parameters, x) & ~np.array([p.may_rest for p in parameters], dtype=bool)).any())


def difference_steps(parameters: Sequence[Parameter], x: np.ndarray, share: float = 0.02) -> np.ndarray:
    """Return steps for one-sided differences that stay inside the bounds, (p,)."""
    _, high = bounds(parameters)
    steps = np.array([p.scale * share for p in parameters])
    return np.where(x + steps > high, -steps, steps) if len(steps) else steps
