"""The next experiment: which one would best tell two explanations apart, within the commands that were used so far.

Those that the system proposes are simulated under both explanations. What counts is the squared difference in units of
the noise that is left once the start state and the second explanation's parameters have made the best of it: half of
it is the log odds that the experiment is expected to yield (the difference of two hypotheses' log likelihoods, as in
optimal discrimination; Atkinson & Fedorov 1975).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from runner.inference.least_squares import Explanation
from runner.inference.parameters import difference_steps
from runner.noise.measured import Measured
from runner.systems.base import AbstractSystem
from runner.systems.simulator import Run


@dataclass(frozen=True)
class NextExperiment:
    """What to do next, in a sentence, and the natural log odds that it is expected to yield."""

    sentence: str
    log_odds: float


def best_experiment(
    system: AbstractSystem,
    measured: Measured,
    first: tuple[Explanation, np.ndarray],
    second: tuple[Explanation, np.ndarray],
    covariance: np.ndarray,
    *,
    threads: int | None = None,
) -> NextExperiment | None:
    """Return the experiment that best tells a first explanation from a second; None: the system proposes none.

    Args:
        system: What was recorded.
        measured: Its noise.
        first: The likelier explanation and its parameters.
        second: The other and its parameters.
        covariance: Of the second's parameters, (p, p).
        threads: For the simulations; None: one per core.
    """
    proposals, planned, start = system.proposals()
    if not proposals:
        return None
    simulator, context = planned.simulator(threads=threads), system.context
    (one, x), (other, y) = first, second
    steps, by_start = difference_steps(other.parameters(context), y, system.difference_share), system.initial.steps
    moved = [other.make(y + d, context) for d in np.diag(steps)] if len(y) else []
    runs = [Run(one.make(x, context), start), Run(other.make(y, context), start)]
    runs += [Run(effects, start) for effects in moved]
    runs += [Run(other.make(y, context), start + d) for d in np.diag(by_start)]
    per = np.concatenate([steps, by_start])
    # the start is measured too, so that it can't be off by more than its noise
    prior = np.diag(np.concatenate([np.zeros(len(y)), system.initial.scale(measured.sigma) ** -2.0]))
    prior[: len(y), : len(y)] = np.linalg.pinv(covariance)
    out = []
    for i, proposal in enumerate(proposals):
        white = measured.noise_model.whiten(simulator.predict(i, runs) / measured.sigma).reshape(len(runs), -1)
        difference = white[0] - white[1]
        columns = ((white[2:] - white[1]) / per[:, None]).T
        right = columns.T @ difference
        # what an experiment tells nothing of has no information at all: it takes nothing off
        taken = right @ np.linalg.lstsq(columns.T @ columns + prior, right, rcond=None)[0]
        left = difference @ difference - taken
        out.append(NextExperiment(proposal.sentence, float(0.5 * max(left, 0.0))))
    return max(out, key=lambda e: e.log_odds)
