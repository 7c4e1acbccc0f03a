"""What an import tells from numbers alone: episodes by what counts them, clocks by how they run, units by a fall."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
import yaml

from runner.errors import RecordingError
from runner.importing.entries import Entry, Role
from runner.importing.guess.clock import clock_times, guess_clock
from runner.importing.guess.counter import guess_episodes
from runner.importing.guess.elements import elements_of
from runner.importing.guess.fall import falls
from runner.importing.guess.names import Quantity, said_by, without, words_of
from runner.importing.guess.unit import guess_unit, of_counts, unit_by_slope
from runner.importing.map_file import TO_FILL
from runner.importing.plausible import within
from runner.importing.propose import propose
from runner.importing.signals import Clock, Log, Part, Signal, part_of

RUNS, SAMPLES = 4, 50
ONE_JOINT = """<mujoco><worldbody><body><joint name="shoulder" axis="0 1 0"/><geom size=".1"/></body></worldbody>
<actuator><motor name="drive" joint="shoulder"/></actuator></mujoco>"""


def log_of(**columns: np.ndarray) -> Log:
    """A table of such columns."""
    signals = {name: Signal(name, "table", np.asarray(values, dtype=float)) for name, values in columns.items()}
    return Log("table", [Part("log.csv", signals)])


def episodes_of(log: Log) -> dict[str, object]:
    """What is proposed."""
    clock = guess_clock(log.parts[0])
    return guess_episodes(log, clock, clock.names)[0]


number, sample = np.divmod(np.arange(RUNS * SAMPLES), SAMPLES)


@pytest.mark.parametrize("name", ["test", "throw", "trial_no", "Versuch"])
@pytest.mark.parametrize("pause_s", [0.01, 30.0, -0.49])
def test_whatever_counts_the_episodes_is_found(name: str, pause_s: float) -> None:
    """Whether the clock runs on, leaps or starts anew where it steps; speed settings and flags are no counters."""
    t = 0.01 * np.arange(RUNS * SAMPLES) + number * (pause_s - 0.01)
    columns = {"time": t, "gear": sample // 25, "flag": sample % 2, name: 3 + number}
    assert episodes_of(log_of(**columns)) == {"by": "column", "signal": name}


def test_a_counter_that_the_clock_confirms_comes_first() -> None:
    """Numbers in any order are numbers of tests where the clock goes back; stages that rise on are less sure."""
    t = 0.01 * sample
    stage = np.arange(RUNS * SAMPLES) // 70
    assert episodes_of(log_of(time=t, stage=stage, test=np.array([4, 1, 9, 2])[number])) == {
        "by": "column", "signal": "test",
    }  # fmt: skip


def test_what_counts_samples_or_comes_again_counts_no_episodes() -> None:
    """Then the clock says where they begin."""
    t = 0.01 * sample
    frame, side = np.arange(RUNS * SAMPLES), number % 2
    assert episodes_of(log_of(time=t, frame=frame, side=side)) == {"by": "restart"}


@pytest.mark.parametrize(("name", "size", "unit"), [("clk_ms", 1e3, "ms"), ("x0", 1e3, "ms"), ("sec", 1.0, "s")])
def test_a_clock_is_known_by_how_it_runs(name: str, size: float, unit: str) -> None:
    """Even steps, new starts and lost rows in it; numbers of frames are none."""
    t = np.delete(0.02 * sample, [7, 60, 61])
    rest = {"frame": np.arange(len(t)), "angle": np.sin(3 * t)}
    log = log_of(**{name: size * t}, **rest)
    clock = guess_clock(log.parts[0])
    assert (clock.name, clock.unit) == (name, unit)
    times = clock_times(log.parts[0], clock)
    assert times is not None
    np.testing.assert_allclose(times, t)
    assert guess_clock(log_of(**rest).parts[0]).name is None


@pytest.mark.parametrize(("unit", "size"), [("m", 1.0), ("mm", 1e3), ("cm", 1e2), ("in", 1 / 0.0254)])
@pytest.mark.parametrize("up", ["y", "z"])
def test_a_fall_tells_unit_and_axis(unit: str, size: float, up: str) -> None:
    """A throw of 0.4 s, with noise of a millimetre, then rest."""
    t = np.arange(120) / 120
    height = np.maximum(0.3 + 1.0 * t - 0.5 * 9.81 * t**2, 0.05)
    places = np.stack([0.8 * t, *((height, 0.2 * t) if up == "y" else (0.2 * t, height))], axis=1)
    places += 1e-3 * np.random.default_rng(0).standard_normal(places.shape)
    found = falls(t, size * places, 9.81)
    assert found is not None
    assert (found.unit, found.up) == (unit, up)
    assert found.acceleration_m_s2 == pytest.approx(9.81, rel=0.05)


def test_what_does_not_fall_tells_nothing() -> None:
    """A body that is carried about."""
    t = np.arange(600) / 120
    places = np.stack([np.sin(t), np.cos(2 * t), 0.1 * t], axis=1)
    assert falls(t, 1000 * places, 9.81) is None


@pytest.mark.parametrize(("unit", "size"), [("rad/s", 1.0), ("deg/s", 180 / np.pi), ("rpm", 30 / np.pi)])
def test_the_slope_of_the_position_tells_the_unit_of_a_velocity(unit: str, size: float) -> None:
    """Over two runs, noise on both; what does not go along with the slope tells nothing."""
    t = np.asarray(np.tile(np.arange(200) * 0.01, 2), dtype=np.float64)
    rng = np.random.default_rng(0)
    position = np.sin(3 * t) + 1e-3 * rng.standard_normal(len(t))
    velocity = size * (3 * np.cos(3 * t) + 0.05 * rng.standard_normal(len(t)))
    found = unit_by_slope(t, position, velocity, "rad/s")
    assert found is not None
    assert found.name == unit
    assert unit_by_slope(t, position, size * np.cos(8 * t), "rad/s") is None


def test_a_range_in_radians_that_mujoco_reads_in_degrees_is_suspected() -> None:
    """`range="-2 2"` of an MJCF without `angle="radian"` is 0.035 rad: a joint that moves by 0.7 rad says so."""
    entry = Entry("channels.q", "q", "q_rad", Role.CHANNEL, unit="rad", si_unit="rad")
    narrow = (np.radians(-2.0), np.radians(2.0))
    with pytest.raises(RecordingError, match='lacks <compiler angle="radian"/>'):
        within(np.array([-0.7, 0.7]), narrow, entry, "joint 'j'")
    with pytest.raises(RecordingError, match=r"deg they would fit\.$"):
        within(np.array([-70.0, 70.0]), (-1.5, 1.5), entry, "joint 'j'")


def test_a_position_is_known_by_following_its_target() -> None:
    """No name says that it is one: of two such columns the one of the servo's joint goes where its target does."""
    model = mujoco.MjModel.from_xml_string("""<mujoco><compiler angle="radian"/><worldbody><body name="arm">
      <joint name="elbow" range="-2 2"/><geom size=".05"/></body></worldbody>
      <actuator><position name="motor" joint="elbow" kp="6"/></actuator></mujoco>""")
    t = np.arange(400) * 0.01
    log = log_of(clock=t, target=60 * np.sin(3 * t), measured=50 * np.sin(3 * t - 0.3), warmth=40 + 2 * t)
    table = {signal: (what, unit) for signal, what, unit, _ in propose(log, model).table}
    assert table["target"] == ("command of motor", "deg")
    assert table["measured"] == ("position of joint elbow", "deg")
    assert "warmth" not in table


@pytest.mark.parametrize(("pause_s", "known"), [(6.0, {"by": "gap", "longer_than_s": 3.0}), (0.3, {"by": "part"})])
def test_runs_in_one_bag_are_parted_where_no_message_comes(pause_s: float, known: dict[str, object]) -> None:
    """Messages have stamps of their own; two that are swapped begin no run, commands that go on hide none."""
    model = mujoco.MjModel.from_xml_string("""<mujoco><worldbody><body><joint name="elbow"/><geom size=".05"/></body>
      </worldbody><actuator><position name="elbow" joint="elbow"/></actuator></mujoco>""")
    measured = (1e9 * (0.01 * np.arange(RUNS * SAMPLES) + number * pause_s)).astype(np.int64) + 1_700_000_000 * 10**9
    measured[[7, 8]] = measured[[8, 7]]
    sent = np.arange(measured.min(), measured.max(), 50_000_000)

    def stamped(name: str, stamps: np.ndarray) -> Signal:
        return Signal(name, name, np.sin(stamps * 1e-9), {"header_stamp": Clock(stamps, in_ns=True)})

    signals = [stamped("/state/position[elbow]", measured), stamped("/command[elbow]", sent)]
    proposal = propose(Log("MCAP", [Part("log.mcap", {s.name: s for s in signals})]), model)
    assert yaml.safe_load(proposal.text)["episodes"] == known


def test_signals_that_differ_in_a_number_alone_are_in_the_order_of_the_model() -> None:
    """And what follows a target that was told so is the position of its joint."""
    t, wave = np.arange(200) * 0.01, np.sin(np.arange(200) * 0.1)
    other = np.cos(np.arange(200) * 0.23)
    columns = {"t": t, "j1_target_deg": 40 * wave, "j1_deg": 38 * wave, "j2_target_deg": 9 * other, "j2_deg": 8 * other}
    model = mujoco.MjModel.from_xml_string(SHOULDER_AND_ELBOW)
    proposal = propose(log_of(**columns), model)
    found = yaml.safe_load(proposal.text)
    assert [c["signal"] for c in found["commands"].values()] == ["j1_target_deg", "j2_target_deg"]
    assert [(c["signal"], c["joint"]) for c in found["channels"].values()] == [
        ("j1_deg", "shoulder_j"),
        ("j2_deg", "elbow_j"),
    ]
    assert not proposal.missing


def test_a_rate_is_a_velocity_of_what_it_names() -> None:
    assert said_by(("rate",), "pivot_rate", named=True).quantity is Quantity.VELOCITY
    assert said_by(("sample", "rate"), "sample_rate").quantity is Quantity.UNKNOWN


@pytest.mark.parametrize(("gear", "unit"), [(1.0, "N m"), (8.0, "")])
def test_a_command_behind_a_gear_may_be_a_current(gear: float, unit: str) -> None:
    model = mujoco.MjModel.from_xml_string(ONE_JOINT.replace("/></actuator>", f' gear="{gear}"/></actuator>'))
    (command,) = [e for e in elements_of(model) if e.is_command]
    assert command.si_unit == unit


@pytest.mark.parametrize(("size", "unit"), [(180 / np.pi, "deg"), (1.0, "rad")])
def test_a_joint_without_a_range_is_in_the_unit_of_those_beside_it(size: float, unit: str) -> None:
    """Of a vector; one that moves little could be in rad by its numbers, and one that stands alone is not told."""
    model = mujoco.MjModel.from_xml_string("""<mujoco><compiler angle="radian"/><worldbody>
      <body><joint name="a" range="-2 2"/><geom size=".05"/><body><joint name="b"/><geom size=".05"/>
      <body><joint name="c"/><geom size=".05"/><body><joint name="d"/><geom size=".05"/></body></body></body></body>
      </worldbody></mujoco>""")
    wave = size * np.sin(0.1 * np.arange(300))
    names = {"state[a.pos]": wave, "state[b.pos]": 1.5 * wave, "state[c.pos]": 0.1 * wave, "d_pos": wave}
    log = log_of(time=0.01 * np.arange(300), **names)
    units = {signal: u for signal, _, u, _ in propose(log, model).table}
    assert units == {
        "state[a.pos]": unit, "state[b.pos]": unit, "state[c.pos]": unit, "d_pos": "TODO" if unit == "deg" else "rad",
    }  # fmt: skip


SHOULDER_AND_ELBOW = """<mujoco><worldbody>
<body><joint name="shoulder_j" axis="0 1 0"/><geom size=".1"/>
<body pos="1 0 0"><joint name="elbow_j" axis="0 1 0"/><geom size=".1"/></body></body></worldbody>
<actuator><position name="shoulder_s" joint="shoulder_j" kp="9"/><position name="elbow_s" joint="elbow_j" kp="9"/>
</actuator></mujoco>"""


@pytest.mark.parametrize(("target", "angle"), [("{}_target", "{}_deg"), ("sp_{}", "enc_{}"), ("{}Cmd", "{}Pos")])
def test_what_all_names_of_a_kind_have_tells_none_from_another(target: str, angle: str) -> None:
    """`shoulder_target` is of `shoulder_s`, and `shoulder_deg` of `shoulder_j`."""
    t = 0.01 * sample
    moved = {joint: np.sin((3 + i) * t) for i, joint in enumerate(("shoulder", "elbow"))}
    columns = {target.format(j): v for j, v in moved.items()} | {angle.format(j): 0.9 * v for j, v in moved.items()}
    found = yaml.safe_load(propose(log_of(time=t, **columns), mujoco.MjModel.from_xml_string(SHOULDER_AND_ELBOW)).text)
    told = {entry["actuator"]: entry["signal"] for entry in found["commands"].values()}
    assert told == {f"{j}_s": target.format(j) for j in moved}
    assert {e["joint"]: e["signal"] for e in found["channels"].values()} == {f"{j}_j": angle.format(j) for j in moved}


def test_a_word_that_begins_one_name_alone_is_short_for_it() -> None:
    """What no word says a quantity of is left alone, and so is what may be short for either."""
    t = 0.01 * sample
    model = mujoco.MjModel.from_xml_string(SHOULDER_AND_ELBOW)
    columns = {"goal_sh": np.sin(3 * t), "goal_el": np.sin(4 * t), "enc_sh": np.sin(2 * t), "enc_el": np.sin(5 * t)}
    proposal = propose(log_of(time=t, el_warmth=40 + t, **columns), model)
    found = yaml.safe_load(proposal.text)
    assert [c["signal"] for c in found["commands"].values()] == ["goal_sh", "goal_el"]
    assert [(c["signal"], c["joint"]) for c in found["channels"].values()] == [
        ("enc_sh", "shoulder_j"),
        ("enc_el", "elbow_j"),
    ]
    assert all(f"'{signal[-2:]}' as short for it" in why for signal, _, _, why in proposal.table)
    alike = mujoco.MjModel.from_xml_string(SHOULDER_AND_ELBOW.replace("elbow", "shin"))
    assert yaml.safe_load(propose(log_of(time=t, goal_sh=np.sin(3 * t)), alike).text)["commands"] == "TODO"


def test_commands_that_are_not_recognised_wait_to_be_filled_in() -> None:
    """Servos that nothing is sent to stand at zero: that is for the owner to say."""
    t = 0.01 * sample
    columns = {"elbow": np.sin(3 * t), "shoulder": np.cos(2 * t), "a": np.sign(t - 0.2), "b": np.sign(t - 0.3)}
    found = propose(log_of(time=t, **columns), mujoco.MjModel.from_xml_string(SHOULDER_AND_ELBOW))
    assert yaml.safe_load(found.text)["commands"] == "TODO"


@pytest.mark.parametrize("name", ["i_elbow_A", "elbow_mA", "elbow_V"])
def test_what_is_in_amperes_or_volts_is_no_position(name: str) -> None:
    """By the unit that its name ends on, where the position has another; a joint may be called so itself."""
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body><joint name="elbow" range="-90 90"/><geom size=".1"/></body></worldbody>'
        '<actuator><position name="elbow" joint="elbow" kp="5"/></actuator></mujoco>'
    )
    t = 0.01 * np.arange(200)
    columns = {"time": t, "target_elbow_deg": 40 * np.sin(t), "pos_elbow_deg": 39 * np.sin(t)}
    said = propose(log_of(**columns, **{name: np.sin(7 * t)}), model)
    assert not any(name in note and "may be" in note for note in said.notes)


@pytest.mark.parametrize(("name", "other"), [("elbow_a", False), ("elbow_A", True), ("elbow_degC", True)])
def test_only_the_symbol_of_a_unit_is_one(name: str, other: bool) -> None:
    """A small letter is a part of a name: the actual angle beside the desired one."""
    assert said_by(without(words_of(name), ("elbow",)), name).other is other
    assert said_by(words_of("dq_v"), "dq_v").other is False


@pytest.mark.parametrize(("moving", "start"), [(0.0, "rest"), (0.5, "free")])
@pytest.mark.parametrize("ticks", [False, True])
def test_runs_that_begin_far_slower_than_they_go_on_begin_at_rest(moving: float, start: str, ticks: bool) -> None:
    """In whatever unit, by noise or by ticks of an encoder; one run in motion is enough for `free`."""
    model = mujoco.MjModel.from_xml_string(ONE_JOINT)
    t, rng = np.arange(300) * 0.01, np.random.default_rng(0)
    runs = []
    for k in range(3):
        q = np.where(t > 0.1, 1 - np.cos((2 + k) * (t - 0.1)), 0.0) + moving * (k == 2) * np.sin(3 * t)
        read = np.floor(q * 4096 / (2 * np.pi) + 2048) if ticks else q + 1e-4 * rng.normal(size=len(t))
        columns = {"t_s": t, "tau_cmd": np.sin(3 * t), "q_ticks" if ticks else "q": read}
        runs.append(
            part_of(f"run{k}", [Signal(n, "table", np.asarray(v, dtype=np.float64)) for n, v in columns.items()])
        )
    whole = np.concatenate([[p.signals[n].values for n in p.signals] for p in runs], axis=1)
    whole[0] = np.arange(len(whole[0])) * 0.01
    names = [*runs[0].signals, "run"]
    counted = [*whole, np.repeat(np.arange(3.0), len(t))]
    joined = part_of("all", [Signal(n, "table", v) for n, v in zip(names, counted, strict=True)])
    for parts in (runs, [joined]):
        proposed = propose(Log("text table", parts), model)
        assert yaml.safe_load(proposed.text)["start"] == start
        said = "if 4096 of them are a turn and its zero is at 2048, `unit: turn, scale: 0.000244140625, offset: -0.5`"
        assert (said in proposed.text) is ticks


@pytest.mark.parametrize(("values", "turn"), [([100.0, 900.0], "1024"), ([3.0, 90.0], None), ([0.5, 900.0], None)])
def test_counts_that_may_be_a_turn(values: list[float], turn: str | None) -> None:
    """The least power of two that holds them; none of few, or of what is no whole number."""
    signal = Signal("q_ticks", "table", np.array(values))
    element = next(e for e in elements_of(mujoco.MjModel.from_xml_string(ONE_JOINT)) if e.quantity == "position")
    unit = of_counts(guess_unit(signal, element, Log("x", [])), signal, element, Log("x", [part_of("x", [signal])]))
    assert unit.name == TO_FILL
    assert (f"if {turn} of them are a turn and its zero is at 0, " in unit.why) is (turn is not None)
    assert ("offset: 0`" in unit.why) is (turn is not None)
