"""Maps of imported logs: what is wrong is one line, what a log may not do is refused, what the page shows works."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pandas as pd
import pytest
import yaml
from log_writers import FLAT, WRITERS, Import, Run
from pydantic import BaseModel

from runner.errors import RecordingError
from runner.importing import map_file, units
from runner.importing.entries import Entry, Role
from runner.importing.propose import propose
from runner.importing.readers import read_log
from runner.importing.readers.rosbag import check_definitions
from runner.importing.signals import ReadOptions
from runner.recording.model_form import read_model_case

PAGE = Path(__file__).parent.parent / "docs" / "importing.md"


def edited(*path_and_value: Any) -> Callable[[dict], object]:
    """Return an edit of a map: keys, and what to put there."""
    *path, value = path_and_value

    def edit(keys: dict) -> None:
        for step in path[:-1]:
            keys = keys.setdefault(step, {})
        keys[path[-1]] = value

    return edit


REFUSED: dict[str, tuple[Callable[[dict], object], str]] = {
    "joint": (edited("channels", "q_elbow", "joint", "elbw"), "channels.q_elbow.joint: no joint 'elbw' in the model."),
    "actuator": (edited("commands", "u_elbow", "actuator", "x"), "commands.u_elbow.actuator: no actuator 'x'"),
    "signal": (
        edited("channels", "q_elbow", "signal", "elbow_po"),
        "channels.q_elbow: no signal 'elbow_po' in 0.csv. Valid: 'cmd_elbow', 'cmd_shoulder_pan', 'elbow_pos', "
        "'elbow_vel', 'shoulder_pan_pos', 'shoulder_pan_vel', 'time'. Did you mean 'elbow_pos'?",
    ),
    "unit of nothing": (edited("channels", "q_elbow", "unit", "degs/h"), "unknown unit 'degs/h'. Valid: "),
    "unit of something else": (
        edited("channels", "q_elbow", "unit", "mm"),
        "channels.q_elbow.unit: 'mm' is none of what is measured in rad. Valid: 'deg', 'mrad', 'rad', 'turn'.",
    ),
    "unit too large": (
        edited("channels", "q_elbow", "unit", "rad"),
        "the range of joint 'elbow' is -2.5 to 2.5; read in rad; in deg they would fit.",
    ),
    "target too large": (
        lambda keys: (
            edited("commands", "u_shoulder_pan", "scale", 1000.0)(keys),
            edited("commands", "u_shoulder_pan", "unit", "N m")(keys),
        ),
        "the range of actuator 'shoulder_pan' is -10 to 10",
    ),
    "rate in another unit": (
        edited("channels", "dq_elbow", "unit", "deg/s"),
        "channels.dq_elbow: is 0.0171 times the slope of 'q_elbow'; read in deg/s, one of the two, or the clock, is in",
    ),
    "clock": (edited("clock", "name", "stamp"), "signal 'cmd_shoulder_pan' has no clock 'stamp'. Valid: "),
    "no clock": (lambda keys: keys.pop("clock"), "clock: none is chosen for signal 'cmd_shoulder_pan'"),
    "unit of time": (edited("clock", "unit", "h"), "clock.unit: unknown unit of time 'h'. Valid: 'ms', 'ns', 's', "),
    "key": (edited("chanels", {}), "unknown key 'chanels'. Valid: "),
    "key below": (
        edited("commands", "u_elbow", "joint", "elbow"),
        "unknown key 'commands.u_elbow.joint'. "
        "Valid: 'actuator', 'between', 'clock', 'offset', 'scale', 'signal', 'unit', 'value'.",
    ),
    "no channels": (lambda keys: keys.pop("channels"), "missing 'channels'."),
    "column": (
        edited("commands", "a b", {"signal": "cmd_elbow", "actuator": "elbow"}),
        "commands.a b: must be letters, digits and '_'",
    ),
    "scale": (
        edited("commands", "u_elbow", "scale", "big"),
        "commands.u_elbow.scale: must be a finite number, got 'big'.",
    ),
    "episodes": (edited("episodes", {"by": "gap"}), "episodes: `by: gap` needs `longer_than_s`"),
    "way to cut": (edited("episodes", {"by": "gaps"}), "episodes.by: unknown 'gaps'. Valid: 'column', 'gap', 'part', "),
    "rows": (edited("rows", {"at": "q_elbw"}), "rows.at: unknown 'q_elbw'. Valid: 'all', 'dq_elbow', "),
    "quaternion": (
        edited("channels", "quat", {"body": "fore", "quantity": "orientation", "signal": "time"}),
        "channels.quat: an orientation needs `signals`, four names, and `order`",
    ),
    "start": (edited("start", "still"), "start: unknown 'still'."),
    "text for number": (edited("noise", {"q_elbow": -1}), "noise.q_elbow: must be a finite number > 0, got -1."),
}  # fmt: skip


@pytest.mark.parametrize("what", REFUSED)
def test_a_wrong_map_is_one_line(what: str, tmp_path: Path, runs: list[Run], run_import: Import) -> None:
    """The key, what it holds, what is allowed; exit code 2, and no case."""
    edit, message = REFUSED[what]
    logs, _ = WRITERS["csv"](tmp_path, runs[:1])
    keys = yaml.safe_load(yaml.safe_dump(FLAT, sort_keys=False))
    edit(keys)
    code, _, err = run_import(logs, keys)
    assert code == 2
    assert err.startswith("map.yaml: ")
    assert message in err
    assert err.count("\n") == 1
    assert not Path("case").exists()


def shown(number: int) -> dict:
    """Return one of the maps on the page."""
    return yaml.safe_load(re.findall(r"```yaml\n(.*?)```", PAGE.read_text(), re.DOTALL)[number])


def test_the_map_with_all_keys_works(tmp_path: Path, run_import: Import) -> None:
    """The one on the page has every key that there is, and makes the case that it says."""
    keys = shown(0)
    sections: dict[str, Any] = {"log": [keys["log"]], "clock": [keys["clock"]], "forces": keys["forces"]}
    sections |= {kind: list(keys[kind].values()) for kind in ("commands", "channels")}
    schemas: dict[str, type[BaseModel]] = {"log": map_file.LogKeys, "clock": map_file.ClockKeys}
    schemas |= {"forces": map_file.ForceKeys, "channels": map_file.ChannelKeys}
    assert set(keys) == set(map_file.Map.model_fields)
    for name, schema in schemas.items():
        assert set().union(*sections[name]) == set(schema.model_fields)
    Path("arm.xml").write_text(
        """<mujoco><worldbody><body name="link"><joint name="elbow" range="-170 170" axis="0 0 1"/><geom size=".1"/>
        <site name="s"/></body><body name="cube" pos="1 0 0"><freejoint/><geom size=".1"/></body></worldbody>
        <actuator><position name="elbow" joint="elbow" kp="5"/></actuator>
        <sensor><gyro name="gyro" site="s"/></sensor></mujoco>"""
    )
    t = np.arange(60) / 50
    q = np.sin(2 * t)
    log = {"time": 1000 * t, "run": t > 0.5, "cmd_elbow": np.degrees(q), "elbow_nm": q, "cube_x": 1000 + t}
    log |= {"elbow_ticks": np.round(2048 + q / 2 / np.pi * 4096), "elbow_rpm": 2 * np.cos(2 * t) * 30 / np.pi}
    log |= {"cube_qw": 1 + 0 * t, "imu_z": np.degrees(t)} | {f"cube_q{a}": 0 * t for a in "xyz"}
    log |= {f"push_{a}": t for a in "xyz"} | {f"at_{a}": 1 + t for a in "xyz"}
    pd.DataFrame(log).astype(float).to_csv("log.csv", index=False)
    code, _, err = run_import([Path("log.csv")], keys)
    assert (code, err) == (0, "")
    recording = read_model_case("case")
    assert recording.mapping.rests
    assert recording.mapping.noise == {"q_elbow": 0.00044}
    assert [len(e) for e in recording.episodes] == [26, 34]
    names = [s.name for s in recording.mapping.sources]
    values = np.concatenate([e.values for e in recording.episodes])
    assert values[:, names.index("q_elbow")] == pytest.approx(q, abs=np.pi / 4096 * 1.01)
    assert values[:, names.index("dq_elbow")] == pytest.approx(2 * np.cos(2 * t))
    assert values[:, names.index("x_cube")] == pytest.approx(1 + t / 1000)
    assert values[:, names.index("gyro_z")] == pytest.approx(t)
    assert np.concatenate([e.commands for e in recording.episodes])[:, 0] == pytest.approx(q)
    assert np.concatenate([e.points_m for e in recording.episodes])[:, 0, 1] == pytest.approx((1 + t) / 1000)


@pytest.mark.parametrize(
    ("number", "kind"),
    [(1, map_file.BoxMap), (2, map_file.BoxMap), (3, map_file.Map), (4, map_file.Map), (5, map_file.Map)],
)
def test_maps_on_the_page_are_maps(number: int, kind: Any, tmp_path: Path) -> None:
    (tmp_path / "map.yaml").write_text(yaml.safe_dump(shown(number)))
    assert map_file.read_map(tmp_path / "map.yaml", kind).channels


@pytest.mark.parametrize(
    ("unit", "si", "size"),
    [
        ("deg", "rad", np.pi / 180), ("°", "rad", np.pi / 180), ("rev", "rad", 2 * np.pi), ("mm", "m", 1e-3),
        ("rpm", "rad/s", 2 * np.pi / 60), ("dps", "rad/s", np.pi / 180), ("Nm", "N m", 1.0), ("N*m", "N m", 1.0),
        ("kgf cm", "N m", 0.0980665), ("g", "m/s2", 9.80665), ("mA", "", 1e-3), ("us", "s", 1e-6),
    ],
)  # fmt: skip
def test_units_have_their_sizes(unit: str, si: str, size: float) -> None:
    assert units.allowed(si)[units.spelled(unit)] == pytest.approx(size)


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ({}, "z"),
        ({"size": -0.001}, "-z"),
        ({"scale": 0.5, "offset": -3.0}, "0.5 z - 3"),
        ({"scale": 2.0, "size": -1.0}, "-(2 z)"),
        ({"value": 45.0, "size": 0.001}, "45 always"),
    ],
)
def test_what_is_done_to_a_signal_is_told(entry: dict[str, Any], said: str) -> None:
    """Where y points up an axis changes its sign, too."""
    assert Entry("channels.y", "y", "z", Role.CHANNEL, **entry).formula == said


def test_pickles_are_refused(tmp_path: Path) -> None:
    """By their ending, and inside of an archive of arrays."""
    (tmp_path / "log.pkl").write_bytes(b"")
    objects: Any = {"q": np.array([{}, []], dtype=object)}
    np.savez(tmp_path / "log.npz", **objects)
    for name in ("log.pkl", "log.npz"):
        with pytest.raises(RecordingError, match="run code when they are read"):
            read_log([tmp_path / name], ReadOptions())


def test_hdf5_leads_to_no_other_file(tmp_path: Path) -> None:
    """Links, arrays kept elsewhere and views of other files are refused; references are left alone."""
    import h5py

    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["secret"] = np.arange(5.0)

    def link(file: Any) -> None:
        file["x"] = h5py.ExternalLink(str(tmp_path / "other.h5"), "/secret")

    def outside(file: Any) -> None:
        file.create_dataset("x", shape=(5,), dtype="f8", external=[(str(tmp_path / "other.h5"), 0, 40)])

    def view(file: Any) -> None:
        layout = h5py.VirtualLayout(shape=(5,), dtype="f8")
        layout[:] = h5py.VirtualSource(str(tmp_path / "other.h5"), "secret", shape=(5,))
        file.create_virtual_dataset("x", layout)

    for number, make in enumerate((link, outside, view)):
        path = tmp_path / f"{number}.h5"
        with h5py.File(path, "w") as file:
            file["q"] = np.arange(5.0)
            make(file)
        with pytest.raises(RecordingError, match="another file, which is not read"):
            read_log([path], ReadOptions())


@pytest.mark.parametrize(
    "definitions",
    [
        {"a/msg/B:\n    print()\nclass C": ([], [("x", (1, ("float64", 0)))])},
        {"a/msg/B": ([], [("x = print()", (1, ("float64", 0)))])},
        {"a/msg/B": ([], [("x", (1, ("float64); print(", 0)))])},
        {"a/msg/B": ([], [("x", (2, "a/msg/C'); print('"))])},
        {"a/msg/B": ([], [("x", (4, ((2, "a b"), 0)))])},
        {"a/msg/B": ([("X", "int32", np.int32(1))], [("x", (1, ("float64", 0)))])},
        {"a/msg/B": ([("X Y", "int32", 1)], [("x", (1, ("float64", 0)))])},
    ],
)
def test_message_definitions_hold_names_and_values_only(definitions: dict) -> None:
    """Code is made of them, so anything else is refused before."""
    with pytest.raises(RecordingError, match="holds more than names and values"):
        check_definitions(Path("a.bag"), definitions)


def test_a_bag_with_code_for_a_type_is_refused(tmp_path: Path, runs: list[Run]) -> None:
    """The type's name stands in the bag by itself, outside of what is parsed."""
    (bag, *_), _ = WRITERS["ros1"](tmp_path, runs[:1])
    raw = bag.read_bytes()
    name, bad = b"sensor_msgs/JointState", b"sensor_msgs/J();print("
    assert raw.count(name) >= 1
    assert len(name) == len(bad)
    bag.write_bytes(raw.replace(name, bad))
    with pytest.raises(RecordingError, match="the type of topic '/joint_states' is no name"):
        read_log([bag], ReadOptions())


def test_a_missing_library_is_named_with_its_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "h5py", None)
    (tmp_path / "log.h5").write_bytes(b"")
    with pytest.raises(RecordingError, match=r"needs h5py, which is not installed; .*pip install 'runner\[import\]'"):
        read_log([tmp_path / "log.h5"], ReadOptions())


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".mcap", ".bag", ".db3", ".h5", ".npz", ".rrd", ".xyz"])
def test_a_broken_file_is_one_line(suffix: str, tmp_path: Path) -> None:
    """Whatever the library of the format makes of it."""
    path = tmp_path / f"log{suffix}"
    path.write_bytes(b"" if suffix == ".csv" else b"not what it says it is" * 100)
    with pytest.raises(RecordingError, match=r"log\.") as caught:
        read_log([path], ReadOptions())
    assert "\n" not in str(caught.value)


def test_what_is_no_data_set_is_refused(tmp_path: Path) -> None:
    """A version of LeRobot that is not read, a folder with nothing in it, one with several formats, a missing file."""
    (tmp_path / "meta").mkdir()
    (tmp_path / "meta" / "info.json").write_text('{"codebase_version": "v1.6", "features": {}}')
    with pytest.raises(RecordingError, match=r"codebase_version 'v1\.6' is not read; allowed: 2 and 3"):
        read_log([tmp_path], ReadOptions())
    (tmp_path / "empty").mkdir()
    with pytest.raises(RecordingError, match=r"in this folder are none of \.csv"):
        read_log([tmp_path / "empty"], ReadOptions())
    for name in ("a.csv", "b.mcap"):
        (tmp_path / "empty" / name).write_text("")
    with pytest.raises(RecordingError, match=r"files of several formats \(\.csv, \.mcap\)"):
        read_log([tmp_path / "empty"], ReadOptions())
    with pytest.raises(RecordingError, match="nowhere' does not exist"):
        read_log([tmp_path / "nowhere"], ReadOptions())


@pytest.mark.parametrize(
    ("begins", "proposed"),
    [
        ((0.0, 8.0), {"by": "gap", "longer_than_s": 3.5}),
        ((0.0, 0.0), {"by": "restart"}),
        ((0.0, 1.01), {"by": "part"}),
    ],
)
def test_runs_in_one_file_are_told_by_the_clock(
    begins: tuple[float, float], proposed: dict[str, object], tmp_path: Path
) -> None:
    """Where it leaps or goes back another run begins; where it goes on there is one."""
    t = np.concatenate([begin + np.arange(101) * 0.01 for begin in begins])
    pd.DataFrame({"time": t, "hinge_deg": np.sin(t), "cmd_drive": t}).to_csv(tmp_path / "log.csv", index=False)
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body><joint name='hinge'/><geom size='.1'/></body></worldbody>"
        "<actuator><motor name='drive' joint='hinge'/></actuator></mujoco>"
    )
    text = propose(read_log([tmp_path / "log.csv"], ReadOptions()), model).text
    assert yaml.safe_load(text)["episodes"] == proposed
