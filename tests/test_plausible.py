"""A recording that can't be is refused or warned of, from its motion and forces alone; a sound one is not."""

from __future__ import annotations

import shutil
from pathlib import Path

import mujoco
import numpy as np
import pandas as pd
import pytest
import yaml

from runner.__main__ import main
from runner.errors import RecordingError
from runner.recording import read_case, write_case
from runner.recording.kinematics import lone_samples
from runner.recording.model_form import read_model_case
from tests import mechanism_cases
from tests.cases import made
from tests.corruptions.edits import (
    Edit,
    constant,
    exchanged,
    frozen,
    late,
    noise,
    of_another_episode,
    rounded,
    scaled,
    shifted,
    spike,
    zero,
)

EXAMPLES = Path(__file__).parents[1] / "examples" / "cases"

MEASURED = ("x", "y", "yaw", "vx", "vy", "wz")
REFUSED: dict[str, tuple[Edit, str]] = {
    "pose held": (
        constant("x", "y", "yaw"),
        "column 'x' never changes, while 'vx' says that it moves: a dead",
    ),
    "y held": (constant("y"), "column 'y' never changes, while 'vy' says that it moves"),
    "vx dead": (zero("vx"), "column 'vx' never changes, while 'x' does: a dead channel?"),
    "all zero": (zero(*MEASURED, "fx", "fy", "px", "py"), "nothing was measured: 'x', 'vx', .* never change"),
    "measured zero": (zero(*MEASURED), "nothing was measured"),
    "pose and velocity": (
        exchanged(("x", "vx"), ("y", "vy"), ("yaw", "wz")),
        "'x', 'y' and 'vx', 'vy' seem to be exchanged",
    ),
    "x and y": (exchanged(("x", "y")), "'x' follows 'vy' and 'y' follows 'vx': two of these columns are exchanged"),
    "vx and vy": (exchanged(("vx", "vy")), "'x' follows 'vy' and 'y' follows 'vx'"),
    "y mirrored": (scaled(-1, "y"), "'y' and 'vy' have opposite signs: one of them is mirrored"),
}
WARNED: dict[str, tuple[Edit, str]] = {
    "forces x1000": (scaled(1000, "fx", "fy"), r"the motion needs 0\.001\d* times the forces 'fx', 'fy'"),
    "forces /1000": (scaled(0.001, "fx", "fy"), r"the motion needs 1\.?\d*e\+03 times the forces"),
    "forces reversed": (scaled(-1, "fx", "fy"), "the body accelerates against the forces 'fx', 'fy'"),
    "forces turned": (
        lambda f: f.assign(fx=-f["fy"], fy=f["fx"]),
        r"the body accelerates at -(89|9\d) degrees to the forces",
    ),
    "fy reversed": (scaled(-1, "fy"), "the motion mirrors the forces: one axis of 'fx', 'fy' has the wrong sign"),
    "fx and fy": (exchanged(("fx", "fy")), "the motion mirrors the forces: .* or they are exchanged"),
    "world mirrored": (scaled(-1, "y", "vy"), "the motion mirrors the forces"),
    "no forces": (zero("fx", "fy", "px", "py"), "nothing is pushed: 'fx', 'fy' are zero in every row"),
    "spike of 10 m": (
        spike("x", 10.0),
        r"'x' is off by (9\.99|10\.0)\d* m for one sample at data row 701 \(episode \d+, t = ",
    ),
    "spike of yaw": (spike("yaw", 2.0), r"'yaw' is off by 2\.?\d* rad for one sample at data row 701"),
    "spike of speed": (spike("vy", -20.0), r"'vy' is off by -(19\.9|20\.)\d* m/s for one sample at data row 701"),
    "noise for a velocity": (
        lambda f: f.assign(vx=np.random.default_rng(0).normal(0, 0.5, len(f))),
        r"'x' does not follow 'vx': of its change \d+% is not the integral of that",
    ),
    "x steps": (
        shifted(1.0, 660, None, "x"),
        r"'x' jumps by (0\.98|0\.99|1\.0)\d* m to data row 661 \(episode \d, t = .*\); 'vx' does not$",
    ),
    "three samples of x": (shifted(10.0, 700, 703, "x"), r"'x' jumps by -?10\.?\d* m .*; 'vx' does not, and 1 more"),
    "the first sample": (shifted(10.0, 0, 1, "x"), r"'x' jumps by -(9\.99|10\.)\d* m to data row 2 \(episode 0"),
    "vx sticks": (
        frozen(100, 180, "vx"),
        r"'vx' keeps one value for 1\.3\d* s from data row 101 .* 'x' says otherwise",
    ),
    "vx has an offset": (
        lambda f: f.assign(vx=f["vx"] + 0.5),
        r"'x' drifts by -0\.(49|5)\d* m/s from the integral of 'vx'",
    ),
    "fy dead": (zero("fy"), r"the forces 'fx', 'fy' explain [0-9]% of what the motion needs along y"),
    "noise for a force": (
        lambda f: f.assign(fx=np.random.default_rng(0).normal(0, 5, len(f))),
        r"explain [0-9]% of what the motion needs along x",
    ),
    "forces late by a second": (late(60, "fx", "fy", "px", "py"), r"the forces 'fx', 'fy' explain 1?\d% of what"),
    "a spike of a force": (
        spike("fx", 1e4),
        r"'fx', 'fy' are 1e\+04 N at data row 701 .*, and the motion does not answer: it needs 2\d\.\d N at most",
    ),
    "px and py": (exchanged(("px", "py")), "the body turns as if 'px' and 'py' were exchanged"),
    "points mirrored": (scaled(-1, "px", "py"), "the body turns against the forces: 'px', 'py', or 'yaw' and the"),
    "yaw mirrored": (scaled(-1, "yaw", "wz"), "the body turns as if 'yaw' and 'wz' had the other sign"),
    "x a thousandth": (
        scaled(0.001, "x"),
        r"'x' changes 0\.001 times as much as 'vx' says \(is one of them in thousandths\?\)",
    ),
    "an offset of a force": (
        shifted(-20.0, 0, None, "fy"),
        r"needs 2\d\.?\d* N less or more than 'fx', 'fy' all the time: has 'fy' an offset\?",
    ),
    "a place beyond the body": (
        spike("px", 10.0),
        r"the place 'px', 'py' of the force is (9|10)\.?\d* m off the body's middle at data row 701",
    ),
    "points zero": (zero("px", "py"), r"the places 'px', 'py' of the forces explain \d% of how the body turns"),
}


@pytest.fixture(params=["nothing_differs", "slippery_floor"])
def case(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """Return a copy of a sound case."""
    shutil.copytree(EXAMPLES / request.param, tmp_path / "case")
    return tmp_path / "case"


def edited(case: Path, edit: Edit) -> Path:
    """Edit the table of a case."""
    edit(pd.read_parquet(case / "recording.parquet")).to_parquet(case / "recording.parquet", index=False)
    return case


@pytest.mark.parametrize("kind", REFUSED)
def test_what_nothing_can_follow_from_is_refused(kind: str, case: Path) -> None:
    """Dead channels, columns exchanged or mirrored against each other."""
    edit, message = REFUSED[kind]
    with pytest.raises(RecordingError, match=message) as error:
        read_case(edited(case, edit))
    assert "\n" not in str(error.value)


def test_a_steady_velocity_is_not_dead(case: Path) -> None:
    """A body that glides on without friction: the velocity never changes, and is the slope of the position."""

    def gliding(table: pd.DataFrame) -> pd.DataFrame:
        return table.assign(x=0.2 * table["t"], vx=0.2)

    read_case(edited(case, gliding))


@pytest.mark.parametrize("kind", WARNED)
def test_what_is_odd_is_said_in_one_line(kind: str, case: Path) -> None:
    """Forces of another size, direction or place, jumps, offsets, lone samples: a line each, and no others."""
    edit, message = WARNED[kind]
    (note,) = read_case(edited(case, edit)).notes
    assert note.startswith("warning: ")
    with pytest.raises(AssertionError, match=message):
        raise AssertionError(note)


def test_a_position_that_sticks(case: Path) -> None:
    """Where the body moves on meanwhile, and leaps to where it is; not where it rests."""
    (leap, note) = read_case(edited(case, frozen(100, 180, "x"))).notes
    assert "'x' jumps by" in leap
    assert "'x' keeps one value for 1.32 s from data row 101 (episode 0, t = 1.6" in note
    assert "while 'vx' says otherwise, by" in note


def test_sound_recordings_are_not_warned_of(case: Path) -> None:
    """Nor those whose forces are a third or thrice, whose world is turned, whose noise has outliers."""
    assert read_case(case).notes == ()
    rng = np.random.default_rng(1)

    def rough(f: pd.DataFrame) -> pd.DataFrame:
        return f.assign(**{n: f[n] + 0.002 * rng.standard_t(3, len(f)) for n in ("x", "y", "yaw", "vx", "vy", "wz")})

    def turned(f: pd.DataFrame) -> pd.DataFrame:
        c, s = np.cos(1.1), np.sin(1.1)
        both = (("x", "y"), ("vx", "vy"), ("fx", "fy"))
        new = {a: c * f[a] - s * f[b] for a, b in both} | {b: s * f[a] + c * f[b] for a, b in both}
        return f.assign(**new, yaw=f["yaw"] + 1.1)

    for edit in (scaled(3.0, "fx", "fy"), scaled(1 / 9, "fx", "fy"), rough, turned, rough):
        assert read_case(edited(case, edit)).notes == ()


def test_it_is_shown(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """By `runner gap`, of one case and of many."""
    for name in "ab":
        write_case(made(episodes=2, seconds=3.0)[0], tmp_path / "cases" / name)
    edited(tmp_path / "cases/a", scaled(-1, "fx", "fy"))
    assert main(["gap", str(tmp_path / "cases/a"), "horizons_s=[0.5]", f"out={tmp_path}/one"]) == 0
    assert "\nWarning: the body accelerates against the forces" in capsys.readouterr().out
    assert main(["gap", str(tmp_path / "cases"), "horizons_s=[0.5]", f"out={tmp_path}/many"]) == 0
    out = capsys.readouterr().out
    assert "a: warning: the body accelerates against the forces" in out
    assert out.count("warning") == 1


def test_a_step_is_no_lone_sample() -> None:
    """A lone sample is; so are two; a step, a kink and steps of rounding are none."""
    smooth = np.sin(np.linspace(0, 3, 200)) + np.random.default_rng(0).normal(0, 1e-3, 200)
    alone = smooth + 5.0 * (np.arange(200) == 77)
    assert lone_samples(alone) == [77]
    assert lone_samples(alone + 3.0 * (np.arange(200) == 120)) == [77, 120]
    for values in (
        smooth,
        smooth + (np.arange(200) > 50),
        smooth + 5 * np.maximum(np.arange(200) - 50, 0),
        np.round(smooth, 1),
        np.zeros(200),
        smooth[:4],
    ):
        assert lone_samples(values) == []


# The model form ------------------------------------------------------------------------------------------------------

MODEL = """<mujoco><worldbody><body name="lever"><joint name="hinge" axis="0 -1 0"/>
<geom type="capsule" fromto="0 0 0 0 0 -0.4" size=".01"/></body></worldbody></mujoco>"""


def lever(folder: Path, edit: Edit) -> Path:
    """Write a swing of a lever, 3 episodes, with noise."""
    rng, rows = np.random.default_rng(0), []
    for episode in range(3):
        t = np.arange(300) / 100
        q = 0.8 * np.cos(5 * t + episode)
        rows.append(pd.DataFrame({"episode": episode, "t": t, "q": q, "dq": -4.0 * np.sin(5 * t + episode)}))
    frame = pd.concat(rows, ignore_index=True)
    frame[["q", "dq"]] += rng.normal(0, [0.001, 0.01], (len(frame), 2))
    folder.mkdir(exist_ok=True)
    edit(frame).to_parquet(folder / "recording.parquet", index=False)
    (folder / "model.xml").write_text(MODEL)
    channels = {n: {"joint": "hinge", "quantity": k} for n, k in (("q", "position"), ("dq", "velocity"))}
    (folder / "nominal.yaml").write_text(yaml.safe_dump({"model": "model.xml", "channels": channels}))
    return folder


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (scaled(-1, "dq"), "warning: 'q' and 'dq' have opposite signs"),
        (exchanged(("q", "dq")), "warning: 'q' and 'dq' have opposite signs|'q' does not follow 'dq'"),
        (
            spike("q", 3.0, 400),
            r"warning: 'q' is off by 3\.?\d* rad for one sample at data row 401 \(episode 1",
        ),
        (lambda f: f.assign(dq=f["dq"].sample(frac=1, random_state=0).to_numpy()), "'q' does not follow 'dq'"),
        (shifted(1.0, 400, 600, "q"), r"warning: 'q' jumps by (0\.9|1)\d*\.?\d* rad to data row 401 \(episode 1"),
        (frozen(400, 450, "dq"), r"warning: 'dq' keeps one value for 0\.49 s from data row 401 .* 'q' says otherwise"),
        (scaled(180 / np.pi, "dq"), r"'q' changes 0\.0175 times as much as 'dq' says \(is the second in degrees/s\?\)"),
        (scaled(1000, "q"), r"'q' changes 1e\+03 times as much as 'dq' says \(is one of them in thousandths\?\)"),
        (lambda f: f.assign(t=f["t"] / 2), r"'q' changes 2 times as much as 'dq' says"),
        (spike("dq", 50.0, 400), r"'dq' is off by (49|50)\.?\d* rad/s for one sample at data row 401"),
        (lambda f: f.assign(dq=f["dq"] + 1.0), r"warning: 'q' drifts by -(0\.9|1)\d*\.?\d* rad/s from the integral of"),
    ],
)
def test_a_mechanism_is_warned_of(edit: Edit, message: str, tmp_path: Path) -> None:
    """Signs, integrals and lone samples, of a joint."""
    notes = read_model_case(lever(tmp_path / "c", edit)).notes
    with pytest.raises(AssertionError, match=message):
        raise AssertionError(notes)


@pytest.mark.parametrize(("name", "other"), [("q", "dq"), ("dq", "q")])
def test_a_dead_channel_of_a_mechanism_is_refused(name: str, other: str, tmp_path: Path) -> None:
    """With what to do about it."""
    message = f"channel '{name}' never changes, while '{other}' says that 'hinge' moves: a dead channel\\? Take it out"
    with pytest.raises(RecordingError, match=message):
        read_model_case(lever(tmp_path / "c", constant(name)))


def test_a_sound_mechanism_is_not_warned_of(tmp_path: Path) -> None:
    """Nor of gaps, coarse counts, another scale, a late velocity, a sensor that is slower, or rounding."""
    for edit in (
        lambda f: f,
        lambda f: f.assign(q=f["q"].where(f.index % 50 > 4)),
        lambda f: f.assign(q=f["q"].round(2)),
        scaled(1.3, "dq"),
        lambda f: f.assign(dq=f["dq"].shift(4, fill_value=0.0)),
        lambda f: f.assign(q=f["q"].where(f.index % 5 == 0).ffill()),
        lambda f: f.assign(dq=np.round(f["dq"])),
    ):
        assert not [n for n in read_model_case(lever(tmp_path / "c", edit)).notes if "warning" in n]


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (shifted(1.0, 400, None, "q"), r"'q' jumps by (0\.9|1)\d*\.?\d* rad to data row 401 \(episode 1"),
        (shifted(3.0, 400, 403, "q"), r"'q' jumps by -?(2\.9|3)\d*\.?\d* rad to data row 40[14] .*, and 1 more"),
        (noise(0.5, "q"), "'q' is another one at each sample, as noise is and no motion"),
    ],
)
def test_a_position_alone_is_warned_of(edit: Edit, message: str, tmp_path: Path) -> None:
    """Steps and noise, where no velocity is measured; not a slower sensor, rounding, or rest."""
    assert not read_model_case(without_velocity(lever(tmp_path / "sound", lambda f: f))).notes
    for sound in (lambda f: f.assign(q=f["q"].where(f.index % 5 == 0).ffill()), rounded(0.1, "q"), scaled(0.0, "q")):
        assert not read_model_case(without_velocity(lever(tmp_path / "too", sound))).notes
    (note,) = read_model_case(without_velocity(lever(tmp_path / "c", edit))).notes
    with pytest.raises(AssertionError, match=message):
        raise AssertionError(note)


def without_velocity(case: Path) -> Path:
    """Take a velocity out of a mapping and out of the table."""
    content = yaml.safe_load((case / "nominal.yaml").read_text())
    del content["channels"]["dq"]
    (case / "nominal.yaml").write_text(yaml.safe_dump(content))
    return edited(case, lambda f: f.drop(columns="dq"))


MOTORS = """<mujoco><option timestep="0.001"/><worldbody><body name="upper">
<joint name="shoulder" axis="0 -1 0" damping=".1"/>
<inertial pos="0 0 -0.15" mass="0.6" diaginertia=".01 .01 .001"/></body></worldbody>
<actuator><motor name="drive" joint="shoulder"/></actuator></mujoco>"""
SERVOS = MOTORS.replace("<motor", '<position kp="6" kv=".4"')
COMMANDS: dict[str, tuple[Edit, str]] = {
    "mirrored": (scaled(-1, "u"), "'q' moves against 'u': one of them has the wrong sign"),
    "motion mirrored": (scaled(-1, "q", "dq"), "'q' moves against 'u': one of them has the wrong sign"),
    "x1000": (
        scaled(1000, "u"),
        r"the motion of 'q' needs 0\.00\d+ times the command 'u' by the model",
    ),
    "/1000": (
        scaled(0.001, "u"),
        r"the motion of 'q' needs (\d{3}|\d\.?\d*e\+03) times the command 'u'",
    ),
    "motion in degrees": (
        scaled(180 / np.pi, "q", "dq"),
        r"the motion of 'q' needs \d+\.?\d* times the|'q' moves against 'u'",
    ),
    "of another episode": (of_another_episode("u"), r"explains 1?\d% of (what the motion of 'q' needs|how 'q' moves)"),
    "a spike": (spike("u", 1000.0, 500), r"'u' is (999|1000)\.?\d* at data row 501 .*, and the motion does not answer"),
    "held": (constant("u"), "^the command 'u' never changes"),
}


@pytest.mark.parametrize("kind", COMMANDS)
@pytest.mark.parametrize("servo", [False, True])
def test_commands_that_the_motion_does_not_answer(kind: str, servo: bool, tmp_path: Path) -> None:
    """Of a motor and of a servo."""
    edit, message = COMMANDS[kind]
    notes = read_model_case(edited(commanded(tmp_path / "c", SERVOS if servo else MOTORS), edit)).notes
    (note,) = [n for n in notes if "turns" not in n]
    with pytest.raises(AssertionError, match=message):
        raise AssertionError(note)


@pytest.mark.parametrize("servo", [False, True])
def test_of_commands_that_the_motion_answers_nothing_is_said(servo: bool, tmp_path: Path) -> None:
    """Nor of those that it answers late or weakly."""
    for edit in (lambda f: f, scaled(1 / 3, "u"), late(10, "u")):
        assert not read_model_case(edited(commanded(tmp_path / "sound", SERVOS if servo else MOTORS), edit)).notes


def commanded(folder: Path, model: str) -> Path:
    """Write what MuJoCo makes of a lever under random commands of a fifth of a second, 3 episodes, with noise."""
    rng, columns = np.random.default_rng(0), []
    world = mujoco.MjModel.from_xml_string(model)
    for _ in range(3):
        data, t = mujoco.MjData(world), np.arange(400) / 100
        u = np.repeat(rng.normal(0, 0.6, 20), 20)
        q, dq = np.empty(400), np.empty(400)
        for k in range(400):
            q[k], dq[k], data.ctrl[0] = data.qpos[0], data.qvel[0], u[k]
            mujoco.mj_step(world, data, 10)
        columns.append({"t": t, "u": u, "q": q + rng.normal(0, 1e-3, 400), "dq": dq + rng.normal(0, 1e-2, 400)})
    channels = {n: {"joint": "shoulder", "quantity": k} for n, k in (("q", "position"), ("dq", "velocity"))}
    nominal = {"commands": {"u": {"actuator": "drive"}}, "channels": channels}
    return mechanism_cases.write_case(folder, model, columns, nominal)
