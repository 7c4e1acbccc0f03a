"""A start state is what is read at the first sample, however late commands or measurements are."""

from __future__ import annotations

import numpy as np
import pytest

from runner.effects.planar_box import ActuatorDelay, ObservationDelay
from runner.effects.planar_box.delay import Delay
from runner.recording import Span
from runner.systems.planar_box.system import PlanarBox
from runner.systems.simulator import Run
from tests.cases import made

MOVING = np.array([0.1, -0.2, 0.3, 0.6, -0.3, 4.0])


@pytest.mark.parametrize("delay", [ActuatorDelay, ObservationDelay])
def test_a_delay_moves_what_is_read_as_smoothly_as_it_grows(delay: type[Delay]) -> None:
    """In the middle of a push, just below and above whole physics steps: jumps would be a step's way, over 1 mm."""
    recording, _ = made(episodes=1, seconds=3.0)
    simulator = PlanarBox(recording).simulator(threads=1)
    part = simulator.parts([Span(0, 60, 90)])
    step_s = simulator.step_s
    delays = [0.0, 1e-7, step_s - 1e-7, step_s, step_s + 1e-7, 3.5 * step_s]
    shown = part.predict(0, [Run((delay(s),) if s else (), MOVING) for s in delays])[:, :, :6]
    # pushed at 17 m/s2, which takes half a metre per second away in a row
    np.testing.assert_allclose(shown[:, 0], np.tile(MOVING, (len(delays), 1)), atol=2e-5)
    way_m = step_s * np.abs(MOVING[3:5]).max()
    for lower, upper in ((0, 1), (2, 3), (3, 4)):
        assert np.abs(shown[upper] - shown[lower])[:, :2].max() < 0.02 * way_m
