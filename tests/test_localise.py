"""What is planted in one place, at one time or on one channel is found there; where nothing is planted, nothing is."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pandas as pd
import pytest
from cases import RATE_HZ, made
from mechanism_cases import followed, system_of, write_case

from runner.effects.planar_box import ActuatorDelay, FrictionPatch, Inertia, Wind
from runner.errors import RecordingError
from runner.localise import cells, excess, gap_by_horizon
from runner.localise.where import Where, localise
from runner.localise.windows import check_length, window_lengths_s, windows_of_length
from runner.noise.measured import measure
from runner.recording import Span
from runner.settings import SETTINGS
from runner.systems.channels import Signals
from runner.systems.planar_box import commands
from runner.systems.planar_box import windows as simulated
from runner.systems.planar_box.initial import PlanarStart
from runner.systems.planar_box.system import PlanarBox
from runner.systems.planar_box.windows import Effects
from runner.systems.windows import Labels, Windows, windows_of

PATCH = FrictionPatch(0.5, 0.8, 0.3, 0.5)


def where(planted: Effects, *, held: Effects = (), episodes: int = 5, seconds: float = 6.0, seed: int = 0) -> Where:
    """Localise the gap of a recording with these effects in it."""
    recording, starts = made(planted, episodes=episodes, seconds=seconds, seed=seed)
    return localise(PlanarBox(recording), measure(PlanarBox(recording)), dict(enumerate(starts)), held)


@pytest.fixture(scope="module")
def patch() -> Where:
    """A floor patch with more friction."""
    return where((PATCH,))


@pytest.fixture(scope="module")
def nothing() -> Where:
    """Noise alone."""
    return where(())


def test_noise_alone_exceeds_nothing(nothing: Where) -> None:
    """No gap, no cell, a missing wrench of zero within its errors, and one noise at all horizons."""
    assert not nothing.exceeds
    assert nothing.sentence == "nothing exceeds chance"
    assert (nothing.cells["q"].to_numpy()[nothing.cells["factor"] != "channel"] > 0.05).all()
    assert nothing.gap["noises"].to_numpy() == pytest.approx(1.0, abs=0.12)
    for name in ("fx_n", "fy_n", "mz_n_m"):
        ratio = (nothing.missing_force[name] / nothing.missing_force[f"{name}_se"]).dropna().to_numpy()
        assert len(ratio) > 50
        assert abs(np.mean(ratio)) < 4 / np.sqrt(len(ratio))
        assert 0.6 < np.std(ratio) < 1.3


def test_floor_patch_shows_at_its_place(patch: Where) -> None:
    """Of all places, the worst is within the patch's radius, and its excess is beyond chance."""
    assert patch.exceeds
    places = [row for row in patch.cells.to_dict("records") if row["factor"] == "place"]
    worst = max(places, key=lambda row: row["excess"])
    assert np.hypot(worst["x_m"] - PATCH.x_m, worst["y_m"] - PATCH.y_m) < PATCH.radius_m + 0.5
    assert worst["lift"] > 1.5
    assert worst["p"] < 0.02
    windows = patch.windows
    xy = windows[["x_m", "y_m"]].to_numpy()
    inside = np.hypot(xy[:, 0] - PATCH.x_m, xy[:, 1] - PATCH.y_m) < PATCH.radius_m
    assert windows["excess"].to_numpy()[inside].sum() > 0.5 * patch.excess
    assert inside.mean() < 0.4


def test_right_effect_takes_the_gap_away() -> None:
    """With the planted effect in the model, nothing exceeds chance."""
    assert not where((PATCH,), held=(PATCH,)).exceeds


def test_wind_is_the_missing_wrench() -> None:
    """A planted wind of 1.2 N comes out in the world, within its error, with no moment."""
    found = where((Wind(1.2, 2.0),)).missing_force
    for name, true in (("fx_n", 1.2 * np.cos(2.0)), ("fy_n", 1.2 * np.sin(2.0)), ("mz_n_m", 0.0)):
        known = found[[name, f"{name}_se"]].dropna().to_numpy()
        weight = known[:, 1] ** -2
        mean, error = (known[:, 0] @ weight) / weight.sum(), weight.sum() ** -0.5
        assert abs(mean - true) < 4 * error
        assert error < 0.1
    turned = found["fx_n"] * np.cos(found["yaw_rad"]) + found["fy_n"] * np.sin(found["yaw_rad"])
    both = turned.notna() & found["fx_body_n"].notna()
    assert both.to_numpy().sum() > 30
    np.testing.assert_allclose(turned[both], found.loc[both, "fx_body_n"], atol=1e-9)


def test_wrong_inertia_shows_in_yaw() -> None:
    """An inertia 1.5 times as large: most of the excess is in the yaw rate, and the sentence begins with it."""
    found = where((Inertia(1.5),))
    channels = found.cells[found.cells["factor"] == "channel"].set_index("cell")
    assert channels.index[np.argmax(channels["share"].to_numpy())] == "wz"
    assert found.sentence.startswith("wz")


def test_late_push_shows_after_changes_of_command() -> None:
    """A delay of the actuator is a gap just after the command changes."""
    found = where((ActuatorDelay(0.1),))
    row = next(r for r in found.cells.to_dict("records") if r["cell"] == "just after a change of command")
    assert row["share"] > 0.6
    assert row["lift"] > 1.2
    assert row["q"] < 0.05
    assert "just after a change of command" in found.sentence


def test_shares_of_a_factor_add_up(patch: Where) -> None:
    """Every window is in one regime, one place, one quarter, one episode; so is all of the excess."""
    cells = patch.cells
    for factor in ("regime", "push", "place", "time", "episode"):
        inside = (cells["factor"] == factor).to_numpy()
        assert cells["n"].to_numpy()[inside].sum() == len(patch.windows)
        assert cells["share"].to_numpy()[inside].sum() == pytest.approx(1.0)
    channels = (cells["factor"] == "channel").to_numpy()
    assert cells["share"].to_numpy()[channels].sum() == pytest.approx(1.0)
    assert (cells["excess"] < 0).any()  # what shows less than the noise has no share, and takes none off the others'
    assert (cells["share"] >= 0).all()
    p, q = cells["p"].to_numpy(), cells["q"].to_numpy()
    assert np.all((p >= 0) & (p <= q + 1e-12) & (q <= 1))


def test_the_one_cell_of_a_factor_stands_out_from_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """What moves when anything moves is known before: of one joint, all of the gap and no discovery."""
    label = PlanarBox.label

    def of_one_joint(system: PlanarBox, signals: Signals, windows: Windows) -> Labels:
        labels = label(system, signals, windows)
        moving = [None if regime == "at rest" else "'slide'" for regime in labels.table["regime"]]
        return replace(labels, table=labels.table.assign(push=moving))

    monkeypatch.setattr(PlanarBox, "label", of_one_joint)
    found = where((Wind(1.2, 2.0),), episodes=3).cells
    (only,) = [row for row in found.to_dict("records") if row["factor"] == "push"]
    assert only["n"] < sum(row["n"] for row in found.to_dict("records") if row["factor"] == "regime")
    assert only["share"] > 0.9
    assert only["q"] == 1.0


def test_same_recording_same_answer() -> None:
    """The permutations are drawn the same every time."""
    one, two = (where((PATCH,), episodes=2, seconds=4.0) for _ in range(2))
    assert one.sentence == two.sentence
    np.testing.assert_array_equal(one.cells["p"], two.cells["p"])


def test_smoothed_states_are_exact_on_a_cubic() -> None:
    """Local cubics return position and velocity of a cubic motion."""
    t = np.arange(121) / RATE_HZ
    rate = np.stack([1 + t - 0.5 * t**2, 0 * t + 0.3, 2 * t], axis=1)
    pose = np.stack([t + t**2 / 2 - t**3 / 6, 0.3 * t, t**2], axis=1)

    class Cubic:
        values = (np.hstack([pose, rate]),)
        valid = (np.ones((121, 6), bool),)
        sigma = np.array([0.01, 0.01, 0.01, 0.1, 0.1, 0.1])
        spans = (Span(0, 0, 121),)

    windows = windows_of([121], 20)
    states = PlanarStart(RATE_HZ, np.arange(6)).guess_windows(Cubic(), windows, smooth=True)
    np.testing.assert_allclose(states, Cubic.values[0][windows.first], atol=1e-9)


def test_too_little_to_look_at_is_refused() -> None:
    """A second of one episode has no eight windows."""
    recording, starts = made(episodes=1, seconds=1.0)
    with pytest.raises(RecordingError, match=r"windows of 0.25 s, at least 8 are needed"):
        localise(PlanarBox(recording), measure(PlanarBox(recording)), {0: starts[0]})


def test_short_episodes_are_looked_at_in_shorter_windows() -> None:
    """Twelve flights of 0.2 s hold no window of a quarter of a second, and two of an eighth less one sample."""
    recording, _ = made(episodes=12, seconds=0.2)
    system = PlanarBox(recording)
    lengths = window_lengths_s(system, range(12))
    assert lengths[1:] == SETTINGS.where.window_lengths_s
    assert len(windows_of_length(system, lengths[0], range(12))) == 12
    check_length(system)


def test_in_portions_it_is_the_same(patch: Where, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of windows, permutations, rollouts and commands few are in memory, and the numbers are those of all at once."""
    for module in (excess, gap_by_horizon):
        monkeypatch.setattr(module, "WINDOWS_AT_ONCE", 17)
    monkeypatch.setattr(cells, "ORDERS_AT_ONCE", 70)
    monkeypatch.setattr(simulated, "BYTES_AT_ONCE", 3e6)
    monkeypatch.setattr(commands, "KEPT_BYTES", 0.0)
    other = where((PATCH,))
    for name in ("gap", "windows", "missing_force", "cells"):
        pd.testing.assert_frame_equal(getattr(other, name), getattr(patch, name), rtol=1e-9, atol=1e-12)
    assert other.sentence == patch.sentence


def test_permutations_of_an_hour_take_little_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    """14,400 windows of 120 episodes: of a quarter of the orders, all at once would be a hundred megabytes."""
    few = replace(SETTINGS, where=replace(SETTINGS.where, permutations=999))
    monkeypatch.setattr(cells, "SETTINGS", few)
    number = np.arange(14_400)
    episode = np.array([f"episode {k // 120}" for k in number], dtype=object)
    third = np.array(["a" if k % 3 else "b" for k in number], dtype=object)
    size = np.random.default_rng(0).standard_normal(len(number)) + (number // 120 == 7)
    factors = {name: cells._Factor.of(labels, size) for name, labels in (("episode", episode), ("third", third))}
    tracemalloc.start()
    by_chance = cells._by_chance(factors, episode)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 50e6
    assert factors["episode"].names[by_chance["episode"].argmin()] == "episode 7"
    assert by_chance["third"].min() > 0.01


SAGGING = """<mujoco><option timestep="0.001"/><worldbody><body name="lever">
<joint name="hinge" axis="0 1 0" damping="0.1"/>
<inertial pos="0.3 0 0" mass="1" diaginertia="0.01 0.01 0.01"/></body></worldbody>
<actuator><position name="servo" joint="hinge" kp="{kp}" kv="1.5"/></actuator></mujoco>"""


def test_what_a_joint_misses_at_rest_is_no_slow_noise(tmp_path: Path) -> None:
    """A servo that is softer than believed lets its load sag, and stands there as still as any sensor sees it."""
    model = mujoco.MjModel.from_xml_string(SAGGING.format(kp=20.0))
    t, columns = 0.01 * np.arange(600), []
    for episode in range(3):
        u = 0.4 * np.round(np.sin(0.8 * t + episode))
        q = followed(model, u)
        columns.append({"t": t, "u": u, "q": q + 2e-4 * np.random.default_rng(episode).normal(size=len(t))})
    nominal = {
        "commands": {"u": {"actuator": "servo"}},
        "channels": {"q": {"joint": "hinge", "quantity": "position"}},
        "noise": {"q": 2e-4},
    }
    system = system_of(write_case(tmp_path, SAGGING.format(kp=25.0), columns, nominal))
    measured = measure(system)
    starts = {e: system.initial.guess(measured, e) for e in range(3)}
    found = localise(system, measured, starts)
    table = found.windows[found.windows["regime"] == "at rest"]
    assert len(table) > 20
    assert table["excess"].min() > 10.0 * table["freedom"].max()
    # under its load of 2.9 N m it sags to where the believed servo, stiffer by a quarter, exerts a quarter more
    still = found.missing_force[found.missing_force["regime"] == "at rest"]
    assert still["tau_hinge_n_m"].median() == pytest.approx(0.25 * 2.94 * 0.95, rel=0.1)
