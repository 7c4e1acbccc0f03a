"""Eq. 6: what f_difference must be, against MuJoCo at a fine step, and what the rule does in the closed loop."""

from __future__ import annotations

import math

import numpy as np
import pytest

from runner.estimation.copies import Copies, to_vector
from runner.estimation.eq6 import ComEq6, Factor, difference_factor
from runner.physics.forces import Straight
from runner.physics.scene import BodyConfig, SceneConfig, push_columns
from runner.teleop.estimators import Outcome
from runner.teleop.experiment import Experiment, RemoteConfig, StartConfig
from runner.teleop.frames import RunResult
from runner.teleop.link import LinkConfig
from runner.teleop.loop import run

BODY = BodyConfig(3.0, 0.3)
FORCE_N, T = 15.0, 1 / 60
ACCELERATION = FORCE_N / 3.0 - 0.3 * 9.81


def difference(scene: SceneConfig, start_m_s: float, offset_m: float) -> float:
    """Return by how much a cube with its CoM to the left of a push along x turns faster after an interval, rad/s."""
    x = np.array([to_vector(BODY), to_vector(BODY)])
    x[1, 2] = offset_m / BODY.half_size_m[1]
    start = np.zeros((2, 6))
    start[:, 3] = start_m_s
    pushes = np.tile(push_columns((FORCE_N, 0.0, 0.0), (0.0, 0.0, 0.0)), (round(T / scene.timestep_s), 1))
    turning = Copies(scene, BODY).run(x, start, pushes)[:, 5]
    return float(turning[1] - turning[0])


@pytest.mark.parametrize("start_m_s", [0.0, 0.02, 0.2, 1.0])
def test_the_closed_form_is_the_limit_of_small_steps(start_m_s: float) -> None:
    """f_difference with the moment of friction is that of the engine at 1/30000 s, from rest and in motion."""
    scene = SceneConfig(timestep_s=1 / 30_000, grid=16)
    offset = 1e-3
    told = difference_factor(
        Factor.sliding, scene, BODY, FORCE_N, 0.0, (start_m_s, start_m_s + ACCELERATION * T), T
    ) * difference(scene, start_m_s, offset)
    assert told == pytest.approx(offset, rel=0.01)


def test_from_rest_friction_acts_like_inertia() -> None:
    """From rest the factor is the free one times 1 + mu N (h^2 / 3 - (mu z)^2) / (I a)."""
    scene = SceneConfig()
    free, sliding = (
        difference_factor(f, scene, BODY, FORCE_N, 0.0, (0.0, ACCELERATION * T), T)
        for f in (Factor.free, Factor.sliding)
    )
    assert sliding / free == pytest.approx(1 + 0.3 * 3.0 * 9.81 * (0.25 / 3 - 0.15**2) / 0.5 / ACCELERATION)
    assert math.isinf(difference_factor(Factor.sliding, scene, BODY, FORCE_N, 0.0, (0.1, 0.05), T))


def pushed(factor: Factor, force_n: float = FORCE_N, angle_rad: float = 0.0, friction: float = 0.3) -> RunResult:
    """Push a cube with its CoM 3 cm to the left of the push."""
    left = -math.sin(angle_rad), math.cos(angle_rad)
    return run(
        Experiment(
            seed=0,
            scene=SceneConfig(),
            forces=Straight(
                (force_n * math.cos(angle_rad), force_n * math.sin(angle_rad), 0.0), lead_s=0.0, push_s=0.4, rest_s=0.1
            ),
            remote=RemoteConfig(com_m=(0.03 * left[0], 0.03 * left[1], 0.0), friction=friction),
            start=StartConfig(mass_kg=3.0),
            link=LinkConfig(),
            estimator={"eq6": ComEq6(factor)},
        )
    )


@pytest.mark.parametrize("angle_rad", [0.0, 0.7, math.pi / 2])
def test_one_update_with_the_models_own_factor(angle_rad: float) -> None:
    """One update finds the offset to 1 %, in any direction, and nothing along the push."""
    frames = pushed(Factor.simulated, angle_rad=angle_rad).updates
    x, y = frames.column("eq6_com_x_m"), frames.column("eq6_com_y_m")
    across = -math.sin(angle_rad) * x + math.cos(angle_rad) * y
    along = math.cos(angle_rad) * x + math.sin(angle_rad) * y
    assert across[0] == pytest.approx(0.03, rel=0.01)
    assert along[0] == pytest.approx(0.0, abs=1e-12)
    assert across[-1] == pytest.approx(0.03, rel=1e-4)


def test_without_friction_the_original_is_right() -> None:
    """On ice I / (F T) is the factor, and one update is enough."""
    frames = pushed(Factor.free, friction=0.0).updates
    assert frames.column("eq6_com_y_m")[0] == pytest.approx(0.03, rel=1e-3)


def test_with_friction_the_original_falls_short() -> None:
    """With friction 0.3 the same factor tells about two thirds of the offset."""
    frames = pushed(Factor.free).updates
    assert 0.5 < frames.column("eq6_com_y_m")[0] / 0.03 < 0.75


def test_a_cube_that_sticks_says_nothing() -> None:
    """Below the threshold the estimate is held."""
    frames = pushed(Factor.simulated, force_n=7.0).updates
    assert not frames.column("eq6_com_y_m").any()
    assert set(frames.column("eq6_outcome")) == {Outcome.at_rest}
