"""The closed loop: the published run, its limits, and that nothing but physics decides a single bit of it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import pytest
from mujoco import rollout

from runner.effects.planar_box import ActuatorGain, FloorTilt, Mass, ObservationDelay, ViscousDrag
from runner.errors import ConfigError
from runner.physics import dry_friction
from runner.physics.forces import Offcentre, PaperForces, Ramp, RandomForces, Straight
from runner.physics.scene import Dof, FloorContact, SceneConfig
from runner.teleop import loop
from runner.teleop.batch import run_batch
from runner.teleop.estimators import Linear, LinearGuarded, Outcome, Rotational
from runner.teleop.experiment import Experiment, RemoteConfig, StartConfig, commands, compile_experiment
from runner.teleop.follow import Unaware
from runner.teleop.frames import Frames, RunResult, Status
from runner.teleop.link import LinkConfig

SHORT = PaperForces(pushes=3, rest_s=0.5)
USERDATA = mujoco.mjtState.mjSTATE_USERDATA.value
FULL = mujoco.mjtState.mjSTATE_FULLPHYSICS.value


def experiment(start_kg: float = 1.0, **changes: Any) -> Experiment:
    """Return the published experiment with changes."""
    base = Experiment(
        seed=0,
        scene=SceneConfig(),
        forces=PaperForces(),
        remote=RemoteConfig(),
        start=StartConfig(start_kg),
        link=LinkConfig(),
        estimator={"linear": Linear()},
    )
    return replace(base, **changes)


def same(a: Frames, b: Frames) -> bool:
    """Whether two tables of frames are equal, bit for bit, NaN included."""
    return a.columns.keys() == b.columns.keys() and all(
        np.array_equal(a.column(c).view(np.uint8), b.column(c).view(np.uint8)) for c in a.columns
    )


def same_run(a: RunResult, b: RunResult) -> bool:
    """Whether two runs left the same frames."""
    return same(a.steps, b.steps) and same(a.updates, b.updates)


def error(result: RunResult, name: str = "linear") -> np.ndarray:
    """Return the relative error of the mass after each update."""
    return result.updates.column(f"{name}_mass_error")


@pytest.mark.parametrize("start_kg", [1.0, 1.5, 2.0, 4.0, 6.0])
def test_the_published_run_finds_the_mass(start_kg: float) -> None:
    """True mass 3 kg, 60 Hz: both rules end below 1e-6, from a third of the mass to twice the mass."""
    result = loop.run(experiment(start_kg, estimator={"linear": Linear(), "rotational": Rotational()}))
    assert result.status is Status.done
    assert len(result.updates) == 930
    assert abs(error(result)[-1]) < 1e-6
    assert abs(error(result, "rotational")[-1]) < 1e-6


def test_low_start_masses_peak_early_and_the_guard_removes_the_peak() -> None:
    """From 0.5 kg eq. 2 overshoots by more than the true mass at the first update of the first push; guarded, not."""
    rules = {"linear": Linear(), "guarded": LinearGuarded()}
    result = loop.run(experiment(0.5, estimator=rules))
    peak = int(np.argmax(error(result)))
    assert error(result)[peak] > 1.0
    assert result.updates.column("time_s")[peak] == pytest.approx(0.5 + 1 / 60)
    # m' = M + (M - m) mu g / A, the closed form
    acceleration = 15 / 3 - 0.3 * 9.81
    assert error(result)[peak] == pytest.approx(2.5 * 0.3 * 9.81 / acceleration / 3, rel=1e-5)
    assert np.abs(error(result, "guarded")).max() == pytest.approx(2.5 / 3)  # the start itself
    assert abs(error(result, "guarded")[-1]) < 1e-6


def test_the_error_shrinks_as_predicted_during_a_straight_push() -> None:
    """At every update of the push the error is multiplied by 1 - F T / (M v), as the theory says."""
    result = loop.run(experiment(1.0, forces=Straight(force_n=(15.0, 0, 0), lead_s=0.25, push_s=0.5)))
    speed, err = result.updates.column("remote_vx_m_s"), error(result)
    pushing = np.flatnonzero(result.updates.column("force_x_n") > 14)[1:20]
    rho = 1 - 15 / 60 / 3 / speed[pushing]
    np.testing.assert_allclose(err[pushing], rho * err[pushing - 1], rtol=1e-4, atol=1e-9)


def test_a_ramp_through_breakaway_does_not_lose_the_mass() -> None:
    """Sticking, breaking away and one cube sliding before the other: held, and found in the end."""
    result = loop.run(experiment(1.0, forces=Ramp(slope_n_s=5.0)))
    outcome = result.updates.column("linear_outcome")
    stuck = result.updates.column("remote_slip_m_s") < 1e-6
    assert (outcome[stuck] == Outcome.at_rest).all()
    assert stuck.sum() > 60
    assert abs(error(result)[-1]) < 1e-6


def test_rotation_holds_through_straight_pushes() -> None:
    """A push through the centre turns nothing: the rotational estimate stays at its start."""
    rules = {"rotational": Rotational()}
    straight = loop.run(experiment(forces=Straight(), estimator=rules))
    assert (straight.updates.column("rotational_mass_kg") == 1.0).all()
    offcentre = loop.run(experiment(forces=Offcentre(), estimator=rules))
    assert abs(error(offcentre, "rotational")[-1]) < 0.01


def test_the_local_cube_takes_over_the_remote_state() -> None:
    """At the frame of every update local and remote are equal, bit for bit; within the first push they part."""
    result = loop.run(experiment(forces=SHORT))
    synced = result.updates.column("frame")[:-1]
    for name in ("x_m", "y_m", "yaw_rad", "vx_m_s", "vy_m_s", "wz_rad_s"):
        local, remote = result.steps.column(f"linear_{name}"), result.steps.column(f"remote_{name}")
        assert np.array_equal(local[synced], remote[synced])
    assert result.updates.column("linear_velocity_error_m_s").max() > 0.1


SCENES = [
    SceneConfig(grid=4),
    SceneConfig(contact=FloorContact.corners),
    SceneConfig(contact=FloorContact.feet, grid=2),
    SceneConfig(dof=Dof.free, contact=FloorContact.corners),
]


@pytest.mark.parametrize("scene", SCENES, ids=lambda s: f"{s.dof.value}-{s.contact.value}")
def test_a_batch_has_the_bits_of_single_runs(scene: SceneConfig) -> None:
    """Runs that differ in mass, friction, forces, length, link and effects: in a batch on two threads as one by one."""
    mixed = [
        experiment(0.5, scene=scene, forces=SHORT),
        experiment(2.0, scene=scene, forces=SHORT, remote=RemoteConfig(friction=0.2)),
        experiment(1.0, scene=scene, forces=RandomForces(pushes=2), seed=7, estimator={"rotational": Rotational()}),
        experiment(1.0, scene=scene, forces=SHORT, link=LinkConfig(60.0, 0.05, 0.04, 0.2), seed=3),
        experiment(1.0, scene=scene, forces=SHORT, remote=RemoteConfig(effects={"drag": ViscousDrag(0.5)})),
        experiment(1.0, scene=scene, forces=SHORT, link=LinkConfig(10.0)),
    ]
    together = run_batch(mixed, threads=2)
    for one, batched in zip(mixed, together, strict=True):
        assert same_run(loop.run(one), batched)


def test_a_batch_goes_on_after_the_last_update_as_single_runs_do() -> None:
    """Runs that tick together and end at different times, one of them between two ticks, which no update follows."""
    rests = (0.5, 0.505, 0.502)
    mixed = [experiment(0.5, forces=replace(SHORT, rest_s=rest_s)) for rest_s in rests]
    assert mixed[1].steps % 8
    for one, batched in zip(mixed, run_batch(mixed, threads=1), strict=True):
        assert same_run(loop.run(one), batched)


def test_rollout_replays_the_remote_and_the_local_cube() -> None:
    """`mujoco.rollout` with the same commands gives the remote's bits, and the local's from update to update."""
    given = experiment(forces=SHORT)
    result = loop.run(given)
    compiled = compile_experiment(given)
    model, data, h = compiled.model, compiled.data, given.scene.timestep_s
    pushes = commands(given).pushes
    control = np.zeros((result.step_count, model.nuserdata))
    for body in range(2):
        at = body * dry_friction.USERDATA_SIZE
        control[:, at : at + dry_friction.PUSH_SIZE] = pushes[
            :-1, body * dry_friction.PUSH_SIZE : (body + 1) * dry_friction.PUSH_SIZE
        ]
    names = ("x_m", "y_m", "yaw_rad", "vx_m_s", "vy_m_s", "wz_rad_s")
    states = {who: np.column_stack([result.steps.column(f"{who}_{n}") for n in names]) for who in ("remote", "linear")}
    full = np.zeros((result.step_count, mujoco.mj_stateSize(model, FULL)))
    full[:, 0] = np.arange(result.step_count) * h
    for block, who in ((0, "remote"), (3, "linear")):
        full[:, 1 + block : 4 + block], full[:, 7 + block : 10 + block] = np.split(states[who], 2, axis=1)
    played, _ = rollout.rollout(model, data, full[:1], control[None], control_spec=USERDATA)
    assert np.array_equal(played[0, :-1, [1, 2, 3, 7, 8, 9]].T, states["remote"][1:])
    ends = [0, *result.updates.column("frame").tolist()]
    for k in (0, 30, 31, 33, 40, 60, 90, 100, 130):
        start, end = ends[k], ends[k + 1]
        mass = result.steps.column("linear_mass_kg")[start]
        model.body_mass[2], model.body_inertia[2] = mass, np.full(3, 1 / 6) * mass
        mujoco.mj_setConst(model, compiled.scratch)
        played, _ = rollout.rollout(
            model, data, full[start : start + 1], control[None, start:end], control_spec=USERDATA
        )
        before = [result.updates[k][f"linear_{n}"] for n in names]
        assert played[0, -1, [4, 5, 6, 10, 11, 12]].tolist() == before


def test_same_config_and_seed_give_the_same_bits() -> None:
    """Two runs are equal, also on a world that was used before; another seed gives another link and other forces."""
    given = experiment(forces=RandomForces(pushes=2), link=LinkConfig(60.0, 0.02, 0.03, 0.1), seed=5)
    compiled = compile_experiment(given)
    first, again = loop.run_compiled(given, compiled), loop.run_compiled(given, compiled)
    assert same_run(first, loop.run(given))
    assert same_run(first, again)
    other = loop.run(replace(given, seed=6))
    assert not np.array_equal(first.updates.column("sent_s")[:60], other.updates.column("sent_s")[:60], equal_nan=True)


def test_late_messages_carry_their_time_stamp() -> None:
    """With 100 ms of delay each state taken in is six updates old; unaware, the cube is set to what was then."""
    result = loop.run(experiment(forces=SHORT, link=LinkConfig(60.0, delay_s=0.1), follow=Unaware()))
    sent, now = result.updates.column("sent_s"), result.updates.column("time_s")
    assert np.isnan(sent[:6]).all()
    np.testing.assert_allclose(now[6:] - sent[6:], 0.1, atol=1e-12)
    assert (result.updates.column("linear_outcome")[:6] == Outcome.no_message).all()
    k = 60
    frame, old = int(result.updates.column("frame")[k]), int(result.updates.column("frame")[k - 6])
    assert result.steps.column("linear_x_m")[frame] == result.steps.column("remote_x_m")[old]


def test_nothing_is_learnt_when_all_is_lost() -> None:
    """A link that loses everything leaves the start mass."""
    result = loop.run(experiment(forces=SHORT, link=LinkConfig(loss=1.0)))
    assert (result.updates.column("linear_mass_kg") == 1.0).all()


def test_effects_act_on_the_remote_alone() -> None:
    """A planted mass is the truth; a gain scales the remote's push; a local cube of true mass does not feel drag."""
    heavy = loop.run(experiment(remote=RemoteConfig(effects={"mass": Mass(4.0)})))
    assert heavy.parameters["linear"]["mass_kg"].true == 4.0
    assert abs(error(heavy)[-1]) < 1e-6
    straight = Straight(force_n=(20.0, 0, 0), push_s=0.5)
    plain = loop.run(experiment(3.0, forces=straight))
    gain = loop.run(experiment(3.0, forces=straight, remote=RemoteConfig(effects={"gain": ActuatorGain(1.5)})))
    push = int(np.flatnonzero(plain.updates.column("force_x_n"))[0])
    for result, factor in ((plain, 1.0), (gain, 1.5)):
        wanted = (factor * 20 / 3 - 0.3 * 9.81) / 60
        assert result.updates.column("remote_vx_m_s")[push] == pytest.approx(wanted, rel=1e-4)
        assert result.updates.column("linear_vx_m_s")[push] == pytest.approx((20 / 3 - 0.3 * 9.81) / 60, rel=1e-4)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"estimator": {}}, "estimator: at least one is needed"),
        ({"estimator": {"remote": Linear()}}, "estimator: 'remote' is the name of the remote cube"),
        ({"link": LinkConfig(45.0)}, "link.rate_hz: an update must come after a whole number"),
        ({"seed": -1}, "seed: must be"),
        ({"remote": RemoteConfig(effects={"late": ObservationDelay(0.1)})}, "remote.effects.late: 'observation_delay'"),
    ],
)
def test_experiments_that_can_not_be_run_are_refused(changes: dict[str, Any], message: str) -> None:
    """What does not fit together is refused before anything is compiled."""
    with pytest.raises(ConfigError, match=message):
        experiment(**changes)


def test_what_all_cubes_share_can_not_be_changed_for_one() -> None:
    """A tilted floor would tilt under the local cube as well, so it is refused."""
    with pytest.raises(ConfigError, match=r"effects\.tilt: 'floor_tilt' changes what all cubes of a scene share"):
        loop.run(experiment(remote=RemoteConfig(effects={"tilt": FloorTilt(0.05, 0.0)})))


def test_a_run_that_blows_up_keeps_what_it_had() -> None:
    """A local cube of a nanogram flies off: the run ends as diverged, with its reason, time and frames until then."""
    wild = experiment(1e-12, forces=Straight(force_n=(1e6, 0, 0), lead_s=0.2))
    single, (batched, calm) = loop.run(wild), run_batch([wild, experiment(forces=Straight(lead_s=0.2))])
    for result in (single, batched):
        assert result.status is Status.diverged
        assert result.reason.startswith("MuJoCo warned of ")
        assert result.reason.endswith("after 0.2 s")
        assert len(result.steps) == 96
        assert len(result.updates) == 12
    assert calm.status is Status.done


def test_progress_counts_all_steps() -> None:
    """The function for progress bars is told of steps as they are taken, at most as many as there are."""
    told: list[int] = []
    result = loop.run(experiment(forces=SHORT), told.append)
    assert 0 < sum(told) <= result.step_count
    told.clear()
    run_batch([experiment(forces=SHORT)], advance=told.append)
    assert sum(told) == result.step_count
