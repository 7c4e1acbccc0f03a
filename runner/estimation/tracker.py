"""Recursive estimation of a body's parameters together with its state, many lanes side by side.

The motion is determined by unknowns that do not change: the state at some start (the anchor) and the parameters.
Measurements come with noise. The estimate is the maximum a posteriori one of the unknowns, found by Gauss-Newton, and
it is recursive: ten copies of the body, one at the point of linearisation and one beside it for each unknown, go on
from update to update, and each measurement adds its residual and its sensitivities to the normal equations. An update
costs the same at any time. Where the estimate has moved so far from the point of linearisation that the second order
would matter, the unknowns are linearised anew: the copies go through the history once more (Levenberg-Marquardt). That
happens early, when the parameters are badly known; with growing certainty it ends.

In contrast to an extended Kalman filter, whose early and wrong linearisations remain in its covariance, the result at
any time is that of the batch problem, and so is its covariance. MuJoCo is the model, stick and slip included: a phase
that says nothing of a parameter has no sensitivity to it, and leaves it at its prior. Copies that stick while the body
moves have no sensitivities either, and no gradient leads out of that. Where the measurements can't be explained, the
history is therefore gone through from points that are spread over the prior, and the best of them is followed.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import scipy

from runner.errors import check_range
from runner.estimation.belief import (
    UNKNOWNS,
    Belief,
    MessageInterval,
    Prior,
    beside,
    lanes_of,
    root_of,
    sensitivities,
    times,
    with_lanes,
)
from runner.estimation.copies import SIZE, STATE, Copies
from runner.estimation.linearised import (
    expected_gain,
    expected_loss,
    loss_at_point,
    shortened,
    solved,
    unexplained,
)
from runner.numerics.levenberg_marquardt import Schedule, Trial, descend

VAGUE = 100.0  # so many times the noise of the first measurement the start state may be off
_AT_REST = 0.01  # of the loss: so little is not worth a step
_DAMPING = Schedule(0.0, least_refused=1e-3, most=1e3)
_AHEAD = 1.2  # the history must have grown by this factor before it is gone through again
_FAR, _SOON = 9.0, 1.05  # by this one where the estimate is three standard deviations from the point


@dataclass(frozen=True)
class _Terms:
    """What a measurement adds: whitened residuals (N, 6), their sensitivities (N, 6, 11), and their products."""

    residual: np.ndarray
    white: np.ndarray
    information: np.ndarray
    gradient: np.ndarray
    misfit: np.ndarray
    count: np.ndarray


@dataclass(frozen=True)
class Tracker:
    """Makes beliefs. All methods are pure, but for the scratch memory of `copies`.

    Args:
        copies: The model.
        noise_sd: What to expect of the measurements, (6,), all positive.
        tolerance: A point of linearisation is kept while it says the loss (-2 log posterior) at the estimate so well.
        tries: Points spread over the prior that are tried where the measurements can't be explained; a power of 2.
    """

    copies: Copies
    noise_sd: np.ndarray
    tolerance: float = 0.05
    tries: int = 64

    def __post_init__(self) -> None:
        for value in self.noise_sd:
            check_range("noise", float(value), 0.0, 10.0, lower_open=True)

    def start(self, prior: Prior, first: np.ndarray) -> Belief:
        """Return the belief before the first update.

        Args:
            prior: Of the parameters; its `x` may be (N, 5).
            first: Roughly where each lane starts, such as the first measurement, (N, 6).
        """
        n = len(first)
        mean = np.hstack([first, np.broadcast_to(prior.x, (n, SIZE))])
        root = np.diag(np.concatenate([VAGUE * self.noise_sd, prior.sd]))
        return self.anchored(mean, np.broadcast_to(root, (n, UNKNOWNS, UNKNOWNS)))

    def anchored(self, mean: np.ndarray, root: np.ndarray) -> Belief:
        """Return the belief without history in unknowns u = mean + root z, (N, 11), (N, 11, 11)."""
        n = len(mean)
        none = np.zeros(n)
        return Belief(
            mean=mean,
            root=np.array(root),
            history=(),
            point=np.zeros((n, UNKNOWNS)),
            ends=beside(mean)[..., :STATE],
            information=np.zeros((n, UNKNOWNS, UNKNOWNS)),
            gradient=np.zeros((n, UNKNOWNS)),
            misfit=none,
            count=none,
            gone=none,
            surprise=(none, none),
            z=np.zeros((n, UNKNOWNS)),
        )

    def update(self, belief: Belief, pushes: np.ndarray, measured: np.ndarray) -> Belief:
        """Return the belief after a message.

        Args:
            belief: After the message before, or at the start.
            pushes: Commands since then, (n, 12), or for each lane (N, n, 12); n may be 0.
            measured: The state in the message, (N, 6); NaN where a number did not arrive.
        """
        unknowns = beside(belief.mean + times(belief.root, belief.point))
        ends = self._step(unknowns, belief.ends, pushes)
        terms = self._terms(ends, measured)
        # how far from what was expected: a number that did not arrive is expected exactly
        innovation = terms.residual - times(terms.white, times(belief.root, belief.z - belief.point))
        spread = terms.white @ belief.covariance @ terms.white.transpose(0, 2, 1) + np.eye(STATE)
        surprise = (innovation * np.linalg.solve(spread, innovation[..., None])[..., 0]).sum(axis=1)
        belief = replace(
            belief,
            history=(*belief.history, MessageInterval(pushes, measured)),
            ends=ends,
            information=belief.information + terms.information,
            gradient=belief.gradient + terms.gradient,
            misfit=belief.misfit + terms.misfit,
            count=belief.count + terms.count,
            surprise=(surprise, terms.count),
        )
        return self._improved(solved(belief))

    def rebased(self, belief: Belief) -> Belief:
        """Return the same belief anchored at the last update, its history summed up in its mean and covariance."""
        forward = np.zeros((len(belief.mean), UNKNOWNS, UNKNOWNS))
        forward[:, :STATE] = sensitivities(belief.ends)
        forward[:, STATE:, STATE:] = np.eye(SIZE)
        covariance = forward @ belief.covariance @ forward.transpose(0, 2, 1)
        return self.anchored(np.hstack([belief.now[0], belief.x]), root_of(covariance))

    def foreseen(
        self, unknowns: np.ndarray, pushes: np.ndarray, period: int
    ) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Yield at each message to come the state (N, 6), and what it will tell of the unknowns, (N, 11, 11).

        Args:
            unknowns: State and parameters now, (N, 11).
            pushes: Commands, (N, n, 12).
            period: Steps between messages.
        """
        copies = beside(unknowns)
        states = copies[..., :STATE]
        for begin in range(0, pushes.shape[1], period):
            states = self._step(copies, states, pushes[:, begin : begin + period])
            white = sensitivities(states) / self.noise_sd[:, None]
            yield states[:, 0], white.transpose(0, 2, 1) @ white

    def _step(self, unknowns: np.ndarray, states: np.ndarray, pushes: np.ndarray) -> np.ndarray:
        """Step copies (N, c, ...) from their states."""
        n, c = states.shape[:2]
        if pushes.ndim == 3:
            pushes = np.repeat(pushes, c, axis=0)
        out = self.copies.run(unknowns[..., STATE:].reshape(n * c, SIZE), states.reshape(n * c, STATE), pushes)
        return out.reshape(n, c, STATE)

    def _terms(self, ends: np.ndarray, measured: np.ndarray) -> _Terms:
        """Return what a measurement adds."""
        by_unknowns = sensitivities(ends)
        residual = (measured - ends[:, 0]) / self.noise_sd
        arrived = ~np.isnan(residual)
        residual = np.where(arrived, residual, 0.0)
        white = by_unknowns / self.noise_sd[:, None] * arrived[..., None]
        return _Terms(
            residual,
            white,
            white.transpose(0, 2, 1) @ white,
            times(white.transpose(0, 2, 1), residual),
            (residual**2).sum(axis=1),
            arrived.sum(axis=1).astype(float),
        )

    def _gone_through(self, belief: Belief, point: np.ndarray) -> Belief:
        """Return the belief linearised at another point, (N, 11)."""
        n = len(belief.mean)
        unknowns = beside(belief.mean + times(belief.root, point))
        states = unknowns[..., :STATE]
        information, gradient = np.zeros((n, UNKNOWNS, UNKNOWNS)), np.zeros((n, UNKNOWNS))
        misfit = np.zeros(n)
        for window in belief.history:
            states = self._step(unknowns, states, window.pushes)
            more = self._terms(states, window.measured)
            information += more.information
            gradient += more.gradient
            misfit += more.misfit
        return solved(
            replace(
                belief, point=point, ends=states, information=information, gradient=gradient, misfit=misfit, z=point
            )
        )

    def _improved(self, belief: Belief) -> Belief:
        """Linearise anew where that is due: where the linear model does not say what the loss at the estimate is."""
        length, gain = len(belief.history), expected_gain(belief)
        due = (length >= _AHEAD * belief.gone) & ((gain > _AT_REST) | unexplained(belief))
        lanes = np.flatnonzero(due | (length >= _SOON * belief.gone + 1) & (gain > _FAR))
        if not len(lanes):
            return belief
        some = replace(lanes_of(belief, lanes), gone=np.full(len(lanes), float(length)))
        actual = self._losses(some, some.z[:, None])[:, 0]
        off = np.flatnonzero((np.abs(actual - expected_loss(some)) > self.tolerance) | unexplained(some))
        some = with_lanes(some, off, self._descended(lanes_of(some, off)))
        lost = np.flatnonzero(unexplained(some))
        if len(lost) and self.tries:
            other = self._descended(self._searched(lanes_of(some, lost)))
            better = np.flatnonzero(loss_at_point(other) < loss_at_point(some)[lost])
            some = with_lanes(some, lost[better], lanes_of(other, better))
        return with_lanes(belief, lanes, some)

    def _descended(self, belief: Belief) -> Belief:
        """Return the belief linearised anew until its estimate comes to rest, or nothing is gained."""
        return descend(self._attempt, belief, _DAMPING, iterations=15, blocks=len(belief.mean))

    def _attempt(self, _: int, belief: Belief, lanes: np.ndarray, damping: np.ndarray) -> Trial[Belief]:
        """Linearise lanes anew at the end of a damped step; one that gains nothing stays where it is."""
        old = lanes_of(belief, lanes)
        trial = self._gone_through(old, shortened(old, solved(old, damping).z))
        gained = loss_at_point(trial) < loss_at_point(old)
        belief = with_lanes(belief, lanes[gained], lanes_of(trial, np.flatnonzero(gained)))
        return Trial(belief, gained, ~gained, rests=gained & (expected_gain(trial) <= _AT_REST))

    def _losses(self, belief: Belief, points: np.ndarray) -> np.ndarray:
        """Return the loss at points (N, c, 11), (N, c), without linearising there."""
        unknowns = belief.mean[:, None] + np.einsum("nij,ncj->nci", belief.root, points)
        states, loss = unknowns[..., :STATE], (points**2).sum(axis=2)
        for window in belief.history:
            states = self._step(unknowns, states, window.pushes)
            loss += np.nansum(((window.measured[:, None] - states) / self.noise_sd) ** 2, axis=2)
        return loss

    def _searched(self, belief: Belief) -> Belief:
        """Return the belief linearised at the best of some points that are spread over the prior."""
        n, tries = len(belief.mean), self.tries
        normal = scipy.stats.qmc.MultivariateNormalQMC(np.zeros(SIZE), rng=np.random.default_rng(0)).random(tries)
        points = np.zeros((n, tries, UNKNOWNS))
        points[..., STATE:] = normal
        best = self._losses(belief, points).argmin(axis=1)
        return self._gone_through(belief, points[np.arange(n), best])
