"""Motions without the engine around the law of friction: what MuJoCo's own steps give, to rounding."""

from __future__ import annotations

import numpy as np
import pytest

from runner.physics import dry_friction
from runner.recording import read_case
from runner.systems.case import open_case
from runner.systems.planar_box.simulator import Simulator
from runner.systems.planar_box.system import PlanarBox
from runner.systems.planar_box.windows import planar
from runner.systems.simulator import Run
from runner.systems.windows import Windows

CASE = "examples/cases/slippery_floor"


@pytest.fixture(scope="module")
def system() -> PlanarBox:
    """A box that is pushed."""
    system = open_case(CASE)
    assert isinstance(system, PlanarBox)
    return system


def engine_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have everything simulated by MuJoCo's steps."""
    monkeypatch.setattr(dry_friction, "is_all_that_acts", lambda model: False)


def with_each_effect(system: PlanarBox) -> list[Run]:
    """Return a run without effects, and one with each effect of the vocabulary at half of its usual size."""
    recording = system.recording
    start = np.concatenate([recording.episodes[0].pose[0], [0.1, -0.05, 0.5]])
    runs = [Run((), start)]
    for candidate in system.vocabulary:
        parameters = candidate.parameters(system.context)
        x = np.clip([0.5 * p.scale for p in parameters], [p.lower for p in parameters], [p.upper for p in parameters])
        begin = candidate.starts(system.context)
        runs.append(Run((candidate.make(begin[0] if len(begin) else x, system.context)[0],), start))
    return runs


@pytest.mark.parametrize("threads", [1, 2])
def test_every_effect_moves_the_box_as_in_the_engine(
    system: PlanarBox, threads: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Steps of an episode, with the time, the dampers of joints, leaning gravity, friction of all kinds."""
    simulator, runs = Simulator(system.recording, threads=threads), with_each_effect(system)
    direct = simulator.predict(0, runs)
    engine_alone(monkeypatch)
    assert np.ptp(direct[:, -1], axis=0).max() > 0.01  # they do differ from one another
    np.testing.assert_allclose(direct, simulator.predict(0, runs), rtol=0, atol=1e-11)


def test_windows_move_as_in_the_engine(system: PlanarBox, monkeypatch: pytest.MonkeyPatch) -> None:
    """Windows from measured states, with a disturbance."""
    windows, simulator = Windows(np.array([0, 0, 1]), np.array([0, 40, 80]), 20), Simulator(system.recording, threads=1)
    starts = np.random.default_rng(0).normal(size=(3, 4, 6)) * 0.1
    push = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.05]])
    direct = simulator.predict_windows((), windows, starts, push)
    engine_alone(monkeypatch)
    np.testing.assert_allclose(direct, simulator.predict_windows((), windows, starts, push), rtol=0, atol=1e-11)


def test_what_else_acts_is_left_to_the_engine() -> None:
    """A tether is MuJoCo's; the law knows nothing of it."""
    system = open_case(CASE)
    tether = next(c for c in system.vocabulary if c.name == "tether")
    effects = tether.make(tether.starts(system.context)[0], system.context)
    simulator = Simulator(read_case(CASE), threads=1)
    assert dry_friction.is_all_that_acts(simulator.model(()))
    assert not dry_friction.is_all_that_acts(simulator.model(planar(effects)))
