"""Cases are made as planned: sizes by how far they move the recording, answers outside, the same for the same seed."""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pandas as pd
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from runner.blind import make
from runner.blind.make import BANDS, CasePlan, Mix, find_size, make_cases, plan_cases
from runner.blind.planar_box import plants
from runner.blind.planar_box.case import PlanarBoxMaker
from runner.blind.planar_box.excite import FAMILIES, Drive, draw_episodes
from runner.blind.planar_box.physics import World, simulate, simulate_all
from runner.blind.planar_box.reality import Reality
from runner.errors import ConfigError, ResultError
from runner.recording import read_case

CUBE = World(half_size=(0.5, 0.5, 0.5), mass=3.0, friction=0.3)
BOX = PlanarBoxMaker()
PLAIN = PlanarBoxMaker(Reality(
    texture=(0.0, 0.0), wrong_size=(0.0, 0.0), coloured=0.0, outliers=0.0, noise_unknown=0.0, noise_partly=0.0,
    heights=0.0, boxes=0.0, corners=0.0,
))  # fmt: skip


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> make.MadeCases:
    folder = tmp_path_factory.mktemp("blind")
    return make_cases(2, 3, folder / "cases", folder / "answers.json", BOX, workers=1)


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make cases of three episodes instead of seven to ten."""
    monkeypatch.setattr("runner.blind.planar_box.case.draw_episodes", lambda drive, g: draw_episodes(drive, g)[:3])


def unplanted(world: World = CUBE, seed: int = 0) -> plants.UnplantedCase:
    episodes = draw_episodes(Drive(world, 60.0, heights=False), np.random.default_rng(seed))[:3]
    return plants.UnplantedCase(world, episodes, simulate_all(world, episodes))


def test_the_answers_lie_outside_and_their_hash_with_the_cases(made: make.MadeCases) -> None:
    digest = hashlib.sha256(made.answers.read_bytes()).hexdigest()
    assert made.sha256 == digest
    assert (made.folder / "answers.sha256").read_text().split()[0] == digest
    assert made.folder not in made.answers.parents
    answers = json.loads(made.answers.read_text())
    assert set(answers) == set(made.cases) == {p.name for p in made.folder.iterdir() if p.is_dir()}
    for answer in answers.values():
        assert set(answer["accept"]) <= {*plants.VOCABULARY, "none", "unknown"}
        assert all({"name", "severity", "true"} == set(e) for e in answer["effects"])


def test_nothing_beside_the_recording_speaks_of_the_answer(made: make.MadeCases) -> None:
    for name in made.cases:
        assert {p.name for p in (made.folder / name).iterdir()} == {"recording.parquet", "nominal.yaml"}
        nominal = yaml.safe_load((made.folder / name / "nominal.yaml").read_text())
        assert set(nominal) <= {"half_size", "mass", "friction", "gravity", "rate_hz", "noise", "contact"}


def test_a_recording_has_the_columns_rates_and_lengths_of_the_format(made: make.MadeCases) -> None:
    for name in made.cases:
        table = pd.read_parquet(made.folder / name / "recording.parquet")
        nominal = yaml.safe_load((made.folder / name / "nominal.yaml").read_text())
        assert list(table.columns[:12]) == ["episode", "t", "x", "y", "yaw", "vx", "vy", "wz", "fx", "fy", "px", "py"]
        assert np.all(np.isfinite(table.to_numpy(float)))
        episodes = [g for _, g in table.groupby("episode")]
        assert 7 <= len(episodes) <= 10
        for e in episodes:
            np.testing.assert_allclose(np.diff(e.t), 1 / nominal["rate_hz"], atol=2e-6)
            assert 4.0 <= e.t.max() <= 8.0
            still = (e.fx == 0) & (e.fy == 0)
            assert np.all(e.loc[still, ["px", "py"]] == 0.0)


def test_every_case_is_read_without_complaint(made: make.MadeCases) -> None:
    for name in made.cases:
        assert len(read_case(made.folder / name).episodes) >= 7


@pytest.mark.usefixtures("few")
def test_the_same_seed_makes_the_same_case_and_another_seed_another(tmp_path: Path) -> None:
    plan = CasePlan("single", (("friction", "moderate"),), (5, 2, 0))
    a, b = (BOX.make(plan, tmp_path / name) for name in "ab")
    assert a == b
    left, right = (pd.read_parquet(tmp_path / name / "recording.parquet") for name in "ab")
    pd.testing.assert_frame_equal(left, right)
    other = BOX.make(replace(plan, seed=(6, 2, 0)), tmp_path / "c")
    assert other["made"]["starts"] != a["made"]["starts"]


@pytest.mark.usefixtures("few")
@pytest.mark.parametrize("severity", ["subtle", "strong"])
def test_a_severity_is_met_by_the_ratio_to_the_noise(severity: str, tmp_path: Path) -> None:
    answer = PLAIN.make(CasePlan("single", (("viscous_drag", severity),), (1, 2, 3)), tmp_path / "case")
    low, high = BANDS[severity]
    assert answer["effects"][0]["severity"] == severity
    assert 0.97 * low <= answer["error_ratio"] <= 1.03 * high


@pytest.mark.usefixtures("few")
def test_a_null_case_without_mismatch_has_the_ratio_one(tmp_path: Path) -> None:
    answer = PLAIN.make(CasePlan("null", (), (1, 2, 4)), tmp_path / "case")
    assert answer["effects"] == []
    assert answer["accept"] == ["none"]
    assert answer["error_ratio"] == pytest.approx(1.0, abs=0.03)
    assert answer["made"]["mismatch_ratio"] == 0.0


@pytest.mark.usefixtures("few")
def test_the_mismatch_is_real_and_below_its_limit(tmp_path: Path) -> None:
    answer = BOX.make(CasePlan("null", (), (1, 2, 5)), tmp_path / "case")
    assert 0.02 < answer["made"]["mismatch_ratio"] < 1.2 * Reality().mismatch_limit
    assert answer["made"]["mismatch"]["texture"] > 0.0
    assert answer["made"]["mismatch"]["half_size"] != 0.0


def test_every_effect_is_neutral_at_no_size_and_moves_the_box_at_its_largest() -> None:
    case = unplanted()
    for name in [*plants.VOCABULARY, *plants.OUTSIDE]:
        plant = plants.draw(name, case, np.random.default_rng(2))
        nothing = [simulate(plant.edit(CUBE, 1e-12), e) for e in case.episodes]
        largest = [simulate(plant.edit(CUBE, plant.largest), e) for e in case.episodes]
        near = 1e-2 if name == "contact_pressure" else 1e-4  # its base points are laid out in panels
        for path, reference in zip(nothing, case.paths, strict=True):
            np.testing.assert_allclose(path, reference, atol=near, err_msg=name)
        moved = max(np.abs(a[:, :2] - b[:, :2]).max() for a, b in zip(largest, case.paths, strict=True))
        turned = max(np.abs(a[:, 2] - b[:, 2]).max() for a, b in zip(largest, case.paths, strict=True))
        assert moved > 0.01 or turned > 0.01, name


def test_the_true_values_are_those_of_the_world() -> None:
    case, g = unplanted(), np.random.default_rng(0)
    mass = plants.draw("mass", case, g)
    assert mass.true(CUBE, 0.1)["mass_kg"] == pytest.approx(mass.edit(CUBE, 0.1).mass)
    offset = plants.draw("com_offset", case, g)
    assert (offset.true(CUBE, 0.1)["x_m"], offset.true(CUBE, 0.1)["y_m"]) == pytest.approx(offset.edit(CUBE, 0.1).com)
    heavier = mass.edit(CUBE, 0.1)
    assert heavier.yaw_inertia / CUBE.yaw_inertia == pytest.approx(heavier.mass / CUBE.mass)


def test_sets_are_balanced_over_effects_and_severities() -> None:
    plans = plan_cases(240, 1, Mix(), BOX)
    singles = [j.wanted[0] for j in plans if j.kind == "single"]
    counts = pd.Series([name for name, _ in singles]).value_counts()
    assert set(counts.index) == set(plants.VOCABULARY)
    assert counts.max() - counts.min() <= 1
    severities = pd.Series([severity for _, severity in singles]).value_counts()
    assert severities.max() - severities.min() <= 12
    assert all({a, b} not in plants.TOGETHER_ALIKE for j in plans if j.kind == "pair" for (a, _), (b, _) in [j.wanted])
    assert len([j for j in plans if j.kind == "null"]) == round(240 * 0.12)


@settings(max_examples=30, deadline=None)
@given(power=st.floats(0.4, 2.5), target=st.floats(1.3, 30.0), floor=st.floats(0.0, 0.3))
def test_a_size_is_found_for_any_rising_excess(power: float, target: float, floor: float) -> None:
    def excess(size: float) -> float:
        return math.hypot(floor, 60.0 * size**power)

    size = find_size(excess, 1.0, target)
    assert size is not None
    assert excess(size) == pytest.approx(target, rel=0.065)


def test_a_target_beyond_the_largest_size_has_no_size() -> None:
    assert find_size(lambda size: 3.0 * size, 1.0, 5.0) is None
    assert find_size(lambda size: 5.2 * size, 1.0, 5.0) == pytest.approx(5.0 / 5.2, rel=0.07)


def test_an_excess_that_jumps_over_the_target_has_no_size() -> None:
    assert find_size(lambda size: 0.1 if size < 0.37 else 50.0, 1.0, 5.0) is None


@pytest.mark.parametrize("family", FAMILIES, ids=lambda f: f.__name__)
def test_excitations_push_hard_enough_to_slide_and_not_beyond_reason(family) -> None:
    drive = Drive(CUBE, 60.0, heights=False)
    sizes = []
    for seed in range(5):
        command = family(drive, np.random.default_rng(seed), np.arange(421) / 60.0)
        sizes.append(np.hypot(command[:, 0], command[:, 1]).max() / drive.friction_n)
        assert np.all(abs(command[:, 2:4]) <= 0.5)
    assert max(sizes) > 1.1
    assert max(sizes) < 2.6


def test_no_episode_magnifies_an_error_of_its_start() -> None:
    episodes = draw_episodes(Drive(CUBE, 60.0, heights=False), np.random.default_rng(8))
    for e in episodes:
        start = e.start + np.array([0, 0, 1e-3, 0, 0, 0])
        apart = np.abs(simulate(CUBE, replace(e, start=start)) - simulate(CUBE, e))
        assert apart[:, :3].max() < 1e-2


def test_pushes_at_a_height_do_not_tip_the_box() -> None:
    drive = Drive(CUBE, 60.0, heights=True)
    for e in draw_episodes(drive, np.random.default_rng(4)):
        force = np.hypot(e.command[:, 0], e.command[:, 1])
        lever = force * abs(e.command[:, 4]) + CUBE.friction * CUBE.mass * CUBE.gravity * 0.5
        assert lever.max() <= 0.76 * 0.5 * CUBE.mass * CUBE.gravity


@pytest.mark.usefixtures("few")
def test_an_interrupted_set_is_taken_up_again(tmp_path: Path) -> None:
    """Cases that were made are kept with their answers, the rest is made; other settings are refused."""
    mix, whole = Mix(singles=0.0, pairs=0.0, nulls=1.0, unknowns=0.0), tmp_path / "whole"
    with_all = make_cases(2, 5, whole / "cases", whole / "answers.json", PLAIN, mix=mix, workers=1)
    count = []

    def interrupted(plan: CasePlan, folder: Path) -> dict:
        count.append(folder.name)
        if len(count) == 2:
            (folder / "nominal.yaml").parent.mkdir(parents=True)
            (folder / "nominal.yaml").write_text("half_size:")  # begun, not done
            raise KeyboardInterrupt
        return PLAIN.make(plan, folder)

    part = tmp_path / "part"
    arguments = (2, 5, part / "cases", part / "answers.json")
    broken = PlanarBoxMaker(PLAIN.reality)
    object.__setattr__(broken, "make", interrupted)
    with pytest.raises(KeyboardInterrupt):
        make_cases(*arguments, broken, mix=mix, workers=1)
    assert not (part / "answers.json").exists()
    assert not (part / "cases" / make.HASH_FILE).exists()
    with pytest.raises(ResultError, match="seed 5 instead of 6"):
        make_cases(2, 6, *arguments[2:], PLAIN, mix=mix, workers=1)
    again = make_cases(*arguments, broken, mix=mix, workers=1)
    assert count[2:] == [count[1]]
    assert again.sha256 == with_all.sha256
    for file in whole.rglob("*.*"):
        if file.is_file():
            assert file.read_bytes() == (part / file.relative_to(whole)).read_bytes(), file
    assert {p.name for p in part.iterdir()} == {"cases", "answers.json"}


def test_a_folder_in_use_and_answers_inside_are_refused(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(ConfigError, match=r"blind\.out: the folder .* is not empty"):
        make_cases(1, 0, tmp_path, tmp_path.parent / "answers.json", BOX)
    with pytest.raises(ConfigError, match=r"blind\.answers: must lie outside"):
        make_cases(1, 0, tmp_path / "new", tmp_path / "new" / "answers.json", BOX)
    with pytest.raises(ConfigError, match=r"blind\.out: '.*file' is a file"):
        make_cases(1, 0, tmp_path / "file", tmp_path.parent / "answers.json", BOX)
    with pytest.raises(ConfigError, match=r"blind\.out: '.*' can't be made"):
        make_cases(1, 0, tmp_path / "file" / "below", tmp_path.parent / "answers.json", BOX)
    with pytest.raises(ConfigError, match="Did you mean 'friction'"):
        plants.draw("fricton", unplanted(), np.random.default_rng(0))


def test_a_pair_that_cannot_be_had_is_another(tmp_path: Path) -> None:
    """After as many tries as any case gets, two other effects are drawn; a single one is what it was planned to be."""

    class Hard(PlanarBoxMaker):
        attempts = 3
        tried: ClassVar[list[CasePlan]] = []

        def try_to_make(self, plan: CasePlan, folder: Path, g: np.random.Generator) -> dict[str, Any] | None:
            self.tried.append(plan)
            return None if len(self.tried) < 4 else {"wanted": plan.wanted}

    first = next(p for p in plan_cases(40, 5, Mix(), BOX) if p.kind == "pair")
    maker = Hard()
    found = maker.make(first, tmp_path)["wanted"]
    assert [p.wanted for p in Hard.tried[:3]] == [first.wanted] * 3
    assert found != first.wanted
    assert len({name for name, _ in found}) == 2
    Hard.tried.clear()
    with pytest.raises(ConfigError, match="reaches its severity in 3 tries"):
        maker.make(replace(first, kind="single", wanted=first.wanted[:1]), tmp_path)
