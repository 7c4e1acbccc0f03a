"""From log posteriors and what is left to probabilities: of the explanations, and that there is another one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import expit, softmax

from runner.inference.contender import Contender
from runner.numerics.arrays import FloatArray

TEMPER = 2.0  # log odds are divided by it, against overconfidence; not yet calibrated
UNKNOWN_EXCESS = 0.12  # see `unknown_by_excess`; known effects of tuning and practice cases left up to 0.09
UNKNOWN_WIDTH = 0.4
SOMETHING, SOMETHING_WIDTH = 0.45, 0.15  # see `not_none`; in null cases of tuning sets the gap was 0.40 at most
MOST_UNKNOWN = 0.97
LEAST_UNKNOWN = 0.03  # of unknown effects some look like known ones, as wear does like a patch


def shares(contenders: Sequence[Contender]) -> FloatArray:
    """Return the probability of each explanation, (n,), if one of them holds."""
    return softmax(np.array([c.log_posterior for c in contenders]) / TEMPER)


def unknown_by_excess(excess: float, nominal_excess: float, share: float) -> float:
    """Probability that none of the explanations holds, from what the best one leaves behind.

    A logistic in the log of the residual's excess over the noise, which is held against a fixed share of the noise and
    a small share of the gap: the larger an effect, the more of it small errors of its model leave. `share` is
    `AbstractSystem.unknown_share`.
    """
    score = (np.log(max(excess, 1e-4)) - np.log(allowed_excess(nominal_excess, share))) / UNKNOWN_WIDTH
    return float(np.clip(expit(score), LEAST_UNKNOWN, MOST_UNKNOWN))


def allowed_excess(nominal_excess: float, share: float) -> float:
    """Return what an explanation may leave beyond the noise, in squared noises, and be as likely as none of them."""
    return UNKNOWN_EXCESS + share * max(nominal_excess, 0.0)


def not_none(gap: float) -> float:
    """Probability that something is at work where no effect is named, from what the nominal model leaves.

    In squared noises, of all episodes. How much of that small errors of the simulator could do says little: they could
    do much of what anything does.
    """
    return float(expit(np.log(max(gap, 1e-4) / SOMETHING) / SOMETHING_WIDTH))
