"""Pushes are chosen by what they will tell; freezing, alarms and averages do what they say."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import yaml

from runner.__main__ import main
from runner.estimation.averaged import Average, Averaged, AveragedMemory
from runner.estimation.belief import Prior
from runner.estimation.calibration import Calibrated, LimitsConfig, Planner, Thing, calibrate
from runner.estimation.copies import MASS, Copies, errors, to_vector
from runner.estimation.data import measured_sd
from runner.estimation.tracker import Tracker
from runner.estimation.watch import Watch
from runner.physics.forces import PaperForces
from runner.physics.scene import BodyConfig, SceneConfig, push_columns
from runner.studies.calibration import in_turn, train
from runner.teleop.estimators import Linear, Outcome
from runner.teleop.link import NoiseConfig
from tests.test_estimators import Slide

SCENE = SceneConfig(timestep_s=1 / 120)
TRUE = to_vector(BodyConfig(3.0, 0.3, com_m=(0.06, -0.04, 0.0)))
SD = np.array([0.7, 0.3, 0.3, 0.7, 0.7])
NOISE = measured_sd(NoiseConfig(5e-4, 1e-3, 5e-3, 1e-2))
PERIOD, TARGET = 2, 0.01


def parts(limits: LimitsConfig) -> tuple[Copies, Tracker, Planner]:
    """The model, an estimator, a planner."""
    copies = Copies(SCENE, BodyConfig(1.0, 0.5))
    tracker = Tracker(copies, NOISE)
    return copies, tracker, Planner(tracker, limits, PERIOD, TARGET)


@cache
def chosen(workspace_m: float = 1.0) -> Calibrated:
    """A calibration from a start 1.5 times too light."""
    copies, tracker, planner = parts(LimitsConfig(workspace_m=workspace_m))
    thing = Thing(copies, TRUE, NOISE, np.random.default_rng(4))
    prior = Prior(TRUE + np.array([-0.4, 0.1, -0.1, 0.3, -0.3]), SD)
    return calibrate(
        thing, tracker, prior, lambda belief, _: planner.next(belief, np.zeros(2)),
        period=PERIOD, target=TARGET, longest_s=4.0,
    )  # fmt: skip


def test_calibration_reaches_what_was_asked() -> None:
    """Within a few pushes every interval is within 1 %, and holds the truth about as it should."""
    done = chosen()
    assert done.reached
    assert len(done.pushes) <= 4
    assert (1.96 * done.belief.sd <= TARGET * (1 + 1e-3)).all()
    assert np.abs(errors(done.belief.x[0], TRUE)).max() < 2 * TARGET
    assert all(np.hypot(*p.force_n[:2]) == pytest.approx(15.0) for _, p in done.pushes)


def test_calibration_is_faster_than_the_papers_sequence() -> None:
    """Chosen pushes need less than half of the time of the paper's."""
    copies, tracker, _ = parts(LimitsConfig())
    thing = Thing(copies, TRUE, NOISE, np.random.default_rng(4))
    prior = Prior(TRUE + np.array([-0.4, 0.1, -0.1, 0.3, -0.3]), SD)
    paper = calibrate(
        thing, tracker, prior, in_turn(train(PaperForces(), SCENE.timestep_s, PERIOD)),
        period=PERIOD, target=TARGET, longest_s=8.0,
    )  # fmt: skip
    assert paper.reached
    assert chosen().time_s < 0.5 * paper.time_s


def test_the_workspace_is_kept() -> None:
    """With 15 cm to go the cube stays within them, up to what its unknown mass makes of the first push."""
    assert chosen(0.15).reach_m < 0.25
    assert chosen().reach_m > chosen(0.15).reach_m


def test_a_train_of_pushes_is_the_sequence() -> None:
    """Cut into pushes, a sequence has the commands that it had, and as many pushes."""
    forces = PaperForces(pushes=3)
    pushes = train(forces, SCENE.timestep_s, PERIOD)
    n = sum(len(p.columns) for p in pushes)
    force, point = forces.columns(np.arange(n) * SCENE.timestep_s, SCENE.timestep_s)
    assert np.array_equal(np.vstack([p.columns for p in pushes]), push_columns(force, point))
    assert sum(p.push_s > 0 for p in pushes) == 3


def test_a_certain_estimate_freezes_and_a_change_sets_it_free() -> None:
    """Frozen once certain; a mass that jumps by half is noticed within 0.5 s, and found; without a change no alarm."""
    copies, tracker, _ = parts(LimitsConfig())
    watch = Watch(tracker, certain=0.05)
    rng, state = np.random.default_rng(2), np.zeros((1, 6))
    heavier = TRUE + np.array([np.log(1.5), 0, 0, np.log(1.5), 0])
    watched = watch.start(Prior(TRUE + 0.2 * SD, SD), state)
    frozen, alarms = [], []
    forces = PaperForces(force_n=25.0, pushes=4, lead_s=0.0, rest_s=0.5)
    n = round(forces.duration_s / SCENE.timestep_s)
    columns = push_columns(*forces.columns(np.arange(n) * SCENE.timestep_s, SCENE.timestep_s))
    for k in range(0, n, PERIOD):
        x = heavier if k >= 260 else TRUE  # 2.17 s: during the third push
        state = copies.run(x[None], state, columns[k : k + PERIOD])
        watched = watch.update(watched, columns[k : k + PERIOD], state + NOISE * rng.standard_normal((1, 6)))
        frozen.append(watched.frozen is not None)
        alarms.append(watched.alarms)
    assert frozen[255 // PERIOD]
    assert alarms[258 // PERIOD] == 0
    assert 1 in alarms
    assert alarms.index(1) * PERIOD * SCENE.timestep_s - 260 * SCENE.timestep_s < 0.5
    assert watched.alarms == 1
    assert np.exp(watched.x[0, MASS] - heavier[MASS]) == pytest.approx(1.0, abs=0.05)


def test_averages_pass_over_single_wild_estimates() -> None:
    """The median of the last estimates ignores one that is off; the mean takes its share; both hold with the rule."""
    slide = Slide(0.5, 15.0, 0.3)
    wild = AveragedMemory(3.0, (3.0, 3.0, 30.0, 3.0))
    for average, expected in ((Average.median, 3.0), (Average.mean, 8.4)):
        rule = Averaged(Linear(), average, 5)
        memory, outcome = rule.update(wild, slide.seen(3.0))
        assert outcome is Outcome.updated
        assert rule.values(memory)[0] == pytest.approx(expected, rel=1e-6)
        assert len(rule.update(memory, slide.seen(3.0))[0].last_kg) == 5


def test_the_command_writes_a_model_that_moves_like_the_object(tmp_path) -> None:
    """`runner calibrate` ends well, and its files say what it found."""
    settings = ["scene.timestep_s=0.008333333333333333", "target=0.05", "start.mass_kg=2", f"out={tmp_path}"]
    assert main(["calibrate", *settings]) == 0
    content = yaml.safe_load((tmp_path / "calibrated.yaml").read_text(encoding="utf-8"))
    assert content["certain"]
    for name, true in (("mass_kg", 3.0), ("friction_coefficient", 0.3), ("yaw_inertia_kgm2", 0.5)):
        assert content["parameters"][name]["value"] == pytest.approx(true, rel=0.1)
        assert content["parameters"][name]["observed"]
    assert (tmp_path / "model.xml").stat().st_size > 1000
    lines = (tmp_path / "pushes.csv").read_text(encoding="utf-8").splitlines()
    assert lines[0] == "t,fx,fy,fz,px,py,pz"
    assert len(lines) == 2 + 2 * content["pushes"]
