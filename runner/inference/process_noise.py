"""What a force does to a prediction that is in no recording and in no model: process noise.

A force sensor has noise, a surface is uneven, a command acts a little otherwise than it was logged. However small, that
moves the body, and what it does grows: in half a minute of an unstable motion a thousandth of the usual force makes
thousands of noises. So every explanation is granted a force that nothing foretells: constant over intervals, each with
a Gaussian amplitude of its own, whose standard deviation is a share of the usual force that is estimated. It is
integrated out (see `runner.inference.evidence`), so that no explanation is asked to account for it: the model error of
Kennedy and O'Hagan (2001), as an acceleration rather than as an output, where it spreads as the dynamics have it.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from runner.inference.least_squares import Fit, Fitter
from runner.inference.variable_projection import finite
from runner.numerics.arrays import FloatArray
from runner.settings import SETTINGS
from runner.systems.simulator import Run


def pushed(fitter: Fitter, fit: Fit) -> tuple[FloatArray, ...]:
    """Return how the whitened prediction of a fit answers a force over each interval, per episode (n, intervals D).

    In units of the usual force of each of its D components.
    """
    usual = fitter.system.disturbance.prior / SETTINGS.where.max_force
    share, effects = SETTINGS.process.difference_share, fitter.held + fit.explanation.make(fit.x, fitter.context)
    simulator, scatter, out = fitter.simulator.surveying(), fitter.measured.scatter, []
    before_s = simulator.simulated_s
    for e, start in zip(fit.episodes, fit.starts, strict=True):
        samples = len(fitter.measured.values[e])
        count = max(1, round(fitter.seconds(e) / SETTINGS.process.interval_s))
        edges = np.linspace(0, samples - 1, count + 1).round().astype(int)
        runs = [Run(effects, start)]
        for begin, end in pairwise(edges):
            pushes = np.zeros((len(usual), samples, len(usual)))
            pushes[:, begin:end] = np.diag(share * usual)[:, None]
            runs += [Run(effects, start, push) for push in pushes]
        shown = simulator.predict(e, runs)
        if scatter is not None:
            # nothing answers in proportion through a hit; how far equally good models part there counts as noise
            hit = scatter.begun(e)
            shown[:, hit] = shown[0, hit]
        rows = fitter.measured.whiten(e, shown - fitter.measured.values[e]).reshape(len(runs), -1)
        out.append(finite(rows[1:] - rows[0]).T / share)
    if simulator is not fitter.simulator:
        fitter.simulator.simulated_s += simulator.simulated_s - before_s
    return tuple(out)
