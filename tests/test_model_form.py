"""The model form of recordings: what is written is read back, and every error says what is allowed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from runner.errors import RecordingError
from runner.recording.model_form import is_model_form, read_model_case
from tests.mechanism_cases import ARM, BODY, joint_channels, slide_case, write_case

Edit = Callable[[dict, pd.DataFrame, Path], object]


def arm_case(folder: Path, *, csv: bool = False) -> Path:
    """Write a case of an arm with every kind of column that it has."""
    t = np.arange(50) * 0.01
    columns = {
        "t": t,
        "ua": np.sin(t),
        "ub": -0.5 * t,
        "q_shoulder": 0.3 + t,
        "q_elbow": -t,
        "tau": 0.5 * t,
        "hand": 0.2 + 0.0 * t,
        "spare": t,
    }
    nominal = {
        "commands": {"ua": {"actuator": "shoulder"}, "ub": {"actuator": "elbow"}},
        "channels": {
            **joint_channels(["shoulder", "elbow"], velocities=False),
            "tau": {"actuator": "shoulder", "quantity": "force"},
            "hand": {"body": "forearm", "quantity": "position", "axis": "z"},
        },
        "noise": {"q_shoulder": 0.001, "tau": None},
        "start": "rest",
    }
    return write_case(folder, ARM, [columns, columns], nominal, csv=csv)


@pytest.mark.parametrize("csv", [False, True])
def test_a_case_is_read_as_it_was_written(tmp_path: Path, csv: bool):
    recording = read_model_case(arm_case(tmp_path, csv=csv))
    table = pd.read_csv(tmp_path / "recording.csv") if csv else pd.read_parquet(tmp_path / "recording.parquet")
    first = table.query("episode == 0")
    assert [s.name for s in recording.mapping.sources] == ["q_shoulder", "q_elbow", "tau", "hand"]
    assert [s.unit for s in recording.mapping.sources] == ["rad", "rad", "N m", "m"]
    assert [c.unit for c in recording.mapping.commands.values()] == ["N m", "rad"]
    assert len(recording.episodes) == 2
    names = [s.name for s in recording.mapping.sources]
    assert recording.episodes[0].values == pytest.approx(np.column_stack([first[n] for n in names]))
    assert recording.episodes[0].commands == pytest.approx(np.column_stack([first["ua"], first["ub"]]))
    assert recording.mapping.noise == {"q_shoulder": 0.001}
    assert recording.mapping.rests
    assert recording.step_s == pytest.approx(0.01)
    assert recording.notes == ("not named in nominal.yaml and not read: 'spare'",)
    assert is_model_form(tmp_path)
    with pytest.raises(ValueError, match="read-only"):
        recording.episodes[0].values[0, 0] = 1.0


def test_a_folder_without_model_is_none(tmp_path: Path):
    (tmp_path / "nominal.yaml").write_text("mass: 3\n")
    assert not is_model_form(tmp_path)
    assert not is_model_form(tmp_path / "nowhere")


@given(st.lists(st.floats(0.001, 0.1), min_size=3, max_size=30))
def test_clocks_need_not_be_even(tmp_path_factory: pytest.TempPathFactory, steps: list[float]):
    t = np.concatenate([[0.0], np.cumsum(steps)])
    recording = read_model_case(slide_case(tmp_path_factory.mktemp("clock"), t_s=t))
    assert recording.episodes[0].t_s == pytest.approx(t)
    assert recording.step_s == pytest.approx(np.median(np.diff(t)))


def test_orientations_are_read_as_turns_from_what_was_measured(tmp_path: Path):
    t = np.arange(20) * 0.01
    angle = 3.0 * t
    columns = {"t": t, "w": np.cos(angle / 2), "i": 0 * t, "j": 0 * t, "k": np.sin(angle / 2), "rate": 0 * t + 3.0}
    columns["w"] = np.where(t > 0.15, np.nan, columns["w"])
    channels = {
        "quat": {"body": "object", "quantity": "orientation", "columns": ["w", "i", "j", "k"]},
        "rate": {"sensor": "gyro", "index": 2},
    }
    recording = read_model_case(write_case(tmp_path, BODY, [columns], {"channels": channels, "noise": {"quat": 0.01}}))
    episode = recording.episodes[0]
    assert [s.name for s in recording.mapping.sources] == ["quat.x", "quat.y", "quat.z", "rate"]
    assert recording.mapping.noise == {"quat.x": 0.01, "quat.y": 0.01, "quat.z": 0.01}
    assert [s.unit for s in recording.mapping.sources] == ["rad", "rad", "rad", "rad/s"]
    assert np.isnan(episode.values[t > 0.15, :3]).all()
    assert (episode.values[t <= 0.15, :3] == 0).all()
    assert episode.orientations["quat"][3] == pytest.approx([np.cos(0.045), 0, 0, np.sin(0.045)])


def nominal_key(*path: str, value: object) -> Edit:
    """Return an edit that sets a key of nominal.yaml."""

    def edit(nominal: dict, table: pd.DataFrame, folder: Path) -> None:
        for key in path[:-1]:
            nominal = nominal[key]
        nominal[path[-1]] = value

    return edit


def cell(column: str, row: int, value: float) -> Edit:
    def edit(nominal: dict, table: pd.DataFrame, folder: Path) -> None:
        table[column] = table[column].astype(float)
        table.loc[row, column] = value

    return edit


def mjcf(before: str, after: str) -> Edit:
    def edit(nominal: dict, table: pd.DataFrame, folder: Path) -> None:
        text = (folder / "model.xml").read_text()
        assert before in text
        (folder / "model.xml").write_text(text.replace(before, after, 1))

    return edit


def dropped(column: str) -> Edit:
    return lambda nominal, table, folder: table.pop(column)


def degrees(nominal: dict, table: pd.DataFrame, folder: Path) -> None:
    mjcf('name="shoulder" type="hinge"', 'name="shoulder" type="hinge" limited="true" range="-120 120"')(
        nominal, table, folder
    )
    table["q_shoulder"] = np.linspace(-80, 80, len(table))


ERRORS: dict[str, tuple[Edit, str]] = {
    "an unknown key": (nominal_key("chanels", value={}), "unknown key 'chanels'.*Did you mean 'channels'"),
    "no such model file": (
        nominal_key("model", value="modl.xml"),
        "model: no file 'modl.xml'.*Did you mean 'model.xml'",
    ),
    "a model outside of the folder": (nominal_key("model", value="../model.xml"), "must lie in the folder of the case"),
    "no such joint": (
        nominal_key("channels", "q_elbow", value={"joint": "elbo", "quantity": "position"}),
        "channels.q_elbow.joint: no joint 'elbo' in the model.*Did you mean 'elbow'",
    ),
    "no such actuator": (
        nominal_key("commands", "ua", value={"actuator": "sholder"}),
        "commands.ua.actuator: no actuator 'sholder'.*Did you mean 'shoulder'",
    ),
    "no such sensor": (
        nominal_key("channels", "tau", value={"sensor": "gyro"}),
        "channels.tau.sensor: no sensor 'gyro' in the model. It has no sensor at all",
    ),
    "an actuator twice": (nominal_key("commands", "ub", value={"actuator": "shoulder"}), "driven by two columns"),
    "an unknown quantity": (
        nominal_key("channels", "q_elbow", "quantity", value="velocty"),
        "unknown 'velocty' of a joint. Valid: 'position', 'velocity'. Did you mean 'velocity'",
    ),
    "no axis": (nominal_key("channels", "hand", "axis", value="w"), "hand.axis: must be 'x', 'y' or 'z', got 'w'"),
    "two things measured": (
        nominal_key("channels", "tau", "joint", value="elbow"),
        "must name one of 'joint', 'actuator', 'body', 'sensor'",
    ),
    "noise of no channel": (
        nominal_key("noise", value={"q_shulder": 1.0}),
        "noise.q_shulder'.*Did you mean 'q_shoulder'",
    ),
    "noise below zero": (nominal_key("noise", value={"tau": -1.0}), "noise.tau: must be a finite number > 0 or null"),
    "an unknown start": (nominal_key("start", value="rst"), "start: unknown 'rst'. Valid: 'free', 'rest'"),
    "a missing column": (dropped("q_elbow"), "missing column 'q_elbow'; nominal.yaml names it"),
    "no episode": (dropped("episode"), "missing column 'episode'; every recording needs it"),
    "a command that is NaN": (
        cell("ua", 7, np.nan),
        r"data row 8 \(episode 0, t = 0.07 s\): column 'ua': a command must be a finite number, got nan",
    ),
    "a channel that is infinite": (cell("q_elbow", 3, np.inf), "data row 4.*column 'q_elbow': must be a finite number"),
    "times that fall": (cell("t", 5, 0.001), "data row 6.*column 't' must rise within an episode"),
    "degrees": (degrees, "channel 'q_shoulder' goes up to 80.*probably in degrees, allowed: rad"),
    "MJCF that does not compile": (mjcf('joint="shoulder"', 'joint="sholder"'), "is no model that MuJoCo compiles"),
    "broken XML": (mjcf("</worldbody>", ""), "is not valid XML"),
    "an absolute path": (
        mjcf("<worldbody>", '<include file="/etc/passwd"/><worldbody>'),
        "<include file>: must lie in the folder of the case",
    ),
    "a mesh above the folder": (
        mjcf("<worldbody>", '<asset><mesh file="../../x.stl"/></asset><worldbody>'),
        "<mesh file>: must lie in the folder of the case",
    ),
    "a mesh folder above": (
        mjcf("<worldbody>", '<compiler meshdir="../meshes"/><worldbody>'),
        "<compiler meshdir>: must lie in the folder",
    ),
    "a plugin": (
        mjcf("<worldbody>", '<extension><plugin plugin="mujoco.pid"/></extension><worldbody>'),
        "<extension> needs a plugin, which is code",
    ),
    "entities": (mjcf("<mujoco>", '<!DOCTYPE x [<!ENTITY a "b">]><mujoco>'), "must hold no document type"),
}


@pytest.mark.parametrize("name", ERRORS)
def test_an_error_is_one_line_that_says_what_is_allowed(tmp_path: Path, name: str):
    edit, message = ERRORS[name]
    arm_case(tmp_path)
    nominal = yaml.safe_load((tmp_path / "nominal.yaml").read_text())
    table = pd.read_parquet(tmp_path / "recording.parquet")
    edit(nominal, table, tmp_path)
    (tmp_path / "nominal.yaml").write_text(yaml.safe_dump(nominal))
    table.to_parquet(tmp_path / "recording.parquet", index=False)
    with pytest.raises(RecordingError, match=message) as caught:
        read_model_case(tmp_path)
    assert "\n" not in str(caught.value)
    assert str(tmp_path) in str(caught.value)


def test_times_in_milliseconds_are_refused(tmp_path: Path):
    with pytest.raises(RecordingError, match=r"rises by 5 s per sample.*probably not in s"):
        read_model_case(slide_case(tmp_path, t_s=np.arange(100) * 5.0))


def test_an_included_file_is_checked_too(tmp_path: Path):
    arm_case(tmp_path)
    (tmp_path / "part.xml").write_text('<mujoco><asset><mesh file="/tmp/x.stl"/></asset></mujoco>')
    text = (tmp_path / "model.xml").read_text()
    (tmp_path / "model.xml").write_text(text.replace("<worldbody>", '<include file="part.xml"/><worldbody>', 1))
    with pytest.raises(RecordingError, match=r"part\.xml: <mesh file>: must lie in the folder"):
        read_model_case(tmp_path)


def test_elements_without_a_name_get_one(tmp_path: Path):
    case = slide_case(tmp_path)
    text = (case / "model.xml").read_text()
    (case / "model.xml").write_text(text.replace('<body name="carriage">', "<body>"))
    assert read_model_case(case).spec().bodies[1].name == "body1"


def test_what_is_not_measured_is_noted(tmp_path: Path):
    arm_case(tmp_path)
    table = pd.read_parquet(tmp_path / "recording.parquet")
    table.loc[10:19, "q_elbow"] = np.nan
    table.to_parquet(tmp_path / "recording.parquet", index=False)
    assert "'q_elbow' is not measured (NaN) in 10 of 100 rows" in read_model_case(tmp_path).notes
    both = [c for c in table.columns if c.startswith("q_")][:2]
    table.loc[10:19, both] = np.nan
    table.to_parquet(tmp_path / "recording.parquet", index=False)
    # what a stream lacks is one note, not one for each of an arm's joints
    names = "', '".join(both)
    assert f"'{names}' are not measured (NaN) in 10 of 100 rows" in read_model_case(tmp_path).notes
    table["q_elbow"] = np.nan
    table.to_parquet(tmp_path / "recording.parquet", index=False)
    with pytest.raises(RecordingError, match="channel 'q_elbow' is NaN in all 100 rows"):
        read_model_case(tmp_path)
