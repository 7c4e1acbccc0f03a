"""From log posteriors and what is left to probabilities: of the explanations, and that there is another one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import expit, softmax

from runner.inference.contender import Contender
from runner.numerics.arrays import FloatArray
from runner.settings import SETTINGS


def shares(contenders: Sequence[Contender]) -> FloatArray:
    """Return the probability of each explanation, (n,), if one of them holds."""
    return softmax(np.array([c.log_posterior for c in contenders]) / SETTINGS.probability.temperature)


def unknown_by_excess(excess: float, nominal_excess: float, share: float, error: float = 0.0) -> float:
    """Probability that none of the explanations holds, from what the best one leaves behind.

    A logistic in the log of the residual's excess over the noise, which is held against a fixed share of the noise and
    a small share of the gap: the larger an effect, the more of it small errors of its model leave.

    Args:
        excess: In squared noises.
        nominal_excess: The same of the nominal model: the gap.
        share: `AbstractSystem.unknown_share`.
        error: Standard error of the excess, see `error_of_excess`.
    """
    score = np.log(max(excess, 1e-4)) - np.log(allowed_excess(nominal_excess, share, error))
    return as_unknown(expit(score / SETTINGS.probability.unknown_log_width))


def as_unknown(probability: float) -> float:
    """Return a probability of `unknown` within its limits: neither it nor what is known is ever certain."""
    return float(np.clip(probability, SETTINGS.probability.min_unknown, SETTINGS.probability.max_unknown))


def allowed_excess(nominal_excess: float, share: float, error: float = 0.0) -> float:
    """Return what an explanation may leave beyond the noise, in squared noises, and be as likely as none of them."""
    limits = SETTINGS.probability
    return float(np.hypot(limits.unknown_excess, limits.chance_errors * error)) + share * max(nominal_excess, 0.0)


def error_of_excess(*counts: int) -> float:
    """Return the standard error of a mean square in squared noises: of the values, and of those that told the noise."""
    return float(np.sqrt(sum(2.0 / max(n, 1) for n in counts)))
