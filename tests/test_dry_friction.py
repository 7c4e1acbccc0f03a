"""Compiled dry friction against closed forms, and against an independent integration (`reference.Box`)."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from drive import SQUARE_RADIUS, STEP_S, G, make, outputs, play, set_planar, set_push, twist, wait
from hypothesis import assume, given
from hypothesis import strategies as st
from reference import Box
from scipy.integrate import dblquad, quad

from runner.physics import dry_friction
from runner.physics.scene import Base, BodyConfig

CUBE = BodyConfig(mass_kg=3.0, friction=0.5)
FRICTIONLESS = replace(CUBE, friction=0.0)
# off the middle in all axes, lying box, inertia of no uniform body
ODD = BodyConfig(
    mass_kg=2.0,
    friction=0.4,
    half_size_m=(0.5, 0.4, 0.3),
    com_m=(0.1, -0.07, 0.05),
    inertia_kg_m2=(0.3, 0.35, 0.45),
)


def angles(values: tuple[float, ...] = (0.0, math.pi / 4, 1.1)) -> pytest.MarkDecorator:
    return pytest.mark.parametrize("angle_rad", values)


def towards(angle_rad: float, size: float = 1.0) -> np.ndarray:
    return size * np.array([math.cos(angle_rad), math.sin(angle_rad), 0.0])


# The whole set of equations


@st.composite
def situations(draw: st.DrawFn) -> tuple[BodyConfig, dict[str, Any], np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A body, its friction, gravity, a motion, and a push, with every option somewhere."""

    def number(low: float, high: float) -> float:
        return low + (high - low) * draw(st.integers(0, 1000)) / 1000

    half = np.array([number(0.2, 0.6), number(0.2, 0.6), number(0.1, 0.4)])
    inertia = np.array([number(0.5, 1.5) for _ in range(3)]) + 1.0
    mass = number(0.3, 10)
    body = BodyConfig(
        mass_kg=mass,
        friction=number(0.05, 1.0),
        half_size_m=tuple(half),
        com_m=tuple(half * [number(-0.25, 0.25), number(-0.25, 0.25), number(-0.5, 0.5)]),
        inertia_kg_m2=tuple(mass * 0.1 * inertia),
        base=draw(st.sampled_from(Base)),
    )
    record: dict[str, Any] = {}
    if draw(st.booleans()):
        record |= {"along": number(0.5, 1.5), "across": number(0.5, 1.5), "aniso_angle": number(-3, 3)}
        record |= {"normality": number(0.0, 1.0)}
    if draw(st.booleans()):
        record |= {"stribeck": number(-0.5, 1.0), "stribeck_speed": number(0.2, 1.0)}
    if draw(st.booleans()):
        record |= {"patch": number(-0.9, 1.0), "patch_x": number(-1, 1), "patch_y": number(-1, 1)}
    if draw(st.booleans()):
        record |= {"film": number(0.0, 10.0), "air_drag": number(0.0, 5.0), "mass_leak": number(0.0, 0.5)}
    if draw(st.booleans()) and body.base is Base.even:
        record |= {"pressure": number(-0.9, 0.9)}
    tilt = np.array([number(-0.5, 0.5), number(-0.5, 0.5), -G])
    velocity = towards(number(-3.2, 3.2), number(0.5, 3.0))
    state = np.array([number(-1, 1), number(-1, 1), number(-4, 4), velocity[0], velocity[1], number(-4, 4)])
    force = towards(number(-3.2, 3.2), number(0, 1.5) * body.friction * mass * G)
    force[2] = number(-0.3, 0.3) * mass * G
    point = half * [number(-1, 1), number(-1, 1), number(-1, 1)]
    return body, record, tilt, state, force, point


@given(situations())
def test_friction_agrees_with_independent_equations(
    case: tuple[BodyConfig, dict[str, Any], np.ndarray, np.ndarray, np.ndarray, np.ndarray],
) -> None:
    """In a vanishing step, acceleration, friction and load are those of equations written about the CoM."""
    body, record, gravity, state, force, point = case
    scene = make(body, **record)
    scene.model.opt.timestep = h = 1e-7
    scene.model.opt.gravity[:] = gravity
    set_planar(scene, state)
    scene.data.time = t = 0.3
    set_push(scene, force, point)
    before = twist(scene)
    wait(scene, STEP_S)  # one step
    got = (twist(scene) - before)[[0, 1, 5]] / h
    out = outputs(scene)
    cop = out[dry_friction.OUT_COP : dry_friction.OUT_COP + 2]
    assume(np.all(np.abs(cop) < 0.8 * np.array(body.half_size_m[:2])))  # or it would tip

    view = scene.friction("b0")
    numbers = scene.model.body_user[scene.body("b0").body_id][dry_friction.STRIDE :]
    points = numbers[: int(view["points"]) * dry_friction.POINT_STRIDE].reshape(-1, dry_friction.POINT_STRIDE)

    def coefficient(speed: np.ndarray, place: np.ndarray) -> np.ndarray:
        near = np.hypot(place[:, 0] - view["patch_x"], place[:, 1] - view["patch_y"]) - view["patch_radius"]
        inside = 1 / (1 + np.exp(np.clip(near / (0.08 * view["patch_radius"]), -700, 700)))
        falls = np.exp(-((speed / view["stribeck_speed"]) ** 2))
        return body.friction * (1 + view["stribeck"] * falls) * (1 + view["patch"] * inside)

    box = Box(
        mass_kg=body.mass_kg,
        friction=body.friction,
        inertia_kg_m2=body.inertia[2],
        half_size_m=body.half_size_m,
        com_m=body.com_m,
        gravity_m_s2=(gravity[0], gravity[1], gravity[2]),
        points=points[:, :2],
        areas=points[:, 2],
        pressure=1 + view["pressure"] * points[:, 3],
        slip_eps_m_s=dry_friction.SLIP_EPS,
        friction_of=coefficient,
        axes=(view["along"], view["across"]),
        axis_rad=view["aniso_angle"],
        normality=view["normality"],
        film_n_s_m=view["film"],
        air_n_s2_m2=view["air_drag"],
        leak_per_s=view["mass_leak"],
    )
    loads = box.loads(t, box.to_com(state[None])[0], lambda _: (force, point))
    # the geometric centre's acceleration: that of the CoM, and of turning about it
    left = 1 - view["mass_leak"] * t
    turning = loads.torque_nm / (body.inertia[2] * left)
    c, s = np.cos(state[2]), np.sin(state[2])
    lx, ly = c * body.com_m[0] - s * body.com_m[1], s * body.com_m[0] + c * body.com_m[1]
    linear = loads.force_n / (body.mass_kg * left) + turning * np.array([ly, -lx]) + state[5] ** 2 * np.array([lx, ly])
    np.testing.assert_allclose(got, [*linear, turning], atol=1e-5 * (G + np.abs(got).max()))
    np.testing.assert_allclose(
        out[dry_friction.OUT_FORCE : dry_friction.OUT_FORCE + 2], loads.friction_n, atol=1e-5 * loads.carried_n
    )
    assert out[dry_friction.OUT_LOAD] == pytest.approx(loads.carried_n, rel=1e-6)
    np.testing.assert_allclose([c * cop[0] - s * cop[1], s * cop[0] + c * cop[1]], loads.centre_m, atol=1e-5)


# Straight motion


def test_coasting_stops_where_coulomb_says() -> None:
    """Coasting covers v0^2 / (2 mu g), 0.01 %; the engine's own positions lack v0 dt / 2 of it, known exactly.

    So qpos is within 0.5 % for v0 > 200 mu g dt: 2.04 m/s at mu 0.5 and 1/480 s, 1.23 m/s at mu 0.3.
    """
    for speed in (0.5, 2.0, 2.1, 5.0):
        track = play(make(CUBE), speed / (0.5 * G) + 0.1, start=(0, 0, 0, speed, 0, 0))
        far = speed**2 / (2 * 0.5 * G)
        assert track.state[-1, 0] == pytest.approx(far, rel=1e-4)
        covered = track.raw[-1, 0] - track.raw[0, 0]
        assert covered == pytest.approx(far - speed * STEP_S / 2, rel=1e-4)
        assert (abs(covered / far - 1) < 0.005) == (speed > 2.05)
        assert np.abs(track.raw[-1, 3:]).max() < 1e-12


@angles()
@pytest.mark.parametrize("body", [CUBE, replace(CUBE, base=Base.corners), ODD])
def test_stick_threshold(angle_rad: float, body: BodyConfig) -> None:
    """At 90 % of the threshold the body creeps by less than 1 um/s, at 99.9 % it stays, at 100.1 % it goes.

    The force acts on the CoM, level with it; at 100.1 % it accelerates by exactly what is left.
    """
    limit = body.friction * body.mass_kg * G
    for share in (0.9, 0.999):
        scene = make(body)
        set_push(scene, towards(angle_rad, share * limit), body.com_m)
        start = play(scene, 1.0).raw[-1]
        end = play(scene, 2.0, start=start).raw[-1]
        creep = np.abs((end - start)[:3]).max() / 2
        assert creep < (1e-6 if share == 0.9 else 5e-6)
    scene = make(body)
    set_push(scene, towards(angle_rad, 1.001 * limit), body.com_m)
    speed = np.hypot(*play(scene, 1.0).raw[-1, 3:5])
    assert speed == pytest.approx(0.001 * body.friction * G, rel=0.01)


def test_creep_under_a_twist() -> None:
    """At 90 % of the torque that turns it, a cube creeps by less than 1 urad/s."""
    scene = make(CUBE)
    torque = 0.9 * 0.5 * 3 * G * SQUARE_RADIUS
    scene.data.xfrc_applied[scene.body("b0").body_id, 5] = torque
    start = play(scene, 1.0).raw[-1]
    end = play(scene, 2.0, start=start).raw[-1]
    assert abs(end - start)[2] / 2 < 1e-6


# Turning


@pytest.mark.parametrize(("grid", "square", "oblong"), [(6, 0.003, 0.006), (8, 0.0013, 0.003), (12, 5e-4, 1e-3)])
@pytest.mark.parametrize("half", [(0.5, 0.5, 0.5), (0.5, 0.2, 0.1)])
def test_spin_down_of_a_patch(grid: int, square: float, oblong: float, half: tuple[float, float, float]) -> None:
    """A turning body stops after the angle I w0^2 / (2 mu m g r), r the mean radius of its base, and when it should.

    0.5 % is met from 8 x 8 points on, for a square base from 6 x 6.
    """
    tolerance = square if half[0] == half[1] else oblong
    body = BodyConfig(mass_kg=2.0, friction=0.3, half_size_m=half)
    radius = dblquad(lambda y, x: np.hypot(x, y), 0, half[0], 0, half[1])[0] / (half[0] * half[1])
    braking = 0.3 * 2.0 * G * radius / body.inertia[2]
    track = play(make(body, grid=grid), 6 / braking * 1.05 + 0.05, start=(0, 0, 0, 0, 0, 6.0))
    assert track.state[-1, 2] == pytest.approx(6**2 / (2 * braking), rel=tolerance)
    assert np.flatnonzero(track.raw[:, 5] < 1e-6)[0] * STEP_S == pytest.approx(6 / braking, rel=tolerance, abs=STEP_S)
    assert np.abs(track.raw[:, [0, 1, 3, 4]]).max() < 1e-12


def test_spin_down_on_corners() -> None:
    """Carried by its corners, a cube acts at the radius sqrt(2) half: exact to 0.01 %."""
    body = replace(CUBE, base=Base.corners)
    braking = 0.5 * 3 * G * math.sqrt(0.5) / body.inertia[2]
    track = play(make(body), 6 / braking + 0.05, start=(0, 0, 0, 0, 0, 6.0))
    assert track.state[-1, 2] == pytest.approx(6**2 / (2 * braking), rel=1e-4)


# Slide and spin


def weave(t_s: float) -> tuple[np.ndarray, np.ndarray]:
    """A push that turns once in 4 s, swells and ebbs, at a point of the body that moves about; rests at both ends."""
    if not 1.0 <= t_s < 19.0:
        return np.zeros(3), np.zeros(3)
    phase = 0.5 * math.pi * t_s
    return towards(phase, 22 * (0.6 + 0.4 * math.sin(3 * phase))), np.array([0, 0.25 * math.sin(1.7 * phase), -0.2])


@pytest.mark.parametrize(
    "body",
    [CUBE, BodyConfig(3.0, 0.5, com_m=(0.08, -0.05, 0.05), inertia_kg_m2=(0.4, 0.5, 0.62))],
    ids=["cube", "off-centre"],
)
def test_episode_of_slide_and_spin(body: BodyConfig) -> None:
    """Over 20 s and 13 or 17 m of sliding, spinning, stick and slip with load transfer: 3 mm and 0.6 degrees rms."""
    track = play(make(body), 20.0, weave)
    ticks = track.time_s[:: round(1 / 60 / STEP_S)]
    box = Box(body.mass_kg, body.friction, body.inertia[2], com_m=body.com_m)
    truth = box.run(ticks, weave, breaks_s=(1.0, 19.0))
    path = np.hypot(*np.diff(truth[:, :2], axis=0).T).sum()
    assert path > 12
    # as the engine has it, and with the lead of its positions taken off
    for states, far, turned in ((track.raw, 0.003, 0.6), (track.state, 0.0015, 0.2)):
        error = states[:: round(1 / 60 / STEP_S)] - truth
        assert np.sqrt(np.mean(error[:, 0] ** 2 + error[:, 1] ** 2)) < far
        assert np.degrees(np.sqrt(np.mean(error[:, 2] ** 2))) < turned


@pytest.mark.parametrize("body", [CUBE, ODD])
def test_steps_are_of_second_order(body: BodyConfig) -> None:
    """While a body slides and spins, halving the step divides the error by four or more."""
    push = lambda t: (towards(1 + 3 * t, 8.0), np.array([0.2, 0.1, -0.1]))  # noqa: E731
    start = (0, 0, 0.3, 2.0, -1.0, 4.0)
    ends = [play(make(body, timestep_s=1 / n), 0.5, push, start).state[-1] for n in (60, 120, 240, 1920)]
    errors = [np.abs(end - ends[-1]).max() for end in ends[:3]]
    assert errors[0] < 2e-3
    assert errors[1] < errors[0] / 3
    assert errors[2] < errors[1] / 3


@pytest.mark.parametrize("body", [CUBE, ODD])
def test_halving_the_step_changes_little(body: BodyConfig) -> None:
    """Over 6 s with stops and starts, halving the default step moves the end by less than 0.2 mm and 0.02 degrees."""
    ends = [play(make(body, timestep_s=h), 6.0, weave, (0, 0, 0, 1.0, 0, 3.0)).state[-1] for h in (STEP_S, STEP_S / 2)]
    change = np.abs(ends[0] - ends[1])
    assert change[:2].max() < 2e-4
    assert math.degrees(change[2]) < 0.02


@pytest.mark.parametrize("body", [CUBE, replace(CUBE, base=Base.corners), ODD])
def test_friction_work_is_the_energy_lost(body: BodyConfig) -> None:
    """From any start to rest, the friction's work is the kinetic energy lost, 0.5 %."""
    start = np.array([0, 0, 0.4, 1.5, -0.8, 5.0])
    track = play(make(body), 1.5, start=start)
    com = Box(body.mass_kg, 0, body.inertia[2], com_m=body.com_m).to_com(start[None])[0]
    energy = 0.5 * body.mass_kg * (com[3] ** 2 + com[4] ** 2) + 0.5 * body.inertia[2] * com[5] ** 2
    assert np.abs(track.raw[-1, 3:]).max() < 1e-12
    assert -track.out[:, dry_friction.OUT_POWER].sum() * STEP_S == pytest.approx(energy, rel=1e-3)


# The load over the base


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


# Options of friction


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


@pytest.mark.parametrize("change", [-0.4, 0.8])
def test_stribeck(change: float) -> None:
    """Coasting covers the integral of v / (mu(v) g), mu(v) = mu (1 + s exp(-(v / v_s)^2)), 0.1 %."""
    scene = make(CUBE, stribeck=change, stribeck_speed=0.4)
    track = play(scene, 0.9, start=(0, 0, 0, 2.0, 0, 0))
    far = quad(lambda v: v / (0.5 * G * (1 + change * math.exp(-((v / 0.4) ** 2)))), 0, 2)[0]
    assert abs(track.raw[-1, 3]) < 1e-9
    assert track.state[-1, 0] == pytest.approx(far, rel=1e-3)


def test_stribeck_while_turning() -> None:
    """Each point of a turning base has the coefficient of its own slip: 0.2 % of the integration, by 8 x 8 points."""
    body = replace(CUBE, friction=0.3)
    track = play(make(body, stribeck=0.6, stribeck_speed=0.5), 0.6, start=(0, 0, 0, 0.8, 0, 5.0))
    box = Box(3.0, 0.3, body.inertia[2], friction_of=lambda u, _: 0.3 * (1 + 0.6 * np.exp(-((u / 0.5) ** 2))))
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


# Its place in the model


def test_neutral_record_leaves_the_bits_alone() -> None:
    """Each option at its neutral value gives the same bits, whatever its other parameters are."""
    plain = play(make(CUBE), 1.0, weave, (0, 0, 0, 1, 0, 2)).raw
    off: dict[str, Any] = {
        "aniso_angle": 0.7,
        "stribeck_speed": 0.3,
        "stiction_speed": 0.01,
        "patch_x": 1.0,
        "patch_radius": 0.2,
    }
    np.testing.assert_array_equal(play(make(CUBE, **off), 1.0, weave, (0, 0, 0, 1, 0, 2)).raw, plain)


def test_record_is_read_and_written_by_name() -> None:
    """The record of a compiled body holds the body's friction and base; a name that it lacks is refused."""
    view = make(ODD).friction("b0")
    assert [view[n] for n in ("mu", "base_z", "half_x", "half_y", "points")] == [0.4, -0.3, 0.5, 0.4, 64]
    view["film"] = 2.5
    assert view["film"] == 2.5
    with pytest.raises(KeyError, match="frction"):
        view["frction"] = 1.0


@given(st.floats(0.01, 5), st.floats(0.01, 5), st.integers(2, 16))
def test_base_points_have_the_moments_of_the_base(half_x: float, half_y: float, n: int) -> None:
    """Weights sum to 1, first moments vanish, second moments are those of the rectangle; pressures have mean 0."""
    x, y, w, shape = dry_friction.base_points(half_x, half_y, n).T
    assert w.sum() == pytest.approx(1)
    np.testing.assert_allclose([w @ x, w @ y, w @ (x * y), w @ shape], 0, atol=1e-12)
    np.testing.assert_allclose([w @ x**2, w @ y**2], [half_x**2 / 3, half_y**2 / 3])
