"""A box of which only poses were recorded, some of them lost: what is told of it without velocities."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from runner.effects.planar_box import Friction
from runner.inference.least_squares import NONE, Explanation, Fitter
from runner.noise.measured import measure
from runner.recording.model_form_mjcf import read_mjcf
from runner.systems.case import open_case
from runner.systems.planar_box.system import PlanarBox
from runner.systems.windows import Windows

EXAMPLE = Path(__file__).parents[1] / "examples" / "cases" / "slippery_floor"
TRUE, EPISODES = 0.277, 3


@pytest.fixture(scope="module")
def system(tmp_path_factory: pytest.TempPathFactory) -> PlanarBox:
    """The first episodes of the example without their velocities, and three poses of a hundred lost."""
    folder = tmp_path_factory.mktemp("poses")
    table = pd.read_parquet(EXAMPLE / "recording.parquet").astype(float)
    table = table[table["episode"] < EPISODES].drop(columns=["vx", "vy", "wz"])
    table.loc[np.random.default_rng(0).random(len(table)) < 0.03, ["x", "y", "yaw"]] = np.nan
    table.to_parquet(folder / "recording.parquet", index=False)
    shutil.copy(EXAMPLE / "nominal.yaml", folder)
    opened = open_case(folder)
    assert isinstance(opened, PlanarBox)
    return opened


def test_what_was_not_measured_is_no_channel(system: PlanarBox) -> None:
    """Channels, values and predictions are poses alone; a lost pose does not count."""
    assert [c.name for c in system.channels] == ["x", "y", "yaw"]
    measured = measure(system)
    lost = np.isnan(system.values()[0]).any(axis=1)
    assert lost.any()
    assert not measured.valid[0][lost].any()
    again = system.with_values(system.values())
    np.testing.assert_array_equal(again.values()[0], system.values()[0])


def test_friction_is_found_from_poses_alone(system: PlanarBox) -> None:
    """The planted 0.277 within four standard errors, and nothing but noise is left."""
    measured = measure(system)
    fitter = Fitter(system, system.simulator(), measured)
    episodes = tuple(range(EPISODES))
    explanation = Explanation((system.vocabulary.by_name["friction"][0],))
    fit = fitter.fit(explanation, episodes, starts=fitter.fit(NONE, episodes).starts)
    (friction,) = explanation.make(fit.x, fitter.context)
    assert isinstance(friction, Friction)
    error = float(np.sqrt(1.0 / sum(float(j[:, 0] @ j[:, 0]) for j in fit.jacobian)))
    assert abs(np.log(friction.mu / TRUE)) < 4 * error < 0.01
    assert fit.total / measured.count(episodes) == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("rates", [True, False])
def test_a_start_that_was_lost_is_told_by_what_follows(system: PlanarBox, *, rates: bool) -> None:
    """A tracker that sees nothing of a box before 0.1 s: its start is where it comes from, not the origin."""
    box = open_case(EXAMPLE) if rates else system
    assert isinstance(box, PlanarBox)
    values = [v.copy() for v in box.values()]
    true = values[0][0].copy()
    values[0][:7] = np.nan
    lost = measure(box.with_values(values))
    start = box.initial.guess(lost, 0)
    assert np.abs(true[:3]).min() > 1.0
    assert start[:3] == pytest.approx(true[:3], abs=0.2)


@pytest.mark.parametrize("smooth", [True, False])
def test_a_window_that_begins_while_nothing_is_seen_starts_where_it_was_seen_next(*, smooth: bool) -> None:
    """Or last, where nothing follows; a coordinate that was seen all the while is that of the sample itself."""
    box = open_case(EXAMPLE)
    assert isinstance(box, PlanarBox)
    values = [v.copy() for v in box.values()]
    true, end = values[0].copy(), len(values[0]) - 3
    values[0][20:29, :2] = np.nan
    values[0][end - 4 :] = np.nan
    lost = measure(box.with_values(values))
    starts = box.initial.guess_windows(lost, Windows(np.zeros(2, int), np.array([24, end]), 2), smooth=smooth)
    assert np.hypot(*true[[24, end], :2].T).min() > 1.0
    assert starts[:, :2] == pytest.approx(true[[24, end], :2], abs=0.2)
    assert starts[0, 2] == pytest.approx(true[24, 2], abs=0.02)


def test_slopes_start_a_window(system: PlanarBox) -> None:
    """Starts of windows have velocities although none were measured: that of the path between two samples."""
    measured = measure(system)
    first = np.arange(20, 200, 20)
    windows = Windows(np.zeros(len(first), int), first, 20)
    starts = system.initial.guess_windows(measured, windows, smooth=True)
    path = pd.DataFrame(system.values()[0]).interpolate().to_numpy()
    slope = (path[first + 10] - path[first - 10]) / (20 / system.rate_hz)
    assert np.corrcoef(starts[:, 3], slope[:, 0])[0, 1] > 0.9


def test_a_free_joint_without_a_name_has_that_of_its_body(tmp_path: Path) -> None:
    """Other joints are named by their number."""
    model = tmp_path / "model.xml"
    model.write_text(
        "<mujoco><worldbody><body name='cube'><freejoint/><geom size='0.1'/></body>"
        "<body><joint axis='0 1 0'/><geom size='0.1'/></body></worldbody></mujoco>"
    )
    spec = read_mjcf(model)
    assert [j.name for j in spec.joints] == ["cube", "joint1"]
    assert [b.name for b in spec.bodies] == ["world", "cube", "body2"]
