"""A pin on a recorded path pushes a plate: against closed forms, the least power, and another integrator."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.path import Path as MatplotlibPath
from reference import Box
from scipy.integrate import solve_ivp
from scipy.optimize import minimize_scalar
from test_outline import BENT, DISC, HEX, WEDGE, G, around, fine

from runner.effects.planar_box import ActuatorDelay, ObservationDelay, PinFriction, PinOffset, PressureShape
from runner.numerics.polygon import Polygon
from runner.physics import dry_friction
from runner.physics.dry_friction.pin import nearest_on_outline
from runner.recording import BelievedPin, Episode, Form, Nominal, Recording, Support, read_case, write_case
from runner.systems.planar_box.simulator import Simulator
from runner.systems.planar_box.system import PlanarBox
from runner.systems.simulator import Run

RATE_HZ, MASS_KG, FRICTION, RADIUS_M = 250.0, 0.9, 0.25, 0.005


def plate(outline: Polygon | None, half_size_m: tuple[float, float, float], grip: float, **rest) -> Nominal:
    return Nominal(half_size_m, MASS_KG, FRICTION, G, RATE_HZ, outline=outline, pin=BelievedPin(RADIUS_M, grip), **rest)


def case(nominal: Nominal, path: np.ndarray, force_n: float = np.nan) -> Recording:
    nothing = np.zeros((len(path), 3))
    episode = Episode(0, np.arange(len(path)) / RATE_HZ, nothing, nothing, nothing + force_n, nothing, path)
    return Recording(Path("made"), Form.PLANAR, nominal, (episode,))


def moved(nominal: Nominal, path: np.ndarray, effects=(), step_rate_hz: float | None = None) -> np.ndarray:
    """Return the motion (T, 6) of a body that begins at rest at the origin."""
    simulator = Simulator(case(nominal, path), step_rate_hz=step_rate_hz, threads=1)
    return simulator.predict(0, [Run(effects, np.zeros(6))])[0]


def line(start: tuple[float, float], velocity: tuple[float, float], lasts_s: float, rest_s: float = 0.0) -> np.ndarray:
    """Return a path at even speed that ends in a rest, (T, 2)."""
    t = np.arange(round((lasts_s + rest_s) * RATE_HZ) + 1) / RATE_HZ
    return np.array(start) + np.minimum(t, lasts_s)[:, None] * velocity


def pin_force(nominal: Nominal, path: np.ndarray) -> np.ndarray:
    """Return the force of the pin on the body at samples, (T, 2), N."""
    return Simulator(case(nominal, path, 0.0), threads=1).predict(0, [Run((), np.zeros(6))])[0][:, 6:]


def test_a_disc_pushed_through_its_centre_stays_on_the_line() -> None:
    """It goes as fast as the pin, whose force is that of friction, and stays where it is once the pin has stopped."""
    speed, grip = 0.05, 0.3
    nominal = plate(DISC, (0.05, 0.05, 0.0065), grip)
    angle = math.radians(23)  # through a corner: the polygon is the same to either side
    ahead = np.array([math.cos(angle), math.sin(angle)])
    path = line(tuple(-ahead * (0.05 + RADIUS_M + 0.001)), tuple(speed * ahead), 1.0, 0.2)
    motion = moved(nominal, path)
    across = motion[:, 0] * -ahead[1] + motion[:, 1] * ahead[0]
    np.testing.assert_allclose(across, 0, atol=2e-5)  # a disc of 360 corners
    np.testing.assert_allclose(motion[:, 2], 0, atol=1e-3)
    pushed = slice(50, 240)
    np.testing.assert_allclose(motion[pushed, 3:5], np.tile(speed * ahead, (190, 1)), atol=1e-3 * speed)
    force = pin_force(nominal, path)[50:235]
    np.testing.assert_allclose(force, np.tile(FRICTION * MASS_KG * G * ahead, (185, 1)), rtol=1e-3, atol=5e-3)
    # it coasts by v^2 / (2 mu g) after the pin has stopped
    coasts = float(motion[-1, :2] @ ahead - (path[-1] @ ahead + 0.05 + RADIUS_M))
    assert coasts == pytest.approx(speed**2 / (2 * FRICTION * G), rel=0.05)
    assert np.abs(motion[-1, 3:]).max() < 1e-5


@pytest.mark.parametrize("share", [0.2, 0.6, 0.95])
def test_a_rod_on_two_feet_turns_about_the_far_one(share: float) -> None:
    """Pushed across at a distance a from its middle by a smooth pin: the force is mu m g L / (L + a)."""
    far, speed = 0.1, 0.01
    nominal = plate(None, (far, 1e-4, 1e-4), 0.0, contact=Support.CORNERS, inertia_kg_m2=MASS_KG * far**2)
    at = share * far
    path = line((at, 1e-4 + RADIUS_M), (0.0, -speed), 0.5)
    motion = moved(nominal, path)
    rate = -speed / (far + at)
    np.testing.assert_allclose(motion[25:, 5], rate, rtol=0.01)
    turn = motion[-1, 2]
    foot = motion[-1, :2] - far * np.array([math.cos(turn), math.sin(turn)])
    np.testing.assert_allclose(foot, [-far, 0], atol=2e-4)
    force = pin_force(nominal, path)
    assert force[60, 1] == pytest.approx(-FRICTION * MASS_KG * G * far / (far + at), rel=0.01)


@pytest.mark.parametrize("shape", [None, (0.8, 0.0, -0.9), (-0.5, 1.2, 0.3)], ids=["even", "two ends", "aslant"])
@pytest.mark.parametrize("outline", [HEX, BENT, WEDGE], ids=["hex", "bent", "wedge"])
def test_a_sticking_pin_moves_a_slider_by_the_least_power(
    outline: Polygon, shape: tuple[float, float, float] | None
) -> None:
    """Slowly pushed at a point that sticks, a body turns at the rate at which friction takes the least power.

    Peshkin and Sanderson, "Minimization of energy in quasi-static manipulation", IEEE Trans. Robotics and Automation 5,
    1989. The base is a fine grid there, and the first moments of a push are compared, before the body has turned. A
    load that is spread otherwise is tilted so that its centre is below that of the mass, as on the floor.
    """
    low, _ = outline.bounds_m
    near = outline.corners[np.argsort(outline.corners[:, 1])[:2]]  # the lowest side, which is level
    x = float(0.35 * near[:, 0].max() + 0.65 * near[:, 0].min())
    velocity = np.array([0.001, 0.008])
    nominal = plate(outline, around(outline, 1e-4), 3.0)
    effects = () if shape is None else (PressureShape(*shape),)
    motion = moved(nominal, line((x, float(low[1]) - RADIUS_M), tuple(velocity), 0.2), effects)
    places, touched = fine(outline), np.array([x, low[1]])
    load = np.ones(len(places))
    if shape is not None:
        p, q = places.T / math.sqrt(np.mean(np.sum(places**2, axis=1)))
        load = np.exp(shape[0] * p**2 + shape[1] * p * q + shape[2] * q**2)
        design = np.column_stack([np.ones(len(places)), places])
        load *= design @ np.linalg.solve(design.T @ (load[:, None] * design), [1.0, 0.0, 0.0])
    assert load.min() > 0

    def power(rate: float) -> float:
        off = places - touched
        return float(np.average(np.hypot(velocity[0] - rate * off[:, 1], velocity[1] + rate * off[:, 0]), weights=load))

    found: Any = minimize_scalar(power, bracket=(-0.2, 0.0, 0.2), tol=1e-10)
    best = found.x
    assert motion[10, 5] == pytest.approx(best, rel=0.02, abs=1e-3)
    assert abs(best) > 0.005


def test_a_push_along_a_line_through_the_centre_of_mass_does_not_turn() -> None:
    """A smooth pin on the level side of a wedge, below its centre of mass."""
    low, _ = WEDGE.bounds_m
    x, _ = WEDGE.centroid_m
    nominal = plate(WEDGE, around(WEDGE, 0.0065), 0.0)
    motion = moved(nominal, line((float(x), float(low[1]) - RADIUS_M - 1e-3), (0.0, 0.05), 0.6))
    assert motion[-1, 1] == pytest.approx(0.05 * 0.6 - 1e-3, abs=5e-5)
    np.testing.assert_allclose(motion[:, 2], 0, atol=3e-3)


def nearest(corners: np.ndarray, place: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Return distance, nearest point and normal of a place outside of a polygon."""
    start, way = corners, np.roll(corners, -1, axis=0) - corners
    part = np.clip(((place - start) * way).sum(axis=1) / (way**2).sum(axis=1), 0, 1)
    points = start + part[:, None] * way
    far = np.linalg.norm(place - points, axis=1)
    k = int(np.argmin(far))
    return far[k], points[k], (place - points[k]) / far[k]


def test_a_pin_that_touches_low_leaves_the_load_where_it_is() -> None:
    """Pushed at the base a box moves as a flat plate does, as friction has no lever; an effect says the same."""
    high, flat, start = (0.08, 0.055, 0.035), (0.08, 0.055, 1e-4), (0.012, -0.055 - RADIUS_M - 0.001)
    path = line(start, (0.0, 0.03), 1.5)
    inertia = MASS_KG * (high[0] ** 2 + high[1] ** 2) / 3
    low = replace(plate(None, high, 0.3, inertia_kg_m2=inertia), pin=BelievedPin(RADIUS_M, 0.3, -high[2]))
    plain = moved(plate(None, flat, 0.3, inertia_kg_m2=inertia), path)[-1, :3]
    at_centre = plate(None, high, 0.3, inertia_kg_m2=inertia)
    np.testing.assert_allclose(moved(low, path)[-1, :3], plain, atol=2e-3 * abs(plain[2]))
    assert abs(moved(at_centre, path)[-1, 2] / plain[2] - 1.0) > 0.1
    lower = (PinOffset(0.0, 0.0, -high[2]),)
    np.testing.assert_allclose(moved(at_centre, path, lower), moved(low, path), atol=1e-12)


@pytest.mark.parametrize("count", [3, 15, 16, 17, 333, 720])
def test_nearest_side_of_an_outline_however_many_there_are(count: int) -> None:
    draw = np.random.default_rng(count)
    angle = np.sort(draw.uniform(0.0, 2 * np.pi, count))
    corners = draw.uniform(0.3, 1.0, count)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    numbers = dry_friction.pack(dry_friction.FrictionRecord(), np.empty((0, dry_friction.POINT_STRIDE)), corners)
    assert len(numbers) == dry_friction.size_of(0, count)
    for place in draw.uniform(-1.3, 1.3, (200, 2)):
        far, _, _ = nearest(corners, place)
        found, x, y = nearest_on_outline(numbers, dry_friction.STRIDE, count, *place)
        assert found == pytest.approx(-far if MatplotlibPath(corners).contains_point(place) else far, abs=1e-12)
        assert np.hypot(x - place[0], y - place[1]) == pytest.approx(far, abs=1e-12)


@pytest.mark.parametrize(
    ("outline", "grip", "slant", "half_z_m", "height_m"),
    [
        pytest.param(HEX, 0.15, 0.5, 0.0065, 0.0, id="hex slides"),
        pytest.param(HEX, 0.6, 0.2, 0.0065, 0.0, id="hex sticks"),
        pytest.param(DISC, 0.15, 0.5, 0.0065, 0.0, id="disc slides"),
        pytest.param(DISC, 0.6, 0.2, 0.0065, 0.0, id="disc sticks"),
        pytest.param(HEX, 0.6, 0.2, 0.03, -0.03, id="pushed at the base"),
        pytest.param(HEX, 0.15, 0.5, 0.03, 0.02, id="pushed high up"),
    ],
)
def test_motion_agrees_with_another_integrator(
    outline: Polygon, grip: float, slant: float, half_z_m: float, height_m: float
) -> None:
    """LSODA on the equations with the spring and damper of the contact: the same to 0.1 mm and 0.2 degrees."""
    half = around(outline, half_z_m)
    nominal = plate(outline, half, grip)
    nominal = replace(nominal, pin=BelievedPin(RADIUS_M, grip, height_m))
    low, _ = outline.bounds_m
    speed = 0.05 * np.array([math.sin(slant), math.cos(slant)])
    start = np.array([0.012, low[1] - RADIUS_M - 0.004])
    path = line(tuple(start), tuple(speed), 0.6)
    recording = case(nominal, path)
    simulator = Simulator(recording, threads=1)
    view = dry_friction.FrictionView(simulator.model(()), 1)
    stiffness, damping = view["pin_stiffness"], view["pin_damping"]
    box = Box(MASS_KG, FRICTION, nominal.yaw_inertia_kg_m2, half, points=fine(outline, 40), slip_eps_m_s=1e-4)

    def rate(t_s: float, state: np.ndarray) -> np.ndarray:
        c, s = math.cos(state[2]), math.sin(state[2])
        turn = np.array([[c, -s], [s, c]])
        far, point, normal = nearest(outline.corners, turn.T @ (start + t_s * speed - state[:2]))
        arm, normal = turn @ point, turn @ normal
        opens = speed - state[3:5] - state[5] * np.array([-arm[1], arm[0]])
        push = max(-stiffness * (far - RADIUS_M) - damping * float(opens @ normal), 0.0)
        slip = opens - (opens @ normal) * normal
        force = -push * normal + grip * push * slip / math.hypot(1e-4, *slip)
        loads = box.loads(t_s, state, lambda _: (np.array([*force, 0.0]), np.array([*point, height_m])))
        return np.array([*state[3:], *(loads.force_n / MASS_KG), loads.torque_nm / nominal.yaw_inertia_kg_m2])

    answer = solve_ivp(rate, (0, 0.6), np.zeros(6), "LSODA", rtol=1e-5, atol=1e-7, max_step=5e-3)
    found = simulator.predict(0, [Run((), np.zeros(6))])[0][-1]
    assert np.hypot(*answer.y[:2, -1]) > 0.005
    assert abs(answer.y[2, -1]) > 0.05
    np.testing.assert_allclose(found[:2], answer.y[:2, -1], atol=1e-4)
    assert found[2] == pytest.approx(answer.y[2, -1], abs=math.radians(0.2))


def test_finer_steps_lead_to_the_same_place() -> None:
    """The usual steps are within a tenth of a millimetre and of a degree of steps of a tenth of that."""
    nominal = plate(HEX, around(HEX, 0.0065), 0.25)
    path = line((0.02, float(HEX.bounds_m[0][1]) - RADIUS_M - 0.002), (0.02, 0.08), 0.6, 0.2)
    usual, fine_ = (moved(nominal, path, step_rate_hz=hz)[-1] for hz in (None, 10_000.0))
    np.testing.assert_allclose(usual[:2], fine_[:2], atol=1e-4)
    assert usual[2] == pytest.approx(fine_[2], abs=math.radians(0.1))


def test_a_pin_that_is_found_inside_pushes_out_gently() -> None:
    """Places that overlap by a millimetre do not fling the body away."""
    nominal = plate(HEX, around(HEX, 0.0065), 0.25)
    path = line((0.0, float(HEX.bounds_m[0][1]) - RADIUS_M + 1e-3), (0.0, 0.0), 0.5)
    motion = moved(nominal, path)
    assert motion[-1, 1] == pytest.approx(1e-3, abs=1e-4)
    assert np.linalg.norm(motion[:, 3:5], axis=1).max() < 0.015


def test_an_offset_and_a_delay_move_the_path() -> None:
    """A pin that is elsewhere, or comes later, moves the body as its path there, or then, does."""
    nominal = plate(HEX, around(HEX, 0.0065), 0.25)
    path = line((0.01, float(HEX.bounds_m[0][1]) - RADIUS_M - 0.002), (0.0, 0.05), 0.6)
    np.testing.assert_allclose(
        moved(nominal, path, (PinOffset(2e-3, -1e-3),)), moved(nominal, path + np.array([2e-3, -1e-3])), atol=1e-9
    )
    late = np.vstack([np.tile(path[:1], (10, 1)), path[:-10]])
    for effect in (ActuatorDelay, ObservationDelay):
        np.testing.assert_allclose(moved(nominal, path, (effect(0.04),)), moved(nominal, late), atol=1e-9)
    other = plate(HEX, around(HEX, 0.0065), 0.5)
    np.testing.assert_allclose(moved(nominal, path, (PinFriction(0.5),)), moved(other, path), atol=1e-12)


def test_the_vocabulary_is_that_of_what_pushes() -> None:
    """Effects of a commanded force belong to forces, those of a pin to pins."""
    path = line((0.0, -0.1), (0.0, 0.05), 0.6)
    by_pin = PlanarBox(case(plate(HEX, around(HEX, 0.0065), 0.25), path))
    names = set(by_pin.vocabulary.by_name)
    assert {"friction[pin]", "friction", "application_point_offset", "contact_pressure", "actuator_delay"} <= names
    assert not names & {"actuator_gain", "actuator_lag", "actuator_saturation", "force_misalignment", "unknown"}
    assert [b.name for b in by_pin.drawn()] == ["object", "pin"]
    found, planned, start = by_pin.proposals()
    assert found
    motions = [planned.simulator(threads=1).predict(i, [Run((), start)])[0] for i in range(len(found))]
    assert all(np.hypot(*(m[-1, :2] - start[:2])) > 0.001 for m in motions)


def test_a_body_rests_before_its_pin_moves_and_some_time_after() -> None:
    """What is measured then is noise; between, and just after the pin has stopped, it is not."""
    lead = np.tile([0.0, -0.1], (50, 1))
    path = np.vstack([lead, line((0.0, -0.1), (0.0, 0.05), 0.6, 0.5)])
    system = PlanarBox(case(plate(HEX, around(HEX, 0.0065), 0.25), path))
    (_, before), (_, after) = system.rests()
    assert (before.start, after.stop) == (0, len(path))
    assert 50 <= before.stop <= 53
    assert after.start == pytest.approx(50 + (0.6 + 0.2) * RATE_HZ, abs=2)
    still = PlanarBox(case(plate(HEX, around(HEX, 0.0065), 0.25), np.tile([0.0, -0.1], (50, 1))))
    assert still.rests()[0] == (0, slice(0, 50))


@pytest.mark.parametrize("outline", [None, Polygon.ellipse(0.05, 0.05)])
def test_a_pin_that_is_in_the_body_or_far_off_is_noted(tmp_path: Path, outline: Polygon | None) -> None:
    """A pin touches what it pushes: with the tip's place off by 2 cm either way, or a wrong radius, a line says so."""
    nominal = plate(None, (0.05, 0.05, 0.02), 0.3)
    path = line((-0.056, 0.0), (0.05, 0.0), 1.0)
    pushed = moved(nominal, path)
    nominal = replace(nominal, outline=outline)

    def notes(shift_m: float, radius_m: float = RADIUS_M) -> tuple[str, ...]:
        made = case(replace(nominal, pin=BelievedPin(radius_m, 0.3)), path + np.array([shift_m, 0.0]))
        episode = replace(made.episodes[0], pose=pushed[:, :3], twist=pushed[:, 3:])
        write_case(replace(made, episodes=(episode,)), tmp_path / "case")
        return read_case(tmp_path / "case").notes

    assert notes(0.0) == ()
    (inside,) = notes(0.02)
    assert inside.startswith("warning: where the pin touches the body as believed it is 20 mm inside it by the median")
    (off,) = notes(-0.02)
    assert off.startswith("warning: the pin pushes nothing: it stays 20 mm or more off the body as believed.")
    (large,) = notes(0.0, 0.02)
    assert "15 mm inside it by the median, most at data row" in large
