"""What an impact leaves open: how far predictions differ between models that are equally good beforehand.

How hard a contact is, and how long a step, are numbers of a simulator that nobody has measured on the body; a quarter
more or less of either is as good a model. What that changes after an impact no comparison with a recording can hold
against a model, whatever the sensors' noise: so it counts as noise (of the three floors, sensor, repeatability and
numerics, the largest is what a fit may hope for).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from runner.effects.base import Effects
from runner.effects.mechanism import ContactStiffness, contacts
from runner.numerics.arrays import FloatArray, spread_over
from runner.recording import Span
from runner.settings import SETTINGS
from runner.systems.channels import Scatter
from runner.systems.mechanism.settings import MECHANISM
from runner.systems.mechanism.simulator import MechanismSimulator, Stretch


def scatter(
    simulator: MechanismSimulator,
    spans: Sequence[Span],
    starts: Sequence[FloatArray],
    groups: Sequence[str],
    calm: tuple[NDArray[np.bool_], ...],
) -> Scatter:
    """Return the root mean square difference of predictions with equally good contacts, once there was an impact.

    Args:
        simulator: Of the recording.
        spans: Stretches that begin in flight and end after an impact.
        starts: A start of each, (S,).
        groups: Of each channel, (C,): those of one group share a level.
        calm: Per episode (T,): where nothing hits the body.
    """
    found = Scatter(np.zeros(len(groups)), calm)
    after = found.parts(spans)
    model = simulator.models.compiled(()).model
    bodies = [model.body(b).name for b in range(1, model.nbody)]
    harder: Effects = tuple(
        ContactStiffness(b, MECHANISM.replay.harder_contact) for b in bodies if contacts.touches(model, b)
    )
    squares = []
    for i in spread_over(len(spans), SETTINGS.stretches.probed_windows):
        span = spans[i]
        shown = simulator.simulate(
            [Stretch(span.episode, span.begin, span.end, effects, starts[i]) for effects in ((), harder)]
        )
        squares.append((shown[1] - shown[0])[after.begun(i)] ** 2)
    every = np.concatenate(squares)
    if not np.isfinite(every).any(axis=0).all():
        return found
    mean, names = np.nanmean(every, axis=0), np.array(groups)
    return replace(found, level=np.sqrt([mean[names == g].mean() for g in names]))
