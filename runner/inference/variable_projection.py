"""Descent of a fit whose start states are eliminated episode by episode (variable projection, Golub & Pereyra 1973).

The start state of an episode matters to that episode only. With the derivatives by it projected out, each episode
leaves a few rows of one small bounded least-squares problem in the parameters that all episodes share:
Levenberg-Marquardt steps by `scipy.optimize.lsq_linear`.

A step is first only simulated: derivatives cost a simulation for each parameter. Where they foretold what the step did
they are kept, until the descent would end. A secant update would change them by little (Broyden 1965), but also put a
little on what nothing measured depends on, which a step then moves by much.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum, auto
from typing import Protocol

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import lsq_linear

from runner.effects.base import Parameter
from runner.inference.parameters import bounds
from runner.numerics.levenberg_marquardt import Schedule, Trial, descend
from runner.settings import SETTINGS

DAMPING = Schedule(1e-4, least=1e-8, least_refused=1e-2, most=1e7)


@dataclass(frozen=True)
class Basis:
    """Derivatives of the whitened residuals by the start states, per episode: orthonormal (n, S), triangle (S, S)."""

    q: tuple[np.ndarray, ...]
    r: tuple[np.ndarray, ...]


class Ending(Enum):
    """Why a descent went no further."""

    RESTED = auto()  # nothing more is to be gained
    BEHIND = auto()  # it won't come near what others have reached


@dataclass(frozen=True)
class Spread:
    """How many times the noise's variance the residuals of each episode are taken to have, and what that costs.

    An episode that goes elsewhere than any model says (an impact on another corner) would by its squares outweigh all
    others. From a mean square c on it has a dispersion of its own, the likeliest: minus twice its log likelihood is
    then c n (1 + log(s / (c n))) for a sum of squares s of n values, which pulls no more than c n does, whatever s is;
    so does the heavy tail of Student's t for whole blocks (Lange, Little and Taylor 1989).

    Args:
        dispersion: Of each episode, (E,).
        volume: What of minus twice the log likelihood is not squares, (E,).
    """

    dispersion: np.ndarray
    volume: np.ndarray

    @classmethod
    def none(cls, episodes: int) -> Spread:
        """Residuals are as noise is."""
        return cls(np.ones(episodes), np.zeros(episodes))

    @classmethod
    def beyond(cls, odd_from: float, squares: np.ndarray, counts: np.ndarray) -> Spread:
        """Return that of sums of squares (E,) of so many values (E,); episodes are odd from such a mean square on."""
        usual = odd_from * np.maximum(counts, 1)
        dispersion = np.where(np.isfinite(squares), np.maximum(squares / usual, 1.0), 1.0)
        return cls(dispersion, usual * np.log(dispersion))

    def of(self, kept: Sequence[int]) -> Spread:
        """Return that of some of the episodes, by their place."""
        return Spread(self.dispersion[list(kept)], self.volume[list(kept)])

    def loss(self, residual: Sequence[np.ndarray]) -> np.ndarray:
        """Return minus twice the log likelihood of whitened residuals (n,) of each episode, up to a constant, (E,)."""
        return np.array([r @ r for r in residual]) / self.dispersion + self.volume


@dataclass(frozen=True)
class Residuals:
    """What a model leaves: whitened residuals (n,) of each episode, and how they spread."""

    each: list[np.ndarray]
    spread: Spread

    @property
    def total(self) -> float:
        """Minus twice the log likelihood: the sum of squared whitened residuals, where their spread is the noise's."""
        return float(self.spread.loss(self.each).sum())


@dataclass(frozen=True)
class FitPoint:
    """Where a fit stands: its unknowns (p,), (E, S), the residuals (n,) and raw derivatives (n, p) of each episode.

    `taken` says whether the derivatives by the parameters were taken at this point, not kept from one before; `fresh`,
    whether moreover the basis was, or was found to hold here. `reach` is how far the next step may go in each
    parameter, in its prior widths; `gained_share` is which share of what it promised the last one gained, 1 before any.
    """

    x: np.ndarray
    starts: np.ndarray
    residual: list[np.ndarray]
    jacobian: list[np.ndarray]
    spread: Spread
    basis: Basis
    fresh: bool
    taken: bool = True
    ending: Ending | None = None
    reach: float = SETTINGS.fit.trust_radius
    gained_share: float = 1.0

    @property
    def total(self) -> float:
        """See `Residuals.total`."""
        return self.residuals.total

    @property
    def residuals(self) -> Residuals:
        """What is left here."""
        return Residuals(self.residual, self.spread)

    def projected(self) -> tuple[np.ndarray, ...]:
        """The derivatives by the parameters, the start states projected out, per episode (n, p)."""
        return tuple(project(j, q) for j, q in zip(self.jacobian, self.basis.q, strict=True))

    def moved(self, dx: np.ndarray, ds: np.ndarray, there: Residuals) -> FitPoint:
        """Return where a step (p,), (E, S) has led, with the derivatives from here."""
        return replace(
            self,
            x=self.x + dx,
            starts=self.starts + ds,
            residual=there.each,
            spread=there.spread,
            fresh=False,
            taken=not len(dx),  # without parameters there is nothing to take
        )

    def foretold(self, dx: np.ndarray, ds: np.ndarray, there: Residuals) -> bool:
        """Whether what a step (p,), (E, S) did to the residuals is what the linear model says, to a share steps bear.

        An episode that is odd counts as little as in the loss.
        """
        missed = asked = 0.0
        for e, (before, after) in enumerate(zip(self.residual, there.each, strict=True)):
            moved = self.jacobian[e] @ dx + self.basis.q[e] @ (self.basis.r[e] @ ds[e])
            missed += float(np.sum((after - before - moved) ** 2)) / float(self.spread.dispersion[e])
            asked += float(moved @ moved) / float(self.spread.dispersion[e])
        return missed <= SETTINGS.fit.derivative_reuse**2 * asked


class Problem(Protocol):
    """What a descent goes down: unknowns are parameters (p,) and start states (E, S)."""

    def residuals(self, x: np.ndarray, starts: np.ndarray) -> Residuals:
        """Return what is left somewhere, which costs one simulation of each episode."""
        ...

    def linearise(
        self, x: np.ndarray, starts: np.ndarray, basis: Basis | None, *, checked: bool, there: Residuals | None = None
    ) -> FitPoint:
        """Return where a fit stands, with derivatives.

        Args:
            x: Parameters.
            starts: Start states.
            basis: Derivatives by those; None: they are to be taken.
            checked: Whether they are to be checked, and taken anew where they do not hold.
            there: What is left there, where that was simulated before.
        """
        ...

    def best(self, x: np.ndarray, starts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return which of K start states of each episode, (E, K, S), or that of the measurements leaves least.

        Returns:
            It, (E, S), and what it leaves, (E,).
        """
        ...


@dataclass(frozen=True)
class Descent:
    """Takes a fit down to where it rests.

    Args:
        parameters: Those that all episodes share.
        problem: What it goes down.
        count: How many measurements there are.
        target: A loss that others have reached; a fit that won't come near it is not finished.
        patience: So many steps are taken before that is judged.
        tolerance: It rests where a step promises less than this, in units of the loss (more where the fit is bad).
        polish: Whether the start states' derivatives are taken anew where the steps come to rest.
        jumps: Whether the motion jumps along the way, as through a hit: a promise is then worth what the last was.
    """

    parameters: Sequence[Parameter]
    problem: Problem
    count: int
    target: float
    patience: int
    tolerance: float
    polish: bool
    jumps: bool

    def down(self, point: FitPoint, iterations: int) -> FitPoint:
        """Return where at most so many steps lead."""
        point = descend(self._attempt, point, DAMPING, iterations=iterations)
        if point.ending is not Ending.BEHIND and not self._holds(point):
            point = self._renewed(point, checked=self.polish)
        return point

    def _holds(self, point: FitPoint) -> bool:
        """Whether derivatives are of this point, those by start states as well where they matter."""
        return point.fresh if self.polish else point.taken

    def _attempt(self, iteration: int, point: FitPoint, _: np.ndarray, damping: np.ndarray) -> Trial[FitPoint]:
        dx, ds, promised = _step(point, self.parameters, float(damping[0]))
        limits = SETTINGS.fit
        hoped = promised * point.gained_share if self.jumps else promised
        enough = self.tolerance + limits.rest_share * max(point.total - self.count, 0.0)
        expected = point.total - limits.promise_factor * hoped
        if iteration > self.patience and expected > hopeless(self.target, self.count):
            if not point.taken:  # it is judged by derivatives of its own, which are what comparisons go by as well
                return Trial(self._renewed(point, checked=False))
            return Trial(replace(point, ending=Ending.BEHIND), rests=True)
        if hoped < enough:
            if self._holds(point):
                return Trial(replace(point, ending=Ending.RESTED), rests=True)
            return Trial(self._renewed(point, checked=self.polish))
        there = self.problem.residuals(point.x + dx, point.starts + ds)
        gain = point.total - there.total
        if np.isfinite(there.total) and gain > 0:
            eased = gain > limits.min_gain_ratio * promised
            trial = self._stepped(point, dx, ds, there, checked=enough < gain and not eased)
            trial = replace(trial, gained_share=gain / promised)
            # what is far off is not reached in steps that nothing but their length has ended (a trust region)
            further = eased and self._is_as_far_as_it_may(point, dx)
            return Trial(replace(trial, reach=2.0 * point.reach) if further else trial, eased=eased)
        point = replace(point, reach=SETTINGS.fit.trust_radius)
        if not point.fresh:
            return Trial(self._renewed(point))
        # one episode in which another corner hits first must not hold all others where they are
        apart = self._each_as_far_as_it_goes(point, dx, ds)
        if apart is None:
            # where friction holds or just doesn't, derivatives promise what no step has, however short: a minimum, too
            if DAMPING.ends_at(damping).all():
                return Trial(replace(point, ending=Ending.RESTED), rests=True)
            return Trial(point, refused=True)
        gain = point.total - apart.total
        if gain < self.tolerance:  # whatever these derivatives promise, as where friction holds or just doesn't
            return Trial(replace(self._renewed(apart, checked=self.polish), ending=Ending.RESTED), rests=True)
        return Trial(replace(apart, gained_share=gain / promised))

    def _each_as_far_as_it_goes(self, point: FitPoint, dx: np.ndarray, ds: np.ndarray) -> FitPoint | None:
        """Return where a step leads if every episode's start takes that share of its own which suits it best.

        Or begins anew from what is measured, which may mean another start by now. None if the loss is no lower there
        either. A start belongs to its episode alone, so that none has to wait for the others.
        """
        x = point.x + dx
        shares = np.array(SETTINGS.fit.start_shares)
        starts, left = self.problem.best(x, point.starts[:, None] + shares[:, None] * ds[:, None])
        if not left.sum() < point.total:
            return None
        return self.problem.linearise(x, starts, point.basis, checked=False)

    def _stepped(self, point: FitPoint, dx: np.ndarray, ds: np.ndarray, there: Residuals, *, checked: bool) -> FitPoint:
        """Return where a step leads that lowers the loss; derivatives are taken anew where they foretold it badly.

        Through a hit they always are: what was foretold along one step may jump in the next. Those by start states
        change slowly: they are looked at where that is `checked` only.
        """
        if not self.jumps and point.foretold(dx, ds, there):
            return point.moved(dx, ds, there)
        x, starts = point.x + dx, point.starts + ds
        return self._carried(self.problem.linearise(x, starts, point.basis, checked=checked, there=there), point)

    def _is_as_far_as_it_may(self, point: FitPoint, dx: np.ndarray) -> bool:
        """Whether a step (p,) has taken a parameter as far as one may go from a point."""
        widths = np.array([q.scale for q in self.parameters])
        return bool(np.any(np.abs(dx) > 0.999 * point.reach * widths))

    def _renewed(self, point: FitPoint, *, checked: bool = True) -> FitPoint:
        x, starts, here = point.x, point.starts, point.residuals
        return self._carried(self.problem.linearise(x, starts, point.basis, checked=checked, there=here), point)

    @staticmethod
    def _carried(new: FitPoint, before: FitPoint) -> FitPoint:
        """Return a point with what is known of steps from the one before it."""
        return replace(new, reach=before.reach, gained_share=before.gained_share)


def hopeless(target: float, count: int) -> float:
    """Return the loss, of so many values, above which a descent is no longer expected to reach a target."""
    limits = SETTINGS.fit
    behind = limits.behind_share * max(target - count, 0.0)
    return target + behind + limits.behind_excess * count + limits.behind_loss


def _step(point: FitPoint, parameters: Sequence[Parameter], damping: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Return a step of the parameters (p,), of the start states (E, S), and the gain in the loss it promises."""
    dx = _shared_step(point, parameters, damping)
    ds, promised = [], 0.0
    episodes = zip(point.residual, point.jacobian, point.basis.q, point.basis.r, point.spread.dispersion, strict=True)
    for r, j, q, t, dispersion in episodes:
        moved = r + j @ dx
        along = q.T @ moved
        ds.append(-told_move(t, along, least_share=0.0) / (1 + damping))
        left = moved - q @ along
        promised += (float(r @ r) - float(left @ left)) / float(dispersion)
    return dx, np.array(ds), promised


def _shared_step(point: FitPoint, parameters: Sequence[Parameter], damping: float) -> np.ndarray:
    """Return a step of the parameters within their bounds, (p,), every start state making the best of it."""
    p = len(point.x)
    if not p:
        return np.zeros(0)
    episodes = zip(point.residual, point.jacobian, point.basis.q, np.sqrt(point.spread.dispersion), strict=True)
    # with the start states projected out, each episode is p + 1 rows of the same normal equations
    small = [np.asarray(np.linalg.qr(project(np.column_stack([j, r]), q), mode="r")) / d for r, j, q, d in episodes]
    right = -np.concatenate([s[:, p] for s in small])
    size = np.array([q.scale for q in parameters])
    matrix = np.vstack([s[:, :p] for s in small]) * size
    ridge = np.sqrt(damping * (matrix**2).sum(axis=0) + 1e-9)
    low, high = bounds(parameters)
    lower, upper = np.maximum((low - point.x) / size, -point.reach), np.minimum((high - point.x) / size, point.reach)
    solved = lsq_linear(
        np.vstack([matrix, np.diag(ridge)]),
        np.concatenate([right, np.zeros(p)]),
        (lower, np.maximum(upper, lower + 1e-9)),
        method="bvls",
    )
    return np.clip(point.x + solved.x * size, low, high) - point.x


def finite(changes: np.ndarray) -> np.ndarray:
    """Return changes (k, n), nothing where the motion diverges: from there no direction can be told."""
    return np.where(np.isfinite(changes).all(axis=1, keepdims=True), changes, 0.0)


def orthonormal(columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the QR decomposition of columns (n, S): (n, S) and (S, S).

    A start that nothing measured depends on (the speed of what begins at rest) has a column of zeros: it takes nothing
    out of the others, and its row and column of the triangle are zero, so that `told_move` leaves it where it is.
    """
    live = np.linalg.norm(columns, axis=0) > 0
    if live.all():
        return np.linalg.qr(columns)
    q, r = np.zeros_like(columns), np.zeros((columns.shape[1], columns.shape[1]))
    q[:, live], r[np.ix_(live, live)] = np.linalg.qr(columns[:, live])
    return q, r


def told_move(
    triangle: np.ndarray, along: np.ndarray, least_share: float = SETTINGS.fit.information_ridge
) -> np.ndarray:
    """Return the move of a start state, (S,) or (S, k), that shows so much along its basis; what is untold stays.

    Args:
        triangle: Of its derivatives, (S, S).
        along: Whitened changes of the prediction, (S,) or (S, k).
        least_share: A direction is told where it shows more than this share of what the plainest one does.
    """
    size = np.abs(np.diag(triangle))
    told = size > least_share * size.max()
    move = np.zeros_like(along)
    move[told] = solve_triangular(triangle[np.ix_(told, told)], along[told], check_finite=False)
    return move


def probing_move(triangle: np.ndarray) -> np.ndarray:
    """Return a move of a start state, (S,), by a standard error in each direction that its derivatives (S, S) know.

    Derivatives that have changed since would have to have changed at right angles to it to foretell what it does.
    """
    return told_move(triangle, np.where(np.arange(len(triangle)) % 2, -1.0, 1.0))


def project(columns: np.ndarray, basis: np.ndarray) -> np.ndarray:
    """Take out of columns (n, k) what an orthonormal basis (n, S) spans."""
    return columns - basis @ (basis.T @ columns)
