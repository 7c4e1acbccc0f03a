"""All parameters of a planar body come out of its motion: exactly without noise, at the Cramer-Rao bound with it."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

from runner.errors import ConfigError
from runner.estimation.belief import Belief, Prior, observable
from runner.estimation.bound import batch_fit, bound, information
from runner.estimation.copies import COM_X, FRICTION, INERTIA, MASS, Copies, errors, from_values, to_values, to_vector
from runner.estimation.data import LEAST_SD, RemoteMotion, measured_sd, motion_of
from runner.estimation.joint import Joint
from runner.estimation.tracker import Tracker
from runner.physics.forces import PaperForces, Straight
from runner.physics.scene import BodyConfig, FloorContact, SceneConfig
from runner.teleop.batch import run_batch
from runner.teleop.estimators import Linear
from runner.teleop.experiment import Experiment, RemoteConfig, StartConfig
from runner.teleop.link import LinkConfig, NoiseConfig
from runner.teleop.loop import run

NOISE = NoiseConfig(position_m=5e-4, angle_rad=1e-3, velocity_m_s=5e-3, rate_rad_s=1e-2)
SCENE = SceneConfig(timestep_s=1 / 120)
REMOTE = RemoteConfig(mass_kg=3.0, com_m=(0.06, -0.04, 0.0), inertia_kg_m2=(0.6, 0.6, 0.6))
SD = np.array([np.log(2), 0.3, 0.3, np.log(2), np.log(2)])


def experiment(pushes: int = 2, **changes: Any) -> Experiment:
    """The paper's sequence, cut short."""
    values: dict[str, Any] = {
        "seed": 0,
        "scene": SCENE,
        "forces": PaperForces(pushes=pushes, lead_s=0.1, rest_s=0.5),
        "remote": REMOTE,
        "start": StartConfig(mass_kg=3.0),
        "link": LinkConfig(),
        "estimator": {"linear": Linear()},
    }
    return Experiment(**(values | changes))


@cache
def motion() -> RemoteMotion:
    """Two pushes."""
    return motion_of(experiment())


def copies() -> Copies:
    """The model, with nothing of the truth in it."""
    return Copies(SCENE, BodyConfig(1.0, 0.5))


def told(tracker: Tracker, belief: Belief, given: RemoteMotion, measured: np.ndarray) -> Belief:
    """Return what is believed after all measurements (N, m, 6)."""
    for k, pushes in enumerate(given.windows()[: measured.shape[1]]):
        belief = tracker.update(belief, pushes, measured[:, k])
    return belief


def test_vectors_and_values_are_inverse() -> None:
    """A vector of a body's parameters gives its values back."""
    body = BodyConfig(2.5, 0.4, (0.5, 0.3, 0.2), (0.1, -0.05, 0.0), (0.4, 0.5, 0.6))
    x = to_vector(body)
    values = to_values(x, body.half_size_m)
    assert values == pytest.approx([2.5, 0.1, -0.05, 0.6, 0.4])
    assert from_values(values, body.half_size_m) == pytest.approx(x)
    assert errors(x + 0.01, x)[[MASS, COM_X]] == pytest.approx([np.expm1(0.01), 0.01])


def test_copies_move_as_the_remote_does() -> None:
    """A copy with the true parameters follows the remote of a dm-control run, whatever it was built with."""
    given, model = motion(), copies()
    state, furthest = np.zeros((1, 6)), 0.0
    for pushes, true in zip(given.windows(), given.states, strict=True):
        state = model.run(given.true_x[None], state, pushes)
        furthest = max(furthest, float(np.abs(state[0] - true).max()))
    assert np.ptp(given.states[:, 0]) > 0.1
    assert furthest < 1e-9


def test_copies_refuse_what_the_law_does_not_carry() -> None:
    """The scene must be planar, on the patch."""
    with pytest.raises(ConfigError, match=r"scene\.contact=patch, got planar and feet"):
        Copies(SceneConfig(contact=FloorContact.feet), BodyConfig(1.0, 0.3))


def test_without_noise_starts_a_factor_of_two_off_end_exactly() -> None:
    """Mass, CoM, inertia and friction within 0.1 % from starts that are all too high, and low and high in turn."""
    given = motion()
    signs = np.array([[1, 1, 1, 1, 1], [-1, 1, -1, 1, -1]])
    tracker = Tracker(copies(), LEAST_SD)
    belief = tracker.start(Prior(given.true_x + signs * SD, SD), np.zeros((2, 6)))
    belief = told(tracker, belief, given, np.repeat(given.states[None], 2, axis=0))
    assert np.abs(errors(belief.x, given.true_x)).max() < 1e-3


@pytest.mark.slow
def test_with_noise_errors_are_those_of_the_bound() -> None:
    """Over 24 seeds the error is the Cramer-Rao bound's, within what 24 seeds can tell (chi-squared, 1e-4), intervals
    hold the truth, and the covariance is that of the bound."""
    given, seeds = motion(), 24
    tracker = Tracker(copies(), measured_sd(NOISE))
    measured = given.measured(NOISE, range(seeds))
    belief = told(tracker, tracker.start(Prior(given.true_x + 0.3 * SD, SD), measured[:, 0]), given, measured)
    info = information(tracker.copies, given.unknowns, given.pushes, given.ends, tracker.noise_sd)
    least = bound(info)[-1]
    off = belief.x - given.true_x
    ratio = np.sqrt((off**2).mean(axis=0)) / least
    assert (ratio > 0.5).all()
    assert (ratio < 1.6).all()
    assert np.median(belief.sd, axis=0) == pytest.approx(least, rel=0.1)
    assert 0.88 <= (np.abs(off) <= 1.96 * belief.sd).mean() <= 0.995


def test_the_batch_answer_is_the_recursive_one() -> None:
    """All data at once, by scipy, give what the recursion gave, to a fraction of the uncertainty."""
    given = motion()
    tracker = Tracker(copies(), measured_sd(NOISE))
    measured = given.measured(NOISE, [7])
    belief = told(tracker, tracker.start(Prior(given.true_x + 0.5 * SD, SD), measured[:, 0]), given, measured)
    begin = belief.unknowns[0] + np.concatenate([np.zeros(6), 2.0 * belief.sd[0]])
    fit = batch_fit(tracker.copies, begin, given.pushes, given.ends, measured[0], tracker.noise_sd)
    assert (np.abs(fit.unknowns[6:] - belief.x[0]) < 0.5 * belief.sd[0]).all()
    assert np.sqrt(np.diagonal(fit.covariance)[6:]) == pytest.approx(belief.sd[0], rel=0.05)


def test_what_the_data_cannot_tell_stays_at_its_prior() -> None:
    """A cube that sticks under its push tells nothing: every parameter stays, and none is observable."""
    held = motion_of(experiment(forces=Straight((5.0, 0.0, 0.0), push_s=0.4, rest_s=0.1)))
    tracker = Tracker(copies(), measured_sd(NOISE))
    measured = held.measured(NOISE, [1])
    belief = told(tracker, tracker.start(Prior(held.true_x, SD), measured[:, 0]), held, measured)
    assert belief.x[0] == pytest.approx(held.true_x, abs=1e-3)
    assert belief.sd[0] == pytest.approx(SD, rel=1e-3)
    assert not observable(belief.sd[0], SD).any()


def test_a_glide_tells_of_friction_and_not_of_mass() -> None:
    """A straight glide is slowed by mu g, whatever the mass: friction becomes known, mass and inertia do not."""
    tracker = Tracker(copies(), measured_sd(NOISE))
    x = to_vector(BodyConfig(3.0, 0.3))
    state, rng = np.array([[0.0, 0, 0, 1.5, 0, 0]]), np.random.default_rng(3)
    belief = tracker.start(Prior(x, SD), state)
    nothing = np.zeros((2, 12))
    for _ in range(25):
        state = tracker.copies.run(x[None], state, nothing)
        belief = tracker.update(belief, nothing, state + tracker.noise_sd * rng.standard_normal((1, 6)))
    assert belief.sd[0, FRICTION] < 0.02
    # noise leaves a little spin possible, and how that would fade tells a little of mass over inertia
    assert belief.sd[0, MASS] > 0.97 * SD[MASS]
    assert belief.sd[0, INERTIA] > 0.9 * SD[INERTIA]


def test_known_parameters_stay_known() -> None:
    """A prior without width is not moved, and the others are estimated given it."""
    given = motion()
    sd = np.array([0.0, 0.3, 0.3, 0.0, 0.0])
    tracker = Tracker(copies(), LEAST_SD)
    start = given.true_x + np.array([0, 0.3, -0.3, 0, 0])
    belief = told(tracker, tracker.start(Prior(start, sd), np.zeros((1, 6))), given, given.states[None])
    assert belief.x[0] == pytest.approx(given.true_x, abs=1e-6)
    assert belief.sd[0, [MASS, INERTIA, FRICTION]] == pytest.approx([0.0] * 3)


def test_missing_messages_and_missing_numbers_only_widen() -> None:
    """Every second message lost, and all velocities missing: still right, and less certain."""
    given = motion()
    tracker = Tracker(copies(), measured_sd(NOISE))
    full = given.measured(NOISE, [5])
    thin = full.copy()
    thin[:, ::2], thin[:, :, 3:] = np.nan, np.nan
    found = [
        told(tracker, tracker.start(Prior(given.true_x + 0.3 * SD, SD), full[:, 0]), given, m) for m in (full, thin)
    ]
    assert (found[1].sd > found[0].sd).all()
    assert (np.abs(found[1].x - given.true_x) < 4 * found[1].sd).all()


def test_a_belief_anchored_anew_believes_the_same() -> None:
    """Summing up the history in mean and covariance changes neither the parameters nor the present state."""
    given = motion()
    tracker = Tracker(copies(), measured_sd(NOISE))
    measured = given.measured(NOISE, [2])
    belief = told(tracker, tracker.start(Prior(given.true_x + 0.3 * SD, SD), measured[:, 0]), given, measured[:, :60])
    again = tracker.rebased(belief)
    assert again.x == pytest.approx(belief.x)
    assert again.sd == pytest.approx(belief.sd, rel=1e-6)
    assert again.now[0] == pytest.approx(belief.now[0], abs=1e-12)
    assert np.diagonal(again.now[1][0]) == pytest.approx(np.diagonal(belief.now[1][0]), rel=1e-5, abs=1e-14)


def test_in_the_closed_loop_alone_and_in_a_batch() -> None:
    """The joint estimator moves the local cube's CoM, inertia and friction, too; a batch gives the same bits."""
    one = experiment(start=StartConfig(mass_kg=2.0, friction=0.4), estimator={"joint": Joint(), "linear": Linear()})
    alone, (together, _) = run(one), run_batch([one, experiment(estimator={"a": Joint(), "b": Linear()})])
    last = alone.updates[-1]
    for name, truth in alone.parameters["joint"].items():
        assert abs(truth.error(last[f"joint_{name}"])) < 1e-3, name
    # with everything right the local cube no longer leaves the remote
    assert last["joint_position_error_m"] < 1e-6 < alone.updates.column("joint_position_error_m").max()
    for name, column in alone.updates.columns.items():
        assert np.array_equal(column, together.updates.column(name), equal_nan=True), name
