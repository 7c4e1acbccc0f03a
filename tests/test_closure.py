"""How far the gap shrinks, in units of the noise at the time: that of the sensors until something is hit."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from runner.diagnosis.closure import close
from runner.noise.measured import Measured
from runner.noise.model import NoiseModel
from runner.recording import Span
from runner.systems.channels import Scatter

COUNT, SENSOR, SCATTER = 100, 0.3, 1.5


@pytest.mark.parametrize("hit_at", [COUNT, 90])
def test_what_hits_at_the_end_is_measured_by_its_sensor_before(hit_at: int) -> None:
    """Off by four noises in the air and by none once corrected: all that can be closed is closed, 75 % in the root."""
    rng, calm = np.random.default_rng(0), np.arange(COUNT) < hit_at
    noise = SENSOR * rng.choice([-1.0, 1.0], COUNT)
    spans, stated = (Span(0, 0, COUNT),), np.full(1, np.nan)
    measured = Measured(
        spans, (noise[:, None],), np.array([SENSOR]), NoiseModel.white(1), (np.ones((COUNT, 1), bool),), stated,
        Scatter(np.array([SCATTER]), (calm,)),
    )  # fmt: skip
    off = np.where(calm, np.sqrt(15.0) * SENSOR * np.sign(noise), 0.0)

    def predict(_: int, runs: Any) -> np.ndarray:
        return np.array([off if not run.effects else np.zeros(COUNT) for run in runs])[:, :, None]

    episodes = [SimpleNamespace(index=3, step_s=0.01)]
    system = SimpleNamespace(
        recording=SimpleNamespace(episodes=episodes), channels=(SimpleNamespace(name="z", unit="m"),)
    )
    fitter: Any = SimpleNamespace(system=system, simulator=SimpleNamespace(predict=predict))
    effects: Any = ("made",)
    found = close({0: (np.zeros(1), np.zeros(1))}, measured, fitter, effects, pd.DataFrame())
    scale = np.where(calm, SENSOR, SCATTER)
    assert found.table["noise"].item() == pytest.approx(np.sqrt(np.mean(scale**2)))
    before, after = (np.sqrt(np.mean(((o - noise) / scale) ** 2)) for o in (off, 0.0 * off))
    assert found.gap_closed == pytest.approx(1 - after / before)
    assert found.closable_closed == pytest.approx((before**2 - after**2) / (before**2 - 1))
