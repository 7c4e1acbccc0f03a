"""The second physics obeys closed forms: sliding, coasting, spinning, load transfer, and each effect by itself."""

from __future__ import annotations

import ast
import math
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from runner.blind.planar_box import physics
from runner.blind.planar_box.physics import IntegrationError, PlannedEpisode, World, base_load, carried_out, simulate
from runner.errors import ConfigError

G = 9.81
BOX = World(half_size=(0.4, 0.4, 0.4), mass=2.5, friction=0.3)
SLICK = replace(BOX, friction=0.0)
WEIGHT = BOX.mass * G


def episode(
    *,
    force: tuple[float, float] = (0.0, 0.0),
    point: tuple[float, float, float] = (0.0, 0.0, 0.0),
    start: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    duration_s: float = 2.0,
    until_s: float = math.inf,
    rate_hz: float = 100.0,
    elapsed_s: float = 0.0,
    number: int = 0,
) -> PlannedEpisode:
    n = round(duration_s * rate_hz) + 1
    command = np.zeros((n, 5))
    command[np.arange(n) / rate_hz < until_s] = [*force, *point]
    return PlannedEpisode(np.array(start, float), command, rate_hz, elapsed_s, number)


def times(e: PlannedEpisode) -> np.ndarray:
    return np.arange(len(e.command)) / e.rate_hz


def test_a_central_push_above_friction_gives_the_sliding_acceleration() -> None:
    e = episode(force=(1.6 * 0.3 * WEIGHT, 0.0))
    path = simulate(BOX, e)
    expected = 0.5 * 0.6 * 0.3 * G * times(e) ** 2
    np.testing.assert_allclose(path[:, 0], expected, atol=2e-5)
    np.testing.assert_allclose(path[:, [1, 2]], 0.0, atol=1e-9)


@pytest.mark.parametrize("heading", [0.0, 0.4, math.pi / 4])
@pytest.mark.parametrize("speed", [0.5, 2.0])
def test_coasting_stops_after_v2_over_2_mu_g_whatever_the_heading(speed: float, heading: float) -> None:
    path = simulate(BOX, episode(start=(0, 0, heading, speed, 0, 0)))
    assert path[-1, 0] == pytest.approx(speed**2 / (2 * 0.3 * G), rel=1e-4)
    assert np.hypot(*path[-1, 3:5]) < 1e-8


def test_spinning_stops_by_the_patch_integral() -> None:
    """Mean distance from the centre of a square of side L: L (sqrt 2 + ln(1 + sqrt 2)) / 6 = 0.3826 L."""
    arm = 0.8 * (math.sqrt(2) + math.log(1 + math.sqrt(2))) / 6
    start = (0, 0, 0, 0, 0, 5.0)
    path = simulate(BOX, episode(start=start))
    expected = BOX.yaw_inertia * 25.0 / (2 * 0.3 * WEIGHT * arm)
    assert path[-1, 2] == pytest.approx(expected, rel=1e-3)
    assert simulate(BOX, episode(start=start), points=40)[-1, 2] == pytest.approx(expected, rel=5e-4)


def test_corners_spin_at_their_own_radius() -> None:
    box = replace(BOX, contact="corners")
    path = simulate(box, episode(start=(0, 0, 0, 0, 0, 5.0)))
    assert path[-1, 2] == pytest.approx(box.yaw_inertia * 25.0 / (2 * 0.3 * WEIGHT * 0.4 * math.sqrt(2)), rel=1e-4)


def test_a_held_body_creeps_no_faster_than_the_regularisation() -> None:
    path = simulate(BOX, episode(force=(0.9 * 0.3 * WEIGHT, 0.0), duration_s=4.0))
    creep = physics.SLIP_EPS * 0.9 / math.sqrt(1 - 0.81)
    assert path[-1, 3] == pytest.approx(creep, rel=1e-3)
    assert path[-1, 0] < 4.5e-5


def test_load_moves_forward_by_mu_h_when_coasting() -> None:
    load = base_load(BOX, np.array([0, 0, 0, 1.0, 0, 0]))
    assert load["x_m"] == pytest.approx(0.3 * 0.4, rel=1e-6)
    assert load["y_m"] == pytest.approx(0.0, abs=1e-12)
    assert load["total"] == pytest.approx(1.0, rel=1e-12)
    assert load["fx_n"] == pytest.approx(-0.3 * WEIGHT, rel=1e-6)


def test_load_under_a_high_push_balances_the_moments() -> None:
    """While sliding: X = (F pz + mu W h) / W, from the moments about the centre of mass."""
    force, height = 12.0, 0.2
    wrench = carried_out(BOX, np.array([[force, 0.0, 0.0, 0.0, height]]))[0]
    load = base_load(BOX, np.array([0, 0, 0, 0.5, 0, 0]), wrench=wrench)
    assert load["x_m"] == pytest.approx((force * height + 0.3 * WEIGHT * 0.4) / WEIGHT, rel=1e-6)


def test_a_load_beyond_the_kern_lifts_the_rear_of_the_base() -> None:
    """A triangular pressure with its resultant at e bears over 3 (h - e) of the length 2 h."""
    tall = replace(BOX, half_size=(0.4, 0.4, 0.8))
    e = 0.3 * 0.8
    load = base_load(tall, np.array([0, 0, 0, 1.0, 0, 0]))
    assert load["x_m"] == pytest.approx(e, rel=0.01)
    assert load["lifted"] == pytest.approx(1 - 3 * (0.4 - e) / 0.8, abs=1.01 / 16)
    assert load["total"] == pytest.approx(1.0, rel=1e-9)


def test_an_offset_centre_of_mass_turns_a_central_push() -> None:
    box = replace(BOX, com=(0.05, 0.0))
    force = 20.0
    e = episode(force=(0.0, force), start=(0, 0, 0, 0, 1.0, 0), duration_s=0.02, rate_hz=1000.0)
    assert simulate(box, e)[-1, 5] / 0.02 == pytest.approx(-0.05 * force / box.yaw_inertia, rel=0.02)


def test_without_friction_the_geometric_centre_circles_the_centre_of_mass() -> None:
    box = replace(SLICK, com=(0.1, -0.05))
    w = 3.0
    e = episode(start=(0, 0, 0, -w * 0.05, -w * 0.1, w))  # centre of mass at rest
    path, t = simulate(box, e), times(e)
    np.testing.assert_allclose(path[:, 0], 0.1 - (0.1 * np.cos(w * t) + 0.05 * np.sin(w * t)), atol=1e-5)
    np.testing.assert_allclose(path[:, 1], -0.05 - (0.1 * np.sin(w * t) - 0.05 * np.cos(w * t)), atol=1e-5)


def test_a_tether_oscillates_and_is_slack_below_its_rest_length() -> None:
    stiff = 10.0
    w = math.sqrt(stiff / BOX.mass)
    e = episode(start=(0.5, 0, 0, 0, 0, 0), duration_s=3.0)
    path = simulate(replace(SLICK, tether=stiff), e)
    np.testing.assert_allclose(path[:, 0], 0.5 * np.cos(w * times(e)), atol=1e-5)
    slack = simulate(replace(SLICK, tether=stiff, tether_rest=0.2), e)
    taut = times(e) * w < math.pi / 2
    np.testing.assert_allclose(slack[taut, 0], 0.2 + 0.3 * np.cos(w * times(e)[taut]), atol=1e-5)
    crossing = (times(e) * w > math.pi / 2) & (abs(slack[:, 0]) < 0.19)
    np.testing.assert_allclose(slack[crossing, 3], -0.3 * w, rtol=1e-5)


def test_drags_decay_as_their_closed_forms() -> None:
    e = episode(start=(0, 0, 0, 2.0, 0, 0))
    t = times(e)
    np.testing.assert_allclose(
        simulate(replace(SLICK, viscous_drag=1.5), e)[:, 3], 2 * np.exp(-1.5 / 2.5 * t), rtol=1e-5
    )
    np.testing.assert_allclose(simulate(replace(SLICK, air_drag=0.8), e)[:, 3], 2 / (1 + 0.8 * 2 / 2.5 * t), rtol=1e-5)
    spin = episode(start=(0, 0, 0, 0, 0, 3.0))
    i = BOX.yaw_inertia
    decay = simulate(replace(SLICK, rotational_damping=0.2), spin)[:, 5]
    np.testing.assert_allclose(decay, 3 * np.exp(-0.2 / i * t), rtol=1e-5)
    film = simulate(replace(SLICK, film=1.5), spin)[:, 5]
    np.testing.assert_allclose(film, 3 * np.exp(-1.5 * (0.8**2 / 6) / i * t), rtol=0.01)


def test_wind_tilt_and_leak_accelerate_as_their_closed_forms() -> None:
    e = episode(start=(0, 0, 0, 1.0, 0, 0), duration_s=0.5)
    tilted = simulate(replace(BOX, tilt=0.05), e)
    slope = math.sin(0.05) - 0.3 * math.cos(0.05)
    np.testing.assert_allclose(tilted[:, 3], np.maximum(1 + G * slope * times(e), 0), atol=1e-4)
    windy = simulate(replace(BOX, wind=(2.0, 0.0)), episode(start=(0, 0, 0, 1.0, 0, 0), duration_s=0.3))
    assert windy[-1, 3] == pytest.approx(1 - 0.3 * (0.3 * G - 2.0 / 2.5), rel=1e-4)
    leak = episode(force=(5.0, 0.0))
    expected = -5.0 / (2.5 * 0.1) * np.log(1 - 0.1 * times(leak))
    np.testing.assert_allclose(simulate(replace(SLICK, mass_leak=0.1), leak)[:, 3], expected, atol=1e-5)


@pytest.mark.parametrize("flow", ["associated", "scaled"])
def test_anisotropic_friction_differs_along_its_axes(flow: Literal["associated", "scaled"]) -> None:
    angle = 0.5
    box = replace(BOX, anisotropy=(1.3, 0.7), anisotropy_angle=angle, anisotropy_flow=flow)
    for factor, direction in ((1.3, angle), (0.7, angle + math.pi / 2)):
        start = (0, 0, 0, math.cos(direction), math.sin(direction), 0)
        end = simulate(box, episode(start=start))[-1]
        assert np.hypot(end[0], end[1]) == pytest.approx(1 / (2 * 0.3 * factor * G), rel=1e-3)
    load = base_load(box, np.array([0, 0, 0, math.cos(angle + math.pi / 4), math.sin(angle + math.pi / 4), 0]))
    c, s = math.cos(angle), math.sin(angle)
    f1, f2 = c * load["fx_n"] + s * load["fy_n"], c * load["fy_n"] - s * load["fx_n"]
    assert f1 / f2 == pytest.approx((1.3 / 0.7) ** (2 if flow == "associated" else 1), rel=1e-6)
    if flow == "associated":
        assert math.hypot(f1 / 1.3, f2 / 0.7) == pytest.approx(0.3 * WEIGHT, rel=1e-6)


def test_stribeck_stops_by_its_integral_and_stiction_holds_up_to_its_excess() -> None:
    """Stopping time under mu (1 + s exp(-(v/vs)^2)) by quadrature of dv / (mu g (1 + ...))."""
    box = replace(BOX, stribeck=0.5, stribeck_speed=0.3)
    path = simulate(box, episode(start=(0, 0, 0, 1.0, 0, 0), duration_s=0.5, rate_hz=1000.0))
    v = np.linspace(0, 1, 20001)
    expected = np.trapezoid(v / (0.3 * G * (1 + 0.5 * np.exp(-((v / 0.3) ** 2)))), v)
    assert path[-1, 0] == pytest.approx(expected, rel=1e-4)
    sticky = replace(BOX, stiction=0.2)
    assert simulate(sticky, episode(force=(1.15 * 0.3 * WEIGHT, 0)))[-1, 0] < 1e-3
    moved = simulate(sticky, episode(force=(1.25 * 0.3 * WEIGHT, 0)))[-1]
    assert moved[3] == pytest.approx(0.25 * 0.3 * G * 2, rel=0.03)


@pytest.mark.parametrize("shape", ["disc", "gaussian"])
def test_a_patch_changes_friction_where_it_is(shape: Literal["disc", "gaussian"]) -> None:
    small = replace(BOX, half_size=(0.05, 0.05, 0.05), patch=0.5, patch_place=(3.0, 1.0), patch_shape=shape)

    def drag(x: float) -> float:
        return -base_load(small, np.array([x, 1.0, 0, 0, 1.0, 0]))["fy_n"] / (0.3 * WEIGHT)

    assert drag(3.0) == pytest.approx(1.5, rel=0.01)
    assert drag(0.5) == pytest.approx(1.0, rel=1e-3)
    assert drag(3.5) == pytest.approx(1.25 if shape == "disc" else 1 + 0.5 * math.exp(-0.5), rel=0.03)


def test_pressure_at_the_rim_turns_harder_than_in_the_middle() -> None:
    def torque(**change: Any) -> float:
        box = replace(BOX, **change)
        return -base_load(box, np.array([0, 0, 0, 0, 0, 3.0]))["torque_n_m"]

    even = torque()
    assert torque(pressure=0.3) > 1.05 * even
    assert torque(pressure=0.3, pressure_where="middle") < 0.9 * even
    middle = torque(pressure=1.0, pressure_where="middle")
    assert middle == pytest.approx(even / 2, rel=0.02)  # a square of half the side


def test_the_actuator_delays_lags_limits_and_turns() -> None:
    e = episode(force=(5.0, 0.0), duration_s=1.0)
    t = times(e)
    late = simulate(replace(SLICK, delay=0.137), e)
    np.testing.assert_allclose(late[:, 3], 2.0 * np.maximum(t - 0.137, 0.0), atol=1e-6)
    lagged = simulate(replace(SLICK, lag=0.2), e)
    np.testing.assert_allclose(lagged[:, 3], 2.0 * (t - 0.2 * (1 - np.exp(-t / 0.2))), atol=1e-6)
    np.testing.assert_allclose(simulate(replace(SLICK, saturation=2.0), e)[:, 3], 0.8 * t, atol=1e-6)
    np.testing.assert_allclose(simulate(replace(SLICK, gain=1.1), e)[:, 3], 2.2 * t, atol=1e-6)
    turned = simulate(replace(SLICK, misalignment=0.3), e)
    np.testing.assert_allclose(
        turned[:, 4] / np.maximum(turned[:, 3], 1e-9)[-1], 2 * t * math.sin(0.3) / (2 * math.cos(0.3)), atol=1e-6
    )
    aside = simulate(replace(SLICK, point_offset=(0.0, 0.1)), episode(force=(5.0, 0), duration_s=0.02, rate_hz=1000.0))
    assert aside[-1, 5] == pytest.approx(-0.5 / BOX.yaw_inertia * 0.02, rel=1e-3)


def test_a_lag_keeps_the_impulse_of_a_push() -> None:
    e = episode(force=(5.0, 0.0), point=(0.0, 0.1, 0.0), until_s=0.3, duration_s=3.0)
    end = simulate(replace(SLICK, lag=0.15), e)[-1]
    assert end[3] == pytest.approx(5 * 0.3 / 2.5, rel=1e-5)


def test_an_observation_delay_equals_an_actuator_delay_of_the_same_length() -> None:
    e = episode(force=(12.0, 3.0), point=(0.1, 0.2, 0.0), start=(0.3, 0.1, 0.2, 0.5, -0.2, 1.0))
    seen = simulate(replace(BOX, observation_delay=0.063), e)
    np.testing.assert_allclose(seen, simulate(replace(BOX, delay=0.063), e), atol=1e-5)


def test_a_sensor_scale_multiplies_lengths_alone() -> None:
    e = episode(force=(12.0, 0.0), point=(0.0, 0.2, 0.0))
    true = simulate(BOX, e)
    np.testing.assert_allclose(
        simulate(replace(BOX, sensor_scale=1.02), e), true * [1.02, 1.02, 1, 1.02, 1.02, 1], atol=1e-6
    )


def test_effects_outside_the_vocabulary_follow_their_closed_forms() -> None:
    e = episode(start=(0, 0, 0, 1.0, 0, 0), duration_s=1.0)
    t = times(e)
    wave = simulate(replace(SLICK, periodic=3.0, periodic_hz=0.8), e)
    w = 2 * math.pi * 0.8
    np.testing.assert_allclose(wave[:, 3], 1 + 3 / 2.5 / w * (1 - np.cos(w * t)), atol=1e-5)
    circle = simulate(replace(SLICK, deflection=4.0), e)
    np.testing.assert_allclose(circle[:, 4], np.sin(4 / 2.5 * t), atol=1e-5)
    bounce = simulate(replace(SLICK, barrier=2000.0, barrier_distance=0.4), e)
    assert bounce[-1, 3] == pytest.approx(-1.0, rel=1e-3)
    cog = simulate(replace(SLICK, cogging=0.05, cogging_teeth=3), episode(start=(0, 0, 0.3, 0, 0, 2.0)))
    energy = 0.5 * BOX.yaw_inertia * cog[:, 5] ** 2 + 0.05 / 3 * np.cos(3 * cog[:, 2])
    np.testing.assert_allclose(energy, energy[0], rtol=1e-5)
    swirl = simulate(
        replace(SLICK, vortex=2.0, vortex_radius=0.7),
        episode(start=(0.7, 0, 0, 0, 0, 0), duration_s=0.01, rate_hz=1000),
    )
    assert swirl[-1, 4] == pytest.approx(2.0 / 2.5 * 0.01, rel=1e-3)
    worn = simulate(replace(BOX, wear=0.01), episode(start=(0, 0, 0, 1.0, 0, 0), elapsed_s=20.0))
    assert worn[-1, 0] == pytest.approx(1 / (2 * 0.3 * G * 1.2), rel=2e-3)
    command = np.array([[4.0, 3.0, 0, 0, 0]])
    np.testing.assert_allclose(carried_out(replace(BOX, deadband=1.0), command)[0, :2], [3.2, 2.4])
    np.testing.assert_allclose(carried_out(replace(BOX, quantum=2.5), command)[0, :2], [5.0, 2.5])
    np.testing.assert_allclose(carried_out(replace(BOX, crosstalk=0.1), command)[0, :2], [4.0, 4.6])


def test_a_wandering_force_has_its_standard_deviation_and_is_slow() -> None:
    rows = []
    for number in range(60):
        terms = physics.wander_terms(5, number)
        t = np.arange(0, 8, 0.1)[:, None]
        rows.append(np.sin(terms[:, 0] * t) @ terms[:, 1] + np.cos(terms[:, 0] * t) @ terms[:, 2])
    force = np.array(rows)
    assert force.std() == pytest.approx(1.0, rel=0.15)
    assert np.mean(force[:, 1:] * force[:, :-1]) > 0.9 * np.mean(force**2)


def test_the_texture_has_its_standard_deviation_and_length() -> None:
    grid = physics.floor_texture(replace(BOX, texture_seed=3))
    assert grid.mean() == pytest.approx(0.0, abs=1e-12)
    assert grid.std() == pytest.approx(1.0)
    near = np.mean(grid * np.roll(grid, 1, axis=0))
    far = np.mean(grid * np.roll(grid, 16, axis=0))
    assert near == pytest.approx(math.exp(-0.5 * (0.125 / 0.3) ** 2), abs=0.05)
    assert abs(far) < 0.2


@pytest.mark.parametrize("texture", [0.0, 0.01])
def test_tighter_tolerances_and_finer_points_change_little(texture: float) -> None:
    box = replace(BOX, texture=texture)
    n = 361
    t = np.arange(n) / 60
    command = np.zeros((n, 5))
    pushed = (t % 2 > 0.2) & (t % 2 < 1.0)
    command[pushed] = np.column_stack([14 * np.cos(2 * t), 14 * np.sin(2 * t), 0 * t + 0.1, 0 * t - 0.2, 0 * t])[pushed]
    e = PlannedEpisode(np.zeros(6), command, 60.0)
    path = simulate(box, e)
    assert np.ptp(path[:, 0]) > 0.3
    np.testing.assert_allclose(path, simulate(box, e, rtol=1e-10, atol=1e-11), atol=5e-5)
    np.testing.assert_allclose(path[:, :3], simulate(box, e, points=32)[:, :3], atol=2e-3)


@settings(max_examples=15, deadline=None)
@given(angle=st.floats(-3, 3), vx=st.floats(-2, 2), vy=st.floats(-2, 2), wz=st.floats(-4, 4), fx=st.floats(-15, 15))
def test_turning_the_world_turns_the_motion_and_a_coasting_body_loses_energy(
    angle: float, vx: float, vy: float, wz: float, fx: float
) -> None:
    c, s = math.cos(angle), math.sin(angle)
    e = episode(force=(fx, 2.0), point=(0.1, 0.2, 0.1), start=(0, 0, 0, vx, vy, wz), until_s=0.4, duration_s=1.0)
    turned = episode(
        force=(c * fx - s * 2.0, s * fx + c * 2.0), point=(0.1, 0.2, 0.1), until_s=0.4, duration_s=1.0,
        start=(0, 0, angle, c * vx - s * vy, s * vx + c * vy, wz),
    )  # fmt: skip
    a, b = simulate(BOX, e), simulate(BOX, turned)
    np.testing.assert_allclose(a[:, 0] * c - a[:, 1] * s, b[:, 0], atol=1e-4)
    np.testing.assert_allclose(a[:, 2] + angle, b[:, 2], atol=3e-4)
    energy = BOX.mass * (a[40:, 3] ** 2 + a[40:, 4] ** 2) + BOX.yaw_inertia * a[40:, 5] ** 2
    assert np.all(np.diff(energy) <= 1e-9)


def test_a_world_out_of_range_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"world\.mass: must be a finite number"):
        replace(BOX, mass=-1.0)


def test_a_box_that_would_tip_is_refused() -> None:
    """Sliding, the load would have to be mu h = 0.48 m ahead of the centre, beyond the base."""
    tall = replace(BOX, half_size=(0.4, 0.4, 1.6))
    with pytest.raises(IntegrationError, match="the box tips"):
        simulate(tall, episode(start=(0, 0, 0, 1.0, 0, 0)))
    with pytest.raises(IntegrationError, match="physics: "):
        simulate(tall, episode(force=(2.0 * 0.3 * WEIGHT, 0.0)))


def test_the_physics_shares_nothing_with_what_the_diagnosis_fits_with() -> None:
    """Only numpy, numba, scipy, the errors and the standard library."""
    names: set[str] = set()
    for file in Path(physics.__file__).parent.glob("*.py"):
        tree = ast.parse(file.read_text())
        names |= {n.module or "" for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)}
        names |= {a.name for n in ast.walk(tree) if isinstance(n, ast.Import) for a in n.names}
    names = {name for name in names if not f"{name}.".startswith("runner.blind.planar_box.physics.")}
    allowed = {
        "__future__",
        "math",
        "warnings",
        "dataclasses",
        "typing",
        "numpy",
        "numba",
        "scipy.integrate",
        "pathlib",
        "runner.errors",
        "runner.storage.numba_cache",
    }
    assert names == allowed
