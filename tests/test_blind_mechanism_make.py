"""Made mechanisms: the MJCF is the made world, planted effects are those of the vocabulary, targets are scored."""

from __future__ import annotations

import inspect
import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from runner.__main__ import main
from runner.blind.make import CasePlan, Mix, Purpose, make_cases, plan_cases
from runner.blind.mechanism.case import SYSTEMS, Unplanted
from runner.blind.mechanism.draw import DRAWN, Needs
from runner.blind.mechanism.excite import Clock, draw_episodes, is_calm
from runner.blind.mechanism.files import nominal_of, table_of, write_case
from runner.blind.mechanism.maker import Circumstances, MechanismMaker
from runner.blind.mechanism.physics import COARSE_S, PlannedEpisode, simulate, simulate_or_none
from runner.blind.mechanism.plants import TOGETHER_ALIKE, VOCABULARY, Plant, kinds_of
from runner.blind.mechanism.plants.plant import full
from runner.blind.oracle import candidates_of
from runner.blind.run import copy_cases
from runner.blind.score import blind_score
from runner.blind.worlds import MAKERS
from runner.diagnosis.score import is_right
from runner.effects.mechanism import EFFECTS
from runner.errors import ResultError
from runner.recording.model_form import read_model_case
from runner.systems.case import open_case
from runner.systems.mechanism.system import MechanismSystem
from runner.systems.simulator import Run

ARM = MechanismMaker("arm2")
EVERYTHING = Needs(servo=True, motor=True, dry=True, velocities=True)
# between drive and link MuJoCo has a soft limit, and the start of the drive is not known
SOFT = ("backlash", "compliance")


def drawn(system: str, seed: int, count: int, needs: Needs | None = None, *, jitter: float = 0.0) -> Unplanted:
    """Return a mechanism that moves freely at first, and so many of its episodes, cut to a second and a half."""
    g = np.random.default_rng(seed)
    world = DRAWN[system](needs or Needs(dry=True), g)
    episodes = [cut(e) for e in draw_episodes(world, Clock(100.0, jitter), g, held=False)[:count]]
    paths = [simulate(world, e) for e in episodes]
    return Unplanted(SYSTEMS[system], world, episodes, paths, (True,) * (2 * len(world.joints)))


def cut(episode: PlannedEpisode) -> PlannedEpisode:
    return replace(episode, t_s=episode.t_s[:150], commands=episode.commands[:150])


def shorter(case: Unplanted) -> Unplanted:
    """Return a case of the first 0.8 s."""
    episodes = [replace(e, t_s=e.t_s[:80], commands=e.commands[:80]) for e in case.episodes]
    return replace(case, episodes=episodes, paths=[p[:80] for p in case.paths])


def sigma_of(case: Unplanted) -> np.ndarray:
    """Return a noise of 2 per mille of the reach and 6 of the speed, (2 count,)."""
    return np.array([(2e-3 * case.reach(i), 6e-3 * case.speed(i)) for i in range(case.count)]).ravel()


def system_of(case: Unplanted, folder: Path) -> MechanismSystem:
    """Return the project's own simulator's view of a case without noise."""
    noise = dict(zip(case.channels, sigma_of(case).tolist(), strict=True))
    write_case(folder, case, nominal_of(case, noise), table_of(case, case.paths))
    return MechanismSystem(read_model_case(folder), step_s=5e-4)


def ratio(a: Sequence[np.ndarray], b: Sequence[np.ndarray], sigma: np.ndarray) -> float:
    return float(np.sqrt(np.mean((np.concatenate([x - y for x, y in zip(a, b, strict=True)]) / sigma) ** 2)))


@pytest.mark.parametrize(("system", "jitter"), [("pendulum", 0.0), ("arm2", 0.4), ("slider_servo", 0.2)])
def test_mujoco_moves_the_nominal_model_as_it_was_made(system: str, jitter: float, tmp_path: Path) -> None:
    """From the true start, the prediction of what the owner believes is off by less than a twentieth of the noise."""
    case = drawn(system, 5, 3, jitter=jitter)
    simulator = system_of(case, tmp_path).simulator(threads=1)
    predicted = [simulator.predict(e, [Run((), episode.start)])[0] for e, episode in enumerate(case.episodes)]
    assert min(np.ptp(p, axis=0).min() for p in case.paths) > 0.0
    assert ratio(predicted, case.paths, sigma_of(case)) < 0.05


def test_what_is_planted_is_what_the_vocabulary_means(tmp_path: Path) -> None:
    """The project's own effect with the true values predicts the recording, for every word, on an arm."""
    case = drawn("arm2", 4, 1, EVERYTHING)
    system, sigma = system_of(case, tmp_path), sigma_of(case)
    simulator, start = system.simulator(threads=1), case.episodes[0].start
    for name, kind in kinds_of("arm2")[0].items():
        plant = kind.draw(case, np.random.default_rng(3))
        assert plant is not None
        size = 0.15 * plant.largest
        made = simulate(plant.edit(case.world, size), case.episodes[0])
        effect = meant(system, plant, plant.true(case.world, size))
        (predicted,) = simulator.predict(0, [Run((effect,), start)])
        left, moved = (ratio([made], [other], sigma) for other in (predicted, case.paths[0]))
        assert moved > 0.02, name
        assert left < (0.1 * moved if name in SOFT else 0.05), (name, left, moved)


def meant(system: MechanismSystem, plant: Plant, true: dict[str, float]):
    """Return the effect of a verdict that has these values; what the plane leaves open is zero."""
    variants = system.vocabulary.by_name[full(plant.name, plant.target)]
    values = {"y_m": 0.0} | true if plant.name in ("com_offset", "payload") else true
    values = values | {"tilt_y_rad": 0.0} if "tilt_x_rad" in true else values
    for candidate in variants:
        if set(values) <= set(inspect.signature(candidate.effect).parameters):
            return candidate.with_values(values)
    raise AssertionError(plant.name)


@pytest.mark.parametrize("system", list(SYSTEMS))
def test_every_effect_is_neutral_at_no_size_and_moves_something_at_its_largest(system: str) -> None:
    """With a word or without; what has none is not in the vocabulary."""
    needs = EVERYTHING if system == "arm2" else Needs(dry=True, servo=system == "slider_servo")
    case = shorter(drawn(system, 8, 1, needs))
    sigma, words = sigma_of(case), {cls.name for cls in EFFECTS}
    before = [simulate(case.world, e, step_s=COARSE_S) for e in case.episodes]
    with_word, without = kinds_of(system)
    assert len(with_word) >= 12
    assert len(without) >= 8
    assert not set(without) & words
    for name, kind in {**with_word, **without}.items():
        plant = kind.draw(case, np.random.default_rng(1))
        if plant is None:
            continue  # a pendulum has a motor or a servo
        assert (plant.name in words) == (name in with_word)
        nothing, largest = (
            simulate_or_none(plant.edit(case.world, size), case.episodes, step_s=COARSE_S)
            for size in (1e-7 * plant.largest, plant.largest)
        )
        assert nothing is not None
        assert ratio(nothing, before, sigma) < 0.02, name
        assert largest is None or ratio(largest, before, sigma) > 0.05, name


def test_turned_zeros_and_shifted_targets_are_one_effect() -> None:
    """What an answer accepts moves the recording alike: a tilt and a sensor's zero; a force and a servo's zero."""
    case = drawn("pendulum", 0, 1, Needs(motor=True))
    angle = 0.07
    tilted = VOCABULARY["gravity_tilt"].draw(case, np.random.default_rng(0))
    assert tilted is not None
    assert "sensor_offset[q_hinge]" in tilted.accept
    planned = case.episodes[0]
    true = simulate(tilted.edit(case.world, angle), planned)
    turn = tilted.true(case.world, angle)["tilt_x_rad"]
    turned = replace(planned, start=planned.start - [turn, 0.0])
    shown = simulate(case.world.with_sensor(0, False, offset=turn), turned)
    np.testing.assert_allclose(shown, true, atol=1e-9)


@pytest.mark.parametrize("system", ["pendulum", "arm2"])
def test_late_measurements_and_late_commands_of_all_drives_are_one_effect(system: str) -> None:
    case, delay_s = drawn(system, 0, 1, Needs(motor=True)), 0.013
    late = VOCABULARY["observation_delay"].draw(case, np.random.default_rng(0))
    assert late is not None
    drives = case.names.actuators
    assert full("actuator_delay", drives[0] if system == "pendulum" else "*") in late.accept
    world = case.world
    for i in range(len(drives)):
        world = world.with_actuator(i, delay_s=delay_s)
    planned = case.episodes[0]
    read, driven = (simulate(w, planned) for w in (late.edit(case.world, delay_s), world))
    np.testing.assert_allclose(read, driven, atol=1e-3 * np.abs(read).max())


def test_no_episode_hangs_on_a_hair() -> None:
    """All are calm, as drawn, whatever drives them."""
    g = np.random.default_rng(0)
    world = DRAWN["arm2"](Needs(motor=True), g)
    assert all(is_calm(world, e) for e in draw_episodes(world, Clock(50.0), g, held=True)[:3])


def test_a_tuning_set_has_half_of_what_has_no_word_and_no_case_of_a_sealed_one() -> None:
    """The same half whatever the seed; a sealed set has all; each kind of system alike."""
    for maker in MAKERS.values():
        assert 0 < len(maker.reserved) == (len(maker.outside) + 1) // 2
        seen = {
            purpose: {
                plan.wanted[0][0] for seed in range(3) for plan in plan_cases(40, seed, Mix(0, 0, 0, 1), maker, purpose)
            }
            for purpose in Purpose
        }
        assert seen[Purpose.SEALED] == set(maker.outside)
        assert seen[Purpose.TUNING] == set(maker.outside) - maker.reserved
        seeds = [{plan.seed for plan in plan_cases(9, 1, Mix(), maker, purpose)} for purpose in Purpose]
        assert not seeds[0] & seeds[1]


def test_pairs_are_of_effects_that_can_be_told_apart() -> None:
    plans = plan_cases(200, 2, Mix(0, 1, 0, 0), ARM)
    assert all({name for name, _ in plan.wanted} not in TOGETHER_ALIKE for plan in plans)


def test_a_made_set_is_whole(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Files and answers by the command; each case opens, and the oracle knows what was planted and where."""
    words = ["n=1", "seed=6", "system=slider_servo", "purpose=tuning", "workers=1", f"out={tmp_path / 'set'}"]
    assert main(["blind", "make", *words]) == 0
    assert "SHA-256 of the answers: " in capsys.readouterr().out
    answers = json.loads((tmp_path / "set.answers.json").read_text())
    for name, answer in answers.items():
        folder = tmp_path / "set" / name
        assert {p.name for p in folder.iterdir()} == {"recording.parquet", "nominal.yaml", "model.xml"}
        system = open_case(folder)
        assert len(system.recording.episodes) >= 6
        known = {c.name for c in system.vocabulary} | {"none", "unknown"}
        assert set(answer["accept"]) <= known
        for effect in answer["effects"]:
            assert set(effect["accept"]) <= set(answer["accept"])
            if effect["name"] != "unknown":
                assert [c.name for c in candidates_of([effect], system.vocabulary)] == [
                    full(effect["name"], effect.get("target"))
                ]
    (copied,) = copy_cases({name: tmp_path / "set" / name for name in answers}, tmp_path / "hidden").values()
    assert {p.name for p in copied.iterdir()} == {"recording.parquet", "nominal.yaml", "model.xml"}
    assert main(["blind", "make", "n=1", "system=arm", f"out={tmp_path / 'other'}"]) == 2
    assert "system: no 'arm'. Valid: 'arm2'" in capsys.readouterr().err
    assert main(["blind", "make", "n=1", "purpose=tunning", f"out={tmp_path / 'other'}"]) == 2
    assert "purpose: no 'tunning'. Valid: 'sealed', 'tuning'. Did you mean 'tuning'?" in capsys.readouterr().err


def test_a_severity_is_met_and_the_same_seed_makes_the_same_case(tmp_path: Path) -> None:
    """The error ratio of the recording, noise included, lies in the band."""
    plan = CasePlan("single", (("servo_gain", "moderate"),), (5, 2, 0))
    maker = MechanismMaker("slider_servo", Circumstances(episodes=(3, 3), seconds=(3.0, 3.0)))
    a, b = (maker.make(plan, tmp_path / name) for name in "ab")
    assert a == b
    assert a["effects"][0]["target"] == "drive"
    assert 3.7 <= a["error_ratio"] <= 7.4
    left, right = (pd.read_parquet(tmp_path / name / "recording.parquet") for name in "ab")
    pd.testing.assert_frame_equal(left, right)


def test_a_right_effect_in_the_wrong_place_is_wrong() -> None:
    """The target is part of the answer; what an effect accepts counts for it and for no other."""
    effects = [
        {"name": "armature", "target": "shoulder", "severity": "strong", "true": {"armature": 1.0},
         "accept": ["armature[shoulder]", "inertia[upper]"]},
    ]  # fmt: skip
    answer = {"effects": effects, "accept": ["armature[shoulder]", "inertia[upper]"]}

    def named(name: str) -> dict:
        return {"ranked": [{"effects": [name], "probability": 1.0, "parameters": {}, "standard_errors": {}}]}

    names = ["armature[shoulder]", "inertia[upper]", "armature[elbow]", "armature", "inertia[forearm]"]
    found = blind_score({n: named(n) for n in names}, dict.fromkeys(names, answer))
    assert list(found.basic.cases["right"]) == [True, True, False, False, False]
    own = {"mass[carriage]": ["armature[slide]"], "joint_friction[slide]": []}
    truth = ["mass[carriage]", "joint_friction[slide]"]
    accept = ["armature[slide]", "mass[carriage]", "joint_friction[slide]"]
    assert is_right(["joint_friction[slide]", "armature[slide]"], truth, accept, own)
    assert not is_right(["mass[carriage]", "armature[slide]"], truth, accept, own)


def test_a_folder_of_one_system_is_not_gone_on_with_as_of_another(tmp_path: Path) -> None:
    """What an interrupted call left says what it was of."""

    class Broken(MechanismMaker):
        def make(self, plan: CasePlan, folder: Path) -> dict:
            raise KeyboardInterrupt

    arguments = (1, 1, tmp_path / "cases", tmp_path / "answers.json")
    with pytest.raises(KeyboardInterrupt):
        make_cases(*arguments, Broken("arm2"), workers=1)
    with pytest.raises(ResultError, match="system arm2 instead of pendulum"):
        make_cases(*arguments, MechanismMaker("pendulum"), workers=1)
