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

Unknowns are u = (state at the anchor (6,), parameters (5,), see `copies`), with u = mean + root z, z ~ N(0, 1) before
the first measurement. A zero column of `root` is an unknown that is known.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import scipy

from runner.errors import check_range, check_vector
from runner.estimation.copies import SIZE, STATE, Copies

UNKNOWNS = STATE + SIZE
VAGUE = 100.0  # so many times the noise of the first measurement the start state may be off
# x and y at the start shift a motion and change nothing else: no copy is needed for them
_TRIED = np.arange(2, UNKNOWNS)
_STEP = np.array([1e-4, 1e-4, 1e-4, 1e-4] + SIZE * [1e-4])
_STRIDE, _FARTHEST = 1.5, 4.0  # of the parameters: the longest step, and how far from the prior, in its deviations
_AT_REST = 0.01  # of the loss: so little is not worth a step
_AHEAD = 1.2  # the history must have grown by this factor before it is gone through again
_FAR, _SOON = 9.0, 1.05  # by this one where the estimate is three standard deviations from the point


@dataclass(frozen=True)
class Prior:
    """What is believed of the parameters beforehand: their vector `x` (5,), and its standard deviations `sd` (5,).

    Zero: known.
    """

    x: np.ndarray
    sd: np.ndarray

    def __post_init__(self) -> None:
        check_vector("prior.sd", tuple(float(v) for v in self.sd), SIZE)


@dataclass(frozen=True)
class Window:
    """What is known of the time between two messages: the commands (n, 12) or (N, n, 12), and what was measured then.

    `measured` is (N, 6); a NaN is a number that did not arrive.
    """

    pushes: np.ndarray
    measured: np.ndarray


@dataclass(frozen=True)
class Belief:
    """What is believed after some updates, of N lanes. Never written to.

    Attributes:
        mean, root: Of the unknowns at the anchor before the history, (N, 11), (N, 11, 11).
        history: Since the anchor.
        point: Point of linearisation, in units of the prior, (N, 11).
        ends: States of the copies now: at the point, then beside it, (N, 10, 6).
        information, gradient: Of the measurements since the anchor, by u at the point, (N, 11, 11), (N, 11).
        misfit: Sum of squared whitened residuals at the point, (N,).
        count: Numbers measured since the anchor, (N,).
        gone: Length of the history when it was last gone through, (N,).
        surprise: Squared whitened innovation of the last update, (N,), and of how many numbers, (N,).
        z: Estimate, in units of the prior, (N, 11).
    """

    mean: np.ndarray
    root: np.ndarray
    history: tuple[Window, ...]
    point: np.ndarray
    ends: np.ndarray
    information: np.ndarray
    gradient: np.ndarray
    misfit: np.ndarray
    count: np.ndarray
    gone: np.ndarray
    surprise: tuple[np.ndarray, np.ndarray]
    z: np.ndarray

    @property
    def unknowns(self) -> np.ndarray:
        """Estimate of state at the anchor and parameters, (N, 11)."""
        return self.mean + _times(self.root, self.z)

    @property
    def x(self) -> np.ndarray:
        """Estimated parameters, (N, 5)."""
        return self.unknowns[:, STATE:]

    @property
    def normal(self) -> np.ndarray:
        """Inverse covariance of z, (N, 11, 11)."""
        return _normal(self.root, self.information)

    @property
    def covariance(self) -> np.ndarray:
        """Of the unknowns, (N, 11, 11)."""
        return covariance_of(self.root, self.information)

    @property
    def parameter_covariance(self) -> np.ndarray:
        """Of the parameters, (N, 5, 5)."""
        return self.covariance[:, STATE:, STATE:]

    @property
    def sd(self) -> np.ndarray:
        """Standard deviations of the parameters, (N, 5)."""
        return np.sqrt(np.maximum(np.diagonal(self.parameter_covariance, axis1=1, axis2=2), 0.0))

    @property
    def prior_sd(self) -> np.ndarray:
        """Standard deviations of the parameters at the anchor, (N, 5)."""
        return np.linalg.norm(self.root[:, STATE:], axis=2)

    @property
    def now(self) -> tuple[np.ndarray, np.ndarray]:
        """Estimated state at the last update, (N, 6), and its covariance, (N, 6, 6)."""
        by_unknowns = _sensitivities(self.ends)
        shift = _times(self.root, self.z - self.point)
        spread = by_unknowns @ self.covariance @ by_unknowns.transpose(0, 2, 1)
        return self.ends[:, 0] + _times(by_unknowns, shift), spread


def root_of(covariance: np.ndarray) -> np.ndarray:
    """Return a root (N, 11, 11) of a covariance of the unknowns in which the parameters hang on the last five z alone.

    The state follows them by regression. The covariance may be singular: a body at rest has a known velocity.
    """
    parameters = covariance[:, STATE:, STATE:]
    corner = _symmetric_root(parameters)
    across = covariance[:, :STATE, STATE:] @ np.linalg.pinv(corner, hermitian=True)
    out = np.zeros_like(covariance)
    out[:, STATE:, STATE:] = corner
    out[:, :STATE, STATE:] = across
    out[:, :STATE, :STATE] = _symmetric_root(covariance[:, :STATE, :STATE] - across @ across.transpose(0, 2, 1))
    return out


def _symmetric_root(matrix: np.ndarray) -> np.ndarray:
    values, vectors = np.linalg.eigh(matrix)
    return (vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]) @ vectors.transpose(0, 2, 1)


@dataclass(frozen=True)
class _Terms:
    """What a measurement adds: whitened residuals (N, 6), their sensitivities (N, 6, 11), and their products."""

    residual: np.ndarray
    white: np.ndarray
    information: np.ndarray
    gradient: np.ndarray
    misfit: np.ndarray
    count: np.ndarray


def _normal(root: np.ndarray, information: np.ndarray) -> np.ndarray:
    return np.eye(UNKNOWNS) + root.transpose(0, 2, 1) @ information @ root


def covariance_of(root: np.ndarray, information: np.ndarray) -> np.ndarray:
    """Return the covariance of the unknowns (N, 11, 11) from that before, root root^T, and the information since."""
    normal = _normal(root, information)
    scale = np.sqrt(np.einsum("nii->ni", normal))
    root = root / scale[:, None, :]
    return root @ np.linalg.inv(normal / scale[:, :, None] / scale[:, None, :]) @ root.transpose(0, 2, 1)


def observable(sd: np.ndarray, prior_sd: np.ndarray, share: float = 0.9) -> np.ndarray:
    """Return which parameters the data have told something of: their uncertainty has shrunk below `share`."""
    return sd < share * prior_sd


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
            ends=_beside(mean)[..., :STATE],
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
        unknowns = _beside(belief.mean + _times(belief.root, belief.point))
        ends = self._step(unknowns, belief.ends, pushes)
        terms = self._terms(ends, measured)
        # how far from what was expected: a number that did not arrive is expected exactly
        innovation = terms.residual - _times(terms.white, _times(belief.root, belief.z - belief.point))
        spread = terms.white @ belief.covariance @ terms.white.transpose(0, 2, 1) + np.eye(STATE)
        surprise = (innovation * np.linalg.solve(spread, innovation[..., None])[..., 0]).sum(axis=1)
        belief = replace(
            belief,
            history=(*belief.history, Window(pushes, measured)),
            ends=ends,
            information=belief.information + terms.information,
            gradient=belief.gradient + terms.gradient,
            misfit=belief.misfit + terms.misfit,
            count=belief.count + terms.count,
            surprise=(surprise, terms.count),
        )
        return self._improved(_solved(belief))

    def rebased(self, belief: Belief) -> Belief:
        """Return the same belief anchored at the last update, its history summed up in its mean and covariance."""
        forward = np.zeros((len(belief.mean), UNKNOWNS, UNKNOWNS))
        forward[:, :STATE] = _sensitivities(belief.ends)
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
        beside = _beside(unknowns)
        states = beside[..., :STATE]
        for begin in range(0, pushes.shape[1], period):
            states = self._step(beside, states, pushes[:, begin : begin + period])
            white = _sensitivities(states) / self.noise_sd[:, None]
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
        by_unknowns = _sensitivities(ends)
        residual = (measured - ends[:, 0]) / self.noise_sd
        arrived = ~np.isnan(residual)
        residual = np.where(arrived, residual, 0.0)
        white = by_unknowns / self.noise_sd[:, None] * arrived[..., None]
        return _Terms(
            residual,
            white,
            white.transpose(0, 2, 1) @ white,
            _times(white.transpose(0, 2, 1), residual),
            (residual**2).sum(axis=1),
            arrived.sum(axis=1).astype(float),
        )

    def _gone_through(self, belief: Belief, point: np.ndarray) -> Belief:
        """Return the belief linearised at another point, (N, 11)."""
        n = len(belief.mean)
        unknowns = _beside(belief.mean + _times(belief.root, point))
        states = unknowns[..., :STATE]
        information, gradient = np.zeros((n, UNKNOWNS, UNKNOWNS)), np.zeros((n, UNKNOWNS))
        misfit = np.zeros(n)
        for window in belief.history:
            states = self._step(unknowns, states, window.pushes)
            more = self._terms(states, window.measured)
            information += more.information
            gradient += more.gradient
            misfit += more.misfit
        return _solved(
            replace(
                belief, point=point, ends=states, information=information, gradient=gradient, misfit=misfit, z=point
            )
        )

    def _improved(self, belief: Belief) -> Belief:
        """Linearise anew where that is due: where the linear model does not say what the loss at the estimate is."""
        length, gain = len(belief.history), _gain(belief)
        due = (length >= _AHEAD * belief.gone) & ((gain > _AT_REST) | _unexplained(belief))
        lanes = np.flatnonzero(due | (length >= _SOON * belief.gone + 1) & (gain > _FAR))
        if not len(lanes):
            return belief
        some = replace(_lanes(belief, lanes), gone=np.full(len(lanes), float(length)))
        actual = self._losses(some, some.z[:, None])[:, 0]
        off = np.flatnonzero((np.abs(actual - _expected_loss(some)) > self.tolerance) | _unexplained(some))
        some = _with_lanes(some, off, self._descended(_lanes(some, off)))
        lost = np.flatnonzero(_unexplained(some))
        if len(lost) and self.tries:
            other = self._descended(self._searched(_lanes(some, lost)))
            better = np.flatnonzero(_loss(other) < _loss(some)[lost])
            some = _with_lanes(some, lost[better], _lanes(other, better))
        return _with_lanes(belief, lanes, some)

    def _descended(self, belief: Belief) -> Belief:
        """Return the belief linearised anew until its estimate comes to rest, or nothing is gained."""
        damping = np.zeros(len(belief.mean))
        lanes = np.arange(len(belief.mean))
        for _ in range(15):
            if not len(lanes):
                break
            old = _lanes(belief, lanes)
            trial = self._gone_through(old, _shortened(old, _solved(old, damping[lanes]).z))
            gained = _loss(trial) < _loss(old)
            damping[lanes] = np.where(gained, damping[lanes] / 10, np.maximum(damping[lanes] * 20, 1e-3))
            belief = _with_lanes(belief, lanes[gained], _lanes(trial, np.flatnonzero(gained)))
            lanes = lanes[np.where(gained, _gain(trial) > _AT_REST, damping[lanes] < 1e3)]
        return belief

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


def _unexplained(belief: Belief) -> np.ndarray:
    """Return where the measurements are further away than their noise can be, (N,)."""
    return _expected_loss(belief) > belief.count + 6 * np.sqrt(2 * belief.count) + 20


def _loss(belief: Belief) -> np.ndarray:
    """Return the loss (-2 log posterior) at the point of linearisation, (N,)."""
    return belief.misfit + (belief.point**2).sum(axis=1)


def _gain(belief: Belief) -> np.ndarray:
    """Return by how much the linear model expects the loss to fall from the point to the estimate, (N,).

    That is their squared distance in standard deviations of the estimate.
    """
    return (_downhill(belief) * (belief.z - belief.point)).sum(axis=1)


def _expected_loss(belief: Belief) -> np.ndarray:
    """Return the loss that the linear model expects at the estimate, (N,)."""
    return _loss(belief) - _gain(belief)


def _downhill(belief: Belief) -> np.ndarray:
    return _times(belief.root.transpose(0, 2, 1), belief.gradient) - belief.point


def _solved(belief: Belief, damping: np.ndarray | None = None) -> Belief:
    """Return the belief with the estimate of the linear model; `damping` (N,) shortens the way from the point."""
    normal = belief.normal
    if damping is not None:
        normal = normal + np.einsum("n,nii->ni", damping, normal)[..., None] * np.eye(UNKNOWNS)
    scale = np.sqrt(np.einsum("nii->ni", normal))
    step = np.linalg.solve(normal / scale[:, :, None] / scale[:, None, :], (_downhill(belief) / scale)[..., None])
    return replace(belief, z=belief.point + step[..., 0] / scale)


def _shortened(belief: Belief, z: np.ndarray) -> np.ndarray:
    """Return the end (N, 11) of the way from the point towards `z`, cut where the linear model says nothing more."""
    way = z - belief.point
    largest = np.abs(way[:, STATE:]).max(axis=1) / _STRIDE
    out = belief.point + way / np.maximum(largest, 1.0)[:, None]
    out[:, STATE:] = np.clip(out[:, STATE:], -_FARTHEST, _FARTHEST)
    return out


def _beside(unknowns: np.ndarray) -> np.ndarray:
    """Return the unknowns (N, 11) of all copies, (N, 10, 11)."""
    out = np.repeat(unknowns[:, None], 1 + len(_TRIED), axis=1)
    out[:, range(1, 1 + len(_TRIED)), _TRIED] += _STEP
    return out


def _sensitivities(ends: np.ndarray) -> np.ndarray:
    """Return the derivatives of the present state by the unknowns, (N, 6, 11)."""
    out = np.zeros((len(ends), STATE, UNKNOWNS))
    out[:, 0, 0] = out[:, 1, 1] = 1.0
    out[..., _TRIED] = (ends[:, 1:] - ends[:, :1]).transpose(0, 2, 1) / _STEP
    return out


def _times(matrix: np.ndarray, vector: np.ndarray) -> np.ndarray:
    return (matrix @ vector[..., None])[..., 0]


_PER_LANE = ("mean", "root", "point", "ends", "information", "gradient", "misfit", "count", "gone", "z")


def _lanes(belief: Belief, lanes: np.ndarray) -> Belief:
    """Return the belief of some lanes."""
    if len(lanes) == len(belief.mean):
        return belief
    history = tuple(
        Window(w.pushes if w.pushes.ndim == 2 else w.pushes[lanes], w.measured[lanes]) for w in belief.history
    )
    surprise = belief.surprise[0][lanes], belief.surprise[1][lanes]
    return replace(belief, history=history, surprise=surprise, **{k: getattr(belief, k)[lanes] for k in _PER_LANE})


def _with_lanes(belief: Belief, lanes: np.ndarray, other: Belief) -> Belief:
    """Return the belief with some of its lanes replaced by those of another, history and surprise aside."""
    if not len(lanes):
        return belief
    changed = {}
    for name in _PER_LANE:
        changed[name] = getattr(belief, name).copy()
        changed[name][lanes] = getattr(other, name)
    return replace(belief, **changed)
