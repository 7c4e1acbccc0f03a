"""The second world of boxes, by Drake: closed forms, the equations of motion, outsiders that show, cases as planned."""

from __future__ import annotations

import functools
import importlib
import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from runner.blind import drake_engine as engine
from runner.blind.drake_box import case
from runner.blind.drake_box.excite import FAMILIES, draw_episode
from runner.blind.drake_box.outside import OUTSIDE
from runner.blind.drake_box.physics import DrakeError, Scene, Strange, simulate
from runner.blind.drake_box.physics.base import base_of
from runner.blind.drake_box.physics.push import lagged, pushed
from runner.blind.drake_box.plants import VOCABULARY, draw
from runner.blind.make import MadeCases, Mix, error_ratio, make_cases
from runner.blind.planar_box import physics as equations
from runner.blind.planar_box.excite import Drive
from runner.blind.planar_box.physics import PlannedEpisode, World
from runner.blind.planar_box.plants import UnplantedCase
from runner.blind.worlds import MAKERS
from runner.commands.blind_make import BlindMakeConfig
from runner.errors import ConfigError
from runner.recording import read_case

CUBE = World(half_size=(0.5, 0.5, 0.5), mass=3.0, friction=0.3)
SIGMA = np.array([0.005, 0.005, 0.01, 0.02, 0.02, 0.03])
needs_drake = pytest.mark.skipif(not engine.available(), reason="Drake is not installed: pip install '.[blind]'")


def episode(start: tuple[float, ...], seconds: float, *, force: tuple[float, float] = (0.0, 0.0)) -> PlannedEpisode:
    command = np.zeros((round(60 * seconds) + 1, 5))
    command[:, :2] = force
    return PlannedEpisode(np.array(start, float), command, 60.0)


def thrown_and_pushed() -> PlannedEpisode:
    """Return 1.8 s: thrown and spinning, then pushed beside the middle, from a side that turns."""
    t = np.arange(109) / 60.0
    on = (t > 0.5) & (t < 1.3)
    force = 1.7 * decelerated(CUBE) * CUBE.mass * on
    command = np.column_stack([force * np.cos(2.0 * t), force * np.sin(2.0 * t), 0.15 * on, -0.1 * on, 0.05 * on])
    return PlannedEpisode(np.array([0.1, -0.1, 0.4, 0.8, 0.5, 1.5]), command, 60.0)


def drawn(world: World = CUBE, seed: int = 1, kinds: tuple[int, ...] = (2, 4)) -> list[PlannedEpisode]:
    g = np.random.default_rng(seed)
    drive = Drive(world, 60.0, heights=True)
    return [draw_episode(drive, g, k, thrown=k == 2, elapsed_s=0.0, number=n) for n, k in enumerate(kinds)]


def decelerated(world: World) -> float:
    return world.friction * world.gravity


@needs_drake
@pytest.mark.parametrize("speed", [0.5, 2.0])
def test_a_thrown_box_stops_after_half_its_speed_squared_over_its_deceleration(speed: float) -> None:
    start = (0.3, -0.2, 0.7, speed * 0.6, speed * 0.8, 0.0)
    end = simulate(Scene(CUBE), episode(start, 1.0))[-1]
    length = speed**2 / (2.0 * decelerated(CUBE))
    assert np.hypot(*(end[:2] - start[:2])) == pytest.approx(length, abs=3e-4)
    assert abs(end[2] - 0.7) < 1e-3
    assert np.max(abs(end[3:])) < 1e-3


@needs_drake
def test_a_spinning_box_stops_as_the_integral_over_its_base_says() -> None:
    # mean distance of a square's points from its middle: half its side times (sqrt 2 + asinh 1) / 3
    arm = 0.5 * (math.sqrt(2.0) + math.asinh(1.0)) / 3.0
    alpha = CUBE.friction * CUBE.gravity * arm / ((0.5**2 + 0.5**2) / 3.0)
    end = simulate(Scene(CUBE), episode((0.0, 0.0, 0.0, 0.0, 0.0, 4.0), 1.5), nodes=10)[-1]
    assert end[2] == pytest.approx(4.0**2 / (2.0 * alpha), rel=2e-3)
    assert np.max(abs(end[[0, 1, 3, 4, 5]])) < 1e-3


@needs_drake
def test_a_pushed_box_accelerates_by_what_friction_leaves() -> None:
    force = 1.5 * decelerated(CUBE) * CUBE.mass
    end = simulate(Scene(CUBE), episode((0.0,) * 6, 1.0, force=(force, 0.0)))[-1]
    assert end[3] == pytest.approx(0.5 * decelerated(CUBE), rel=1e-3)
    assert end[0] == pytest.approx(0.25 * decelerated(CUBE), rel=2e-3)


@needs_drake
def test_a_box_held_by_friction_stays() -> None:
    force = 0.8 * decelerated(CUBE) * CUBE.mass
    path = simulate(Scene(CUBE), episode((0.0,) * 6, 1.0, force=(force, 0.0)))
    assert np.max(abs(path)) < 1e-3


@needs_drake
def test_a_box_slides_down_a_floor_by_what_friction_leaves() -> None:
    world = replace(CUBE, friction=0.1, tilt=0.15, downhill=0.5)
    end = simulate(Scene(world), episode((0.0,) * 6, 1.0))[-1]
    expected = world.gravity * (math.sin(0.15) - 0.1 * math.cos(0.15))
    assert end[3:5] == pytest.approx([expected * math.cos(0.5), expected * math.sin(0.5)], rel=5e-3)


WORLDS = {
    "nothing": CUBE,
    "corners": replace(CUBE, contact="corners", half_size=(0.3, 0.45, 0.2)),
    "body": replace(CUBE, mass=3.6, friction=0.27, inertia=0.7, com=(0.1, -0.06), mass_leak=0.03, tether=2.0,
                    tether_place=(1.0, -0.5), tether_rest=0.3),
    "around": replace(CUBE, viscous_drag=0.8, film=0.6, air_drag=0.5, rotational_damping=0.2, wind=(0.6, -0.3),
                      tilt=0.02, downhill=2.0),
    "push and sensor": replace(CUBE, gain=1.1, saturation=14.0, misalignment=0.1, delay=0.03, lag=0.06,
                               point_offset=(0.03, 0.05), observation_delay=0.02, sensor_scale=1.05),
    "floor": replace(CUBE, patch=0.4, patch_place=(0.2, 0.1), patch_radius=0.7, stribeck=0.2, stribeck_speed=0.3,
                     texture=0.02, texture_seed=2),
}  # fmt: skip


@needs_drake
@pytest.mark.parametrize("name", WORLDS)
def test_the_engine_agrees_with_the_equations_of_motion(name: str) -> None:
    episodes = [thrown_and_pushed(), replace(thrown_and_pushed(), start=np.zeros(6))]
    nominal, expected = (equations.simulate_all(world, episodes) for world in (CUBE, WORLDS[name]))
    found = [simulate(Scene(WORLDS[name]), e, step_s=1.0 / 480.0, nodes=8) for e in episodes]
    assert error_ratio(found, expected, SIGMA) < 0.3
    assert name == "nothing" or error_ratio(expected, nominal, SIGMA) > 3.0


@needs_drake
def test_a_wall_is_not_passed_and_a_box_that_tips_is_refused() -> None:
    thrown = episode((0.0, 0.0, 0.4, 2.0, 0.0, 0.0), 1.0)
    free = simulate(Scene(CUBE), thrown)
    reach = 0.5 * (math.cos(0.4) + math.sin(0.4))
    wall = simulate(Scene(CUBE, strange=Strange(wall_distance=0.9)), thrown)
    assert np.max(free[:, 0]) + reach > 1.0
    assert np.max(wall[:, 0] + 0.5 * (abs(np.cos(wall[:, 2])) + abs(np.sin(wall[:, 2])))) < 0.91
    high = np.zeros((61, 5))
    high[:] = 30.0, 0.0, 0.0, 0.0, 0.5
    with pytest.raises(DrakeError):
        simulate(Scene(CUBE), PlannedEpisode(np.zeros(6), high, 60.0))


@functools.cache
def plainly_thrown_and_pushed() -> np.ndarray:
    return simulate(Scene(CUBE), thrown_and_pushed())


@needs_drake
@pytest.mark.parametrize("name", OUTSIDE)
def test_every_outsider_shows_and_vanishes_with_its_size(name: str) -> None:
    plan, plain = thrown_and_pushed(), [plainly_thrown_and_pushed()]
    plant = draw(name, UnplantedCase(CUBE, [plan], plain), np.random.default_rng(2))
    large, small = (
        error_ratio([simulate(plant.edit(Scene(CUBE), size * plant.largest), plan)], plain, SIGMA)
        for size in (0.8, 1e-3)
    )
    assert large > 2.0
    assert small < 0.2 * large
    assert plant.accept == ("unknown",)


def test_a_push_comes_late_and_lags_as_it_should() -> None:
    command = np.zeros((61, 5))
    command[10:20, 0] = 6.0
    plan = PlannedEpisode(np.zeros(6), command, 60.0)
    prompt, late = (pushed(Scene(replace(CUBE, delay=delay)), plan, 240, 1.0 / 240.0)[:, 0] for delay in (0.0, 0.1))
    assert prompt == pytest.approx(np.repeat(command[:-1, 0], 4))
    assert late == pytest.approx(np.roll(prompt, 24))
    steps = lagged(np.full((400, 1), 2.0), 0.01)[:, 0]
    t = np.arange(401) * 0.01
    mean = 2.0 - 2.0 * np.diff(-np.exp(-t)) / 0.01
    assert steps == pytest.approx(mean)


def test_changes_come_late_by_less_than_a_sample_each_by_its_own() -> None:
    command = np.zeros((61, 5))
    command[::2, 0] = 5.0
    plan = PlannedEpisode(np.zeros(6), command, 60.0)
    steps = pushed(Scene(CUBE, late=1.0, late_seed=4), plan, 60 * 50, 1.0 / 3000.0)[:, 0]
    rises = np.flatnonzero((steps[1:] > 2.5) & (steps[:-1] <= 2.5)) / 3000.0
    late = rises * 60.0 - 2.0 * np.arange(30)[30 - len(rises) :]
    assert np.all((late >= -0.05) & (late <= 1.0))
    assert np.std(late) > 0.1


def test_a_base_carries_what_a_spread_load_does() -> None:
    for contact, spread in (("patch", 1.0 / 3.0), ("corners", 1.0)):
        base = base_of(replace(CUBE, half_size=(0.2, 0.4, 0.3), contact=contact))
        assert base.share.sum() == pytest.approx(1.0)
        assert base.share @ base.x**2 == pytest.approx(spread * 0.2**2)
        assert base.share @ base.y**2 == pytest.approx(spread * 0.4**2)
    rim = base_of(replace(CUBE, pressure=0.8, pressure_where="rim"))
    middle = base_of(replace(CUBE, pressure=0.8, pressure_where="middle"))
    assert rim.share @ rim.x**2 > 0.5**2 / 3.0 > middle.share @ middle.x**2
    mu = engine.half_of(0.3)
    assert 2.0 * mu * 1e6 / (mu + 1e6) == pytest.approx(0.3)


@pytest.mark.parametrize("kind", range(len(FAMILIES)))
def test_pushes_move_the_box_and_end_before_the_episode(kind: int) -> None:
    (plan,) = drawn(kinds=(kind,), seed=kind)
    path = equations.simulate(CUBE, plan)
    assert np.all(plan.command[-10:] == 0.0)
    assert np.max(np.hypot(*(path[:, :2] - path[0, :2]).T)) > 0.05
    assert np.all(np.hypot(*plan.command[:, :2].T) < 4.5 * decelerated(CUBE) * CUBE.mass)


def test_what_drake_has_not_is_refused_not_left_out() -> None:
    assert "anisotropic_friction" not in VOCABULARY
    with pytest.raises(ConfigError, match="anisotropy"):
        Scene(replace(CUBE, anisotropy=(1.2, 0.8)))


@needs_drake
def test_the_same_seed_makes_the_same_cases_and_answers_lie_outside(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def short(drive: Drive, g: np.random.Generator) -> list[PlannedEpisode]:
        plans = [draw_episode(drive, g, k, thrown=False, elapsed_s=0.0, number=n) for n, k in enumerate((2, 6))]
        return [replace(e, command=e.command[: round(e.rate_hz)]) for e in plans]

    monkeypatch.setattr(case, "draw_episodes", short)

    def made(name: str, roughness: float, mix: Mix) -> MadeCases:
        maker = MAKERS["planar_box_drake"].with_roughness(roughness)
        return make_cases(1, 7, tmp_path / name, tmp_path / f"{name}.json", maker, mix=mix, workers=1)

    single, again = (made(name, 0.0, Mix(1.0, 0.0, 0.0, 0.0)) for name in ("a", "b"))
    rough = made("c", 1.0, Mix(0.0, 0.0, 1.0, 0.0))
    assert single.sha256 == again.sha256
    (name,) = single.cases
    recorded = [(made.folder / name / "recording.parquet").read_bytes() for made in (single, again)]
    assert recorded[0] == recorded[1]
    answer = json.loads(single.answers.read_text())[name]
    assert answer["made"]["system"] == "planar_box_drake"
    assert answer["made"]["mismatch_ratio"] == 0.0
    assert answer["error_ratio"] == pytest.approx(answer["made"]["moved"][0], rel=0.1)
    assert 1.15 < answer["made"]["moved"][0] < 66.0
    assert sorted(p.name for p in (single.folder / name).iterdir()) == ["nominal.yaml", "recording.parquet"]
    null = json.loads(rough.answers.read_text())[name]
    assert null["accept"] == ["none"]
    assert 0.2 < null["made"]["mismatch_ratio"] < 5.0
    assert len(read_case(rough.folder / name).episodes) == 2


def test_without_drake_there_is_one_clear_line(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str) -> None:
        raise ImportError(f"No module named '{name}'")

    engine.drake.cache_clear()
    monkeypatch.setattr(importlib, "import_module", missing)
    assert not engine.available()
    with pytest.raises(ConfigError, match=r"^system: this one needs Drake.*\[blind\]") as caught:
        MAKERS["planar_box_drake"].check_ready()
    assert "\n" not in str(caught.value)


def test_roughness_is_the_second_worlds_alone() -> None:
    assert BlindMakeConfig(n=1, out=Path("x"), system="planar_box_drake", roughness=0.5).roughness == 0.5
    with pytest.raises(ConfigError, match="roughness"):
        MAKERS["planar_box"].with_roughness(0.5)
    with pytest.raises(ConfigError, match="roughness"):
        MAKERS["planar_box_drake"].with_roughness(-1.0)
