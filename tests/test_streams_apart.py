"""Topics with stamps of their own: rows of commands hold no measurement, and the noise is found all the same."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pandas as pd
import pytest

from runner.noise.measured import Measured, measure, refine
from runner.noise.model import NoiseModel
from runner.recording.model_form import read_model_case
from runner.systems.mechanism.system import MechanismSystem

SIGMA = 0.001  # rad
MJCF = """
<mujoco><option timestep="0.001"/><worldbody><body name="lever">
  <joint name="hinge" axis="0 -1 0" damping="0.05"/>
  <inertial pos="0 0 -0.3" mass="1" diaginertia="0.01 0.01 0.01"/>
</body></worldbody><actuator><motor name="drive" joint="hinge"/></actuator></mujoco>"""
NOMINAL = """
model: model.xml
commands: {u: {actuator: drive}}
channels: {q: {joint: hinge, quantity: position}}
start: rest
"""


@pytest.fixture(scope="module")
def lever(tmp_path_factory: pytest.TempPathFactory) -> MechanismSystem:
    """Return a swinging lever, exactly as believed: a command every 10 ms, and a reading 1 ms after each."""
    folder: Path = tmp_path_factory.mktemp("lever")
    (folder / "model.xml").write_text(MJCF)
    (folder / "nominal.yaml").write_text(NOMINAL)
    model, rng = mujoco.MjModel.from_xml_string(MJCF), np.random.default_rng(0)
    rows = []
    for run in range(3):
        data = mujoco.MjData(model)
        for k in range(400):
            data.ctrl[0] = np.sin(0.03 * k + run)
            rows.append((run, 0.01 * k, data.ctrl[0], np.nan if k else data.qpos[0]))
            mujoco.mj_step(model, data)
            rows.append((run, 0.01 * k + 0.001, data.ctrl[0], data.qpos[0] + SIGMA * rng.standard_normal()))
            mujoco.mj_step(model, data, nstep=9)
    pd.DataFrame(rows, columns=["episode", "t", "u", "q"]).to_csv(folder / "recording.csv", index=False)
    return MechanismSystem(read_model_case(folder))


def left_by_the_truth(lever: MechanismSystem, measured: Measured) -> dict[int, np.ndarray]:
    """Return noise alone, where there is a reading."""
    rng = np.random.default_rng(1)
    return {
        e: np.where(np.isfinite(v), SIGMA * rng.standard_normal(v.shape), np.nan) for e, v in enumerate(measured.values)
    }


def test_readings_between_rows_of_commands_count(lever: MechanismSystem) -> None:
    """Every reading but few outliers is valid, and nothing else is; the noise is near what was added."""
    measured = measure(lever)
    for values, valid in zip(measured.values, measured.valid, strict=True):
        there = np.isfinite(values)
        assert not valid[~there].any()
        assert valid[there].mean() > 0.99
    assert measured.sigma[0] == pytest.approx(SIGMA, rel=0.15)


def test_rows_without_a_reading_make_the_noise_neither_small_nor_slow(lever: MechanismSystem) -> None:
    """A line drawn between readings would be taken for noise that is half as large and lasts for two rows."""
    measured = measure(lever)
    again = refine(measured, lever, left_by_the_truth(lever, measured))
    assert again.sigma[0] == pytest.approx(SIGMA, rel=0.06)
    assert not again.noise_model.lag_one.any()
    assert all(v[np.isfinite(x)].mean() > 0.99 for v, x in zip(again.valid, again.values, strict=True))


def test_slow_noise_is_whitened_from_reading_to_reading(lever: MechanismSystem) -> None:
    """Rows of commands between them are no readings of 0: what is whitened is white, and of unit variance."""
    measured = replace(measure(lever), sensor=np.array([SIGMA]), noise_model=NoiseModel(np.ones(1), np.full(1, 0.8)))
    residual = np.full((20, *measured.values[0].shape), np.nan)
    rows = np.isfinite(measured.values[0][:, 0])
    fresh = SIGMA * np.random.default_rng(2).standard_normal((20, rows.sum()))
    slow = fresh.copy()
    for k in range(1, rows.sum()):
        slow[:, k] = 0.8 * slow[:, k - 1] + 0.6 * fresh[:, k]
    residual[:, rows, 0] = slow
    valid = measured.counted(0)[:, 0]
    white = measured.whiten(0, residual)[..., 0]
    assert not white[:, ~valid].any()
    white = white[:, valid]
    assert white.std() == pytest.approx(1.0, abs=0.03)
    assert np.mean(white[:, 1:] * white[:, :-1]) == pytest.approx(0.0, abs=0.03)


def test_the_usual_step_is_that_of_all_rows(lever: MechanismSystem) -> None:
    """Steps of 1 ms and of 9 ms alternate: 200 rows a second, so that a horizon of 0.1 s is 20 rows long."""
    assert lever.rate_hz == pytest.approx(200.0)


def test_a_stretch_in_which_a_sensor_says_nothing_leaves_nothing_of_it(lever: MechanismSystem) -> None:
    """The force of a pin counts while it pushes: some stretches have none."""
    measured = replace(measure(lever), sensor=np.array([SIGMA]), noise_model=NoiseModel(np.ones(1), np.full(1, 0.8)))
    silent = replace(measured, values=tuple(np.full_like(v, np.nan) for v in measured.values))
    silent = replace(silent, valid=tuple(np.zeros(v.shape, bool) for v in silent.values))
    assert not silent.whiten(0, np.full((3, *silent.values[0].shape), np.nan)).any()
