"""Importing logs: what was put into a log of any format comes out of the case, in SI and at its own times."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml
from log_writers import ARM, FLAT, JOINTS, RATE_HZ, ROS, WRITERS, Import, Run, frame, mcap_json

from runner.__main__ import main
from runner.importing.readers import read_log
from runner.importing.record import called, episode_sources
from runner.importing.signals import ReadOptions
from runner.recording.model_form import MechanismRecording, read_model_case


def check_same(recording: MechanismRecording, runs: list[Run], *, tolerance: float = 1e-12) -> None:
    """Hold a case against what was simulated; columns may stand in any order."""
    assert len(recording.episodes) == len(runs)
    names = [s.name for s in recording.mapping.sources]
    for episode, run in zip(recording.episodes, runs, strict=True):
        assert episode.t_s == pytest.approx(run.t, abs=2e-7)
        of = {name: episode.values[:, c] for c, name in enumerate(names)}
        driven = dict(zip(recording.mapping.commands, episode.commands.T, strict=True))
        for i, joint in enumerate(JOINTS):
            assert of[f"q_{joint}"] == pytest.approx(run.q[:, i], abs=tolerance)
            assert of[f"dq_{joint}"] == pytest.approx(run.dq[:, i], abs=tolerance)
            assert driven[f"u_{joint}"] == pytest.approx(run.u[:, i], abs=tolerance)


@pytest.mark.parametrize("kind", WRITERS)
def test_what_was_put_in_comes_out(kind: str, tmp_path: Path, runs: list[Run], run_import: Import) -> None:
    """Every format, degrees turned into rad, every run an episode."""
    logs, keys = WRITERS[kind](tmp_path, runs)
    code, out, err = run_import(logs, keys)
    assert (code, err) == (0, "")
    assert "3 episodes, 360 rows: case" in out
    check_same(read_model_case("case"), runs)
    record = yaml.safe_load(Path("case/import.yaml").read_text())
    assert record["clocks"][0]["rate_hz"] == pytest.approx(RATE_HZ, rel=1e-3)
    assert record["map"] == keys
    sources = record["episodes"]
    first, middle, last = sources
    assert [e.index for e in read_model_case("case").episodes] == [first, middle, last]
    several = len(set(sources.values())) > 1
    said = f"Episode {first} is {sources[first]}, {last} is {sources[last]}; the others stand in import.yaml."
    assert several is (said in " ".join(out.split()))
    assert several or kind != "csv"


@pytest.mark.parametrize("kind", ["csv", "parquet", "rrd", "mcap_json", "mcap_ros2", "db3", "lerobot_v3", "npz"])
def test_a_proposed_map_is_right(kind: str, tmp_path: Path, runs: list[Run], run_import: Import) -> None:
    """Names, degrees, clocks and episodes are recognised, and the command that is named goes on from there."""
    logs, _ = WRITERS[kind](tmp_path, runs)
    code, out, err = run_import(logs, None, "out=case")
    assert (code, err) == (0, "")
    assert "Missing" not in out
    (command,) = [line.strip() for line in out.splitlines() if line.startswith("  runner import")]
    assert main(command.split()[1:]) == 0
    if kind in ("mcap_json", "mcap_ros2", "db3"):  # by the stamps of the messages, 3 ms before the commands'
        check_without_commands(read_model_case("case"), runs)
    else:
        check_same(read_model_case("case"), runs)


def check_without_commands(recording: MechanismRecording, runs: list[Run]) -> None:
    """Hold what was measured against what was simulated, where commands go by another clock."""
    names = [s.name for s in recording.mapping.sources]
    for episode, run in zip(recording.episodes, runs, strict=True):
        q = episode.values[:, names.index("q_elbow")]
        measured = np.isfinite(q)
        assert q[measured] == pytest.approx(run.q[1:, 1])  # the first sample is before the first command
        assert measured[0]
        u = episode.commands[:, list(recording.mapping.commands).index("u_elbow")]
        assert u[measured] == pytest.approx(run.u[:-1, 1])


def test_a_proposal_says_what_is_missing(tmp_path: Path, runs: list[Run], run_import: Import) -> None:
    """What nobody can know is left open, and refused until it is filled in."""
    table = frame(runs[0]).rename(columns={"elbow_pos": "elbow_ticks", "cmd_elbow": "spare"})
    table["elbow_ticks"] = np.round(table["elbow_ticks"] * 4096 / 360 + 2048)
    table.to_csv("log.csv", index=False)
    code, out, _ = run_import([Path("log.csv")], None)
    assert code == 0
    assert "Missing: the unit of 'elbow_ticks'" in out
    assert "no command for 'elbow'" in out
    assert "not used: spare" in out
    code, _, err = run_import([Path("log.csv")], None, "map=map.yaml", "out=case")
    assert (code, err) == (2, "map.yaml: channels.q_elbow.unit: is left open (TODO); fill it in.\n")
    keys = yaml.safe_load(Path("map.yaml").read_text())
    keys["channels"]["q_elbow"] |= {"unit": "turn", "scale": 1 / 4096, "offset": -0.5}
    code, _, err = run_import([Path("log.csv")], keys)
    assert (code, err) == (0, "")
    recording = read_model_case("case")
    q = recording.episodes[0].values[:, [s.name for s in recording.mapping.sources].index("q_elbow")]
    assert q == pytest.approx(runs[0].q[:, 1], abs=np.pi / 4096)
    code, _, err = run_import([Path("log.csv")], None)
    assert code == 2
    assert "is there already" in err


def test_a_command_must_be_known(tmp_path: Path, runs: list[Run], run_import: Import) -> None:
    """Many empty cells of a command are refused, unless the map says that they mean no new value; few were lost."""
    table = frame(runs[0])
    table.loc[[5, 6], "cmd_elbow"] = np.nan
    table.to_csv("few.csv", index=False)
    code, out, err = run_import([Path("few.csv")], FLAT)
    assert (code, err) == (0, "")
    assert "'u_elbow': no number in 2 samples, which count as lost" in " ".join(out.split())
    (episode,) = read_model_case("case").episodes
    shutil.rmtree("case")
    assert episode.commands[[4, 7], 1] == pytest.approx(runs[0].u[[4, 7], 1])
    table.loc[5:20, "cmd_elbow"] = np.nan
    table.loc[7, "elbow_pos"] = np.nan
    table.to_csv("log.csv", index=False)
    code, _, err = run_import([Path("log.csv")], FLAT)
    assert code == 2
    assert "commands.u_elbow: signal 'cmd_elbow' is no number in sample 6 (16 of 120 samples)" in err
    code, _, err = run_import([Path("log.csv")], FLAT | {"log": {"sparse": True}})
    assert (code, err) == (0, "")
    (episode,) = read_model_case("case").episodes
    assert episode.commands[[4, 5, 20, 21], 1] == pytest.approx(runs[0].u[[4, 4, 4, 21], 1])
    assert np.flatnonzero(np.isnan(episode.values).any(axis=1)).tolist() == [7]


@pytest.mark.parametrize("cell", ["n/a", "NA", "", "-"])
def test_a_cell_without_a_reading_is_not_measured(cell: str, runs: list[Run], run_import: Import) -> None:
    lines = frame(runs[0]).to_csv(index=False).splitlines()
    column = lines[0].split(",").index("elbow_pos")
    cells = lines[50].split(",")
    lines[50] = ",".join([*cells[:column], cell, *cells[column + 1 :]])
    lines[80] = "," * (len(cells) - 1)
    Path("log.csv").write_text("\n".join(lines))
    code, _, err = run_import([Path("log.csv")], FLAT)
    assert (code, err) == (0, "")
    recording = read_model_case("case")
    elbow = [s.name for s in recording.mapping.sources].index("q_elbow")
    assert np.flatnonzero(np.isnan(recording.episodes[0].values[:, elbow])).tolist() == [49, 79]


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("{before},ERR,{after}", "channels.q_elbow: 'elbow_pos' of log.csv is no column of numbers: 'ERR' in row 50."),
        ("{before}", "log.csv: line 51 has {few} cells, the first line, which names the columns, {all}: '{before}'."),
    ],
)
def test_a_cell_that_is_no_number_is_named(line: str, message: str, runs: list[Run], run_import: Import) -> None:
    """With its row: a column that vanished, and another joint's proposed, told a user nothing."""
    lines = frame(runs[0]).to_csv(index=False).splitlines()
    column, cells = lines[0].split(",").index("elbow_pos"), lines[50].split(",")
    parts = {"before": ",".join(cells[:column]), "after": ",".join(cells[column + 1 :])}
    lines[50] = line.format(**parts)
    Path("log.csv").write_text("\n".join(lines))
    code, _, err = run_import([Path("log.csv")], FLAT)
    assert code == 2
    assert message.format(few=column, all=len(cells), before=parts["before"][:60]) in err


def test_a_model_that_does_not_compile_is_refused(tmp_path: Path, runs: list[Run], run_import: Import) -> None:
    logs, _ = WRITERS["csv"](tmp_path, runs[:1])
    Path("arm.xml").write_text(ARM.replace('joint="elbow"', 'joint="elbow_"'))
    code, _, err = run_import(logs, FLAT)
    assert code == 2
    assert "arm.xml: is no model that MuJoCo compiles" in err
    assert err.count("\n") == 1


def test_clocks_are_reported_and_put_in_order(tmp_path: Path, runs: list[Run], run_import: Import) -> None:
    """Duplicates, samples out of order and a gap are counted; what is left rises."""
    table = frame(runs[0])
    rows = [*range(20), 19, 22, 21, *range(23, 60), *range(80, 120)]
    table.iloc[rows].to_csv("log.csv", index=False)
    code, out, err = run_import([Path("log.csv")], FLAT)
    assert (code, err) == (0, "")
    out = " ".join(out.split())
    assert "'elbow_vel': 1 sample has the stamp of another; the one that arrived last was kept" in out
    assert "'elbow_vel': 1 sample was out of order and put into it" in out
    (clock,) = yaml.safe_load(Path("case/import.yaml").read_text())["clocks"]
    assert clock["samples"] == len(rows)
    assert clock["rate_hz"] == pytest.approx(100)
    assert clock["longest_gap_s"] == pytest.approx(0.21)
    assert clock["duplicates"] == pytest.approx(1 / len(rows), rel=1e-5)
    assert clock["out_of_order"] == 1
    (episode,) = read_model_case("case").episodes
    kept = sorted(set(rows))
    assert episode.t_s == pytest.approx(runs[0].t[kept])
    assert episode.values[:, 0] == pytest.approx(runs[0].q[kept, 0])


def test_jitter_is_that_of_most_steps(tmp_path: Path, runs: list[Run], run_import: Import) -> None:
    """Steps of 8 and 12 ms around 10 ms: the jitter is 2 ms."""
    table = frame(runs[0])
    table["time"] += np.where(np.arange(len(table)) % 4 == 1, -0.002, 0.0)
    table.to_csv("log.csv", index=False)
    code, out, _ = run_import([Path("log.csv")], FLAT)
    assert code == 0
    assert "jitter ms" in out
    assert "unordered" not in out  # what did not happen takes no room
    (clock,) = yaml.safe_load(Path("case/import.yaml").read_text())["clocks"]
    assert clock["jitter_ms"] == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("keys", "lengths"),
    [
        ({"by": "gap", "longer_than_s": 0.5}, [120, 120, 120]),
        ({"by": "column", "signal": "count"}, [60, 300]),
        ({"by": "part"}, [360]),
    ],
)
def test_episodes_are_cut(keys: dict, lengths: list[int], runs: list[Run], run_import: Import, tmp_path: Path) -> None:
    """By gaps, by a column, or not at all."""
    count = np.where(np.arange(360) < 60, 4, 9)
    whole = pd.concat([frame(run).assign(time=run.t + 10 * k) for k, run in enumerate(runs)]).assign(count=count)
    whole.to_csv("log.csv", index=False)
    code, out, err = run_import([Path("log.csv")], FLAT | {"episodes": keys})
    assert (code, err) == (0, "")
    out = " ".join(out.split())
    # a log that stops twice, taken for one episode, is worth a word
    assert ("8.81 s or longer 2 times within an episode" in out) == (keys["by"] == "part")
    assert ("`episodes: {by: gap, longer_than_s: 4.4}`" in out) == (keys["by"] == "part")
    episodes = read_model_case("case").episodes
    assert [len(e) for e in episodes] == lengths
    assert [e.index for e in episodes] == ([4, 9] if keys["by"] == "column" else list(range(len(lengths))))
    assert all(e.t_s[0] == 0 for e in episodes)


def test_times_that_start_anew_are_episodes_only_if_said(runs: list[Run], run_import: Import, tmp_path: Path) -> None:
    """Without a word of it in the map that is refused; it is no disorder of samples."""
    pd.concat([frame(run) for run in runs]).to_csv("log.csv", index=False)
    code, _, err = run_import([Path("log.csv")], FLAT)
    assert code == 2
    assert "fall back by 1.19 s at sample 121; if an episode begins there, write `episodes: {by: restart}`" in err
    code, _, err = run_import([Path("log.csv")], FLAT | {"episodes": {"by": "restart"}})
    assert (code, err) == (0, "")
    check_same(read_model_case("case"), runs)


def test_streams_are_put_on_common_times(tmp_path: Path, runs: list[Run], run_import: Import) -> None:
    """All times, a channel's times, or even times: commands are held, channels interpolated where they have to be."""
    logs, keys = mcap_json(tmp_path, runs[:1])
    stamped = keys | {"clock": {"name": "header_stamp"}}
    code, _, err = run_import(logs, stamped)
    assert code == 2
    assert "commands.u_shoulder_pan: signal '/command/data[0]' has no clock 'header_stamp'. Valid: " in err
    commands: Any = stamped["commands"]
    for command in commands.values():
        command["clock"] = "log_time"
    assert run_import(logs, stamped)[0] == 0
    (episode,) = read_model_case("case").episodes
    # the first measurement after the first command: 7 ms; then the command of 10 ms, the measurement of 17 ms
    assert episode.t_s[:4] == pytest.approx([0.0, 0.003, 0.01, 0.013])
    measured = np.isfinite(episode.values[:, 0])
    assert measured[:4].tolist() == [True, False, True, False]
    assert episode.commands[:4, 0] == pytest.approx(runs[0].u[[0, 1, 1, 2], 0])
    assert run_import(logs, stamped | {"rows": {"at": "even", "rate_hz": 200}})[0] == 0
    (even,) = read_model_case("case").episodes
    assert np.diff(even.t_s) == pytest.approx(0.005)
    expected = np.interp(0.007 + even.t_s, runs[0].t - 0.003, runs[0].q[:, 0])
    assert even.values[:, 0] == pytest.approx(expected, abs=1e-9)
    held = runs[0].u[np.floor((0.007 + even.t_s) * 100 + 1e-6).astype(int), 0]
    assert even.commands[:, 0] == pytest.approx(held)


def test_nothing_is_interpolated_over_gaps(runs: list[Run], run_import: Import, tmp_path: Path) -> None:
    table = frame(runs[0])
    table.loc[40:59, "elbow_pos"] = np.nan
    table.to_csv("log.csv", index=False)
    assert run_import([Path("log.csv")], FLAT | {"rows": {"at": "even", "rate_hz": 50}})[0] == 0
    (episode,) = read_model_case("case").episodes
    lost = np.isnan(episode.values[:, 1])
    assert episode.t_s[lost] == pytest.approx(np.arange(20, 30) / 50)


def test_orientations_are_reordered_and_worlds_turned(tmp_path: Path, run_import: Import) -> None:
    """A body in a world whose y points up, scalar last, in mm: in the case z points up, the scalar is first, in m."""
    body = """<mujoco><worldbody><body name="cube" pos="0.1 0.2 0.9"><freejoint/><geom size=".1" mass="1"/></body>
    </worldbody></mujoco>"""
    Path("arm.xml").write_text(body)
    t = np.arange(40) / 50
    angle = 0.5 + t  # about the vertical
    log = pd.DataFrame({"t": t, "x": 100 + 50 * t, "y": 900.0, "z": -200 - 80 * t})
    for name, values in {"qx": 0 * t, "qy": np.sin(angle / 2), "qz": 0 * t, "qw": -np.cos(angle / 2)}.items():
        log[name] = values
    log["qy"] *= -1  # the other sign of the same quaternion
    log.to_csv("log.csv", index=False)
    place = {"body": "cube", "quantity": "position", "unit": "mm"}
    channels: dict[str, dict] = {f"p_{a}": place | {"signal": a, "axis": a} for a in "xyz"}
    channels["quat"] = {
        "body": "cube", "quantity": "orientation", "signals": ["qx", "qy", "qz", "qw"], "order": "xyzw",
    }  # fmt: skip
    code, _, err = run_import([Path("log.csv")], {"clock": {"name": "t"}, "up": "y", "channels": channels})
    assert (code, err) == (0, "")
    recording = read_model_case("case")
    axes = {s.name: s.index for s in recording.mapping.sources}
    assert [axes[f"p_{a}"] for a in "xyz"] == [0, 2, 1]
    (episode,) = recording.episodes
    columns = [s.name for s in recording.mapping.sources]
    position = np.stack([episode.values[:, columns.index(f"p_{a}")] for a in "xzy"], axis=1)
    assert position == pytest.approx(np.stack([0.1 + 0.05 * t, 0.2 + 0.08 * t, 0.9 + 0 * t], axis=1))
    q = episode.orientations["quat"]
    expected = np.stack([np.cos(angle / 2), 0 * t, 0 * t, np.sin(angle / 2)], axis=1)  # about z now
    assert abs(np.sum(q * expected, axis=1)) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("unit", "up", "said"),
    [
        ("mm", "y", None),
        ("um", "y", "channels: 'cube' falls with 0.00981 m/s2, where the model's gravity is 9.81: is the unit of its "
         "positions um"),
        ("mm", "z", "channels: 'cube' falls along -y of the case's world"),
    ],
)  # fmt: skip
def test_a_fall_tells_a_wrong_unit_and_a_wrong_axis(
    unit: str, up: str, said: str | None, tmp_path: Path, run_import: Import
) -> None:
    """Before a diagnosis looks for what makes a body fall otherwise than it does."""
    Path("arm.xml").write_text(
        '<mujoco><worldbody><body name="cube"><freejoint/><geom size=".1" mass="1"/></body></worldbody></mujoco>'
    )
    t = np.arange(60) / 100
    log = pd.DataFrame({"t": t, "x": 100 + 50 * t, "y": 900.0 + 2e3 * t - 9810 / 2 * t**2, "z": -200 - 80 * t})
    log.to_csv("log.csv", index=False)
    place = {"body": "cube", "quantity": "position", "unit": unit}
    channels: dict[str, dict] = {f"p_{a}": place | {"signal": a, "axis": a} for a in "xyz"}
    code, _, err = run_import([Path("log.csv")], {"clock": {"name": "t"}, "up": up, "channels": channels})
    assert code == (2 if said else 0)
    assert (said or "") in err


def test_a_frame_is_recognised(tmp_path: Path, run_import: Import) -> None:
    """Which axis points up shows in where the model has the body; where the scalar stands, in the names."""
    cube = '<body name="cube" pos="0 0.1 0.9"><freejoint/><geom size=".1" mass="1"/></body>'
    Path("arm.xml").write_text(f"<mujoco><worldbody>{cube}</worldbody></mujoco>")
    t = np.arange(40) / 50
    log = pd.DataFrame({"t": t})
    for name, value in zip("xyz", (0, 0.9, -0.1), strict=True):
        log[f"cube/position/{name}"] = value + 0 * t
    for name, value in zip("xyzw", (0, 0, 0, 1), strict=True):
        log[f"cube/orientation/{name}"] = value + 0.0 * t
    log.to_csv("log.csv", index=False)
    code, _, err = run_import([Path("log.csv")], None)
    assert (code, err) == (0, "")
    keys = yaml.safe_load(Path("map.yaml").read_text())
    assert keys["up"] == "y"
    assert keys["channels"]["quat_cube"]["order"] == "xyzw"
    assert keys["channels"]["x_cube"] == {
        "signal": "cube/position/x", "body": "cube", "quantity": "position", "axis": "x", "unit": "m",
    }  # fmt: skip


def test_forces_on_bodies_are_turned_as_well(tmp_path: Path, run_import: Import) -> None:
    """In a world whose y points up, a weight acts along -y; in the case along -z."""
    Path("arm.xml").write_text(
        '<mujoco><worldbody><body name="cube"><freejoint/><geom size=".1" mass="1"/></body></worldbody></mujoco>'
    )
    t = np.arange(10) / 50
    pd.DataFrame({"t": t, "p": t, "fx": 1 + t, "fy": -2 - t, "fz": 3 + t}).to_csv("log.csv", index=False)
    keys = {
        "clock": {"name": "t"}, "up": "y", "forces": [{"body": "cube", "force": ["fx", "fy", "fz"], "unit": "kN"}],
        "channels": {"p": {"signal": "p", "body": "cube", "quantity": "position", "axis": "z"}},
    }  # fmt: skip
    code, _, err = run_import([Path("log.csv")], keys)
    assert (code, err) == (0, "")
    recording = read_model_case("case")
    (episode,) = recording.episodes
    assert episode.forces_n[:, 0] == pytest.approx(1000 * np.stack([1 + t, -3 - t, -2 - t], axis=1))
    assert recording.mapping.sources[0].index == 1
    assert episode.values[:, 0] == pytest.approx(-t)


def test_a_cut_off_file_is_read_as_far_as_it_goes(tmp_path: Path, runs: list[Run], run_import: Import) -> None:
    (log,), keys = mcap_json(tmp_path, runs[:1])
    log.write_bytes(log.read_bytes()[:-200])
    code, out, err = run_import([log], keys)
    assert (code, err) == (0, "")
    assert "was cut off while it was written" in out
    check_same(read_model_case("case"), runs[:1])


def test_the_model_comes_with_its_files(tmp_path: Path, runs: list[Run], run_import: Import) -> None:
    """Meshes and included files are copied to where the MJCF looks for them."""
    import struct

    logs, keys = WRITERS["csv"](tmp_path, runs[:1])
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype="<f4")
    faces = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
    stl = b"\0" * 80 + struct.pack("<I", 4)
    stl += b"".join(b"\0" * 12 + corners[list(f)].tobytes() + b"\0\0" for f in faces)
    Path("meshes").mkdir()
    Path("meshes/part.stl").write_bytes(stl)
    Path("extra.xml").write_text('<mujoco><asset><mesh name="part" file="part.stl"/></asset></mujoco>')
    geom = '<geom type="mesh" mesh="part" mass="0" contype="0" conaffinity="0"/>'
    head = '<compiler meshdir="meshes" angle="radian"/><include file="extra.xml"/>'
    Path("arm.xml").write_text(
        ARM.replace('<compiler angle="radian"/>', head).replace('<body name="fore"', f'{geom}<body name="fore"')
    )
    code, _, err = run_import(logs, keys)
    assert (code, err) == (0, "")
    assert sorted(p.relative_to("case").as_posix() for p in Path("case").rglob("*") if p.is_file()) == [
        "extra.xml", "import.yaml", "meshes/part.stl", "model.xml", "nominal.yaml", "recording.parquet",
    ]  # fmt: skip
    check_same(read_model_case("case"), runs[:1])


def test_a_folder_of_somebody_is_not_written_over(tmp_path: Path, runs: list[Run], run_import: Import) -> None:
    """An imported case may be made anew; anything else stays."""
    logs, keys = WRITERS["csv"](tmp_path, runs[:1])
    assert run_import(logs, keys)[0] == 0
    believed = Path("case/nominal.yaml").read_text()
    Path("case/nominal.yaml").write_text(believed + "# weighed again\n")
    code, _, err = run_import(logs, keys)
    assert code == 2
    assert "'case/nominal.yaml' was edited since it was imported; name a new folder." in err
    assert Path("case/nominal.yaml").read_text().endswith("# weighed again\n")
    Path("case/nominal.yaml").write_text(believed)
    Path("case/model.xml").write_text(Path("case/model.xml").read_text() + "<!-- mine -->")
    code, _, err = run_import(logs, keys)
    assert code == 2
    assert "'case/model.xml' was edited since it was imported" in err
    shutil.copy("arm.xml", "case/model.xml")
    Path("case/import.yaml").write_bytes(Path("case/import.yaml").read_bytes() + b"# \xff\n")
    assert run_import(logs, keys)[0] == 0
    Path("case/import.yaml").unlink()
    code, _, err = run_import(logs, keys)
    assert code == 2
    assert "'case' is not empty and was not written by an import" in err


def test_both_clocks_of_messages_can_be_had(tmp_path: Path, runs: list[Run], run_import: Import) -> None:
    """The recorder's clock for all; how far it is behind the messages' is said by a proposal."""
    logs, _ = mcap_json(tmp_path, runs)
    code, out, _ = run_import(logs, None)
    assert code == 0
    assert "log_time is 3 ms behind header_stamp" in out
    assert "'/command/data[0]' has no header_stamp and goes by log_time" in out
    assert run_import(logs, ROS)[0] == 0
    check_same(read_model_case("case"), runs)


@pytest.mark.parametrize("storage", ["MCAP", "SQLITE3"])
def test_images_are_left_out(storage: str, tmp_path: Path) -> None:
    """Their topics are named, not decoded; what else is in the bag is read."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.ROS2_HUMBLE)
    time = types.types["builtin_interfaces/msg/Time"](sec=1, nanosec=2)
    header = types.types["std_msgs/msg/Header"](stamp=time, frame_id="")
    image = types.types["sensor_msgs/msg/CompressedImage"](header=header, format="", data=np.zeros(9, dtype=np.uint8))
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin[storage]) as writer:
        for topic, message in {"/camera": image, "/u": types.types["std_msgs/msg/Float64"](data=2.0)}.items():
            connection = writer.add_connection(topic, message.__msgtype__, typestore=types)
            for k in range(3):
                writer.write(connection, k, types.serialize_cdr(message, message.__msgtype__))
    log = read_log([tmp_path / "bag"], ReadOptions())
    assert list(log.parts[0].signals) == ["/u/data"]
    assert log.parts[0].signals["/u/data"].values.tolist() == [2.0, 2.0, 2.0]
    assert any("images, clouds and the like are not read: '/camera'" in note for note in log.notes)


def test_a_case_of_another_log_is_not_written_over(tmp_path: Path, runs: list[Run], run_import: Import) -> None:
    """The same log again is, with another map; a proposal does not hide that a log is missing."""
    keys = FLAT | {"channels": {k: c for k, c in FLAT["channels"].items() if k.startswith("q_")}}
    for name in ("log.csv", "other.csv"):
        frame(runs[0]).to_csv(name, index=False)
    assert run_import([Path("log.csv")], keys)[0] == 0
    assert run_import([Path("log.csv")], keys | {"start": "rest"})[0] == 0
    before = Path("case/import.yaml").read_bytes()
    code, _, err = run_import([Path("other.csv")], keys)
    assert code == 2
    assert "out: 'case' was imported from another log, log.csv; name a new folder." in err
    assert Path("case/import.yaml").read_bytes() == before
    code, _, err = run_import([Path("lost.csv")], None)
    assert (code, "lost.csv" in err, "already" in err) == (2, True, False)


def test_a_case_that_can_not_be_read_is_not_written(tmp_path: Path, runs: list[Run], run_import: Import) -> None:
    """Times in another unit show when it is read: one sample in 10 s is no recording of a mechanism."""
    keys = FLAT | {"channels": {k: c for k, c in FLAT["channels"].items() if k.startswith("q_")}}
    Path("log.csv").write_text(frame(runs[0]).assign(time=runs[0].t * 1000).to_csv(index=False))
    code, _, err = run_import([Path("log.csv")], keys)
    assert code == 2
    assert err.startswith("recording.parquet: data row 1 ")
    assert "probably not in s. By 'map.yaml' the case would be so; it was not written." in err
    assert not Path("case").exists()
    assert not list(Path().glob(".case.*"))


@pytest.mark.parametrize("text", ["[" * 100_000, "episodes: &a {0: *a}", "episodes: 5", "\x00"])
def test_a_record_of_a_stranger_that_is_none_tells_nothing_of_episodes(tmp_path: Path, text: str) -> None:
    """A case that was sent may hold anything beside its recording; that is then told by the numbers of its episodes."""
    (tmp_path / "import.yaml").write_text(text)
    assert episode_sources(tmp_path) == {}
    assert called(tmp_path, 4) == "4"
