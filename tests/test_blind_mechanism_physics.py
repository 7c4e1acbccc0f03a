"""The physics that mechanisms are made by, held against closed forms, balances of energy, and MuJoCo itself."""

from __future__ import annotations

import ast
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.special import ellipk

from runner.blind.mechanism import physics
from runner.blind.mechanism.physics import Actuator, DivergedError, Joint, Link, PlannedEpisode, Sensor, World, simulate

SENSORS = (Sensor(), Sensor())
MASS, DRIVE = 2.0, 0.5
STEPS = (8e-4, 4e-4, 2e-4)


def slide(joint: Joint | None = None, actuator: Actuator | None = None) -> World:
    """A carriage of 2 kg whose drive has 0.5 kg."""
    joint = replace(joint or Joint(), armature=DRIVE)
    return World(True, (Link(MASS),), (joint,), (actuator or Actuator(),), (SENSORS,))


def pendulum(joint: Joint | None = None, actuator: Actuator | None = None) -> World:
    """1.5 kg at 0.4 m."""
    return World(False, (Link(1.5, (0.0, -0.4), 0.02),), (joint or Joint(),), (actuator or Actuator(),), (SENSORS,))


def arm(*joints: Joint) -> World:
    """Two links whose centres of mass lie beside the line between the joints."""
    links = Link(1.2, (0.02, -0.2), 0.01), Link(0.7, (0.01, -0.15), 0.005)
    return World(False, links, joints or (Joint(), Joint()), (Actuator(),) * 2, (SENSORS,) * 2, 0.3)


def episode(seconds: float, start: list[float], command: float | np.ndarray = 0.0, step_s: float = 0.01, **more):
    """An episode of evenly timed samples under one command for all joints, or one per sample and joint."""
    t = np.arange(round(seconds / step_s) + 1) * step_s
    commands = np.broadcast_to(command, (len(t), len(start) // 2)) if np.ndim(command) == 0 else command
    return PlannedEpisode(t, np.array(commands, float), np.array(start), **more)


def energy(world: World, shown: np.ndarray) -> np.ndarray:
    """Return kinetic and potential energy of the arm from places and velocities of its centres of mass, (T,)."""
    q1, v1, q2, v2 = shown.T

    def turned(angle: np.ndarray, x: float, z: float) -> np.ndarray:
        return np.array([x * np.cos(angle) - z * np.sin(angle), x * np.sin(angle) + z * np.cos(angle)])

    (upper, forearm), way = world.links, (0.0, -world.length_m)
    places = turned(q1, *upper.com_m), turned(q1, *way) + turned(q1 + q2, *forearm.com_m)
    quarter = math.pi / 2  # a velocity is the way from the joint, turned and times the rate
    speeds = (
        turned(q1 + quarter, *upper.com_m) * v1,
        turned(q1 + quarter, *way) * v1 + turned(q1 + q2 + quarter, *forearm.com_m) * (v1 + v2),
    )
    total = np.zeros(len(q1))
    for link, place, speed, rate in zip(world.links, places, speeds, (v1, v1 + v2), strict=True):
        total += 0.5 * link.mass_kg * (speed**2).sum(axis=0) + 0.5 * link.inertia_kg_m2 * rate**2
        total += link.mass_kg * 9.81 * place[1]
    return total


def test_the_period_of_a_wide_swing() -> None:
    """4 K(sin^2(a / 2)) sqrt(J / (m g r)), at 1.5 rad."""
    inertia = 0.02 + 1.5 * 0.4**2
    period = 4.0 * ellipk(math.sin(0.75) ** 2) * math.sqrt(inertia / (1.5 * 9.81 * 0.4))
    t = np.array([0.0, 0.5 * period, period, 3.0 * period])
    shown = simulate(pendulum(), PlannedEpisode(t, np.zeros((4, 1)), np.array([1.5, 0.0])))
    np.testing.assert_allclose(shown[:, 0], [1.5, -1.5, 1.5, 1.5], atol=1e-6)


def test_an_arm_keeps_its_energy_and_the_rule_is_of_second_order() -> None:
    """Coriolis and centrifugal forces do no work; half the step makes a quarter of the error."""
    world, planned = arm(), episode(3.0, [1.0, -0.5, 0.0, 1.0])
    exact = simulate(world, planned, step_s=2e-5)
    total = energy(world, exact)
    assert np.ptp(total) < 1e-5 * abs(total[0])
    errors = [np.abs(simulate(world, planned, step_s=h) - exact).max() for h in STEPS]
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.15)
    assert errors[1] / errors[2] == pytest.approx(4.0, rel=0.15)


def test_friction_keeps_the_order_through_reversals_and_sticking() -> None:
    """An arm that is driven to and fro, both joints stopping again and again."""
    world = arm(Joint(1.2, 0.05, 0.01), Joint(0.4, 0.02, 0.004))
    t = np.arange(301) * 0.01
    driven = np.column_stack([2.0 * np.sin(4.0 * t), 0.5 * np.sign(np.sin(2.5 * t))])
    planned = episode(3.0, [0.3, -0.5, 0.0, 0.0], driven)
    exact = simulate(world, planned, step_s=2e-5)
    assert np.mean(exact[:, 3] == 0.0) > 0.05  # it does stick, exactly
    errors = [np.abs(simulate(world, planned, step_s=h) - exact).max() for h in STEPS]
    assert errors[0] > 2.5 * errors[1] > 6.0 * errors[2]


def test_a_coasting_carriage_stops_when_and_where_friction_says() -> None:
    """v0 m / F and v0^2 m / 2 F, friction in the forward direction a quarter above its mean; then it stays."""
    force, mass = 3.0 * 1.25, MASS + DRIVE
    shown = simulate(slide(Joint(dry=3.0, dry_difference=0.5)), episode(2.0, [0.0, 1.22]))
    assert shown[-1, 0] == pytest.approx(1.22**2 * mass / (2.0 * force), rel=1e-9)
    stopped = int(np.argmax(shown[:, 1] == 0.0)) * 0.01
    assert 0.0 <= stopped - 1.22 * mass / force < 0.01
    assert np.all(shown[int(stopped * 100) :, 1] == 0.0)


@pytest.mark.parametrize(("command", "moves"), [(2.99, False), (3.01, True), (-2.99, False)])
def test_what_rests_is_held_up_to_its_friction(command: float, moves: bool) -> None:
    """Not a creep below the limit; above it a motion by the difference."""
    shown = simulate(slide(Joint(dry=3.0)), episode(1.0, [0.1, 0.0], command))
    moved = 0.5 * 0.01 / (MASS + DRIVE) if moves else 0.0
    assert shown[-1, 0] - 0.1 == pytest.approx(moved, abs=1e-12)


def test_a_servo_answers_a_step_as_the_second_order_system_that_it_is() -> None:
    """Below its limit, late by a delay: 1 - exp(-s t) (cos w t + s / w sin w t)."""
    mass, kp, kv, delay = MASS + DRIVE, 250.0, 12.0, 0.0137
    world = slide(actuator=Actuator(1.0, kp, kv, delay_s=delay))
    command = np.full((201, 1), 0.1)
    command[0] = 0.0
    shown = simulate(world, episode(2.0, [0.0, 0.0], command))[:, 0]
    t = np.maximum(np.arange(201) * 0.01 - 0.01 - delay, 0.0)
    decay = kv / (2.0 * mass)
    swing = math.sqrt(kp / mass - decay**2)
    expected = 0.1 * (1.0 - np.exp(-decay * t) * (np.cos(swing * t) + decay / swing * np.sin(swing * t)))
    np.testing.assert_allclose(shown, expected, atol=1e-7)


def test_lags_of_a_motor_and_of_a_sensor_are_first_order() -> None:
    """A constant force through a lag: v = F / m (t - tau (1 - exp(-t / tau))); a ramp through one is late by it."""
    tau, mass = 0.08, MASS + DRIVE
    shown = simulate(slide(actuator=Actuator(lag_s=tau)), episode(1.0, [0.0, 0.0], 5.0, held=True))
    t = np.arange(101) * 0.01
    np.testing.assert_allclose(shown[:, 1], 5.0 / mass * (t - tau * (1.0 - np.exp(-t / tau))), atol=1e-7)
    late = simulate(slide().with_sensor(0, False, lag_s=tau), episode(1.0, [0.0, 0.7]))
    np.testing.assert_allclose(late[:, 0], 0.7 * (t - tau), atol=1e-9)


def test_what_is_read_late_is_the_state_of_before() -> None:
    """A reading that is late by a delay equals a command that is; a fast clock shows every process slower."""
    planned = episode(1.0, [0.2, 0.0], np.sin(np.arange(101) * 0.1)[:, None])
    late = simulate(replace(pendulum(), observation_delay_s=0.0173), planned)
    np.testing.assert_allclose(late, simulate(pendulum(actuator=Actuator(delay_s=0.0173)), planned), atol=1e-9)
    ratio = 1.25
    fast = simulate(replace(pendulum(), clock_ratio=ratio), planned)
    true = simulate(pendulum(), replace(planned, t_s=planned.t_s / ratio))
    np.testing.assert_allclose(fast, true, atol=1e-12)


def test_a_drive_crosses_its_play_and_takes_the_link_along() -> None:
    """Alone under the force through the play, an impact without rebound, then both: by momentum."""
    play, force = 0.02, 4.0
    world = slide(Joint(play=play), Actuator())
    planned = episode(1.0, [0.0, 0.0], force, step_s=0.001)
    start = simulate(world, planned)[:, 1]
    # at the start the drive lies where the force presses it; reverse the force for it to cross
    assert start[-1] == pytest.approx(force / (MASS + DRIVE), rel=1e-9)
    command = np.where(np.arange(1001)[:, None] < 1, force, -force)
    shown = simulate(world, replace(planned, commands=command))[:, 1]
    gained = force / (MASS + DRIVE) * 0.001
    # the drive comes back from the common speed by -force / DRIVE until it is a play behind the link
    meets = math.sqrt(2.0 * play * DRIVE / force)
    together = gained - DRIVE / (MASS + DRIVE) * (force / DRIVE * meets)
    after = together - force / (MASS + DRIVE) * (0.999 - meets)
    assert shown[10] == pytest.approx(gained, rel=1e-9)  # the link is alone
    assert shown[-1] == pytest.approx(after, rel=1e-4)


def test_a_link_swings_on_the_spring_to_its_drive() -> None:
    """Two masses on a spring without damping: sqrt(k (1 / m + 1 / M)), momentum kept."""
    give = 1.0 / 400.0
    world = slide(Joint(give=give, spring_damping_ratio=0.0))
    command = np.where(np.arange(1001)[:, None] < 100, 3.0, 0.0)
    shown = simulate(world, episode(1.0, [0.0, 0.0], command, step_s=0.001))[:, 1]
    rate = math.sqrt(400.0 * (1.0 / MASS + 1.0 / DRIVE))
    period = 2.0 * math.pi / rate
    free = shown[101:]
    mean = 3.0 * 0.1 / (MASS + DRIVE)
    assert np.mean(free[: round(4 * period / 0.001)]) == pytest.approx(mean, rel=0.01)
    crossings = np.flatnonzero(np.diff(np.sign(free - mean)) > 0)
    assert np.diff(crossings).mean() * 0.001 == pytest.approx(period, rel=0.01)


def test_effects_without_a_word_do_what_they_say() -> None:
    """Quadratic drag by its closed form, commands rounded and lost as counted, a coupling that slips."""
    drag, mass = 0.8, MASS + DRIVE
    shown = simulate(slide(Joint(quadratic=drag)), episode(2.0, [0.0, 1.5]))
    t = np.arange(201) * 0.01
    np.testing.assert_allclose(shown[:, 1], 1.5 / (1.0 + drag * 1.5 / mass * t), rtol=1e-6)
    rounded = simulate(slide(actuator=Actuator(quantum=2.0)), episode(1.0, [0.0, 0.0], 2.9))
    assert rounded[-1, 1] == pytest.approx(2.0 / mass, rel=1e-9)
    slipping = simulate(slide(actuator=Actuator(slip=0.25, slip_at=2.0)), episode(1.0, [0.0, 0.0], 2.9))
    assert slipping[-1, 1] == pytest.approx(1.5 / mass, rel=1e-9)
    limited = simulate(slide(actuator=Actuator(slew_per_s=4.0)), episode(1.0, [0.0, 0.0], 2.0))
    assert limited[-1, 1] == pytest.approx((0.5 * 4.0 * 0.5**2 + 2.0 * 0.5) / mass, rel=1e-6)
    g = np.random.default_rng(0)
    commands = g.normal(size=(4001, 1))
    noisy = replace(slide(actuator=Actuator(dropout=0.3)), seed=5)
    shown = simulate(noisy, episode(4.0, [0.0, 0.0], commands, step_s=0.001))
    got = np.diff(shown[:, 1]) * mass / 0.001
    assert np.mean(np.abs(got - commands[:-1, 0]) > 1e-6) == pytest.approx(0.3, abs=0.03)


def test_what_runs_away_is_said() -> None:
    """A spring that pushes away has no end."""
    with pytest.raises(DivergedError, match="episode 3 ran away"):
        simulate(slide(Joint(stiffness=-5000.0)), episode(4.0, [0.01, 0.0], number=3))


def test_the_physics_shares_nothing_with_what_the_diagnosis_fits_with() -> None:
    """Only numpy, numba, the errors and the standard library."""
    names: set[str] = set()
    for file in Path(physics.__file__).parent.glob("*.py"):
        tree = ast.parse(file.read_text())
        names |= {n.module or "" for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)}
        names |= {a.name for n in ast.walk(tree) if isinstance(n, ast.Import) for a in n.names}
    own = "runner.blind.mechanism.physics"
    names = {n for n in names if not f"{n}.".startswith(f"{own}.")}
    allowed = {"__future__", "math", "dataclasses", "collections.abc", "typing", "pathlib", "numpy", "numba"}
    assert names <= allowed | {"runner.errors", "runner.storage.numba_cache"}
