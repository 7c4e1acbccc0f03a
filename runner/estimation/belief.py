"""What is believed of a body's parameters and its state, many lanes side by side: values, never written to.

Unknowns are u = (state at the anchor (6,), parameters (5,), see `copies`), with u = mean + root z, z ~ N(0, 1) before
the first measurement. A zero column of `root` is an unknown that is known. `runner.estimation.tracker` makes beliefs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from runner.errors import check_vector
from runner.estimation.copies import SIZE, STATE

UNKNOWNS = STATE + SIZE
# x and y at the start shift a motion and change nothing else: no copy is needed for them
_TRIED = np.arange(2, UNKNOWNS)
_STEP = np.array([1e-4, 1e-4, 1e-4, 1e-4] + SIZE * [1e-4])


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
class MessageInterval:
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
    history: tuple[MessageInterval, ...]
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
        return self.mean + times(self.root, self.z)

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
        by_unknowns = sensitivities(self.ends)
        shift = times(self.root, self.z - self.point)
        spread = by_unknowns @ self.covariance @ by_unknowns.transpose(0, 2, 1)
        return self.ends[:, 0] + times(by_unknowns, shift), spread


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


def beside(unknowns: np.ndarray) -> np.ndarray:
    """Return the unknowns (N, 11) of all copies, (N, 10, 11)."""
    out = np.repeat(unknowns[:, None], 1 + len(_TRIED), axis=1)
    out[:, range(1, 1 + len(_TRIED)), _TRIED] += _STEP
    return out


def sensitivities(ends: np.ndarray) -> np.ndarray:
    """Return the derivatives of the present state by the unknowns, (N, 6, 11)."""
    out = np.zeros((len(ends), STATE, UNKNOWNS))
    out[:, 0, 0] = out[:, 1, 1] = 1.0
    out[..., _TRIED] = (ends[:, 1:] - ends[:, :1]).transpose(0, 2, 1) / _STEP
    return out


def times(matrix: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Return products of matrices (N, i, j) and vectors (N, j), (N, i)."""
    return (matrix @ vector[..., None])[..., 0]


_PER_LANE = ("mean", "root", "point", "ends", "information", "gradient", "misfit", "count", "gone", "z")


def lanes_of(belief: Belief, lanes: np.ndarray) -> Belief:
    """Return the belief of some lanes."""
    if len(lanes) == len(belief.mean):
        return belief
    history = tuple(
        MessageInterval(w.pushes if w.pushes.ndim == 2 else w.pushes[lanes], w.measured[lanes]) for w in belief.history
    )
    surprise = belief.surprise[0][lanes], belief.surprise[1][lanes]
    return replace(belief, history=history, surprise=surprise, **{k: getattr(belief, k)[lanes] for k in _PER_LANE})


def with_lanes(belief: Belief, lanes: np.ndarray, other: Belief) -> Belief:
    """Return the belief with some of its lanes replaced by those of another, history and surprise aside."""
    if not len(lanes):
        return belief
    changed = {}
    for name in _PER_LANE:
        changed[name] = getattr(belief, name).copy()
        changed[name][lanes] = getattr(other, name)
    return replace(belief, **changed)
