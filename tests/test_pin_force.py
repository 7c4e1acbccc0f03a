"""The force of a pin as a channel: what is predicted, where a measurement counts, and what it tells."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from runner.effects.planar_box import Friction, ObservationDelay, SensorScale, Tether
from runner.inference.least_squares import NONE, Explanation, Fitter
from runner.noise.measured import measure
from runner.physics import dry_friction
from runner.recording import BelievedPin, Episode, Form, Noise, Nominal, Recording, read_case, write_case
from runner.recording.data import warnings
from runner.simulate.gap import measure_gap
from runner.systems.planar_box.pin_force import REACH_S
from runner.systems.planar_box.simulator import Simulator
from runner.systems.planar_box.system import PlanarBox
from runner.systems.simulator import Run
from runner.systems.windows import Windows

G, MASS_KG, FRICTION, RATE_HZ, HALF_M, RADIUS_M = 9.81, 1.2, 0.3, 30.0, 0.06, 0.005
FORCE_N, PLACE_M, ANGLE_RAD = 0.08, 2e-4, 2e-3  # noise
BELIEVED = Nominal(
    (HALF_M, HALF_M, 0.03),
    MASS_KG,
    FRICTION,
    G,
    RATE_HZ,
    noise=Noise(PLACE_M, ANGLE_RAD),
    pin=BelievedPin(RADIUS_M, 0.5),
)
TOUCHING_M = -(HALF_M + RADIUS_M)


def recorded(*paths: np.ndarray, nominal: Nominal = BELIEVED) -> Recording:
    """Return a recording along paths (T, 2) in which poses and forces are measured, as zeros."""
    episodes = []
    for i, path in enumerate(paths):
        nothing = np.zeros((len(path), 3))
        t_s = np.arange(len(path)) / nominal.rate_hz
        episodes.append(Episode(i, t_s, nothing, nothing + np.nan, nothing, nothing, path))
    return Recording(Path("made"), Form.PLANAR, nominal, tuple(episodes))


def along_x(way_m: np.ndarray, y_m: float = 0.0) -> np.ndarray:
    """Return the path of a pin that touches the box and goes so far, (T, 2)."""
    return np.column_stack([TOUCHING_M + way_m, np.full(len(way_m), y_m)])


def push(seconds: float, way_m: float, y_m: float, slant: float) -> np.ndarray:
    """Return a path that rests, goes a way smoothly, and rests, (T, 2)."""
    s = np.clip(np.arange(round(seconds * RATE_HZ) + 1) / RATE_HZ / (seconds - 0.2) - 0.1, 0, 1)
    way = way_m * s**3 * (10 - 15 * s + 6 * s**2)
    return along_x(way, y_m) + slant * np.column_stack([np.zeros(len(way)), way])


def test_a_force_is_that_of_friction_and_of_what_speeds_the_body_up() -> None:
    """Pushed through its centre at x = v t + a t^2 / 2 + j t^3 / 6: mu m g + m (a + j t), neither early nor late."""
    t = np.arange(31) / RATE_HZ
    simulator = Simulator(recorded(along_x(0.05 * t + 0.1 * t**2 / 2 + 1.5 * t**3 / 6)), threads=1)
    shown = simulator.predict(0, [Run((), np.array([0, 0, 0, 0.05, 0, 0]))])[0]
    assert shown.shape == (31, 5)
    inner = slice(3, 28)
    friction = FRICTION * MASS_KG * G
    np.testing.assert_allclose(shown[inner, 3], friction + MASS_KG * (0.1 + 1.5 * t[inner]), rtol=0.01)
    # half a sample late it would be off by m j / (2 rate)
    late_n = shown[inner, 3] - friction - MASS_KG * (0.1 + 1.5 * t[inner])
    assert abs(late_n.mean()) < 0.2 * MASS_KG * 1.5 / (2 * RATE_HZ)
    np.testing.assert_allclose(shown[inner, 4], 0, atol=0.01)
    steady = Simulator(recorded(along_x(0.05 * t)), threads=1)
    shown = steady.predict(0, [Run((), np.array([0, 0, 0, 0.05, 0, 0]))])[0]
    np.testing.assert_allclose(shown[inner, 3], friction, rtol=0.01)


def test_the_engine_tells_the_same_force(monkeypatch: pytest.MonkeyPatch) -> None:
    """Episodes, parts and windows by MuJoCo's own steps, and a tether, which only these know."""
    recording = recorded(push(1.0, 0.05, 0.01, 0.1), push(1.0, 0.05, -0.02, -0.2))
    windows, starts = Windows(np.array([0, 1]), np.array([10, 12]), 8), np.zeros((2, 2, 6))
    starts[:, :, 0] = np.array([0.01, 0.012])[:, None]
    pushed = np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0]])
    runs = [Run(e, np.zeros(6)) for e in ((), (Friction(0.2),), (Tether(1e-9, 0.3, 0.0, 0.0),))]

    def shown() -> tuple[np.ndarray, np.ndarray]:
        simulator = Simulator(recording, threads=1)
        return simulator.predict(0, runs), simulator.predict_windows((), windows, starts, pushed)

    direct = shown()
    np.testing.assert_allclose(direct[0][2], direct[0][0], atol=1e-6)
    assert np.abs(direct[0][..., 3:]).max() > 3.0
    # the pin takes up what else pushes
    assert (direct[1][:, 1, -1, 3] - direct[1][:, 0, -1, 3]).tolist() == pytest.approx([-0.5, -0.5], abs=0.1)
    monkeypatch.setattr(dry_friction, "is_all_that_acts", lambda model: False)
    for ours, theirs in zip(direct, shown(), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-7)


def test_the_scale_of_a_camera_is_not_that_of_a_force() -> None:
    """The force has a sensor of its own; all that is measured is late by one delay."""
    simulator = Simulator(recorded(push(1.0, 0.05, 0.0, 0.0)), threads=1)
    effects = ((), (SensorScale(1.1),), (ObservationDelay(3 / RATE_HZ),))
    plain, scaled, late = simulator.predict(0, [Run(e, np.zeros(6)) for e in effects])
    np.testing.assert_array_equal(plain[:, 3:], scaled[:, 3:])
    np.testing.assert_allclose(1.1 * plain[:, 0], scaled[:, 0])
    np.testing.assert_allclose(plain[3:-6], late[6:-3], atol=0.02)


def test_a_force_counts_while_the_pin_moves_and_pushes() -> None:
    """Not where it stands and only leans on the body, not just after it has met it, and not where it was lost."""
    still, speed = np.zeros(30), 0.05 * np.arange(1, 61) / RATE_HZ
    recording = recorded(along_x(np.concatenate([still, speed, still + speed[-1]])))
    force = np.zeros((120, 3))
    force[:100, 0] = 2.0  # it leans on the body before, and rests against it after
    force[45:90, 0] = 3.5
    force[30:40, 0] = 0.0  # it comes from afar
    force[60, 0] = np.nan
    (episode,) = recording.episodes
    system = PlanarBox(replace(recording, episodes=(replace(episode, force_n=force),)))
    (values,) = system.values()
    counts = np.isfinite(values[:, 3])
    reach = math.ceil(REACH_S * RATE_HZ)
    assert [c.name for c in system.channels] == ["x", "y", "yaw", "fx", "fy"]
    assert counts[40 + 2 * reach : 60].all()
    assert counts[61 : 90 - 2 * reach].all()
    # a sensor shows a touch from one sample to the next; when a model has it, hangs on the noise of a pose
    assert not counts[: 40 + 2 * reach].any()
    assert not counts[60]
    assert not counts[90:].any()
    assert system.with_values(system.values()).values()[0] == pytest.approx(values, nan_ok=True)
    found, planned, start = system.proposals()
    assert planned.channels == system.channels
    assert planned.simulator(threads=1).predict(0, [Run((), start)]).shape[-1] == 5
    assert found


def test_a_force_is_read_where_it_was_measured(tmp_path: Path) -> None:
    """Zeros throughout are no measurement, axis by axis; a warning is of the other sign, not of a pin that is there."""
    recording = made([push(2.0, 0.08, 0.0, 0.0)], FRICTION)
    for axes, names in (([0, 1], ["fx", "fy"]), ([0], ["fx"]), ([], [])):
        episodes = []
        for episode in recording.episodes:
            force = np.zeros_like(episode.force_n)
            force[:, axes] = episode.force_n[:, axes]
            episodes.append(replace(episode, force_n=force))
        write_case(replace(recording, episodes=tuple(episodes)), tmp_path)
        read = read_case(tmp_path)
        system = PlanarBox(read)
        assert [c.name for c in system.channels][3:] == names
        assert not warnings(read.notes)
        assert system.driven_otherwise(2) == ()
        assert np.isnan(system.stated_noise()[3:]).all()
    back = tuple(replace(episode, force_n=-episode.force_n) for episode in recording.episodes)
    write_case(replace(recording, episodes=back), tmp_path)
    (warning,) = warnings(read_case(tmp_path).notes)
    assert "is against its way" in warning


def test_a_window_tells_a_force_once_pin_and_body_have_settled() -> None:
    """Begun anew from states with noise, a pin strikes or leaves the body: a true model has a gap of one noise all the
    same, and of the first tenth of a second nothing is told."""
    system = PlanarBox(made([push(3.0, 0.1, 0.0, 0.05), push(3.0, 0.1, 0.0, -0.05)], FRICTION))
    table = measure_gap(system, measure(system), horizons_s=(0.07, 0.5), whole_episodes=False).table
    rows = [row for row in table.to_dict("records") if row["starts"] == "fitted"]
    noises = {(row["channel"], row["horizon"]): row["noises"] for row in rows}
    assert noises["fx", "0.5 s"] < 1.3
    assert noises["fy", "0.5 s"] < 1.3
    assert np.isnan(noises["fx", "0.07 s"])
    assert noises["x", "0.07 s"] < 1.3


def made(paths: list[np.ndarray], friction: float, seed: int = 3) -> Recording:
    """Return pushes of a box on a floor of this friction, with noise on poses and forces."""
    rng, blank = np.random.default_rng(seed), recorded(*paths)
    simulator, episodes = Simulator(blank, threads=1), []
    for i, episode in enumerate(blank.episodes):
        shown = simulator.predict(i, [Run((Friction(friction),), np.zeros(6))])[0]
        shown += rng.normal(size=shown.shape) * [PLACE_M, PLACE_M, ANGLE_RAD, FORCE_N, FORCE_N]
        force = np.column_stack([shown[:, 3:], np.zeros(len(shown))])
        episodes.append(replace(episode, pose=shown[:, :3], force_n=force))
    return replace(blank, episodes=tuple(episodes))


@pytest.mark.parametrize("friction", [FRICTION, 0.42])
def test_a_force_tells_friction(friction: float) -> None:
    """A push along a path says nothing of how large friction is, its force does: within three errors of mu m g."""
    recording = made([push(1.6, 0.06, 0.0, 0.05), push(1.6, 0.06, 0.01, -0.1)], friction)
    system = PlanarBox(recording)
    measured = measure(system)
    assert measured.sensor[3] == pytest.approx(FORCE_N, rel=0.25)
    fitter = Fitter(system, system.simulator(threads=1), measured)
    none = fitter.fit(NONE, (0, 1), iterations=6)
    (candidate,) = system.vocabulary.by_name["friction"]
    fit = fitter.fit(Explanation((candidate,)), (0, 1), near=none, iterations=12)
    (error,) = np.sqrt(np.diag(np.linalg.inv(fit.information())))
    (effect,) = candidate.make(fit.x, system.context)
    assert isinstance(effect, Friction)
    found, at_an_error = effect.mu, candidate.make(fit.x + error, system.context)[0]
    assert isinstance(at_an_error, Friction)
    assert abs(found - friction) < 3 * (at_an_error.mu - found) < 0.02
    left, gap = (fitter.measured.excess(f.total, (0, 1)) for f in (fit, none))
    assert left < 1.0
    assert gap - left > 10.0 if friction != FRICTION else gap - left < 0.2
