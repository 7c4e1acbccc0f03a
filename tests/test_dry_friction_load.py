"""The load over the base follows the moments, and bodies that should lift or tip are told of."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from drive import STEP_S, G, make, outputs, play, set_push, wait
from friction_cases import CUBE, ODD, angles, situations, towards
from hypothesis import given
from hypothesis import strategies as st

from runner.physics import dry_friction
from runner.physics.scene import Base, BodyConfig


def statics(body: BodyConfig, force: np.ndarray, point: np.ndarray, slides: bool) -> np.ndarray:
    """Centre of the load of a body at yaw 0 under a push, from the moments about the CoM, (2,)."""
    floor = body.half_size_m[2]
    weight = body.mass_kg * G - force[2]
    limit = body.friction * weight
    size = math.hypot(force[0], force[1])
    friction = force[:2] * (min(1.0, limit / size) if slides else 1.0) if size else np.zeros(2)  # towards -force
    com = np.array(body.com_m)
    # N c = N com + (point - com) moments; friction acts com_z + floor below the CoM
    lever = point - com
    moment = lever[2] * force[:2] - lever[:2] * force[2]
    return com[:2] + (moment + (com[2] + floor) * friction) / weight


LOADED = [
    (CUBE, (0.0, 0.0, 0.0)),
    (CUBE, (0.0, 0.0, 0.3)),
    (CUBE, (0.0, 0.0, -0.4)),
    (replace(CUBE, com_m=(0.0, 0.0, -0.3)), (0.0, 0.0, 0.1)),
    (replace(CUBE, com_m=(0.1, -0.15, 0.2)), (0.1, -0.15, 0.0)),
]


@pytest.mark.parametrize(("body", "point"), LOADED)
@pytest.mark.parametrize("share", [0.6, 1.2])
@angles((0.0, 2.5))
def test_load_follows_statics(
    body: BodyConfig, point: tuple[float, float, float], share: float, angle_rad: float
) -> None:
    """Stuck and sliding, the load is the weight, and its centre is where the moments balance, 0.05 %."""
    force = towards(angle_rad, share * body.friction * body.mass_kg * G)
    scene = make(body)
    set_push(scene, force, point)
    # a push through the CoM in plan, so that it does not turn; seen after the transient of the first step
    wait(scene, 4 * STEP_S)
    out = outputs(scene)
    want = statics(body, force, np.array(point), slides=share > 1)
    np.testing.assert_allclose(
        out[dry_friction.OUT_COP : dry_friction.OUT_COP + 2], want, atol=5e-4 * np.abs(want).max() + 1e-6
    )
    assert out[dry_friction.OUT_LOAD] == pytest.approx(body.mass_kg * G)


def test_vertical_push_moves_the_load() -> None:
    """Pressing down at a point adds to the load, lifting takes from it; the centre follows. So does friction."""
    for force_z in (-20.0, 15.0):
        scene = make(CUBE)
        point = np.array([0.2, -0.1, 0.5])
        set_push(scene, (0, 0, force_z), point)
        wait(scene, 2 * STEP_S)
        out = outputs(scene)
        assert out[dry_friction.OUT_LOAD] == pytest.approx(3 * G - force_z)
        want = statics(CUBE, np.array([0, 0, force_z]), point, slides=False)
        np.testing.assert_allclose(out[dry_friction.OUT_COP : dry_friction.OUT_COP + 2], want, atol=1e-9)
        slowed = play(scene, 0.2, start=(0, 0, 0, 3.0, 0, 0)).raw[-1, 3]
        assert 3.0 - slowed == pytest.approx(0.2 * 0.5 * (3 * G - force_z) / 3, rel=0.01)


def test_weightless_body_slides_freely() -> None:
    """Lifted by more than its weight, the base bears nothing: no friction, no load, all of it lifted."""
    scene = make(CUBE)
    set_push(scene, (0, 0, 40.0))
    track = play(scene, 0.5, start=(0, 0, 0, 1.0, 0.5, 2.0))
    np.testing.assert_allclose(track.raw[-1, 3:], (1.0, 0.5, 2.0), atol=1e-12)
    assert track.out[-1, dry_friction.OUT_LIFTED] == 1.0
    assert track.out[-1, dry_friction.OUT_LOAD] == 0.0


def test_forces_on_the_com_act_like_pushes_there() -> None:
    """`xfrc_applied` (at the CoM), vertical part and tilting moments included, moves and loads like a push."""
    force, at = np.array([9.0, -4.0, 6.0]), np.array([0.3, 0.2, 0.15])
    pushed, applied = make(ODD), make(ODD)
    body = applied.body("b0").body_id
    for _ in range(300):
        set_push(pushed, force, at)
        wait(pushed, STEP_S)
        yaw = applied.data.qpos[2]
        c, s = math.cos(yaw), math.sin(yaw)
        arm = np.array(at) - ODD.com_m
        arm[:2] = c * arm[0] - s * arm[1], s * arm[0] + c * arm[1]
        applied.data.xfrc_applied[body] = [*force, *np.cross(arm, force)]
        wait(applied, STEP_S)
    np.testing.assert_allclose(applied.data.qpos, pushed.data.qpos, atol=1e-9)
    np.testing.assert_allclose(outputs(applied), outputs(pushed), atol=1e-6)


@given(
    angle_rad=st.integers(0, 62).map(lambda i: i / 10),
    height=st.integers(-4, 4).map(lambda i: i / 10),
    share=st.sampled_from([0.5, 0.999, 1.001, 1.4]),
    base=st.sampled_from(Base),
)
def test_lift_is_seen_exactly_when_moments_say_so(angle_rad: float, height: float, share: float, base: Base) -> None:
    """The base lifts at a corner when the load's centre leaves the kern: |x| / hx + |y| / hy > 1/3 (corners: 1).

    A push brings the centre to a share of the way to the kern's edge, 0.1 % on either side of it included.
    """
    body = replace(CUBE, base=base, half_size_m=(0.5, 0.4, 0.5), friction=10.0)
    point = np.array([0, 0, height])
    push = towards(angle_rad)
    kern = 1 / 3 if base is Base.even else 1.0
    # stuck, the centre is in proportion to the push
    push *= share * kern / np.sum(np.abs(statics(body, push, point, slides=False)) / body.half_size_m[:2])
    scene = make(body)
    set_push(scene, push, point)
    wait(scene, 3 * STEP_S)
    assert (outputs(scene)[dry_friction.OUT_LIFTED] > 0) == (share > 1)


def test_lifted_share_of_an_edge() -> None:
    """Past the kern the load is a wedge over 3 (half - centre) of the base; the rest is lifted, 2 % of the base."""
    for height in (-0.1, 0.0, 0.1, 0.2):
        scene = make(CUBE, grid=16)
        set_push(scene, (14.0, 0, 0), (0, 0, height))
        wait(scene, STEP_S)
        centre = 14.0 * (height + 0.5) / (3 * G)
        assert centre > 0.5 / 3
        assert outputs(scene)[dry_friction.OUT_LIFTED] == pytest.approx(1 - 3 * (0.5 - centre), abs=0.02)


def test_body_that_should_tip_slides_on() -> None:
    """Pushed so high that it would tip, a body still slides by Coulomb's law, and says where the load should be."""
    scene = make(CUBE)
    set_push(scene, (22.0, 0, 0), (0, 0, 0.45))
    track = play(scene, 1.0)
    assert track.raw[-1, 3] == pytest.approx(22 / 3 - 0.5 * G, rel=1e-6)
    assert np.abs(track.raw[:, [1, 2]]).max() < 1e-9
    cop = track.out[-1, dry_friction.OUT_COP]
    assert cop == pytest.approx((22 * 0.45 + 0.5 * 3 * G * 0.5) / (3 * G), rel=1e-6)
    assert cop > 0.5
    assert track.out[-1, dry_friction.OUT_LIFTED] > 0.7


@given(situations(), st.floats(0.0, 10.0))
def test_any_situation_stays_finite(
    case: tuple[BodyConfig, dict[str, Any], np.ndarray, np.ndarray, np.ndarray, np.ndarray], strength: float
) -> None:
    """However hard a body is pushed, the motion stays finite, and friction never does work on it."""
    body, record, gravity, state, force, point = case
    scene = make(body, **record)
    scene.model.opt.gravity[:] = gravity
    set_push(scene, strength * force * [1, 1, 0.1], point)
    track = play(scene, 0.1, start=state)
    assert np.isfinite(track.raw).all()
    assert np.isfinite(track.out).all()
    assert track.out[:, dry_friction.OUT_POWER].max() < 1e-3 * body.mass_kg * G
