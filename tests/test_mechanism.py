"""A mechanism as a system: starts, windows, effects, forces, labels, experiments, drawing, the corrected model."""

from __future__ import annotations

import copy
import shutil
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar, Self

import dm_control
import mujoco
import numpy as np
import pytest

from runner.effects.base import Parameter, Vector
from runner.effects.mechanism import Command, MechanismEffect, Reading, Scope
from runner.effects.mechanism.actuator_delay import ActuatorDelay
from runner.effects.mechanism.clock_scale import ClockScale
from runner.effects.mechanism.joint_friction import JointFriction
from runner.effects.mechanism.observation_delay import ObservationDelay
from runner.errors import ResultError
from runner.recording import Span
from runner.systems.mechanism import MechanismSystem, model_file, read_mechanism
from runner.systems.mechanism.held import step_means
from runner.systems.mechanism.scope import raw_signals
from runner.systems.simulator import Run
from runner.systems.windows import Windows
from tests.mechanism_cases import ARM, BODY, MOTOR, PENDULUM, SLIDE, joint_channels, slide_case, system_of, write_case

PRACTICE = Path("/work/shared/practice_joints")
JOINTS = ("shoulder", "elbow")
NULLS = ("j4abe752026", "j9c45b719af", "jf33833e847")


@dataclass(frozen=True)
class Throwaway(MechanismEffect):
    """Base of effects that stand in for real ones."""

    name: ClassVar[str] = "throwaway"
    label: ClassVar[str] = "throwaway"

    @classmethod
    def parameters(cls, context: Scope) -> tuple[Parameter, ...]:
        return ()

    @classmethod
    def from_vector(cls, x: Vector, context: Scope) -> Self:
        return cls()


@dataclass(frozen=True)
class Heavier(Throwaway):
    ratio: float = 1.0

    def edit_model(self, model: mujoco.MjModel) -> None:
        model.body_mass[1:] *= self.ratio


@dataclass(frozen=True)
class Off(Throwaway):
    """A centre of mass that is elsewhere: what MuJoCo ignores in a body that it takes for simple."""

    def edit_model(self, model: mujoco.MjModel) -> None:
        model.body_ipos[1] = [0.05, 0.0, 0.0]


@dataclass(frozen=True)
class Spring(Throwaway):
    structural: ClassVar[bool] = True
    stiffness: float = 0.0

    def edit_spec(self, spec: mujoco.MjSpec) -> None:
        tendon = spec.add_tendon(name="spring", springlength=[0.0, 0.0])
        tendon.wrap_joint("slide", 1.0)
        tendon.stiffness = [self.stiffness, 0.0, 0.0] if np.ndim(tendon.stiffness) else self.stiffness


@dataclass(frozen=True)
class Doubled(Throwaway):
    def edit_command(self, command: Command) -> Command:
        return replace(command, columns={n: 2 * c for n, c in command.columns.items()})


@dataclass(frozen=True)
class Scaled(Throwaway):
    def edit_reading(self, reading: Reading) -> Reading:
        return replace(reading, channels={n: 1.1 * c for n, c in reading.channels.items()})


def driven(t: np.ndarray) -> np.ndarray:
    return 2.0 * np.sin(3 * t) + 1.0


def arm(folder: Path, *, episodes: int = 2, start: str = "free") -> MechanismSystem:
    t = np.arange(301) * 0.01
    columns = {"t": t, "ua": np.sin(4 * t), "ub": 0.4 * np.sin(3 * t)}
    blank = columns | dict.fromkeys(("q_shoulder", "q_elbow", "dq_shoulder", "dq_elbow", "tau"), 0.0 * t)
    nominal = {
        "commands": {"ua": {"actuator": "shoulder"}, "ub": {"actuator": "elbow"}},
        "channels": {**joint_channels(["shoulder", "elbow"]), "tau": {"actuator": "elbow", "quantity": "force"}},
        "noise": {"q_shoulder": 1e-3, "q_elbow": 1e-3, "dq_shoulder": 1e-2, "dq_elbow": 1e-2, "tau": 0.01},
        "start": start,
    }
    system = system_of(write_case(folder, ARM, [blank] * episodes, nominal))
    start_at = np.array([0.4, -0.2, 0.0, 0.0])
    values = [system.simulator().predict(e, [Run((), start_at)])[0] for e in range(episodes)]
    return system.with_values(values)


def test_means_of_what_is_held_are_exact():
    t, held = np.array([0.0, 0.1, 0.25]), np.array([[1.0], [2.0], [-1.0]])
    means = step_means(t, held, np.array([-0.1, 0.0, 0.05, 0.15, 0.3]), np.array([5.0]))
    assert means[:, 0] == pytest.approx([5.0, 1.0, 1.5, (0.1 * 2.0 - 0.05) / 0.15])


def test_an_edited_number_changes_the_motion_as_it_should(tmp_path: Path):
    """Twice the mass is half the acceleration; twice the command is twice; a reading is scaled as it is."""
    system = system_of(slide_case(tmp_path, command=lambda t: np.full_like(t, 3.0)))
    start = np.zeros(2)
    runs = [Run(e, start) for e in ((), (Heavier(2.0),), (Doubled(),), (Scaled(),), (Heavier(2.0), Doubled()))]
    plain, heavy, doubled, scaled, both = system.simulator().predict(0, runs)
    assert heavy == pytest.approx(plain / 2, abs=1e-9)
    assert doubled == pytest.approx(plain * 2, abs=1e-9)
    assert scaled == pytest.approx(plain * 1.1, abs=1e-9)
    assert both == pytest.approx(plain, abs=1e-9)
    assert system.simulator().simulated_s == pytest.approx(5 * 2.0)


def test_a_structural_effect_adds_what_it_needs(tmp_path: Path):
    """A tendon's spring makes the carriage swing with sqrt(k / m)."""
    system = system_of(slide_case(tmp_path, mass=2.0))
    soft, hard = system.simulator().predict(0, [Run((Spring(k),), np.array([0.1, 0.0])) for k in (8.0, 32.0)])
    t = system.recording.episodes[0].t_s
    assert soft[:, 0] == pytest.approx(0.1 * np.cos(2 * t), abs=1e-5)
    assert hard[:, 0] == pytest.approx(0.1 * np.cos(4 * t), abs=1e-5)


def test_parts_and_windows_go_on_as_the_episode_does(tmp_path: Path):
    """Begun from the predicted state, a part of an episode is predicted as within the whole."""
    system = arm(tmp_path)
    simulator = system.simulator()
    whole = system.values()[0]
    state = np.concatenate([whole[60, :2], whole[60, 2:4]])
    part = simulator.parts([Span(1, 60, 140)]).predict(0, [Run((), state)])[0]
    assert part == pytest.approx(whole[60:140], abs=2e-4)
    windows = Windows(np.array([0, 1]), np.array([60, 60]), 80)
    rows = simulator.predict_windows((), windows, np.tile(state, (2, 3, 1)))
    assert rows.shape == (2, 3, 80, 5)
    assert rows[1, 2] == pytest.approx(part, abs=1e-12)
    nested = simulator.parts([Span(0, 40, 200)]).parts([Span(0, 20, 100)])
    assert nested.predict(0, [Run((), state)])[0] == pytest.approx(part, abs=1e-12)


def test_parts_side_by_side_move_as_each_does_alone(tmp_path: Path):
    """Of whatever length, with whatever each is asked for: what is simulated beyond a shorter one's end is not seen."""
    simulator = arm(tmp_path).simulator().parts([Span(0, 0, 100), Span(0, 20, 200), Span(0, 5, 98), Span(0, 3, 4)])
    state = np.array([0.2, -0.1, 0.4, 0.3])
    runs = [[Run((), state), Run((Heavier(1.25),), state)], [Run((), -state)], [Run((Heavier(1.1),), state)], []]
    each = simulator.predict_each(list(enumerate(runs)))
    assert [len(shown) for shown in each] == [2, 1, 1, 0]
    for k, shown in enumerate(each):
        for run, row in zip(runs[k], shown, strict=True):
            np.testing.assert_array_equal(row, simulator.predict(k, [run])[0])


def test_a_late_command_of_before_the_cut_still_comes(tmp_path: Path):
    """The last third of a log in one piece goes on under what was commanded before it: a carriage driven by sin(4t)."""
    delay_s, mass = 0.15, 2.0

    def motion(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        late = 4 * np.maximum(t - delay_s, 0.0)
        return (late - np.sin(late)) / (16 * mass), (1 - np.cos(late)) / (4 * mass)

    folder = slide_case(tmp_path, mass=mass, command=lambda t: np.sin(4 * t), motion=motion, step_s=0.002, length_s=3.0)
    system = read_mechanism(folder)
    recorded = system.recording.episodes[1]
    assert recorded.after is system.recording.episodes[0]
    run = Run((ActuatorDelay("drive", delay_s),), recorded.values[0])
    predicted = system.simulator().predict(1, [run])[0]
    # means over the steps of a command that is held from sample to sample: late by half a sample
    assert predicted == pytest.approx(recorded.values, abs=1e-3)
    assert system.simulator().predict(1, [Run((), recorded.values[0])])[0] != pytest.approx(recorded.values, abs=0.02)


def test_a_disturbance_is_a_force_at_its_joint(tmp_path: Path):
    """A missing force of 1 N on 2 kg moves the carriage by t^2 / 4."""
    system = system_of(slide_case(tmp_path, mass=2.0))
    windows = Windows(np.array([0, 0]), np.array([10, 50]), 101)
    forces = np.array([[0.0], [1.0]])
    rows = system.simulator().predict_windows((), windows, np.zeros((2, 2, 2)), forces)
    t = np.arange(101) * 0.005
    assert rows[:, 0] == pytest.approx(0.0, abs=1e-12)
    assert rows[:, 1, :, 0] == pytest.approx(np.tile(t**2 / 4, (2, 1)), abs=1e-9)
    assert system.disturbance.names == ("f_slide_n",)
    assert arm(tmp_path / "arm", episodes=1).disturbance.names == ("tau_shoulder_n_m", "tau_elbow_n_m")


def test_windows_begin_where_their_sensors_show(tmp_path: Path):
    """With a scaled reading the true start is the shown one divided by the scale."""
    system = system_of(slide_case(tmp_path))
    shown = np.array([0.22, 0.44])
    assert system.simulator().seen_start((Scaled(),), shown) == pytest.approx([0.2, 0.4], abs=1e-9)
    rows = system.simulator().predict_windows(
        (Scaled(),), Windows(np.array([0]), np.array([20]), 10), shown[None, None]
    )
    assert rows[0, 0, 0] == pytest.approx(shown, abs=1e-9)


@pytest.mark.parametrize("velocities", [True, False])
def test_starts_are_guessed_from_what_is_measured(tmp_path: Path, velocities: bool):
    """Positions as measured; velocities from their channel or from slopes."""

    def motion(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return 0.3 * np.sin(2 * t), 0.6 * np.cos(2 * t)

    system = system_of(slide_case(tmp_path, motion=motion))
    if not velocities:
        values = [np.column_stack([v[:, 0], np.full(len(v), np.nan)]) for v in system.values()]
        system = system.with_values(values)
    signals = raw_signals(system.recording)
    t = np.array([0, 40, 200])
    guess = system.initial.guess_windows(signals, Windows(np.zeros(3, int), t, 5), smooth=True)
    assert guess[:, 0] == pytest.approx(0.3 * np.sin(2 * t * 0.005), abs=2e-3)
    assert guess[:, 1] == pytest.approx(0.6 * np.cos(2 * t * 0.005), abs=2e-2)
    assert system.initial.guess(signals, 0) == pytest.approx([0.0, 0.6], abs=2e-2)


def test_a_start_that_was_not_measured_is_told_by_the_next_readings(tmp_path: Path):
    """Nothing of the position came through for a while: it starts where the next ones lead, not at zero."""
    system = system_of(slide_case(tmp_path, motion=lambda t: (1.0 + 0.3 * t + 0.05 * t**2, 0.3 + 0.1 * t)))
    values = [v.copy() for v in system.values()]
    values[0][:40, 0] = np.nan
    system = system.with_values(values)
    signals = raw_signals(system.recording)
    assert system.initial.guess(signals, 0) == pytest.approx([1.0, 0.3], abs=5e-2)


def test_many_starts_are_those_that_are_found_one_by_one(tmp_path: Path):
    """Of an arm whose joints are measured, some readings lost: what is solved at once, and by iteration."""
    t, random = np.arange(61) * 0.01, np.random.default_rng(2)
    columns = {"t": t, "u": 0.0 * t, **{name: np.cumsum(random.normal(size=61)) for name in joint_channels(JOINTS)}}
    columns["q_shoulder"][20:30], columns["dq_elbow"][::3], columns["q_elbow"][:25] = np.nan, np.nan, np.nan
    nominal = {
        "commands": {"u": {"actuator": "shoulder"}},
        "channels": joint_channels(JOINTS),
        "noise": dict(zip(joint_channels(JOINTS), (1e-3, 2e-3, 1e-2, 3e-2), strict=True)),
        "start": "free",
    }
    system = system_of(write_case(tmp_path, ARM, [columns], nominal))
    signals = raw_signals(system.recording)
    for smooth in (True, False):
        found = system.initial.guess_windows(signals, Windows(np.zeros(61, int), np.arange(61), 1), smooth=smooth)
        for k in range(61):
            alone = system.initial._solve(signals, 0, k, smooth=smooth, rests=False)
            assert found[k] == pytest.approx(alone, rel=1e-9, abs=1e-9)


def test_a_start_at_rest_has_no_speed(tmp_path: Path):
    """Whatever the start says of speeds, an episode that begins at rest begins without; a part of it does not."""
    system = system_of(slide_case(tmp_path, start="rest"))
    fast = np.array([0.1, 5.0])
    assert system.simulator().predict(0, [Run((), fast)])[0][:, 0] == pytest.approx(0.1, abs=1e-12)
    later = system.simulator().parts([Span(0, 10, 20)]).predict(0, [Run((), fast)])[0]
    assert later[1, 0] == pytest.approx(0.1 + 5.0 * 0.005)


def body_case(folder: Path, *, forces: bool = False) -> MechanismSystem:
    """Return a body in free flight, its pose measured, spinning about z, with a force at a point of it."""
    t = np.arange(61) * 0.01
    columns = {"t": t, **dict.fromkeys(("x", "y", "z", "i", "j", "k", "rate"), 0.0 * t), "w": 0.0 * t + 1.0}
    columns |= {"fx": 0.0 * t + 3.0, "fy": 0.0 * t, "fz": 0.0 * t + 2 * 9.81}
    columns |= {"px": 0.0 * t, "py": 0.0 * t + 0.1, "pz": 0.0 * t}
    channels: dict[str, object] = {a: {"body": "object", "quantity": "position", "axis": a} for a in "xyz"}
    channels["quat"] = {"body": "object", "quantity": "orientation", "columns": ["w", "i", "j", "k"]}
    channels["rate"] = {"sensor": "gyro", "index": 2}
    nominal: dict[str, object] = {"channels": channels, "noise": dict.fromkeys(["x", "y", "z", "quat", "rate"], 1e-3)}
    if forces:
        nominal["forces"] = [{"body": "object", "force": ["fx", "fy", "fz"], "point": ["px", "py", "pz"]}]
    return system_of(write_case(folder, BODY, [columns], nominal))


def test_a_thrown_body_flies_and_spins(tmp_path: Path):
    """Ballistic, and at a constant rate about a principal axis; orientations are turns from what was measured."""
    system = body_case(tmp_path)
    start = np.array([0.1, 0.2, 1.0, 0.0, 0.0, 0.3, 1.0, -2.0, 3.0, 0.0, 0.0, 4.0])
    t = system.recording.episodes[0].t_s
    shown = system.simulator().predict(0, [Run((), start)])[0]
    assert shown[:, 0] == pytest.approx(0.1 + t, abs=1e-9)
    assert shown[:, 2] == pytest.approx(1.0 + 3 * t - 0.5 * 9.81 * t**2, abs=1e-9)
    # measured was no turn at all
    assert shown[:, 5] == pytest.approx(0.3 + 4 * t, abs=1e-9)
    assert shown[:, 3:5] == pytest.approx(0.0, abs=1e-9)
    assert shown[:, 6] == pytest.approx(4.0, abs=1e-9)


def test_the_start_of_a_thrown_body_is_found_again(tmp_path: Path):
    """Pose and twist follow from positions, orientations and a gyroscope, also far from the reference."""
    system = body_case(tmp_path)
    start = np.array([0.1, 0.2, 1.0, 0.4, -1.2, 2.0, 1.0, -2.0, 3.0, 0.5, -0.3, 4.0])
    shown = system.simulator().predict(0, [Run((), start)])[0]
    recording = system.recording
    turns = shown[:, 3:6]
    size = np.linalg.norm(turns, axis=1, keepdims=True)
    measured = np.hstack([np.cos(size / 2), np.sin(size / 2) * turns / size])
    values = shown.copy()
    values[:, 3:6] = 0.0
    episode = replace(recording.episodes[0], values=values, orientations={"quat": measured})
    again = MechanismSystem(replace(recording, episodes=(episode,)), step_s=system.step_s)
    guess = again.initial.guess(raw_signals(again.recording), 0)
    assert guess[:3] == pytest.approx(start[:3], abs=2e-3)
    assert guess[6:] == pytest.approx(start[6:], abs=0.1)
    residual = again.simulator().predict(0, [Run((), start)])[0] - values
    assert residual == pytest.approx(0.0, abs=1e-7)
    poses = again.poses(0, values)["object"]
    assert poses[:, :3] == pytest.approx(values[:, :3], abs=1e-5)
    assert np.abs(np.sum(poses[:, 3:] * measured, axis=1)) == pytest.approx(1.0, abs=1e-9)


def test_a_recorded_force_acts_at_its_point(tmp_path: Path):
    """A force off the centre: m a, and the moment r x F that turns with the body, from an independent integration."""
    system = body_case(tmp_path, forces=True)
    shown = system.simulator().predict(0, [Run((), np.zeros(12))])[0]
    t = system.recording.episodes[0].t_s
    assert shown[:, 0] == pytest.approx(3.0 / 2.0 * t**2 / 2, abs=1e-6)
    assert shown[:, 2] == pytest.approx(0.0, abs=1e-6)
    # at first the arm points along y: moments about x and z
    early = t < 0.05
    assert shown[early, 5] == pytest.approx(-0.1 * 3.0 / 0.04 * t[early] ** 2 / 2, rel=2e-2, abs=1e-7)
    assert shown[early, 3] == pytest.approx(0.1 * 2 * 9.81 / 0.02 * t[early] ** 2 / 2, rel=2e-2, abs=1e-7)


def test_a_centre_of_mass_that_is_edited_counts(tmp_path: Path):
    """MuJoCo compiles a body with its mass in its origin as simple and would not use another centre."""
    system = body_case(tmp_path, forces=True)
    plain, off = system.simulator().predict(0, [Run(e, np.zeros(12)) for e in ((), (Off(),))])
    assert np.abs(plain - off)[:, 3:6].max() > 0.05


def test_the_vocabulary_is_bound_to_what_is_there(tmp_path: Path):
    names = {c.name for c in arm(tmp_path, episodes=1).vocabulary}
    assert {"joint_damping[shoulder]", "joint_damping[elbow]", "mass[forearm]", "actuator_gain[shoulder]"} <= names
    assert {"servo_gain[elbow]", "sensor_offset[tau]", "gravity"} <= names
    assert not {"servo_gain[shoulder]", "mass[world]", "link_length[shoulder]"} & names


def test_windows_are_labelled_by_what_was_done(tmp_path: Path):
    """A carriage that rests, is pushed, coasts and is pushed back."""
    t = np.arange(801) * 0.005
    force = np.select([t < 1.0, t < 1.5, t < 2.5], [0.0, 6.0, 0.0], -6.0)
    system = system_of(slide_case(tmp_path, friction=0.2, t_s=t, command=lambda _: force, start="rest"))
    system = system.with_values([system.simulator().predict(0, [Run((), np.zeros(2))])[0]])
    windows = Windows(np.zeros(16, int), np.arange(0, 800, 50), 51)
    table = system.label(raw_signals(system.recording), windows).table
    assert set(table["regime"]) <= set(system.regimes)
    regimes = table["regime"].tolist()
    assert regimes[:4] == ["at rest"] * 4
    assert regimes[4] == "just after a change of command"
    assert regimes[5] == "driven"
    assert regimes[8] == "free swing"
    assert "reversal" in regimes[10:]
    assert {"moving joint", "direction", "position", "speed", "load", "time"} <= set(table.columns)
    assert table["direction"].tolist()[5] == "'slide' moves up"
    usual = f"{system.context.speed['slide']:.2g} m/s of 'slide')"
    assert all(said.endswith(f"times the usual {usual}") for said in table["speed"].dropna())
    assert table["speed"].notna().sum() >= 6
    assert system.phrase("regime", "reversal") == "when a joint turns round"
    assert [s.start for e, s in system.rests()] == [100]
    views = system.missing_force_views(
        np.ones((16, 1)), np.full((16, 1, 1), 0.04), system.label(raw_signals(system.recording), windows)
    )
    assert views["along_f_slide_n"][5] == 1.0
    assert np.isnan(views["along_f_slide_n"][0])
    assert views["along_f_slide_n_se"][5] == pytest.approx(0.2)


def test_proposals_stay_within_the_recorded_commands(tmp_path: Path):
    system = arm(tmp_path)
    trials, empty, start = system.proposals()
    assert {t.pattern for t in trials} == {"step", "ramp", "sine", "reversal"}
    assert all(np.isnan(v).all() for v in empty.values())
    recorded = np.concatenate([e.commands for e in system.recording.episodes])
    for i, trial in enumerate(trials):
        commands = empty.recording.episodes[i].commands
        assert (commands >= recorded.min(axis=0) - 1e-9).all()
        assert (commands <= recorded.max(axis=0) + 1e-9).all()
        assert trial.sentence.startswith("From rest, ")
        assert np.isfinite(empty.simulator().predict(i, [Run((), start)])).all()


def test_the_corrected_model_is_what_was_simulated(tmp_path: Path):
    """Written, read by plain MuJoCo, and the numbers are there; what is no part of a model is named."""
    system = arm(tmp_path / "case", episodes=1)
    (tmp_path / "out").mkdir()
    assert system.write_model((Heavier(1.25), Doubled()), tmp_path / "out") == ("model.xml",)
    text = (tmp_path / "out" / "model.xml").read_text()
    assert "Not expressed here: throwaway" in text
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "out" / "model.xml"))
    assert model.body("upper").mass[0] == pytest.approx(1.5)
    assert model.body("forearm").mass[0] == pytest.approx(0.875)
    assert model.nsensor == 0


def test_a_clock_that_is_off_is_not_in_the_corrected_model(tmp_path: Path):
    """Its owner divides the recording's times: a model with a step of another length would correct that twice."""
    system = arm(tmp_path / "case", episodes=1)
    (tmp_path / "out").mkdir()
    system.write_model((ClockScale(0.97), Heavier(1.25), Doubled()), tmp_path / "out")
    text = (tmp_path / "out" / "model.xml").read_text()
    assert "Not expressed here: throwaway" in text
    assert "Not expressed here: clock_scale, which is of the recording, not of the machine." in text
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "out" / "model.xml"))
    assert model.opt.timestep == mujoco.MjModel.from_xml_path(str(system.recording.model_path)).opt.timestep
    assert model.body("upper").mass[0] == pytest.approx(1.5)


def test_a_late_command_is_in_the_corrected_model(tmp_path: Path):
    """MuJoCo's own delay, of servos and motors: it moves as the simulation does that sends commands later."""
    system = arm(tmp_path / "case", episodes=1)
    (tmp_path / "out").mkdir()
    system.write_model((ActuatorDelay("elbow", 0.0203), Heavier(1.25)), tmp_path / "out")
    text = (tmp_path / "out" / "model.xml").read_text()
    assert "Commands come late: 'elbow' 0.0203 s" in text
    assert "Not expressed" not in text
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "out" / "model.xml"))
    data, shown = mujoco.MjData(model), []
    run = Run((Heavier(1.25), ActuatorDelay("elbow", 0.0203)), np.zeros(4))
    expected = system.simulator().predict(0, [run])[0]
    recorded = system.recording.episodes[0]
    columns = [model.actuator(c.actuator).id for c in system.recording.mapping.commands.values()]
    t = recorded.t_s - recorded.t_s[0]
    for k in range(round(t[-1] / model.opt.timestep)):
        data.ctrl[columns] = recorded.commands[np.searchsorted(t, k * model.opt.timestep + 1e-9, side="right") - 1]
        mujoco.mj_step(model, data)
        shown.append(data.qpos.copy())
    assert np.abs(expected[-1, :2] - shown[-1]).max() < 2e-3
    without = system.simulator().predict(0, [Run((Heavier(1.25),), np.zeros(4))])[0]
    assert np.abs(expected[-1, :2] - without[-1, :2]).max() > 1e-2


def test_a_corrected_model_may_have_actuators_without_a_name(tmp_path: Path):
    """Nothing was sent to them; they are driven all the same where the written model is tried."""
    system = arm(tmp_path / "case", episodes=1)
    mjcf = tmp_path / "case" / system.recording.model_path.name
    mjcf.write_text(mjcf.read_text().replace("</actuator>", '<motor joint="elbow"/><motor joint="elbow"/></actuator>'))
    (tmp_path / "out").mkdir()
    late = system_of(tmp_path / "case")
    assert late.write_model((ActuatorDelay("elbow", 0.0203), Heavier(1.25)), tmp_path / "out") == ("model.xml",)
    assert mujoco.MjModel.from_xml_path(str(tmp_path / "out" / "model.xml")).nu == 4


def test_a_delay_that_the_owner_believes_in_is_simulated(tmp_path: Path):
    """As commands that are sent later, wherever in an episode a stretch begins; one that is found comes on top."""
    plain = arm(tmp_path / "plain", episodes=1)
    shutil.copytree(tmp_path / "plain", tmp_path / "late")
    mjcf = tmp_path / "late" / plain.recording.model_path.name
    mjcf.write_text(mjcf.read_text().replace('name="elbow" joint', 'name="elbow" delay="0.02" nsample="41" joint'))
    late = system_of(tmp_path / "late")
    start = np.array([0.4, -0.2, 0.0, 0.0])
    of_both = ((), ActuatorDelay("elbow", 0.02)), ((ActuatorDelay("elbow", 0.01),), ActuatorDelay("elbow", 0.03))
    for found, whole in of_both:
        expected = plain.simulator().predict(0, [Run((whole,), start)])[0]
        np.testing.assert_allclose(late.simulator().predict(0, [Run(tuple(found), start)])[0], expected, atol=1e-9)
    part = [Span(0, 120, 300)]
    expected = plain.simulator().parts(part).predict(0, [Run((ActuatorDelay("elbow", 0.02),), start)])[0]
    np.testing.assert_allclose(late.simulator().parts(part).predict(0, [Run((), start)])[0], expected, atol=1e-9)


def test_links_that_burst_apart_are_compared_without_contact(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Kinova's Jaco folds into itself at the reference position: the sixth digit says how it flies apart."""
    kinova = Path(dm_control.__file__).parent / "third_party" / "kinova"
    names = [f"joint_{k}" for k in range(1, 7)]
    t = np.arange(5) * 0.01
    columns = {"t": t} | {f"{d}q_{n}": 0.0 * t for n in names for d in ("", "d")}
    nominal = {"commands": {}, "channels": joint_channels(names), "start": "rest"}
    shutil.copytree(kinova, tmp_path / "case")
    case = write_case(tmp_path / "case", (kinova / "jaco_arm.xml").read_text(), [columns], nominal)
    models = system_of(case)._models
    effects = (JointFriction("joint_3", 2.6006837),)
    edited = models.edited(effects)
    nearly = copy.copy(edited)
    nearly.dof_frictionloss[:] = [float(f"{v:.6g}") for v in edited.dof_frictionloss]
    assert model_file._moves_otherwise(nearly, edited, ()) is not None
    (tmp_path / "out").mkdir()
    assert model_file.write_model(models, effects, tmp_path / "out")[0] == "model.xml"
    monkeypatch.setattr(mujoco.MjSpec, "copy_back", lambda self, model: None)
    with pytest.raises(ResultError, match="does not move as it does in the simulation"):
        model_file.write_model(models, (JointFriction("joint_1", 0.0),), tmp_path / "out")


def test_a_corrected_model_that_moves_otherwise_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    system = arm(tmp_path / "case", episodes=1)
    monkeypatch.setattr(mujoco.MjSpec, "copy_back", lambda self, model: None)
    with pytest.raises(ResultError, match="joint 'shoulder' does not move as it does in the simulation"):
        system.write_model((Heavier(1.25),), tmp_path)
    assert model_file.MODEL == "model.xml"


def test_bodies_are_drawn_where_joints_put_them(tmp_path: Path):
    """Links without shapes are lines; a forearm at right angles stands beside the upper arm's end."""
    system = arm(tmp_path, episodes=1)
    assert [b.name for b in system.drawn()] == ["upper", "forearm"]
    assert system.drawn()[0].shapes[0].kind == "capsule"
    poses = system.poses(0, np.array([[np.pi / 2, -np.pi / 2, 0, 0, 0]]))
    assert poses["forearm"][0, :3] == pytest.approx([0.3, 0.0, 0.0], abs=1e-9)
    assert poses["forearm"][0, 3:] == pytest.approx([1, 0, 0, 0], abs=1e-9)
    half, right = np.pi / 4, np.pi / 2
    lost = np.array([[right, -right, 0, 0, 0], [np.nan] * 5, [half, np.nan, 0, 0, 0]])
    poses = system.poses(0, lost)["forearm"][:, 3:]
    assert poses[1] == pytest.approx(poses[0])  # it stays where it was seen last
    assert np.abs(poses[2, [0, 2]]) == pytest.approx([np.cos(half / 2), np.sin(half / 2)])


@pytest.mark.skipif(not PRACTICE.is_dir(), reason="the practice recordings are not part of the project")
@pytest.mark.parametrize("name", NULLS)
def test_recordings_of_nothing_but_noise_are_predicted(name: str):
    """Even from guessed starts the mean square is about that of the noise."""
    system = system_of(PRACTICE / name)
    signals = raw_signals(system.recording)
    squares = []
    for e, values in enumerate(system.values()):
        prediction = system.simulator().predict(e, [Run((), system.initial.guess(signals, e))])[0]
        squares.append(((prediction - values) / signals.sigma) ** 2)
    assert np.mean(np.concatenate(squares)) < 1.25


def pendulum_case(folder: Path, model: str, t: np.ndarray, command: np.ndarray, start: str) -> Path:
    """Write a case of a pendulum that was not looked at."""
    columns = {"t": t, "u": command, "q_hinge": np.zeros_like(t), "dq_hinge": np.zeros_like(t)}
    nominal = {
        "commands": {"u": {"actuator": "drive"}},
        "channels": joint_channels(["hinge"]),
        "noise": {"q_hinge": 1e-3, "dq_hinge": 1e-2},
        "start": start,
    }
    return write_case(folder, model, [columns], nominal)


@pytest.mark.parametrize("delay_s", [0.002, 0.0062, 0.01, -0.003])
def test_a_command_that_comes_between_two_steps_frees_what_sticks_when_it_comes(tmp_path: Path, delay_s: float) -> None:
    """A carriage that sticks until 8 N come against 3 N of friction is from then on where x = (F - f) t^2 / 2 m says.

    A step that got the mean of no force and 8 N would begin too slowly: half a millimetre in half a second.
    """
    friction_n, force_n, mass_kg = 3.0, 8.0, 2.0

    def command(t_s: np.ndarray) -> np.ndarray:
        return np.where(t_s >= 0.1 - 1e-9, force_n, 0.0)

    case = slide_case(tmp_path, friction=friction_n, mass=mass_kg, command=command, length_s=0.6)
    simulator = system_of(case).simulator(threads=1)
    late: list[MechanismEffect] = [ObservationDelay(delay_s)]
    if delay_s > 0.0:
        late.append(ActuatorDelay("drive", delay_s))
    for effect in late:
        got = simulator.predict(0, [Run((effect,), np.zeros(2))])[0]
        for_s = np.maximum(np.arange(len(got)) * 0.005 - 0.1 - delay_s, 0.0)
        acceleration = (force_n - friction_n) / mass_kg
        np.testing.assert_allclose(got[:, 0], 0.5 * acceleration * for_s**2, atol=1e-6)
        np.testing.assert_allclose(got[:, 1], acceleration * for_s, atol=1e-5)


INTEGRATOR = PENDULUM.replace(
    '<motor name="drive" joint="hinge"/>', '<intvelocity name="drive" joint="hinge" kp="20" actrange="-3 3"/>'
)


@pytest.mark.parametrize("delay_s", [1e-5, 0.0013, 0.0062, -0.0004])
@pytest.mark.parametrize("start", ["rest", "free"])
@pytest.mark.parametrize("model", [PENDULUM, INTEGRATOR], ids=["motor", "integrator"])
def test_a_constant_command_that_is_late_changes_nothing(
    tmp_path: Path, model: str, start: str, delay_s: float
) -> None:
    """A pendulum that is let go, or under way, has the state of its start at the first sample, and goes on alike.

    In windows, too, that begin between two steps of the episode: its clock is uneven.
    """
    t = np.concatenate([[0.0, 0.0037], 0.0037 + 0.005 * np.arange(1, 100)])
    case = pendulum_case(tmp_path, model.format(damping=0.05), t, 0.0 * t, start)
    simulator, at = system_of(case).simulator(threads=1), np.array([1.2, 0.0 if start == "rest" else 1.5])
    windows = Windows(np.array([0, 0]), np.array([1, 30]), 50)
    starts = np.array([[[1.2, 1.5]], [[-0.4, 3.0]]])
    late: list[MechanismEffect] = [ObservationDelay(delay_s)]
    if delay_s > 0.0:
        late.append(ActuatorDelay("drive", delay_s))
    for effect in late:
        got, expected = (simulator.predict(0, [Run(effects, at)])[0] for effects in ((effect,), ()))
        np.testing.assert_allclose(got[0], at, rtol=0, atol=1e-12)
        np.testing.assert_allclose(got, expected, rtol=0, atol=2e-4)
        got, expected = (simulator.predict_windows(effects, windows, starts) for effects in ((effect,), ()))
        np.testing.assert_allclose(got[:, 0, 0], starts[:, 0], rtol=0, atol=1e-12)
        np.testing.assert_allclose(got, expected, rtol=0, atol=2e-4)


@pytest.mark.parametrize("start", ["rest", "free"])
def test_a_chirp_that_is_late_by_a_part_of_a_step_moves_a_pendulum_as_its_equation_says(
    tmp_path: Path, start: str
) -> None:
    """Against Runge and Kutta's fourth order in steps of 0.1 ms, commands held from sample to sample, 2 ms late."""
    damping, delay_steps, fine_s = 0.05, 20, 1e-4
    t = 0.005 * np.arange(201)
    sent = 3.0 * np.sin(2 * np.pi * (0.5 * t + 1.5 * t**2)) + 1.0
    inertia, weight = 0.01 + 1.5 * 0.4**2, 1.5 * 9.81 * 0.4

    def rate(x: np.ndarray, torque: float) -> np.ndarray:
        return np.array([x[1], (torque - weight * np.sin(x[0]) - damping * x[1]) / inertia])

    x = np.array([0.6, 0.0 if start == "rest" else 1.5])
    exact = [x]
    for k in range(50 * (len(t) - 1)):
        torque = sent[(k - delay_steps) // 50] if k >= delay_steps else 0.0
        a = rate(x, torque)
        b = rate(x + 0.5 * fine_s * a, torque)
        c = rate(x + 0.5 * fine_s * b, torque)
        x = x + fine_s / 6 * (a + 2 * b + 2 * c + rate(x + fine_s * c, torque))
        if k % 50 == 49:
            exact.append(x)
    case = pendulum_case(tmp_path, PENDULUM.format(damping=damping), t, sent, start)
    simulator = system_of(case).simulator(threads=1)
    assert 0.002 % simulator.step_s > 1e-5
    for effect in ActuatorDelay("drive", delay_steps * fine_s), ObservationDelay(delay_steps * fine_s):
        got = simulator.predict(0, [Run((effect,), exact[0])])[0]
        np.testing.assert_allclose(got[:, 0], np.array(exact)[:, 0], atol=3e-5)
        np.testing.assert_allclose(got[:, 1], np.array(exact)[:, 1], atol=2e-4)


@pytest.mark.parametrize("delay_s", [0.0, 0.0062])
def test_a_window_between_two_steps_of_its_episode_has_steps_of_its_own(tmp_path: Path, delay_s: float) -> None:
    """What sticks breaks away when the force comes, where no sample but the first is at a step of the episode."""
    friction_n, force_n, mass_kg = 3.0, 8.0, 2.0
    t = np.concatenate([[0.0], 0.0037 + 0.005 * np.arange(120)])
    case = slide_case(
        tmp_path, friction=friction_n, mass=mass_kg, command=lambda t: np.where(t > 0.1, force_n, 0.0), t_s=t
    )
    simulator = system_of(case).simulator(threads=1).stepping(0.0025)
    effects = (ObservationDelay(delay_s),) if delay_s else ()
    got = simulator.predict_windows(effects, Windows(np.array([0]), np.array([1]), 110), np.zeros((1, 1, 2)))[0, 0]
    for_s = np.maximum(t[1:111] - t[t > 0.1][0] - delay_s, 0.0)
    acceleration = (force_n - friction_n) / mass_kg
    np.testing.assert_allclose(got[:, 0], 0.5 * acceleration * for_s**2, atol=1e-6)
    np.testing.assert_allclose(got[:, 1], acceleration * for_s, atol=1e-5)


def test_a_force_is_read_under_the_command_that_has_come(tmp_path: Path) -> None:
    """A motor whose command changes at every sample exerts that of the sample before, where it is 1 ms late."""
    t = 0.005 * np.arange(40)
    sent = np.where(np.arange(40) % 2 == 0, 1.0, -1.0)
    columns = {"t": t, "u": sent, "q_slide": 0.0 * t, "f": sent}
    nominal = {
        "commands": {"u": {"actuator": "drive"}},
        "channels": {
            **joint_channels(["slide"], velocities=False),
            "f": {"actuator": "drive", "quantity": "force"},
        },
        "noise": {"q_slide": 1e-3, "f": 1e-2},
        "start": "rest",
    }
    model = SLIDE.format(friction=0.0, damping=0.0, mass=2.0, actuator=MOTOR)
    simulator = system_of(write_case(tmp_path, model, [columns], nominal)).simulator(threads=1)
    got = simulator.predict(0, [Run((ActuatorDelay("drive", 0.001),), np.zeros(2))])[0, :, 1]
    np.testing.assert_allclose(got, [0.0, *sent[:-1]], atol=1e-12)


def test_positions_are_those_of_the_stamps_where_the_clock_is_off(tmp_path: Path) -> None:
    """By a clock that runs fast by a quarter, 5 N move 2 kg from rest by a / 2 (t / 1.25)^2."""
    case = slide_case(tmp_path, command=lambda t: np.full_like(t, 5.0), length_s=0.5)
    got = system_of(case).simulator(threads=1).predict(0, [Run((ClockScale(1.25),), np.zeros(2))])[0]
    for_s = 0.005 * np.arange(len(got)) / 1.25
    np.testing.assert_allclose(got[:, 0], 0.5 * 2.5 * for_s**2, atol=1e-9)
    np.testing.assert_allclose(got[:, 1], 2.5 * for_s, atol=1e-9)
