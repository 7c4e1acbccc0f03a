"""What a force does to a prediction that is in no recording and in no model: process noise.

A force sensor has noise, a surface is uneven, a command acts a little otherwise than it was logged. However small, that
moves the body, and what it does grows: in half a minute of an unstable motion a thousandth of the usual force makes
thousands of noises. So every explanation is granted a force that nothing foretells: constant over intervals, each with
a Gaussian amplitude of its own, whose standard deviation is a share of the usual force that is estimated. It is
integrated out (see `runner.inference.evidence`), so that no explanation is asked to account for it: the model error of
Kennedy and O'Hagan (2001), as an acceleration rather than as an output, where it spreads as the dynamics have it.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from runner.inference.least_squares import Fit, Fitter
from runner.inference.variable_projection import finite
from runner.numerics.arrays import FloatArray
from runner.settings import SETTINGS
from runner.systems.simulator import AbstractSimulator, Run

RUNS_AT_ONCE = 60  # bounds the memory of one batch


def pushed(fitter: Fitter, fit: Fit) -> tuple[FloatArray, ...]:
    """Return how the whitened prediction of a fit answers a force over each interval, per episode (n, intervals D).

    In units of the usual force of each of its D components over `ProcessSettings.interval_s`; where intervals are
    shorter, as episodes are, a force of the same power is larger.
    """
    simulator = fitter.simulator.surveying()
    before_s = simulator.simulated_s
    effects = fitter.held + fit.explanation.make(fit.x, fitter.context)
    out = tuple(_answers(fitter, simulator, e, Run(effects, s)) for e, s in zip(fit.episodes, fit.starts, strict=True))
    if simulator is not fitter.simulator:
        fitter.simulator.simulated_s += simulator.simulated_s - before_s
    return out


def _answers(fitter: Fitter, simulator: AbstractSimulator, episode: int, run: Run) -> FloatArray:
    """Return the answers of one episode, (n, intervals D)."""
    usual, share = fitter.system.disturbance.prior / SETTINGS.where.max_force, SETTINGS.process.difference_share
    samples, seconds = len(fitter.measured.values[episode]), fitter.seconds(episode)
    count = min(max(1, round(seconds / SETTINGS.process.interval_s)), samples - 1)
    edges = np.linspace(0, samples - 1, count + 1).round().astype(int)
    (base,) = simulator.predict(episode, [run])
    scatter, changes, at_once = fitter.measured.scatter, [], max(1, RUNS_AT_ONCE // len(usual))
    for some in (list(pairwise(edges))[k : k + at_once] for k in range(0, count, at_once)):
        pushes = np.zeros((len(some), len(usual), samples, len(usual)))
        for push, (begin, end) in zip(pushes, some, strict=True):
            push[:, begin:end] = np.diag(share * usual)[:, None]
        shown = simulator.predict(episode, [replace(run, push=p) for p in pushes.reshape(-1, samples, len(usual))])
        if scatter is not None:
            # nothing answers in proportion through a hit; how far equally good models part there counts as noise
            hit = scatter.begun(episode)
            shown[:, hit] = base[hit]
        both = np.concatenate([base[None], shown]) - fitter.measured.values[episode]
        rows = fitter.measured.whiten(episode, both).reshape(len(both), -1)
        changes.append(finite(rows[1:] - rows[0]))
    return np.concatenate(changes).T / share * np.sqrt(SETTINGS.process.interval_s * count / seconds)
