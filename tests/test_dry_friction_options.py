"""Every option of dry friction: anisotropy, Stribeck, stiction, patches, films, air, tilt, a mass that leaks."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from drive import SQUARE_RADIUS, STEP_S, G, make, play, set_push
from friction_cases import CUBE, FRICTIONLESS, ODD, angles, towards
from reference import Box
from scipy.integrate import dblquad, quad, solve_ivp

from runner.physics import dry_friction


@angles((0.0, 0.5, math.pi / 2, 2.2))
@pytest.mark.parametrize("axis_rad", [0.0, 0.6])
@pytest.mark.parametrize("normality", [1.0, 0.0])
def test_anisotropic_friction(angle_rad: float, axis_rad: float, normality: float) -> None:
    """Friction is mu_1 along its axis, mu_2 across it, on the ellipse in between, where the flow says.

    The axes turn with the body; slip at `angle_rad` from the axis.
    """
    along, across, yaw = 1.3, 0.7, 0.4
    scene = make(CUBE, along=along, across=across, aniso_angle=axis_rad, normality=normality)
    slip = towards(angle_rad + axis_rad + yaw)
    track = play(scene, STEP_S, start=(0, 0, yaw, *(2 * slip[:2]), 0))
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    if normality == 1.0:
        local = np.array([along**2 * c, across**2 * s]) / math.hypot(along * c, across * s)
    else:
        local = np.array([along * c, across * s])
    local *= -0.5 * 3 * G
    turn = axis_rad + yaw
    want = [
        math.cos(turn) * local[0] - math.sin(turn) * local[1],
        math.sin(turn) * local[0] + math.cos(turn) * local[1],
    ]
    np.testing.assert_allclose(
        track.out[0, dry_friction.OUT_FORCE : dry_friction.OUT_FORCE + 2], want, rtol=2e-3, atol=0.02
    )
    np.testing.assert_allclose((track.raw[1] - track.raw[0])[3:5] / STEP_S, np.array(want) / 3, rtol=2e-3, atol=0.01)


@pytest.mark.parametrize("normality", [1.0, 0.0])
def test_anisotropic_threshold(normality: float) -> None:
    """A body at rest yields at mu_1 along the axis, at mu_2 across it, and on the ellipse in between."""
    between = 1 / math.hypot(math.cos(0.6) / 1.3, math.sin(0.6) / 0.7)
    for angle, factor in ((0.3, 1.3), (0.3 + math.pi / 2, 0.7), (0.3 + 0.6, between)):
        for share in (0.99, 1.01):
            scene = make(CUBE, along=1.3, across=0.7, aniso_angle=0.3, normality=normality)
            set_push(scene, towards(angle, share * factor * 0.5 * 3 * G))
            speed = np.hypot(*play(scene, 0.5).raw[-1, 3:5])
            assert (speed > 1e-4) == (share > 1)


@pytest.mark.parametrize("speed", [0.1013, 0.5021, 1.0007, 1.4993])
@pytest.mark.parametrize("share", [1.05, 1.5, 3.0])
def test_a_body_that_is_pushed_back_turns_round_within_a_step(speed: float, share: float) -> None:
    """It slides on at (F + mu N) / m until it stops, and goes back at (F - mu N) / m from that very moment."""
    scene = make(CUBE)
    set_push(scene, towards(math.pi, share * 0.5 * 3 * G))
    last = play(scene, 1.0, start=(0, 0, 0, speed, 0, 0)).state[-1]
    stop = speed / ((share + 1) * 0.5 * G)
    back = (share - 1) * 0.5 * G * (1.0 - stop)
    assert last[3] == pytest.approx(-back, abs=1e-3)
    assert last[0] == pytest.approx(speed * stop / 2 - back * (1.0 - stop) / 2, abs=1e-3)


@pytest.mark.parametrize("spin", [0.05, 0.4, 0.9])
def test_a_spinning_body_that_is_pushed_back_needs_no_shorter_steps(spin: float) -> None:
    """Where it turns round, slip changes its direction within a step; as fast as with steps 16 times shorter."""
    ends = []
    for step_s in (STEP_S, STEP_S / 16):
        scene = make(CUBE, timestep_s=step_s)
        set_push(scene, (8.0, 24.0, 0.0), (0.12, 0.32, 0.0))
        ends.append(play(scene, 0.4, start=(0, 0, 0, -0.165, -0.33, spin)).state[-1])
    np.testing.assert_allclose(ends[0][3:5], ends[1][3:5], atol=5e-4)
    assert ends[0][5] == pytest.approx(ends[1][5], abs=1e-3)
    assert abs(ends[0][4]) > 0.3


def test_a_body_that_is_pushed_too_weakly_stops() -> None:
    """At 95 % of friction it comes to rest, and stays."""
    scene = make(CUBE)
    set_push(scene, towards(math.pi, 0.95 * 0.5 * 3 * G))
    track = play(scene, 0.5, start=(0, 0, 0, 1.0, 0, 0))
    assert np.abs(track.raw[-1, 3:]).max() < 1e-6
    assert track.state[-1, 0] == pytest.approx(1.0 / (2 * 1.95 * 0.5 * G), abs=2e-4)


def test_no_force_is_too_small_for_a_flow() -> None:
    """One that has decayed to less than can be squared leaves a body at rest where it is."""
    scene = make(CUBE, along=1.3, across=0.7, aniso_angle=0.3, normality=0.0)
    start = (1.0, 2.0, 0.3, 0.0, 0.0, 0.0)
    for size in (1e-150, 1e-200, 1e-310):
        set_push(scene, towards(1.0, size))
        # where something is not a number, MuJoCo begins anew at the origin
        np.testing.assert_allclose(play(scene, 0.1, start=start).raw[-1, :6], start, atol=1e-6)


@pytest.mark.parametrize("reference", [0.0, 1.0])
@pytest.mark.parametrize("exponent", [0.5, 1.0, 2.0])
@pytest.mark.parametrize("change", [-0.4, 0.7])
def test_stribeck(change: float, exponent: float, reference: float) -> None:
    """Coasting covers the integral of v / (mu(v) g), mu(v) = mu (1 + s (exp(-(v / v_s)^d) - r)), 0.1 %."""
    scene = make(CUBE, stribeck=change, stribeck_speed=0.4, stribeck_exponent=exponent, stribeck_reference=reference)
    track = play(scene, 2.0, start=(0, 0, 0, 2.0, 0, 0))
    far = quad(lambda v: v / (0.5 * G * (1 + change * (math.exp(-((v / 0.4) ** exponent)) - reference))), 0, 2)[0]
    assert abs(track.raw[-1, 3]) < 1e-9
    assert track.state[-1, 0] == pytest.approx(far, rel=1e-3)


@pytest.mark.parametrize("speed_m_s", [2e-3, 0.012])
def test_static_friction_is_gone_within_a_speed(speed_m_s: float) -> None:
    """A push just above kinetic friction, and below static: 0.5 % of the speed that the closed form has after 0.4 s.

    From 5 mm/s on, dt/dv = 1 / (f / m - mu g (1 + s exp(-(v / v_s)^2))).
    """
    push, excess = 1.3 * 0.5 * 3.0 * G, 0.25
    scene = make(CUBE, stiction=excess, stiction_speed=speed_m_s)
    set_push(scene, towards(0.0, push))
    track = play(scene, 0.4, start=(0, 0, 0, 5e-3, 0, 0))

    def rate(_: float, v: np.ndarray) -> np.ndarray:
        return push / 3.0 - 0.5 * G * (1 + excess * np.exp(-((v / speed_m_s) ** 2)))

    wanted = solve_ivp(rate, (0.0, 0.4), [5e-3], rtol=1e-9, atol=1e-12).y[0, -1]
    assert track.raw[-1, 3] == pytest.approx(wanted, rel=5e-3)


@pytest.mark.parametrize("exponent", [1.0, 2.0])
def test_stribeck_while_turning(exponent: float) -> None:
    """Each point of a turning base has the coefficient of its own slip: 0.2 % of the integration, by 8 x 8 points."""
    body = replace(CUBE, friction=0.3)
    scene = make(body, stribeck=0.6, stribeck_speed=0.5, stribeck_exponent=exponent)
    track = play(scene, 0.6, start=(0, 0, 0, 0.8, 0, 5.0))
    box = Box(3.0, 0.3, body.inertia[2], friction_of=lambda u, _: 0.3 * (1 + 0.6 * np.exp(-((u / 0.5) ** exponent))))
    truth = box.run(track.time_s, start=(0, 0, 0, 0.8, 0, 5.0))
    assert truth[-1, 2] > 1.8
    assert np.abs(track.state - truth)[:, 2].max() < 0.004
    assert np.abs(track.state - truth)[:, :2].max() < 0.004


def test_stiction() -> None:
    """At rest a body yields at mu (1 + s) m g; once it slides, it is held by mu m g alone."""
    limit = 0.5 * 3 * G * 1.4
    for share in (0.995, 1.005):
        scene = make(CUBE, stiction=0.4)
        set_push(scene, (share * limit, 0, 0))
        track = play(scene, 1.0)
        if share < 1:
            assert abs(track.raw[-1, 0]) < 1e-6
        else:
            slides = track.raw[:, 3] > 0.02
            accel = np.diff(track.raw[slides, 3]) / STEP_S
            np.testing.assert_allclose(accel, (share * limit) / 3 - 0.5 * G, rtol=1e-9)
    # a hard push is held back by static friction only up to some mm/s, whatever the step: 0.4 mu g for 2 mm/s of them
    scene = make(CUBE, stiction=0.4)
    set_push(scene, (2 * limit, 0, 0))
    accel = 2 * limit / 3 - 0.5 * G
    lost = 0.4 * 0.5 * G * (0.5 * np.sqrt(np.pi) * 2e-3) / accel
    assert accel * 0.5 - play(scene, 0.5).raw[-1, 3] == pytest.approx(lost, rel=0.6)
    # braking from a slide is that of mu alone, down to the last 2 mm/s
    coast = play(make(CUBE, stiction=0.4), 0.6, start=(0, 0, 0, 2.0, 0, 0))
    assert coast.state[-1, 0] == pytest.approx(4 / (2 * 0.5 * G), rel=1e-3)


@pytest.mark.parametrize("change", [-0.7, 0.9])
def test_friction_patch_on_the_floor(change: float) -> None:
    """Inside a disc friction is mu (1 + p), outside mu; across its edge the motion is that of the integration."""
    small = replace(CUBE, half_size_m=(0.1, 0.1, 0.1))
    options: dict[str, Any] = {"patch": change, "patch_x": 2.0, "patch_y": 0.0, "patch_radius": 0.6}
    for x, factor in ((2.0, 1 + change), (0.0, 1.0)):
        scene = make(small, **options)
        track = play(scene, 10 * STEP_S, start=(x, 0, 0, 1.0, 0, 0))
        assert (track.raw[0, 3] - track.raw[-1, 3]) / (10 * STEP_S) == pytest.approx(0.5 * factor * G, rel=1e-3)

    def coefficient(speed: np.ndarray, place: np.ndarray) -> np.ndarray:
        outside = (np.hypot(place[:, 0] - 2.0, place[:, 1]) - 0.6) / (0.08 * 0.6)
        return 0.5 * (1 + change / (1 + np.exp(np.minimum(outside, 500))))

    # half of the base crosses the edge of the disc, which turns the body
    start = (0.8, 0.55, 0.2, 3.0, 0.0, 0.0)
    track = play(make(CUBE, **options), 1.5, start=start)
    truth = Box(3.0, 0.5, CUBE.inertia[2], friction_of=coefficient).run(track.time_s, start=start)
    assert np.abs(truth[-1, 2]) > 0.03
    assert np.abs(track.state - truth)[:, :2].max() < 3e-3
    assert np.abs(track.state - truth)[:, 2].max() < 0.01


def test_film() -> None:
    """A film of c N s/m slows a slide by exp(-c t / m), a spin by exp(-c r^2 t / I), r^2 the base's mean square."""
    track = play(make(FRICTIONLESS, film=4.0), 1.0, start=(0, 0, 0, 2.0, -1.0, 3.0))
    slide, spin = math.exp(-4.0 / 3), math.exp(-4.0 / 6 / 0.5)
    np.testing.assert_allclose(track.raw[-1, 3:], [2 * slide, -slide, 3 * spin], rtol=1e-5)
    np.testing.assert_allclose(track.state[-1, 0], 2 * (1 - slide) * 3 / 4, rtol=1e-5)


def test_air_drag() -> None:
    """Drag c v^2 slows a slide to v0 / (1 + c v0 t / m); it leaves turning alone."""
    track = play(make(FRICTIONLESS, air_drag=2.0), 1.0, start=(0, 0, 0, 1.8, 2.4, 3.0))
    left = 1 / (1 + 2.0 * 3.0 * 1.0 / 3)
    np.testing.assert_allclose(track.raw[-1, 3:], [1.8 * left, 2.4 * left, 3.0], rtol=1e-5)
    np.testing.assert_allclose(np.hypot(*track.state[-1, :2]), 3 / 2 * math.log(1 / left), rtol=1e-5)


def test_mass_leak() -> None:
    """A body that loses the share k per second gains F / (m k) ln(1 / (1 - k t)) under F, less mu g t."""
    for friction in (0.0, 0.3):
        scene = make(replace(CUBE, friction=friction), mass_leak=0.3)
        set_push(scene, (12.0, 0, 0))
        track = play(scene, 2.0)
        want = 12 / (3 * 0.3) * math.log(1 / (1 - 0.6)) - friction * G * 2
        assert track.raw[-1, 3] == pytest.approx(want, rel=1e-5)
        assert track.out[-1, dry_friction.OUT_LOAD] == pytest.approx(3 * G * (1 - 0.3 * (2 - STEP_S / 2)), rel=1e-9)
    scene = make(FRICTIONLESS, mass_leak=0.3)
    scene.data.xfrc_applied[scene.body("b0").body_id, 5] = 1.0
    assert play(scene, 2.0).raw[-1, 5] == pytest.approx(1 / (0.5 * 0.3) * math.log(1 / 0.4), rel=1e-5)


@pytest.mark.parametrize("share", [-0.9, -0.4, 0.5, 1.0])
def test_pressure(share: float) -> None:
    """Load on the rim (or in the middle) raises (lowers) the braking torque as the integral over the base says."""

    def load(y: float, x: float) -> float:
        return 1 + share * (2 * max(x, y) ** 2 - 1)

    radius = dblquad(lambda y, x: load(y, x) * math.hypot(x, y), 0, 1, 0, lambda x: x)[0] * 2 * 0.5
    assert (radius > SQUARE_RADIUS) == (share > 0)
    track = play(make(CUBE, pressure=share), 10 * STEP_S, start=(0, 0, 0, 0, 0, 6.0))
    torque = -track.out[:, dry_friction.OUT_FORCE + 2]
    np.testing.assert_allclose(torque, 0.5 * 3 * G * radius, rtol=5e-3)


@pytest.mark.parametrize("angle_rad", [0.0, 2.0])
def test_tilted_gravity(angle_rad: float) -> None:
    """On a floor tilted by more than atan mu a body slides with g (sin - mu cos); by less, it stays.

    The load shifts downhill by the height of the CoM times the tangent, and is the normal share of the weight.
    """
    for slope in (0.4, 0.5):
        scene = make(CUBE)
        scene.model.opt.gravity[:] = towards(angle_rad, G * math.sin(slope)) - [0, 0, G * math.cos(slope)]
        track = play(scene, 1.0)
        want = max(math.sin(slope) - 0.5 * math.cos(slope), 0.0) * G
        np.testing.assert_allclose(track.raw[-1, 3:5], towards(angle_rad, want)[:2], atol=5e-5 * G)
        assert track.out[-1, dry_friction.OUT_LOAD] == pytest.approx(3 * G * math.cos(slope))
        shift = 0.5 * min(math.tan(slope), 0.5)
        cop = track.out[-1, dry_friction.OUT_COP : dry_friction.OUT_COP + 2]
        np.testing.assert_allclose(cop, towards(angle_rad, shift)[:2], atol=1e-4)


def test_joint_damping() -> None:
    """Damping of the joints slows a frictionless body by exp(-d t / m), each axis its own, also when it is stiff."""
    scene = make(FRICTIONLESS)
    scene.model.dof_damping[:] = (3.0, 6.0, 0.5)
    track = play(scene, 1.0, start=(0, 0, 0, 2.0, -1.0, 3.0))
    np.testing.assert_allclose(track.raw[-1, 3:], [2 * math.exp(-1), -math.exp(-2), 3 * math.exp(-1)], rtol=1e-4)
    scene = make(CUBE)
    scene.model.dof_damping[:] = 1e5
    set_push(scene, (30.0, 0, 0))
    track = play(scene, 1.0, start=(0, 0, 0, 2.0, 1.0, 3.0))
    np.testing.assert_allclose(track.raw[-1, 3:], [(30 - 0.5 * 3 * G) / 1e5, 0, 0], atol=1e-9)
    assert np.abs(track.raw).max() < 4.0


@pytest.mark.parametrize("push", [(0.0, 0.0), (3.0, -2.0)])
def test_free_body_with_the_mass_off_centre(push: tuple[float, float]) -> None:
    """Without friction the CoM keeps a straight line and its speed, and the spin its rate; a push at it bends neither.

    The frame, off the CoM, is swung about it: centrifugal terms and all.
    """
    body = replace(ODD, friction=0.0)
    scene = make(body)
    set_push(scene, (*push, 0.0), body.com_m)
    track = play(scene, 4.0, start=(0.2, -0.1, 0.7, 1.0, 0.4, 5.0))
    com = Box(2.0, 0.0, body.inertia[2], com_m=body.com_m).to_com(track.state)
    t, a = track.time_s, np.array(push) / 2.0
    np.testing.assert_allclose(com[:, 3:5], com[0, 3:5] + t[:, None] * a, atol=1e-4)
    np.testing.assert_allclose(com[:, :2], com[0, :2] + t[:, None] * com[0, 3:5] + 0.5 * t[:, None] ** 2 * a, atol=1e-4)
    np.testing.assert_allclose(com[:, 5], 5.0, atol=2e-4)
