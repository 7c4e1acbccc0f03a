"""Mass, centre of mass and inertia of a body in space: the physics against closed forms and another integrator, the
estimator against the Cramer-Rao bound, and what a flight cannot tell."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy

from runner.errors import ConfigError, RecordingError
from runner.estimation.space.bound import information, least_covariance
from runner.estimation.space.dynamics import Motion, accelerations, body_of, regressor, step, step_with_sensitivities
from runner.estimation.space.estimator import SpaceEstimator, SpaceWatch, numbers_of
from runner.estimation.space.inertial import (
    NAMES,
    SHARES,
    Inertial,
    derivative,
    from_vector,
    shares_of,
    standard_of,
    to_vector,
    values_of,
)
from runner.estimation.space.made import MadeMotion, followed, shaken, tossed
from runner.estimation.space.readings import Reading, SensorConfig, SpacePrior
from runner.estimation.space.tracker import SpaceBelief, SpaceTracker
from runner.physics.forces import Straight
from runner.physics.scene import SceneConfig
from runner.studies.space import Space
from runner.teleop.estimators import Linear
from runner.teleop.experiment import Experiment, RemoteConfig, StartConfig
from runner.teleop.link import LinkConfig, NoiseConfig

HALF = np.array([0.12, 0.08, 0.05])
GRAVITY = np.array([0.0, 0.0, -9.81])
INERTIA = np.array([[3.8e-3, 4e-4, -3e-4], [4e-4, 6.4e-3, 2e-4], [-3e-4, 2e-4, 7.4e-3]])
TRUE = Inertial(1.2, np.array([0.02, -0.015, 0.01]), INERTIA)
X = to_vector(TRUE, HALF)
START = to_vector(Inertial(2.4, np.array([-0.016, 0.009, -0.005]), np.diag([7.1e-3, 13.5e-3, 16.6e-3])), HALF)
NOISE = NoiseConfig(5e-4, 1e-3, 5e-3, 1e-2)
SENSORS = SensorConfig(grip_m=(0.05, 0.0, 0.02))
STEP_S = 0.02
ESTIMATOR = SpaceEstimator(SENSORS)


def shake(duration_s: float = 0.4) -> MadeMotion:
    """A short shake."""
    return shaken(X, HALF, step_s=STEP_S, duration_s=duration_s, gravity=GRAVITY, seed=0)


def toss(seed: int = 0) -> MadeMotion:
    """A short flight."""
    return tossed(X, HALF, step_s=STEP_S, duration_s=0.4, gravity=GRAVITY, spin_rad_s=9.0, seed=seed)


@cache
def tracker() -> SpaceTracker:
    """The estimator's recursion."""
    return ESTIMATOR.tracker(HALF, STEP_S, NOISE, GRAVITY)


def told(made: MadeMotion, lanes: int, belief: SpaceBelief | None = None, *, first: int = 0) -> SpaceBelief:
    """Return what is believed after all readings of an episode."""
    for k, reading in enumerate(made.measured(SENSORS, NOISE, [(first + i, 2) for i in range(lanes)])):
        if k:
            assert belief is not None
            belief = tracker().update(belief, reading)
        else:
            belief = tracker().begun(belief, reading) if belief else tracker().start(SpacePrior(START), reading)
    assert belief is not None
    return belief


def test_standard_parameters_are_the_parallel_axis_theorem() -> None:
    """Values come back, the inertia about the tracked point is Steiner's, complex steps are finite differences."""
    assert values_of(X, HALF) == pytest.approx(TRUE.values)
    com = TRUE.com_m
    about = INERTIA + 1.2 * (com @ com * np.eye(3) - np.outer(com, com))
    assert standard_of(X, HALF)[4:] == pytest.approx([*np.diag(about), about[0, 1], about[0, 2], about[1, 2]])
    assert shares_of(X, HALF)[3:] == pytest.approx(TRUE.values[4:] / np.trace(INERTIA))
    for function in (standard_of, values_of, shares_of):
        apart = np.array([function(X + h, HALF) - function(X - h, HALF) for h in 1e-6 * np.eye(10)]).T / 2e-6
        np.testing.assert_allclose(derivative(function, X, HALF), apart, atol=1e-9)


def test_the_regressor_is_newton_and_euler_about_the_centre_of_mass() -> None:
    """Force is mass times what the centre of mass is accelerated by, torque about it Euler's; and back again."""
    rng = np.random.default_rng(1)
    rate, both = rng.standard_normal(3), rng.standard_normal(6)
    specific, turning = both[:3], both[3:]
    at_com = specific + np.cross(turning, TRUE.com_m) + np.cross(rate, np.cross(rate, TRUE.com_m))
    force = 1.2 * at_com
    torque = INERTIA @ turning + np.cross(rate, INERTIA @ rate) + np.cross(TRUE.com_m, force)
    wrench = regressor(both, rate) @ standard_of(X, HALF)
    assert wrench == pytest.approx(np.concatenate([force, torque]), rel=1e-12)
    assert accelerations(body_of(X, HALF), rate, wrench) == pytest.approx(both, rel=1e-10)


def test_a_shaken_body_moves_as_another_integrator_says() -> None:
    """Position, turn and rates of the centre of mass form, by Dormand and Prince's eighth order at 1e-9."""
    made = shake(0.2)
    assert made.wrench is not None
    held = scipy.interpolate.interp1d(np.arange(len(made.wrench)) * STEP_S, made.wrench, axis=0)
    inverse = np.linalg.inv(INERTIA)

    def slope(t: float, y: np.ndarray) -> np.ndarray:
        turn, velocity, rate = y[3:12].reshape(3, 3), y[12:15], y[15:]
        force, torque = np.split(held(t), 2)
        turning = inverse @ (torque - np.cross(TRUE.com_m, force) - np.cross(rate, INERTIA @ rate))
        lever = np.cross(turning, TRUE.com_m) + np.cross(rate, np.cross(rate, TRUE.com_m))
        spin = np.array([[0, -rate[2], rate[1]], [rate[2], 0, -rate[0]], [-rate[1], rate[0], 0]])
        return np.concatenate([velocity, (turn @ spin).ravel(), turn @ (force / 1.2 - lever) + GRAVITY, turning])

    first = np.concatenate([np.ravel(part[0]) for part in made.motion])
    y = first
    for k in range(len(made.wrench) - 1):  # corners of the wrench are ends of its steps
        span = (k * STEP_S, (k + 1) * STEP_S)
        y = scipy.integrate.solve_ivp(slope, span, y, method="DOP853", rtol=1e-9, atol=1e-11).y[:, -1]
    last = np.concatenate([np.ravel(part[-1]) for part in made.motion])
    assert np.abs(last - first).max() > 0.1
    np.testing.assert_allclose(last, y, atol=1e-6)


def test_a_flight_keeps_what_it_must() -> None:
    """The centre of mass flies a parabola, angular momentum about it and energy of turning stay."""
    made = toss()
    motion, time_s = made.motion, np.arange(21) * STEP_S
    centre = motion.position + motion.turn @ TRUE.com_m
    speed = motion.velocity[0] + motion.turn[0] @ np.cross(motion.rate[0], TRUE.com_m)
    parabola = centre[0] + time_s[:, None] * speed + 0.5 * time_s[:, None] ** 2 * GRAVITY
    np.testing.assert_allclose(centre, parabola, atol=1e-8)
    assert np.linalg.norm(motion.position - parabola, axis=1).min() > 0.02
    momentum = (motion.turn @ INERTIA @ motion.rate[..., None])[..., 0]
    np.testing.assert_allclose(momentum, np.broadcast_to(momentum[0], momentum.shape), atol=1e-8)
    energy = np.einsum("ti,ij,tj->t", motion.rate, INERTIA, motion.rate)
    np.testing.assert_allclose(energy, energy[0], rtol=1e-7)
    assert np.ptp(motion.rate, axis=0).min() > 0.3  # it tumbles


def test_a_symmetric_top_precesses_as_in_the_textbook() -> None:
    """Rates across its axis turn at (I_a - I_c) / I_a times the spin, about the centre of mass and body axes."""
    top = Inertial(1.0, np.zeros(3), np.diag([5e-3, 5e-3, 7e-3]))
    zero = np.zeros(3)
    motion = Motion(zero, np.eye(3), zero, np.array([2.0, 0.0, 6.0]))
    moved = followed(body_of(to_vector(top, HALF), HALF), motion, np.zeros((101, 6)), STEP_S, zero)
    phase = (7 - 5) / 5 * 6.0 * np.arange(101) * STEP_S
    wanted = np.stack([2 * np.cos(phase), 2 * np.sin(phase), np.full(101, 6.0)], axis=1)
    np.testing.assert_allclose(moved.rate, wanted, atol=1e-6)


def test_sensitivities_are_finite_differences() -> None:
    """Of one step, by the motion, the ten numbers and both wrenches."""
    made = shake()
    assert made.wrench is not None
    body, now = body_of(X, HALF), made.motion.of(7)
    wrench = np.concatenate([made.wrench[7], made.wrench[8]])

    def ahead(by: np.ndarray) -> Motion:
        held = wrench + by[22:]
        return step(body_of(X + by[12:22], HALF), now.moved(by[:12]), (held[:6], held[6:]), 0.01, GRAVITY)

    found = step_with_sensitivities(body, now, (wrench[:6], wrench[6:]), 0.01, GRAVITY)[1]
    apart = np.array([ahead(h).less(ahead(-h)) for h in 1e-5 * np.eye(34)]).T / 2e-5
    assert np.abs(apart[9:, 12:]).max() > 0.05
    # both are of fourth order: they differ by what a torque of 1 N m does at the fifth
    np.testing.assert_allclose(found, apart, atol=1e-5)


def ratios(
    values: np.ndarray, covariance: np.ndarray, truth: np.ndarray, least: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return rmse against the bound, and stated deviations against it."""
    off = np.sqrt(((values - truth) ** 2).mean(axis=0)) / np.sqrt(np.diag(least))
    return off, np.sqrt(np.median(np.einsum("nii->ni", covariance), axis=0) / np.diag(least))


def test_held_and_shaken_all_ten_are_at_the_bound() -> None:
    """Over 24 seeds from twice the mass: errors within what 24 seeds can tell (chi-squared, 1e-4 each), and the
    covariance is that of the bound, which knows every wrench as an unknown."""
    made, lanes = shake(), 24
    least = least_covariance(information(made, X, HALF, SENSORS, NOISE, GRAVITY), derivative(values_of, X, HALF))
    values, covariance = tracker().values(told(made, lanes))
    ratio, stated = ratios(values, covariance, TRUE.values, least)
    assert (ratio > 0.5).all()
    assert (ratio < 1.6).all()
    assert stated == pytest.approx(1.0, rel=0.05)
    error = values - TRUE.values
    distance2 = np.einsum("ni,nij,nj->n", error, np.linalg.inv(covariance), error)
    assert scipy.stats.chi2.ppf(1e-4, 10 * lanes) < distance2.sum() < scipy.stats.chi2.ppf(1 - 1e-4, 10 * lanes)


def test_tossed_the_shares_are_at_the_bound_and_the_rest_is_not_told() -> None:
    """Two flights, one after the other: centre of mass and shares at the bound; mass and size stay at the prior."""
    flights = [toss(0), toss(1)]
    info = sum(information(made, X, HALF, SENSORS, NOISE, GRAVITY) for made in flights)
    belief = None
    for j, made in enumerate(flights):
        belief = told(made, 24, belief, first=100 * j)
    assert belief is not None
    values, covariance = tracker().values(belief, held=False)
    least = least_covariance(np.asarray(info), derivative(shares_of, X, HALF))
    ratio, stated = ratios(values, covariance, shares_of(X, HALF), least)
    assert (ratio > 0.5).all()
    assert (ratio < 1.6).all()
    assert stated == pytest.approx(1.0, rel=0.05)
    # of ten two are not told: the mass, and the size of the inertia
    by = derivative(values_of, X, HALF)
    assert np.isinf(np.diag(least_covariance(np.asarray(info), by)))[[0, 4, 5, 6]].all()
    assert np.isfinite(np.diag(least_covariance(np.asarray(info), by)))[1:4].all()
    mass_by = derivative(values_of, belief.x, HALF)[:, 0] / values_of(belief.x, HALF)[:, :1]
    mass_sd = np.sqrt(np.einsum("ni,nij,nj->n", mass_by, belief.x_covariance, mass_by))
    assert mass_sd == pytest.approx(2 * np.sqrt(0.3**2 + (np.log(2) / 2) ** 2), rel=1e-3)


def test_the_recursion_is_the_batch_answer() -> None:
    """All unknowns at once, every wrench among them, by scipy on its own differences: to a fraction of what is unknown.

    What is left is what motions that are linearised as they pass cost, measured 0.12.
    """
    made = shake(0.2)
    readings = made.measured(SENSORS, NOISE, [(5, 2)])
    belief = tracker().start(SpacePrior(START), readings[0])
    for reading in readings[1:]:
        belief = tracker().update(belief, reading)
    m, sd = len(readings), SENSORS.sd(NOISE)
    prior = np.linalg.inv(np.linalg.cholesky(SpacePrior(START).covariance))
    carried = np.array([SENSORS.to_point @ r.wrench[0] for r in readings if r.wrench is not None])
    measured = Motion(*(np.stack(parts) for parts in zip(*(r.motion for r in readings), strict=True)))
    faster = np.stack([r.acceleration for r in readings])
    count = 22 + 6 * m

    def residuals(u: np.ndarray) -> np.ndarray:
        """Of many tries (L, count) at once."""
        off = u[:, 22:].reshape(-1, m, 6).swapaxes(0, 1)
        held = carried[:, None] + off @ SENSORS.wrench_root.T
        body = body_of(START + u[:, :10], HALF)
        start = Motion(*(np.broadcast_to(part[0, 0], (len(u), *part.shape[2:])) for part in measured))
        motion = followed(body, start.moved(1e-3 * u[:, 10:22]), held, STEP_S, GRAVITY)
        apart = np.concatenate([measured.less(motion), faster - accelerations(body, motion.rate, held)], axis=-1) / sd
        return np.hstack([apart.swapaxes(0, 1).reshape(len(u), -1), u[:, 22:], u[:, :10] @ prior.T])

    def by(u: np.ndarray) -> np.ndarray:
        both = residuals(np.concatenate([u + 1e-5 * np.eye(count), u - 1e-5 * np.eye(count)]))
        return ((both[:count] - both[count:]) / 2e-5).T

    fit = scipy.optimize.least_squares(lambda u: residuals(u[None])[0], np.zeros(count), by, x_scale="jac")
    deviation = np.sqrt(np.diagonal(belief.x_covariance[0]))
    assert np.abs(X - START).max() > 0.3
    assert deviation.max() < 0.1
    assert np.abs((fit.x[:10] + START - belief.x[0]) / deviation).max() < 0.25


def test_whatever_is_believed_can_exist() -> None:
    """After three readings too, every lane's inertia is one of a body."""
    for x in told(shake(0.02), 10).x:
        moments = np.linalg.eigvalsh(from_vector(x, HALF).inertia_kg_m2)
        assert moments[0] > 0
        assert moments[2] < moments[0] + moments[1]


def test_an_estimate_freezes_and_is_set_free_when_the_body_changes() -> None:
    """It stays what it was while it fits; half a kilogram more in the hand is noticed, and found."""
    watch = SpaceWatch(tracker(), 0.05)
    readings = shake(0.8).measured(SENSORS, NOISE, [(3, 2)])
    watched = watch.start(SpacePrior(START), readings[0])
    given = []
    for reading in readings[1:]:
        watched = watch.update(watched, reading)
        if watched.frozen is not None:
            given.append(watch.values(watched))
    assert len(given) > 10
    assert watched.alarms == 0
    assert (given[0] == given[-1]).all()
    assert given[0][0] == pytest.approx(1.2, rel=0.05)
    heavier = numbers_of(Inertial(1.7, TRUE.com_m, INERTIA), HALF)
    other = shaken(heavier, HALF, step_s=STEP_S, duration_s=0.8, gravity=GRAVITY, seed=4)
    changed = other.measured(SENSORS, NOISE, [(4, 2)])
    watched = watch.begun(watched, changed[0])
    for reading in changed[1:]:
        watched = watch.update(watched, reading)
    assert watched.alarms >= 1
    assert watched.frozen is not None
    assert watch.values(watched)[0] == pytest.approx(1.7, rel=0.05)
    assert watched.names == NAMES


def test_numbers_that_did_not_arrive_are_left_out() -> None:
    """Without accelerometers and every other pose the estimate is still right; a beginning must be complete."""
    made = shake()
    belief = None
    for k, reading in enumerate(made.measured(SENSORS, NOISE, [(9, 2)])):
        nothing = np.full_like(reading.acceleration, np.nan)
        part = Reading(reading.motion, nothing, reading.wrench)
        if k % 2:
            missing = reading.motion._replace(turn=np.full((1, 3, 3), np.nan), position=np.full((1, 3), np.nan))
            part = replace(part, motion=missing)
        belief = tracker().update(belief, part) if belief else tracker().start(SpacePrior(START), part)
    assert belief is not None
    values, covariance = tracker().values(belief)
    error = values[0] - TRUE.values
    assert error @ np.linalg.solve(covariance[0], error) < 30  # chi-squared, 10 degrees of freedom: 99.9 %
    reading = made.measured(SENSORS, NOISE, [(9, 2)])[0]
    lost = replace(reading, motion=reading.motion._replace(rate=np.full((1, 3), np.nan)))
    with pytest.raises(RecordingError, match="first one of an episode must have a pose and a velocity"):
        tracker().start(SpacePrior(START), lost)
    with pytest.raises(RecordingError, match="not a rotation matrix"):
        replace(reading, motion=reading.motion._replace(turn=2 * np.eye(3)[None]))
    with pytest.raises(RecordingError, match="wrench is not finite"):
        replace(reading, wrench=np.full((1, 6), np.nan))


def experiment(**changes: Any) -> Experiment:
    """The body as settings."""
    remote = RemoteConfig(1.2, (0.12, 0.08, 0.05), (0.02, -0.015, 0.01), (3.8e-3, 6.4e-3, 7.4e-3))
    values: dict[str, Any] = {
        "seed": 0,
        "scene": SceneConfig(timestep_s=0.002),
        "forces": Straight(),
        "remote": remote,
        "start": StartConfig(2.4),
        "link": LinkConfig(rate_hz=100, noise=NOISE),
        "estimator": {"linear": Linear()},
    }
    return Experiment(**(values | changes))


def test_the_study_says_what_a_flight_does_not_tell(tmp_path: Path) -> None:
    """A row for each share at the bound, and one for the mass, whose bound is infinite."""
    rows = Space(shakes=0, tosses=1, seeds=4, toss_s=0.3).rows(experiment(), tmp_path)
    assert [row["parameter"] for row in rows] == [*SHARES, "mass_kg"]
    assert all(0.2 < row["ratio"] < 3 for row in rows[:-1])
    assert np.isinf(rows[-1]["bound"])
    assert (tmp_path / "over_time.parquet").is_file()


def test_what_is_wrong_is_one_line(tmp_path: Path) -> None:
    """Each names its setting."""
    with pytest.raises(ConfigError, match="shakes, tosses: at least one"):
        Space(shakes=0, tosses=0)
    with pytest.raises(
        ConfigError, match=r"remote, study\.products_kg_m2\.inertia: no body has these principal moments"
    ):
        Space(products_kg_m2=(0.006, 0.0, 0.0)).rows(experiment(), tmp_path)
    with pytest.raises(ConfigError, match=r"link\.noise\.position_m: must be above 0"):
        Space().rows(experiment(link=LinkConfig(rate_hz=100)), tmp_path)
    with pytest.raises(ConfigError, match=r"study\.shake_s: must be 1 to 600 readings at 100 Hz"):
        Space(shake_s=20.0).rows(experiment(), tmp_path)
    with pytest.raises(ConfigError, match="certain"):
        SpaceEstimator(certain=0.0)
    with pytest.raises(ConfigError, match="force_n"):
        SensorConfig(force_n=0.0)
