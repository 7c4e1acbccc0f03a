"""Policies of following take over what they say, and the measure of the jump is the closed form where there is one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from runner.errors import ConfigError
from runner.physics.forces import PaperForces, Straight
from runner.physics.scene import SceneConfig
from runner.studies.model_jump import ModelJump, jumps
from runner.teleop import loop
from runner.teleop.estimators import Linear
from runner.teleop.experiment import Experiment, RemoteConfig, StartConfig
from runner.teleop.follow import (
    ALL,
    NOTHING,
    Blended,
    Difference,
    FreeSpace,
    Immediate,
    PerceptualDeadBand,
    RateLimited,
    Share,
)
from runner.teleop.link import LinkConfig, NoiseConfig

HERE = Difference(0.1, 0.2, 0.5, 1.0, 0.5, 1.0, 2.0, True, 1 / 60)
LINK = LinkConfig(delay_s=0.1, jitter_s=0.03, loss=0.2, noise=NoiseConfig(5e-4, 1e-3, 5e-3, 1e-2))
BASE = Experiment(
    0, SceneConfig(), Straight(), RemoteConfig(), StartConfig(1.5), LinkConfig(), {"linear": Linear()}, Immediate()
)


def test_shares() -> None:
    """At once everything, limited at the limits, blended by the time constant, in free space only unpushed."""
    assert Immediate().share(HERE) == ALL
    limited = RateLimited(0.6, 1.2, 3.0, 6.0, 3.0).share(HERE)
    np.testing.assert_allclose(limited, [0.1, 0.1, 0.1, 0.1, 0.1])
    assert (
        RateLimited().share(
            HERE._replace(position_m=0.0, angle_rad=0.0, velocity_m_s=0.0, rate_rad_s=0.0, parameters=0.0)
        )
        == ALL
    )
    np.testing.assert_allclose(Blended(1 / 60).share(HERE), [1 - np.exp(-1)] * 5)
    assert FreeSpace().share(HERE) == NOTHING
    assert FreeSpace().share(HERE._replace(pushed=False)) == ALL


def test_the_dead_band_is_a_fraction_of_what_is_there() -> None:
    """A change of a parameter by 6 % is left alone, by 8 % taken over; 7 % of the speed left alone, 9 % taken over."""
    small = Difference(0.011, 0.034, 0.07, 0.15, 0.06, 1.0, 2.0, False, 1 / 60)
    large = Difference(0.013, 0.036, 0.09, 0.17, 0.08, 1.0, 2.0, True, 1 / 60)
    assert PerceptualDeadBand().share(small) == NOTHING
    assert PerceptualDeadBand().share(large) == ALL
    assert PerceptualDeadBand().share(small._replace(speed_m_s=0.1)) == Share(0.0, 0.0, 1.0, 0.0, 0.0)


@pytest.mark.parametrize("wrong", [{"time_s": 0.0}, {"time_s": float("nan")}])
def test_wrong_values_are_refused(wrong: dict[str, float]) -> None:
    """Time constants that make no sense name their key."""
    with pytest.raises(ConfigError, match="time_s"):
        Blended(**wrong)
    with pytest.raises(ConfigError, match="force"):
        PerceptualDeadBand(force=1.5)


def test_the_force_of_the_same_motion_is_in_proportion_to_the_mass() -> None:
    """Sliding under a push F, an update from m to m' jumps by F |m' / m - 1|; at rest and unpushed by nothing."""
    result = loop.run(BASE)
    table = jumps(BASE, result, "linear")
    mass = np.concatenate([[1.5], result.updates.column("linear_mass_kg")])[:-1]
    pushed = np.flatnonzero(result.updates.column("force_x_n")[: len(table)] > 19)[2:20]
    wanted = 20.0 * np.abs(mass[pushed + 1] / mass[pushed] - 1)
    np.testing.assert_allclose(table["force_n"].to_numpy()[pushed], wanted, rtol=1e-4, atol=1e-9)
    assert wanted.max() > 0.1
    assert not table["force_n"].to_numpy()[:15].any()


def test_the_jump_of_the_state_is_what_was_between_the_two() -> None:
    """On an ideal link, followed at once, the jump is the distance from the remote just before."""
    table = jumps(BASE, result := loop.run(BASE), "linear")
    updates = result.updates
    wanted = updates.column("linear_position_error_m")[: len(table)]
    np.testing.assert_allclose(table["position_m"], wanted, atol=1e-15)
    np.testing.assert_allclose(table["velocity_m_s"], updates.column("linear_velocity_error_m_s")[: len(table)])


def test_a_rate_limit_bounds_every_jump() -> None:
    """No jump is larger than the limit times the interval; one that takes over at once jumps by more."""
    limit = RateLimited(velocity_m_s=0.3, acceleration_m_s2=6.0)
    given = replace(BASE, link=LINK, follow=limit)
    table = jumps(given, loop.run(given), "linear")
    assert table["position_m"].to_numpy().max() <= 0.3 / 60 * (1 + 1e-9)
    assert table["velocity_m_s"].to_numpy().max() <= 6.0 / 60 * (1 + 1e-9)
    at_once = replace(given, follow=Immediate())
    assert jumps(at_once, loop.run(at_once), "linear")["velocity_m_s"].to_numpy().max() > 0.2


def test_the_study_compares_policies_on_the_same_runs(tmp_path: Path) -> None:
    """Ten rows; in free space no force is felt, at once the search is; the estimates end alike."""
    given = replace(BASE, link=LINK, forces=PaperForces(pushes=3, rest_s=0.5))
    rows = ModelJump(seeds=2, settled_s=1.5).rows(given, tmp_path)
    table = {(row["policy"], row["phase"]): row for row in rows}
    assert len(table) == 10
    assert table["free_space", "search"]["largest_force_n"] < 1e-6
    assert table["immediate", "search"]["largest_force_n"] > 2.0
    assert table["rate_limited", "search"]["largest_force_n"] < table["immediate", "search"]["largest_force_n"]
    assert table["immediate", "search"]["behind_m"] < table["free_space", "search"]["behind_m"]
    assert (tmp_path / "immediate.parquet").is_file()
