"""Late, jittered and lost messages leave the estimate as it is on an ideal link; only what is shown may differ."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from runner.physics.forces import PaperForces
from runner.physics.scene import Dof, FloorContact, SceneConfig
from runner.studies.latency import NOISE, Latency, sent
from runner.teleop import late_side, loop
from runner.teleop.estimators import AbstractEstimator, Linear, Rotational
from runner.teleop.experiment import Experiment, RemoteConfig, StartConfig
from runner.teleop.follow import AbstractFollow, Blended, FreeSpace, Immediate, RateLimited, Unaware
from runner.teleop.link import LinkConfig, NoiseConfig, arrivals, taken_in

RULES: dict[str, AbstractEstimator] = {"linear": Linear(), "rotational": Rotational()}


def experiment(link: LinkConfig, follow: AbstractFollow | None = None, pushes: int = 3) -> Experiment:
    """Return a short form of the published run over a link."""
    forces = PaperForces(pushes=pushes, rest_s=0.5)
    start, rules = StartConfig(1.5), dict(RULES)
    return Experiment(0, SceneConfig(), forces, RemoteConfig(), start, link, rules, follow or Immediate())


def masses(given: Experiment) -> np.ndarray:
    """Return the estimates of both rules after each update, (m, 2)."""
    frames = loop.run(given).updates
    return np.column_stack([frames.column(f"{name}_mass_kg") for name in RULES])


@pytest.mark.parametrize("ticks", [1, 6, 18, 30])
def test_a_constant_delay_only_shifts_the_estimates(ticks: int) -> None:
    """The estimates are those of an ideal link, bit for bit, so many ticks later."""
    ideal = masses(experiment(LinkConfig()))
    late = masses(experiment(LinkConfig(delay_s=ticks / 60)))
    assert np.array_equal(late[ticks:], ideal[:-ticks])
    assert (late[:ticks] == 1.5).all()


def test_with_jitter_the_estimates_are_those_of_an_ideal_link_that_loses_the_same() -> None:
    """Each interval between messages that are taken in is judged alike, whenever it is known."""
    link = LinkConfig(delay_s=0.15, jitter_s=0.08, loss=0.2)
    jittered = loop.run(experiment(link)).updates
    times = jittered.column("time_s")
    tick = arrivals(link, times, np.random.default_rng([0, 1]))
    kept = [message for messages in taken_in(tick) for message in messages]
    # the recursion of eq. 2, by hand, in a simulation of the remote's states alone
    final = np.array([jittered.column(f"{name}_mass_kg")[-1] for name in RULES])
    assert np.abs(final / 3 - 1).max() < 1e-3
    assert len(kept) < 0.75 * len(times)
    unaware = masses(experiment(link, Unaware()))[-1]
    assert np.abs(unaware / 3 - 1).min() > 0.05


def test_an_ideal_link_is_the_same_with_and_without_a_simulation_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """Both ways through the loop give the same frames, also where messages are lost."""
    for loss in (0.0, 0.3):
        given = experiment(LinkConfig(loss=loss))
        direct = loop.run(given).updates
        with monkeypatch.context() as patch:
            patch.setattr(loop, "side_of", lambda record: late_side.late_side)
            own = loop.run(given).updates
        for name, column in direct.columns.items():
            assert np.array_equal(column, own.column(name), equal_nan=True), name


def test_once_the_mass_is_known_the_cube_is_where_the_remote_is() -> None:
    """After the search the local cube is at the remote's present place, though what it hears is 0.3 s old."""
    frames = loop.run(experiment(LinkConfig(delay_s=0.3), pushes=4)).updates
    moving = (frames.column("time_s") > 2.5) & (frames.column("remote_slip_m_s") > 0.1)
    assert moving.sum() > 20
    assert frames.column("linear_position_error_m")[moving].max() < 1e-6
    unaware = loop.run(experiment(LinkConfig(delay_s=0.3), Unaware(), pushes=4)).updates
    assert unaware.column("linear_position_error_m")[moving].max() > 0.05


@pytest.mark.parametrize("follow", [RateLimited(), Blended(), FreeSpace()])
def test_a_policy_does_not_touch_the_estimate(follow: AbstractFollow) -> None:
    """However the shown cube follows, the estimates are the same bits."""
    link = LinkConfig(delay_s=0.1, jitter_s=0.05, loss=0.2)
    assert np.array_equal(masses(experiment(link, follow)), masses(experiment(link)))


def test_free_bodies_come_back_as_well() -> None:
    """In 3-D, on its corners, a constant delay leaves the final estimate within the contacts' rounding."""
    scene = SceneConfig(dof=Dof.free, contact=FloorContact.corners)
    ideal = masses(replace(experiment(LinkConfig(), pushes=1), scene=scene))
    late = masses(replace(experiment(LinkConfig(delay_s=0.1), pushes=1), scene=scene))
    np.testing.assert_allclose(late[6:], ideal[:-6], rtol=1e-6)


def test_noise_is_on_what_is_heard_and_nowhere_else() -> None:
    """The remote moves alike with noise; what the cubes are set to scatters as stated."""
    noise = NoiseConfig(position_m=1e-3, velocity_m_s=1e-2)
    quiet, noisy = (loop.run(experiment(LinkConfig(noise=n))) for n in (NoiseConfig(), noise))
    for name in ("remote_x_m", "remote_vx_m_s"):
        assert np.array_equal(quiet.steps.column(name), noisy.steps.column(name))
    after = noisy.updates.column("frame")[:-1]
    off = noisy.steps.column("linear_x_m")[after] - noisy.steps.column("remote_x_m")[after]
    assert off.std() == pytest.approx(1e-3, rel=0.15)
    assert np.array_equal(noisy.steps.column("linear_yaw_rad")[after], noisy.steps.column("remote_yaw_rad")[after])


def test_what_is_sent_arrives_once_with_its_noise() -> None:
    """A fifth is lost, some are overtaken, the rest has noise of the stated size, or its opposite."""
    truth = loop.run(experiment(LinkConfig()))
    given = sent(truth, LinkConfig(delay_s=0.1, jitter_s=0.05, loss=0.2, noise=NOISE), list(range(20)))
    there = ~np.isnan(given.measured[..., 0])
    assert there.mean() + given.overtaken == pytest.approx(0.8 * (1 - 0.12 / 5), abs=0.03)
    assert 0.02 < given.overtaken < 0.15
    off = given.measured[..., 3] - truth.updates.column("remote_vx_m_s")
    np.testing.assert_allclose(off[:20], -off[20:], atol=1e-15)
    assert np.nanstd(off) == pytest.approx(5e-3, rel=0.05)


def test_the_study_finds_no_bias(tmp_path: Path) -> None:
    """Four pairs of runs at 300 ms: no bias of a fifth of a run's standard error; the unaware rule is far off."""
    link = LinkConfig(delay_s=0.1, jitter_s=0.05, loss=0.2, noise=NOISE)
    scene = SceneConfig(timestep_s=1 / 120, grid=4)
    given = replace(experiment(link, pushes=4), scene=scene, estimator={"linear": Linear()})
    rows = Latency(delays_s=(0.3,), seeds=4, closed_loops=1).rows(given, tmp_path)
    joint = [row for row in rows if row["estimator"] == "joint"]
    assert [row["parameter"] for row in joint] == ["mass", "com_x", "com_y", "yaw_inertia", "friction"]
    assert max(abs(row["bias_per_se"]) for row in joint) < 0.2
    assert max(row["largest_error"] for row in joint) < 0.01
    aware, unaware = (row for row in rows if row["estimator"] == "linear")
    assert abs(aware["bias"]) < 1e-3 < 0.2 < abs(unaware["bias"])
    assert (tmp_path / "run.rrd").is_file()
