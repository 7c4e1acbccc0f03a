"""The gap of a perfect model is the noise and nothing else; the right effect closes that of a wrong one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import mujoco
import numpy as np
import pandas as pd
import pytest
import yaml
from cases import SIGMA, made

from runner.__main__ import main
from runner.commands.gap import in_short
from runner.diagnosis.corrected import read_corrected, write_corrected
from runner.effects.planar_box import (
    ActuatorDelay,
    AnisotropicFriction,
    ComOffset,
    FloorTilt,
    Friction,
    FrictionPatch,
    Mass,
    ObservationDelay,
    SensorScale,
    Tether,
    ViscousDrag,
    ViscousFilm,
)
from runner.effects.wording import unit_of
from runner.errors import ConfigError, RecordingError, ResultError
from runner.noise.measured import Measured, measure
from runner.recording import write_case
from runner.settings import SETTINGS
from runner.simulate import gap as gap_module
from runner.simulate.gap import WHOLE_EPISODE, Gap, measure_gap
from runner.simulate.shooting import Fitted, fit_starts
from runner.systems.case import open_case
from runner.systems.planar_box.model_file import MODEL
from runner.systems.planar_box.simulator import Simulator
from runner.systems.planar_box.system import PlanarBox
from runner.systems.planar_box.windows import Effects
from runner.systems.simulator import Run
from runner.systems.windows import Windows, windows_of
from tests.mechanism_cases import joint_channels, slide_case
from tests.mechanism_cases import write_case as write_joints
from tests.tosses import toss_case, world

EXAMPLES = Path(__file__).parent.parent / "examples" / "cases"


def noises(table: pd.DataFrame, starts: str, column: str = "noises") -> np.ndarray:
    """Return multiples of the noise, (horizons, channels)."""
    chosen = table[table["starts"] == starts]
    return chosen.pivot_table(index="horizon", columns="channel", values=column, sort=False).to_numpy()


def test_windows_share_their_borders_and_stay_inside() -> None:
    """Windows of 10 steps lie end to end in each episode that is long enough."""
    windows = windows_of([31, 10, 25], 10)
    assert windows.samples == 11
    assert list(zip(windows.episode, windows.first, strict=True)) == [(0, 0), (0, 10), (0, 20), (2, 0), (2, 10)]
    assert len(windows_of([31, 31], 10, [1])) == 3


@pytest.mark.parametrize(
    "effects", [(), (Mass(2.5), ViscousDrag(1.0)), (ActuatorDelay(0.05),), (SensorScale(1.1),)], ids=str
)
def test_windows_continue_an_episode_exactly(effects: Effects) -> None:
    """A window begun from a state of the simulated episode repeats the rest of it."""
    recording, starts = made(noise=0.0, episodes=1)
    simulator = Simulator(recording)
    whole = simulator.predict(0, [Run(effects, starts[0])])[0]
    first = np.array([0, 37, 150])
    windows = Windows(np.zeros(3, int), first, 61)
    again = simulator.predict_windows(effects, windows, whole[first][:, None])[:, 0]
    for f, part in zip(first, again, strict=True):
        np.testing.assert_allclose(part, whole[f : f + 61], atol=1e-9)


def test_a_delayed_measurement_needs_no_past() -> None:
    """In windows, a late measurement is a late command: restarted from what was measured, the rest follows."""
    delay = (ObservationDelay(3 / 60),)
    recording, _ = made(delay, noise=0.0, episodes=1)
    whole = recording.episodes[0]
    shown = np.hstack([whole.pose, whole.twist])
    first = np.array([30, 120, 200])
    windows = Windows(np.zeros(3, int), first, 46)
    again = Simulator(recording).predict_windows(delay, windows, shown[first][:, None])[:, 0]
    for f, part in zip(first, again, strict=True):
        np.testing.assert_allclose(part, shown[f : f + 46], atol=1e-6)


def test_extra_wrench_moves_the_free_body_by_newtons_law() -> None:
    """Without friction, a force of 3 N and a moment of 0.5 N m on 3 kg and 0.5 kg m2 accelerate by 1 m/s2, 1 rad/s2."""
    recording, _ = made(noise=0.0, episodes=1)
    windows = Windows(np.array([0]), np.array([100]), 31)
    start = np.array([[[0.1, 0.2, 0.7, 0.0, 0.0, 0.0]]]).repeat(2, axis=1)
    with_wrench = np.array([[0.0, 0.0, 0.0], [3.0, 0.0, 0.5]])
    without, moved = Simulator(recording).predict_windows((Friction(0.0),), windows, start, with_wrench)[0]
    # the couple turns with the recorded yaw, not with that of this body: right where the two agree
    pose = recording.episodes[0].pose[100:131, 2]
    half = moved[-1] - without[-1]
    assert half[3] == pytest.approx(0.5, rel=1e-3)
    assert half[0] == pytest.approx(0.125, rel=5e-2)
    turn = np.cos(moved[:, 2] - pose).mean() * 0.5
    assert half[5] == pytest.approx(turn, rel=5e-2)


def test_perfect_model_leaves_noise_alone() -> None:
    """Fitted starts: one noise at every horizon; measured starts: what the noise of sample and start makes."""
    recording, starts = made(episodes=4)
    gap = measure_gap(PlanarBox(recording), measure(PlanarBox(recording)))
    assert list(dict.fromkeys(gap.table["horizon"])) == ["0.1 s", "0.5 s", "1 s", WHOLE_EPISODE]
    np.testing.assert_allclose(noises(gap.table, "fitted"), 1.0, atol=0.08)
    ratio = noises(gap.table, "measured") / noises(gap.table, "measured", "noises_expected")
    # linear in the noise, so less exact where friction makes it bend
    np.testing.assert_allclose(ratio[:2], 1.0, atol=0.15)
    np.testing.assert_allclose(ratio[2], 1.0, atol=0.3)
    assert noises(gap.table, "measured")[0].min() > 1.1
    for e, start in gap.starts.items():
        assert np.all(np.abs(start - starts[e]) < 4 * SIGMA)


def test_gap_with_itself_is_zero() -> None:
    """Without noise, from measured starts, nothing is left, over whole episodes either."""
    recording, _ = made(noise=0.0, episodes=2)
    gap = measure_gap(PlanarBox(recording), measure(PlanarBox(recording)), horizons_s=(0.5,))
    assert gap.table["rms"].to_numpy().max() < 1e-9
    assert gap.episodes["episode"].unique().tolist() == [0, 1]


def test_fitted_starts_miss_no_more_than_measured_ones(tmp_path: Path) -> None:
    """Through hits neither: of what a descent leaves more of than the measured start does, that start is kept."""
    system = open_case(toss_case(tmp_path, world(friction=0.1), tosses=2, length_s=0.5))
    gap = measure_gap(system, measure(system), horizons_s=(0.1,), whole_episodes=False).table
    fitted, measured = (float((noises(gap, starts) ** 2).sum()) for starts in ("fitted", "measured"))
    assert measured > 30.0
    assert fitted < measured


def test_a_start_whose_fit_went_astray_is_the_measured_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where a descent ends in worse, or where nothing is finite, the measured start and what it leaves count."""
    recording, _ = made(episodes=2, seconds=3.0)
    system = PlanarBox(recording)
    measured = measure(system)
    plain = gap_module.fit_starts

    def astray(*problem: Any, **how: Any) -> Fitted:
        fitted = plain(*problem, **how)
        residual = fitted.residual + 50.0 * measured.sigma
        residual[::2] = np.nan
        return replace(fitted, residual=residual, starts=fitted.starts + 1.0)

    monkeypatch.setattr(gap_module, "fit_starts", astray)
    gap = measure_gap(system, measured, horizons_s=(0.1,))
    assert max(np.abs(start).max() for start in gap.starts.values()) < 1.0
    fitted, kept = (float((noises(gap.table, starts)[0] ** 2).sum()) for starts in ("fitted", "measured"))
    assert fitted <= kept


@pytest.mark.parametrize("effect", [ActuatorDelay(0.04), ObservationDelay(0.037)])
def test_a_window_is_as_late_as_an_episode(effect: ActuatorDelay | ObservationDelay) -> None:
    """Whatever part of a sample a delay is: a window that begins with an episode shows what the episode does."""
    recording, starts = made(effects=(effect,), noise=0.0, episodes=1, seconds=3.0)
    simulator = PlanarBox(recording).simulator(threads=1)
    samples = len(recording.episodes[0])
    start = simulator.seen_start((effect,), np.asarray(starts[0]))
    whole = simulator.predict(0, [Run((effect,), start)])[0]
    windows = Windows(np.array([0]), np.array([0]), samples)
    assert simulator.predict_windows((effect,), windows, np.asarray(starts[0])[None, None])[0, 0] == pytest.approx(
        whole, abs=1e-9
    )


def test_time_origin_does_not_matter() -> None:
    """A clock that begins elsewhere changes nothing."""
    recording, _ = made(episodes=2, seconds=3.0)
    late = replace(recording, episodes=tuple(replace(e, t_s=e.t_s + 100.0) for e in recording.episodes))
    tables = [measure_gap(PlanarBox(r), measure(PlanarBox(r)), horizons_s=(0.5,)).table for r in (recording, late)]
    np.testing.assert_allclose(tables[0]["rms"], tables[1]["rms"], rtol=1e-6)


@pytest.mark.parametrize("effect", [Friction(0.24), FloorTilt(0.03, 1.0), ObservationDelay(0.1)], ids=str)
def test_right_effect_closes_the_gap(effect: Friction | FloorTilt | ObservationDelay) -> None:
    """The nominal model misses what was planted by far; with the effect only noise is left at every horizon."""
    recording, _ = made((effect,), episodes=2)
    system = PlanarBox(recording)
    signals = measure(system)
    nominal = noises(measure_gap(system, signals).table, "fitted")
    corrected = noises(measure_gap(system, signals, effects=(effect,)).table, "fitted")
    assert nominal[-1].max() > 3
    assert nominal[2].max() > 1.5
    np.testing.assert_allclose(corrected, 1.0, atol=0.12)


def test_too_long_and_too_short_horizons_are_refused() -> None:
    """The message says what is possible."""
    recording, _ = made(episodes=1, seconds=2.0)
    with pytest.raises(RecordingError, match=r"made: no episode is as long as the horizon 5 s; the longest has 2 s"):
        measure_gap(PlanarBox(recording), measure(PlanarBox(recording)), horizons_s=(5.0,))
    with pytest.raises(RecordingError, match=r"horizons_s: must be at least one sample, 0.01667 s, got 0.001 s"):
        measure_gap(PlanarBox(recording), measure(PlanarBox(recording)), horizons_s=(0.001,))


MANY: Effects = (
    Mass(3.123456789012345),
    ComOffset(0.0123456789, -0.02),
    FrictionPatch(0.3, 0.1, 0.2, 0.5),
    FloorTilt(0.02, 1.0),
    ViscousFilm(0.3),
    AnisotropicFriction(1.2, 0.4, normality=0.0),
    Tether(1.2345678901234, 1.0, 2.0, 0.5),
    ActuatorDelay(0.03),
)


def test_corrected_model_reads_back(tmp_path: Path) -> None:
    """`corrected.yaml` gives the same effects in the same order, and names the model beside it."""
    recording, _ = made(noise=0.0, episodes=1, seconds=1.0)
    system = PlanarBox(recording)
    path = write_corrected(tmp_path / "new", MANY, system)
    assert read_corrected(path, system) == (MANY, system)
    assert read_corrected(tmp_path / "new", system) == (MANY, system)
    assert yaml.safe_load(path.read_text(encoding="utf-8"))["model"] == [MODEL]


def test_no_correction_is_a_model_too(tmp_path: Path) -> None:
    """`none` writes an empty set of effects, and reads back as that."""
    system = PlanarBox(made(noise=0.0, episodes=1, seconds=1.0)[0])
    assert read_corrected(write_corrected(tmp_path, (), system), system) == ((), system)


@pytest.mark.parametrize(
    ("text", "error", "message"),
    [
        ("effects: {frictoin: {mu: 0.2}}", ConfigError, "effects.frictoin: no such effect.*near it: 'friction'"),
        ("effects: {friction: {nu: 0.2}}", ConfigError, "effects.friction.nu: no such parameter.*Did you mean 'mu'"),
        ("effects: {wind: {force_n: 1.0}}", ConfigError, "effects.wind: must have 'force_n', 'direction_rad', got"),
        ("effects: {friction: {mu: -1}}", ConfigError, r"effects.friction.mu: must be a finite number in \[0, 10\]"),
        ("effects: {friction: {mu: much}}", ConfigError, "effects.friction.mu: must be a number, got 'much'"),
        ("effects: {friction: 0.2}", ConfigError, "effects.friction: must be {parameter: value}, got 0.2"),
        ("effects: [friction]", ResultError, "must hold 'effects: {name: {parameter: value}}'"),
        ("friction: 0.2", ResultError, "must hold 'effects: {name: {parameter: value}}'"),
        ("effects: {", ResultError, "no YAML"),
    ],
)
def test_bad_models_are_refused(tmp_path: Path, text: str, error: type[Exception], message: str) -> None:
    """One line with the file, the key, and what is allowed."""
    (tmp_path / "corrected.yaml").write_text(text, encoding="utf-8")
    with pytest.raises(error, match=message) as caught:
        read_corrected(tmp_path, PlanarBox(made(noise=0.0, episodes=1, seconds=1.0)[0]))
    assert str(tmp_path / "corrected.yaml") in str(caught.value)
    assert "\n" not in str(caught.value)


def test_missing_model_and_doubled_effect_are_refused(tmp_path: Path) -> None:
    """A path without a file, and a model that the file can't hold."""
    system = PlanarBox(made(noise=0.0, episodes=1, seconds=1.0)[0])
    with pytest.raises(ResultError, match=r"nowhere.yaml: no such file"):
        read_corrected(tmp_path / "nowhere.yaml", system)
    with pytest.raises(ResultError, match="'viscous_drag' can be written once only"):
        write_corrected(tmp_path, (ViscousDrag(1.0), ViscousFilm(1.0)), system)


def test_units_follow_from_names() -> None:
    """The longest ending counts."""
    names = ("mass_kg", "mu", "coefficient_n_m_s", "coefficient_n_s_per_m", "speed_m_s", "share_per_s", "force_n")
    assert [unit_of(n) for n in names] == ["kg", "", "N m s", "N s/m", "m/s", "1/s", "N"]


def test_command_reproduces_the_gap_with_the_model_that_was_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """`runner gap DIR model=PATH` writes the same table as the effects give directly; what is believed is told, too."""
    effect = (Friction(0.26),)
    recording, _ = made(effect, episodes=2, seconds=4.0)
    write_case(recording, tmp_path / "case")
    system = PlanarBox(recording)
    path = write_corrected(tmp_path / "model", effect, system)
    arguments = ["gap", str(tmp_path / "case"), f"model={path}", f"out={tmp_path / 'out'}"]
    assert main(arguments) == 0
    table = pd.read_parquet(tmp_path / "out" / "gap.parquet")
    want = measure_gap(system, measure(system), effects=effect).table
    np.testing.assert_allclose(table["rms"], want["rms"], rtol=1e-9)
    out = capsys.readouterr().out
    assert out.index("the model misses") < out.index("growth of noise") < out.index("missed: each window begins")
    assert max(map(len, out.splitlines()[:-1])) <= 80
    assert "As believed, without the correction: over all 2 episodes the model misses" in " ".join(out.split())
    episodes = pd.read_parquet(tmp_path / "out" / "gap_episodes.parquet")
    assert set(episodes["episode"]) == {0, 1}


def test_a_table_by_any_name_is_a_recording(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The file that is named is read, not the one beside it that has the usual name; without pushes that is said."""
    recording, _ = made(episodes=2, seconds=2.0)
    write_case(recording, tmp_path, table="recording.csv")
    table = pd.read_csv(tmp_path / "recording.csv")
    table[table["episode"] == 1].assign(fx=0.0, fy=0.0).to_csv(tmp_path / "mylog.csv", index=False)
    assert main(["gap", str(tmp_path / "mylog.csv"), f"out={tmp_path / 'out'}", "horizons_s=[0.5]"]) == 0
    assert set(pd.read_parquet(tmp_path / "out" / "gap_episodes.parquet")["episode"]) == {1}
    out = capsys.readouterr().out
    assert "nothing is pushed: 'fx', 'fy' are zero in every row" in out
    assert "over the whole episode the model misses" in " ".join(out.split())


def test_parts_of_one_episode_are_not_called_episodes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A log in one piece is cut in two: it was imported as one episode."""
    slide_case(tmp_path / "case", friction=0.5, command=lambda t: 6 * np.sin(4 * t))
    assert main(["gap", str(tmp_path / "case"), f"out={tmp_path / 'out'}", "horizons_s=[0.5]"]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "over the 2 parts of the one episode the model misses" in out
    assert "2 episodes" not in out


def test_command_takes_a_folder_of_cases(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Every case below it gets its rows; the example without a difference is at its noise in all windows."""
    assert main(["gap", str(EXAMPLES), "horizons_s=[0.5]", f"out={tmp_path}"]) == 0
    table = pd.read_parquet(tmp_path / "gap.parquet")
    assert {Path(c).name for c in table["case"]} == {"nothing_differs", "slippery_floor"}
    fitted = [r for r in table.to_dict("records") if (r["starts"], r["horizon"]) == ("fitted", "0.5 s")]
    worst = {
        name: max(r["noises"] for r in fitted if r["case"] == str(EXAMPLES / name))
        for name in ("nothing_differs", "slippery_floor")
    }
    assert worst["nothing_differs"] < 1.1
    assert worst["slippery_floor"] > worst["nothing_differs"]
    assert "slippery_floor" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("horizons_s=[]", "horizons_s: at least one horizon is needed"),
        ("horizons_s=[0.1,-1]", r"horizons_s[1]: must be a finite number in ]0, 3600] s, got -1.0"),
        ("horizons_s=[0.1,0.1]", "horizons_s: each once only"),
        ("recording=nowhere", "nowhere: no such file or folder"),
    ],
)
def test_command_refuses_bad_settings(
    setting: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Exit code 2 and one line."""
    case = [] if setting.startswith("recording") else [str(EXAMPLES / "nothing_differs")]
    assert main(["gap", *case, setting, f"out={tmp_path / 'out'}"]) == 2
    assert message in capsys.readouterr().err


def test_a_start_that_the_motion_amplifies_is_found_over_longer_and_longer_parts() -> None:
    """The descent over all of sin(x t) at once ends in another valley; from the valley of a short time it does not."""
    t_s = np.linspace(0.0, 40.0, 400)
    signals = cast("Measured", SimpleNamespace(sigma=np.array([0.01]), noise_model=SimpleNamespace(whiten=lambda r: r)))
    values = np.sin(1.0 * t_s)[None, :, None]

    def predict(starts: np.ndarray, samples: int, _: np.ndarray) -> np.ndarray:
        return np.sin(starts * t_s[:samples])[..., None]  # (W, K, 1) by (n,)

    problem = (predict, values, np.ones_like(values, bool), signals, np.array([[1.3]]))
    steps, scale = np.array([1e-6]), np.array([0.2])
    assert abs(fit_starts(*problem, steps, scale, iterations=20).starts[0, 0] - 1.0) > 0.1
    assert fit_starts(*problem, steps, scale, shares=SETTINGS.held_out.growing_shares).starts[0, 0] == pytest.approx(
        1.0, abs=1e-3
    )


def test_where_noise_grows_shorter_windows_say_what_is_missed(tmp_path: Path) -> None:
    """A pole that falls from its head: over two seconds a hair's breadth at the top is half a turn."""
    xml = """<mujoco><option timestep="0.002" integrator="implicitfast"/><worldbody><body>
        <joint name="pole" axis="0 1 0" damping="0.05"/>
        <geom type="capsule" fromto="0 0 0 0 0 0.6" size="0.02" mass="1"/></body></worldbody></mujoco>"""
    model = mujoco.MjModel.from_xml_string(xml)
    data, rng, columns = mujoco.MjData(model), np.random.default_rng(0), []
    for above in (0.005, -0.01, 0.02):
        mujoco.mj_resetData(model, data)
        data.qpos[0], angles = above, []
        for _ in range(400):
            angles.append(data.qpos[0] + 0.003 * rng.normal())
            mujoco.mj_step(model, data, 5)
        columns.append({"t": 0.01 * np.arange(400), "q_pole": np.array(angles)})
    channels = joint_channels(["pole"], velocities=False)
    write_joints(tmp_path, xml, columns, {"commands": {}, "channels": channels, "noise": {"q_pole": 0.003}})
    system = open_case(tmp_path)
    found = measure_gap(system, measure(system))
    assert found.told != WHOLE_EPISODE
    assert found.growth[WHOLE_EPISODE] > 10.0 > found.growth[found.told]
    said = in_short(found, system.recording, found.told)
    assert said == f"in windows of {found.told} the model misses nothing but the noise."


def test_a_free_motion_is_told_of_as_a_whole(tmp_path: Path) -> None:
    """Noise of its first speeds leads far away, but a fit finds them: it grows in proportion to the time alone."""
    toss_case(tmp_path, world(), tosses=3, height_m=5.0)
    system = open_case(tmp_path)
    found = measure_gap(system, measure(system))
    measured = found.table.loc[lambda t: (t["horizon"] == WHOLE_EPISODE) & (t["starts"] == "measured")]
    assert measured["noises_expected"].max() > 10.0
    assert found.told == WHOLE_EPISODE


@pytest.mark.parametrize(("stated", "values", "noises", "said"), [
    (True, 400, 1.12, True), (False, 400, 1.12, False), (False, 400, 1.4, True), (False, 40000, 1.12, True),
])  # fmt: skip
def test_what_an_estimated_noise_may_be_off_by_is_no_gap(
    *, stated: bool, values: int, noises: float, said: bool
) -> None:
    """Of few samples the noise is known to a tenth: a right model leaves as much more, or as much less."""
    row = {
        "starts": "fitted", "horizon": WHOLE_EPISODE, "channel": "x", "stated": stated, "values": float(values),
        "noises": noises, "noises_expected": 1.0, "noises_median": noises, "windows": 1,
    }  # fmt: skip
    found = Gap(pd.DataFrame([row]), pd.DataFrame(), {}, {WHOLE_EPISODE: 1.0})
    recording, _ = made(episodes=1, seconds=1.0)
    assert ("misses x by" in in_short(found, recording, WHOLE_EPISODE)) is said


def test_few_windows_that_make_most_of_a_gap_are_told() -> None:
    """Of a recording of which one second in six is missed by far: what half of the windows miss stands beside it."""
    recording, _ = made(episodes=1, seconds=6.5)
    (episode,) = recording.episodes
    pose = episode.pose.copy()
    late = episode.t_s > 5.0
    pose[late, 0] += 0.02 * np.sin(9.0 * episode.t_s[late])
    spoilt = PlanarBox(replace(recording, episodes=(replace(episode, pose=pose),)))
    for system, told in ((spoilt, True), (PlanarBox(recording), False)):
        found = measure_gap(system, measure(system), horizons_s=[1.0], whole_episodes=False)
        said = in_short(found, system.recording, "1 s")
        assert ("at most in half of the windows)" in said) is told, said
