"""The plumb line finds the centre of mass within a millimetre, says how sure it is, and refuses what can't cross."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from runner.__main__ import main
from runner.effects.planar_box import ComOffset
from runner.errors import ConfigError, ResultError
from runner.physics.forces import Straight
from runner.physics.scene import SceneConfig
from runner.studies.plumb_line import PlumbLine, crossing, hang, measured_plumb, plumb
from runner.teleop.estimators import Linear
from runner.teleop.experiment import Experiment, RemoteConfig, StartConfig
from runner.teleop.link import LinkConfig, NoiseConfig

POINTS = ((0.5, 0.0, 0.0), (0.0, 0.5, 0.0), (0.0, 0.0, 0.5))
COM = (0.12, -0.08, 0.1)


def experiment(remote: RemoteConfig, noise: NoiseConfig | None = None) -> Experiment:
    """Return an experiment with this remote."""
    link = LinkConfig(noise=noise or NoiseConfig())
    return Experiment(0, SceneConfig(), Straight(), remote, StartConfig(), link, {"linear": Linear()})


def test_a_body_at_rest_hangs_with_its_centre_under_the_point() -> None:
    """The line down from the hanging point passes the centre of mass within a micrometre."""
    hanging = hang(experiment(RemoteConfig(com_m=COM)), POINTS)
    for k, point in enumerate(POINTS):
        down = plumb(hanging.swing(k, damping_nms_rad=5.0, longest_s=100.0).at_rest)
        arm = np.array(COM) - point
        assert np.linalg.norm(np.cross(down, arm)) < 1e-6
        assert down @ arm > 0


def test_it_swings_with_the_period_of_a_physical_pendulum() -> None:
    """A light damper leaves the period 2 pi sqrt(I / (m g l)) of small swings, with I about the point."""
    remote = RemoteConfig(com_m=(0.02, 0.0, -0.2))
    hanging = hang(experiment(remote), ((0.0, 0.0, 0.5),))
    damping = 0.3
    swing = hanging.swing(0, damping_nms_rad=damping, longest_s=1000.0)
    tilt = np.arctan2(plumb(swing.quaternion)[:, 0], -plumb(swing.quaternion)[:, 2]) - np.arctan2(0.02, 0.7)
    up = np.flatnonzero((tilt[:-1] < 0) & (tilt[1:] >= 0))[:6]
    crossed = swing.time_s[up] - tilt[up] / (tilt[up + 1] - tilt[up]) * np.diff(swing.time_s)[up]
    length = np.hypot(0.02, 0.7)
    inertia = remote.body.inertia[1] + 3.0 * length**2
    omega = np.sqrt(3.0 * 9.81 * length / inertia - (damping / (2 * inertia)) ** 2)
    assert np.diff(crossed).mean() == pytest.approx(2 * np.pi / omega, rel=1e-3)


def test_within_a_millimetre_on_a_cube_of_one_metre(tmp_path: Path) -> None:
    """With 1 mrad of noise every one of 20 bodies is found within 1 mm, and within 0.001 mm without."""
    noise = NoiseConfig(angle_rad=1e-3)
    rows = PlumbLine(objects=20).rows(experiment(RemoteConfig(com_m=COM), noise), tmp_path)
    for count in (2, 3):
        mine = [row for row in rows if row["points"] == count]
        assert len(mine) == 20
        assert max(row["error_mm"] for row in mine) < 1.0
        assert max(row["error_without_noise_mm"] for row in mine) < 1e-3
        # squared distances in units of the stated covariance: chi-square, 3 degrees of freedom for each body
        assert 35 < sum(row["mahalanobis2"] for row in mine) < 92  # 99 %
    assert (tmp_path / "run.rrd").stat().st_size > 1000


def test_effects_on_the_remote_are_the_truth() -> None:
    """A planted offset of the centre of mass is what is found."""
    hanging = hang(experiment(RemoteConfig(effects={"com": ComOffset(0.05, 0.1)})), POINTS)
    np.testing.assert_allclose(hanging.com_m, (0.05, 0.1, 0.0))
    downs = [plumb(hanging.swing(k, damping_nms_rad=5.0, longest_s=100.0).at_rest) for k in range(3)]
    found = crossing(np.array(POINTS), np.array(downs), 1e-3)
    np.testing.assert_allclose(found.point_m, hanging.com_m, atol=1e-6)


def test_the_covariance_is_the_scatter() -> None:
    """Over 2000 draws of noisy directions the scatter of the crossing is its stated covariance, within 15 %."""
    rng, com, points = np.random.default_rng(1), np.array(COM), np.array(POINTS)
    exact = (com - points) / np.linalg.norm(com - points, axis=1)[:, None]
    noisy = exact + 1e-3 * rng.standard_normal((2000, 3, 3))
    noisy /= np.linalg.norm(noisy, axis=2, keepdims=True)
    found = np.array([crossing(points, d, 1e-3).point_m for d in noisy])
    stated = crossing(points, exact, 1e-3).covariance_m2
    np.testing.assert_allclose(np.cov(found.T), stated, atol=0.15 * stated.max())
    np.testing.assert_allclose(found.mean(axis=0), com, atol=5e-5)


def test_a_mean_of_many_measurements_is_sure() -> None:
    """Sixty measurements of 10 mrad are off by 10 / sqrt(60) mrad about each axis across the line."""
    rng = np.random.default_rng(2)
    quaternion = np.array([1.0, 0.0, 0.0, 0.0])
    off = np.array([measured_plumb(quaternion, 1e-2, 60, rng)[:2] for _ in range(500)])
    assert off.std() == pytest.approx(1e-2 / np.sqrt(60), rel=0.1)


def test_points_on_one_line_with_the_centre_are_refused() -> None:
    """Two points above one another give one line."""
    down = np.array([[0.0, 0.0, -1.0], [0.0, 0.0, -1.0]])
    with pytest.raises(ResultError, match="the lines do not cross"):
        crossing(np.array([[0.0, 0.0, 0.5], [0.0, 0.0, 0.2]]), down, 1e-3)


def test_wrong_settings_are_refused(tmp_path: Path) -> None:
    """One point, a point outside, and a body that never comes to rest."""
    with pytest.raises(ConfigError, match="points_m: at least two"):
        PlumbLine(points_m=([0.5, 0.0, 0.0],))
    with pytest.raises(ConfigError, match=r"study.points_m\[1\]: .* outside the body"):
        PlumbLine(points_m=([0.5, 0.0, 0.0], [0.0, 0.6, 0.0])).rows(experiment(RemoteConfig()), tmp_path)
    with pytest.raises(ResultError, match="still swings after 2 s"):
        PlumbLine(longest_s=2.0, damping_nms_rad=0.01).rows(experiment(RemoteConfig(com_m=COM)), tmp_path)


def test_the_command_makes_the_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`runner run experiment=plumb_line` leaves a row for each body and number of points."""
    assert main(["run", "experiment=plumb_line", "study.objects=2", f"out={tmp_path}/x"]) == 0
    table = pd.read_parquet(tmp_path / "x" / "summary.parquet")
    assert set(table["status"]) == {"done"}
    assert table["points"].tolist() == [2, 3, 2, 3]
    assert "error_mm" in capsys.readouterr().out
