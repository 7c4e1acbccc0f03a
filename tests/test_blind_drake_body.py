"""Bodies in space by Drake: closed forms, MuJoCo without any effect, outsiders that show, cases as planned."""

from __future__ import annotations

import functools
import json
import math
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from runner.blind import drake_engine
from runner.blind.drake_body import case
from runner.blind.drake_body.case import Circumstances, DrakeBodyMaker
from runner.blind.drake_body.excite import draw_toss, draw_world
from runner.blind.drake_body.files import by_mujoco, mjcf
from runner.blind.drake_body.physics import Shape, Toss, World, away, lowest_m, points_of, simulate_all
from runner.blind.drake_body.physics.poses import moved, turns_of
from runner.blind.drake_body.plants import OUTSIDE, TOGETHER_ALIKE, VOCABULARY, UnplantedBody, draw
from runner.blind.make import CasePlan, error_ratio
from runner.blind.oracle import candidates_of
from runner.effects.mechanism import EFFECTS
from runner.effects.mechanism.contacts import rebound
from runner.systems.case import open_case

HZ = 2.0 * math.pi * 100.0
BOX = World(Shape.BOX, (0.06, 0.04, 0.03), 0.4, 0.1 * HZ**2, 2.0 * 0.3 / HZ, 0.25)
CUBE = replace(BOX, shape=Shape.CUBE, half_size=(0.05, 0.05, 0.05))
UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])
SIGMA = np.array([2e-3] * 3 + [2e-2] * 3)
needs_drake = pytest.mark.skipif(
    not drake_engine.available(), reason="Drake is not installed: pip install 'runner[blind]'"
)


def toss(
    height: float, *, spin: tuple[float, ...] = (0.0, 0.0, 0.0), velocity: tuple[float, ...] = (0.0, 0.0, 0.0),
    seconds: float = 0.5, rate_hz: float = 100.0,
) -> Toss:  # fmt: skip
    samples = round(seconds * rate_hz) + 1
    return Toss(np.array([0.0, 0.0, height]), UPRIGHT, np.array(spin), np.array(velocity), rate_hz, samples)


def noises(paths: list[np.ndarray], others: list[np.ndarray]) -> float:
    off = away(paths, others)
    return error_ratio(off, [np.zeros_like(o) for o in off], SIGMA)


@needs_drake
def test_free_flight_is_a_parabola_that_keeps_momentum_and_energy_of_its_spin() -> None:
    """An asymmetric top that tumbles about its middle axis; its centre of mass is not the geometric centre."""
    world = replace(BOX, com=(0.01, -0.005, 0.004))
    plan = toss(5.0, spin=(3.0, 9.0, 0.2), velocity=(1.0, 0.0, 2.0), seconds=1.2, rate_hz=1000.0)
    (path,) = simulate_all(world, [plan], step_s=2.5e-4)
    turns, t = turns_of(path), np.arange(len(path)) / 1000.0
    centre = path[:, :3] + turns.apply(np.array(world.com))
    begin = plan.velocity + np.cross(plan.spin, np.array(world.com))
    fallen = centre[0] + np.outer(t, begin) - np.outer(0.5 * world.gravity * t**2, [0.0, 0.0, 1.0])
    assert np.max(abs(centre - fallen)) < 1e-4
    spin = (turns[1:] * turns[:-1].inv()).as_rotvec() * 1000.0
    middle = Rotation.from_rotvec(0.5 * spin / 1000.0) * turns[:-1]
    inertia, of_body = np.array(world.uniform_inertia), middle.inv().apply(spin)
    momentum, energy = middle.apply(inertia * of_body), (of_body**2) @ inertia
    assert np.max(np.linalg.norm(momentum - momentum[0], axis=1)) < 5e-3 * np.linalg.norm(momentum[0])
    assert np.ptp(energy) < 5e-3 * energy[0]
    assert np.min(of_body[:, 1]) < 0.0 < np.max(of_body[:, 1])  # it turned over


@needs_drake
def test_a_sliding_body_stops_after_half_its_speed_squared_over_its_deceleration() -> None:
    sunk = BOX.mass * BOX.gravity / (4.0 * BOX.stiffness_n_per_m)
    (path,) = simulate_all(BOX, [toss(0.03 - sunk, velocity=(0.8, 0.0, 0.0), seconds=0.6)])
    assert path[-1, 0] == pytest.approx(0.8**2 / (2.0 * BOX.friction * BOX.gravity), rel=0.01)
    assert np.max(abs(path[-1, 1:3] - [0.0, 0.03])) < 5e-4


@needs_drake
@pytest.mark.parametrize("ratio", [0.2, 0.6])
def test_a_flat_impact_leaves_what_a_damped_spring_does_in_drake_and_in_mujoco(ratio: float) -> None:
    world = replace(CUBE, relaxation_s=2.0 * ratio / HZ)
    plan = toss(0.05 + 0.05, velocity=(0.0, 0.0, -2.0), seconds=0.07, rate_hz=1000.0)
    fine = mjcf(world).replace('timestep="0.0005"', 'timestep="0.0001"')
    touched = math.sqrt(4.0 + 2.0 * 9.81 * 0.05)
    for (path,) in (simulate_all(world, [plan], step_s=2.5e-4), by_mujoco(fine, [plan])):
        speed = np.diff(path[:, 2]) * 1000.0
        k = int(np.argmax(speed))
        assert speed[k] / touched == pytest.approx(rebound(ratio), abs=0.03)


@needs_drake
def test_a_cylinder_on_its_side_rolls() -> None:
    """Without slipping once friction has made it turn: a third of the speed goes into the turning."""
    world = replace(CUBE, shape=Shape.CYLINDER, half_size=(0.04, 0.04, 0.05))
    lying = (Rotation.from_euler("x", 90.0, degrees=True)).as_quat()[[3, 0, 1, 2]]
    plan = replace(toss(0.04, velocity=(0.3, 0.0, 0.0), seconds=0.35), quaternion=lying)
    (path,) = simulate_all(world, [plan])
    assert (path[25, 0] - path[15, 0]) / 0.1 == pytest.approx(0.2, rel=0.05)
    assert abs(path[-1, 2] - 0.04) < 1e-3


@needs_drake
def test_both_engines_take_a_body_alike_through_flight_and_a_slide() -> None:
    world = replace(BOX, friction=0.2)
    plans = [
        toss(1.2, spin=(2.0, -5.0, 3.0), velocity=(0.8, 0.2, 0.5), seconds=0.4),
        toss(0.03, spin=(0.0, 0.0, 2.0), velocity=(0.6, 0.2, 0.0), seconds=0.4),
    ]
    assert noises(simulate_all(world, plans), by_mujoco(mjcf(world), plans)) < 0.3


@functools.cache
def tossed_and_slid() -> tuple[list[Toss], list[np.ndarray]]:
    """Return two plans, and how a box goes by them without any effect."""
    plans = [
        toss(0.16, spin=(2.0, -6.0, 3.0), velocity=(0.8, 0.2, 0.3), seconds=0.35),
        toss(0.03, spin=(0.0, 0.0, 2.0), velocity=(0.6, 0.2, 0.0), seconds=0.35),
    ]
    return plans, simulate_all(BOX, plans)


@needs_drake
@pytest.mark.parametrize("name", [*VOCABULARY, *OUTSIDE])
def test_every_effect_shows_and_vanishes_with_its_size(name: str) -> None:
    plans, plain = tossed_and_slid()
    plant = draw(name, UnplantedBody(BOX, plain), np.random.default_rng(2))
    large, small = (noises(simulate_all(plant.edit(BOX, size * plant.largest), plans), plain) for size in (0.7, 1e-4))
    assert large > (0.8 if name in ("restitution", "contact_stiffness") else 1.5)
    assert small < max(0.1 * large, 0.05)


def test_words_are_those_of_the_vocabulary_and_outsiders_have_none() -> None:
    words = {cls.name for cls in EFFECTS}
    for name, kind in {**VOCABULARY, **OUTSIDE}.items():
        plant = kind(UnplantedBody(CUBE, [np.zeros((2, 7))]), np.random.default_rng(0))
        assert (plant.name in words) == (name in VOCABULARY)
    assert all(pair <= set(VOCABULARY) for pair in TOGETHER_ALIKE)


def test_moving_a_path_is_the_inverse_of_comparing_two() -> None:
    g = np.random.default_rng(0)
    quaternions = g.standard_normal((20, 4))
    path = np.column_stack([g.standard_normal((20, 3)), quaternions / np.linalg.norm(quaternions, axis=1)[:, None]])
    by = 0.3 * g.standard_normal((20, 6))
    np.testing.assert_allclose(away([moved(path, by)], [path])[0], by, atol=1e-12)


@pytest.mark.parametrize("kind", ["tossed", "dropped", "slid"])
def test_bodies_begin_above_the_table_and_the_mjcf_is_of_the_same_body(kind: str) -> None:
    g = np.random.default_rng(4)
    for _ in range(6):
        world = draw_world(g)
        plan = draw_toss(world, kind, 148.0, g)
        turn = Rotation.from_quat(plan.quaternion[[1, 2, 3, 0]]).as_matrix()[None]
        assert 0.0 < lowest_m(world, turn, plan.place[2:])[0] < 0.6
        model = mujoco.MjModel.from_xml_string(mjcf(world))
        assert model.body_mass[1] == pytest.approx(world.mass)
        assert sorted(model.body_inertia[1]) == pytest.approx(sorted(world.uniform_inertia), rel=1e-4)
        assert model.geom_rbound[1] == pytest.approx(np.max(np.linalg.norm(points_of(world)[0], axis=1)), rel=1e-6)


@needs_drake
def test_a_made_case_is_whole_and_the_same_seed_makes_it_again(tmp_path: Path) -> None:
    """A null is one to MuJoCo; what is planted is what the oracle finds in the vocabulary, and moves as told."""
    maker = DrakeBodyMaker(Circumstances(episodes=(2, 2)))
    null = maker.make(CasePlan("null", (), (3, 4, 0)), tmp_path / "null")
    assert null["accept"] == ["none"]
    assert null["made"]["engine_ratio"] <= case.APART
    plan = CasePlan("single", (("gravity", "moderate"),), (3, 4, 1))
    a, b = (maker.make(plan, tmp_path / name) for name in "ab")
    assert a == b
    assert (tmp_path / "a" / "recording.parquet").read_bytes() == (tmp_path / "b" / "recording.parquet").read_bytes()
    assert 1.1 < a["made"]["moved"][0] < 66.0
    assert a["error_ratio"] == pytest.approx(a["made"]["moved"][0], rel=0.3, abs=0.5)
    assert json.loads(json.dumps(a)) == a
    assert {p.name for p in (tmp_path / "a").iterdir()} == {"model.xml", "nominal.yaml", "recording.parquet"}
    system = open_case(tmp_path / "a")
    assert len(system.recording.episodes) == 2
    assert [c.name for c in candidates_of(a["effects"], system.vocabulary)] == ["gravity"]
    known = {c.name for c in system.vocabulary.candidates}
    body = a["made"]["body"]
    plain = UnplantedBody(CUBE, [np.zeros((2, 7))])
    for name in VOCABULARY:
        word = draw(name, plain, np.random.default_rng(0)).full.replace("[cube]", f"[{body}]")
        assert word in known
