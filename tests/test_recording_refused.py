"""A table that can't be right is refused with its place."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from recording_cases import (
    NOMINAL,
    RATE_HZ,
    SAVED,
    frame_of,
    notes_of,
    planar,
    planar_episode,
    spatial,
    spatial_episode,
)
from scipy.spatial.transform import Rotation

from runner.errors import RecordingError
from runner.recording import (
    Episode,
    Form,
    Recording,
    find_cases,
    read_case,
    write_case,
    write_nominal,
)

# What is refused: the table ------------------------------------------------------------------------------------------


def cell(column: str, row: int, value: object) -> Callable[[pd.DataFrame], pd.DataFrame]:
    def edit(frame: pd.DataFrame) -> pd.DataFrame:
        if isinstance(value, str):
            frame[column] = frame[column].astype(object)
        frame.loc[row, column] = value
        return frame

    return edit


def times(factor: float, *columns: str) -> Callable[[pd.DataFrame], pd.DataFrame]:
    return lambda frame: frame.assign(**{name: frame[name] * factor for name in columns})


def swap(frame: pd.DataFrame, one: int, other: int) -> pd.DataFrame:
    order = list(range(len(frame)))
    order[one], order[other] = order[other], order[one]
    return frame.iloc[order]


def in_body(frame: pd.DataFrame) -> pd.DataFrame:
    c, s = np.cos(frame["yaw"]), np.sin(frame["yaw"])
    return frame.assign(vx=c * frame["vx"] + s * frame["vy"], vy=c * frame["vy"] - s * frame["vx"])


def faster_second_episode(frame: pd.DataFrame) -> pd.DataFrame:
    return frame.assign(t=frame["t"] * np.where(frame["episode"] == 1, 0.5, 1.0))


def stretched(frame: pd.DataFrame) -> pd.DataFrame:
    late = (frame["episode"] == 1) & (frame["t"] > 1.0)
    return frame.assign(t=frame["t"] + 0.01 * late)


PLACE_12 = re.escape("data row 13 (episode 0, t = 0.2 s): ")
PLANAR_ERRORS = {
    "missing column": (
        lambda f: f.drop(columns="yaw"),
        r"missing column 'yaw' \[rad\]; the planar form needs .* \(vx, vy, wz where they were measured\)\. Found:",
    ),
    "two missing": (lambda f: f.drop(columns=["fx", "py"]), r"missing columns 'fx' \[N\], 'py' \[m\];"),
    "other case": (lambda f: f.rename(columns={"x": "X"}), r"missing column 'x' .* Rename 'X' -> 'x'\?"),
    "unit in name": (
        lambda f: f.rename(columns={"vx": "vx_m_s"}),
        r"unknown column 'vx_m_s'\. Did you mean 'vx' \[m/s\]\?",
    ),
    "bracket": (lambda f: f.rename(columns={"yaw": "Yaw [rad]"}), r"Rename 'Yaw \[rad\]' -> 'yaw'\?"),
    "synonyms": (
        lambda f: f.rename(columns={"t": "time", "yaw": "theta", "fx": "force_x"}),
        r"Rename 'time' -> 't', 'theta' -> 'yaw', 'force_x' -> 'fx'\?",
    ),
    "typing slip": (lambda f: f.rename(columns={"episode": "epsiode"}), r"Rename 'epsiode' -> 'episode'\?"),
    "optional": (lambda f: f.rename(columns={"pz": "p_z"}), r"unknown column 'p_z'\. Did you mean 'pz' \[m\]\?"),
    "empty": (lambda f: f.iloc[:0], r"has no rows; at least three samples"),
    "text": (cell("fy", 12, "none"), r"data row 13: column 'fy' must be a number in N, got 'none'"),
    "NaN command": (
        cell("px", 12, np.nan),
        PLACE_12 + r"column 'px' must be a finite number in m; no force is 0, not empty, got nan\.",
    ),
    "NaN commands": (
        lambda f: f.assign(fy=np.where(f.index >= 12, np.nan, f["fy"])),
        PLACE_12 + r"column 'fy' must be a finite number in N; no force is 0, not empty, got nan \(351 such rows\)",
    ),
    "infinite": (cell("x", 12, -np.inf), PLACE_12 + r"column 'x' must be a finite number in m, got -inf"),
    "NaN time": (cell("t", 3, np.nan), r"data row 4 \(episode 0, t = nan s\): column 't' must be a finite number in s"),
    "part of an episode": (
        lambda f: f.assign(episode=f["episode"] + 0.5 * (f.index == 12)),
        r"column 'episode' must be an integer, got 0\.5",
    ),
    "episode comes back": (
        lambda f: pd.concat([f[f["episode"] != 0], f[f["episode"] == 0]]),
        r"data row 243 \(episode 0, t = 0 s\): column 'episode' must not fall, got 0 after 2; sort",
    ),
    "too short": (lambda f: f.drop(range(123, 242)), r"data row 122 .*: the episode has 2 samples, at least 3"),
    "unsorted": (lambda f: swap(f, 12, 13), r"data row 14 .*: column 't' must rise .*, 0\.2 s follows 0\.216666667 s"),
    "duplicate": (lambda f: f.iloc[[*range(13), *range(12, 363)]], r"data row 14 .*, 0\.2 s is there twice"),
    "lost sample": (lambda f: f.drop(12), r"data row 13 .*: 0\.0333333 s since the last .*\(1 sample missing: fill in"),
    "pause": (stretched, r"data row 183 \(episode 1, .* 't' must be even within 5% of a step: 0\.0266667 s since"),
    "mixed rates": (faster_second_episode, r"data row 122 .*: the episode has 120 samples per second, the others 60"),
    "other rate": (times(0.6, "t"), r"has 100 samples per second, .*nominal\.yaml says rate_hz: 60\. One of the two"),
    "ms": (times(1000, "t"), r"has 0\.06 samples per second, .* 't' is probably in ms, allowed: s"),
    "wrapped": (
        lambda f: f.assign(yaw=(f["yaw"] + 2.5 + np.pi) % (2 * np.pi) - np.pi),
        r"column 'yaw' must be unwrapped, it jumps by -6\.2.* about a whole turn in rad; apply numpy\.unwrap",
    ),
    "wrapped degrees": (
        lambda f: f.assign(yaw=(np.rad2deg(f["yaw"] + 2.5) + 180) % 360 - 180),
        r"column 'yaw' must be unwrapped, .* about a whole turn in degrees; allowed: rad",
    ),
    "position in mm": (times(1000, "x", "y"), r"'x', 'y' change 1000 times .*probably 'x', 'y' in mm"),
    "position in cm": (times(100, "x", "y"), r"probably 'x', 'y' in cm"),
    "velocity in mm/s": (times(1000, "vx", "vy"), r"times as much as 'vx', 'vy' say.* probably 'vx', 'vy' in mm/s"),
    "velocity in km/h": (times(3.6, "vx", "vy"), r"probably 'vx', 'vy' in km/h"),
    "yaw in degrees": (times(180 / np.pi, "yaw"), r"'yaw' change 57\.\d* times .* probably 'yaw' in degrees"),
    "rate in degrees/s": (times(180 / np.pi, "wz"), r"probably 'wz' in degrees/s"),
    "rate in rpm": (times(30 / np.pi, "wz"), r"probably 'wz' in turns per minute"),
    "clockwise yaw": (times(-1.0, "yaw"), r"'yaw' and 'wz' have opposite signs; allowed: right-handed axes"),
    "body axes": (in_body, r"'vx', 'vy' agree with 'x', 'y' in body axes, not in world axes"),
    "all lengths": (times(2500, "x", "y", "vx", "vy"), r"column 'x' is .* half sizes from the .* probably in mm"),
    "all speeds": (times(300, "x", "y", "vx", "vy"), r"column 'vx' is 2\d\d\.\d* m/s, allowed .* probably in mm/s"),
    "all lengths in cm": (times(80, "x", "y", "vx", "vy"), r"'vx', 'vy' change .* as force and friction .* not in m "),
    "all angles in degrees": (
        times(180 / np.pi, "yaw", "wz"),
        r"'wz' change .* 'yaw' and 'wz' are probably in degrees",
    ),
    "point in mm": (times(1000, "px", "py"), r"column 'px' is 100 m, allowed for a body .* up to 25 m; probably in mm"),
}


@pytest.mark.parametrize("kind", PLANAR_ERRORS)
def test_planar_table_is_refused(kind: str, tmp_path: Path) -> None:
    """One line with the file, the place, the column and what is allowed, from Parquet as from CSV."""
    edit, message = PLANAR_ERRORS[kind]
    frame = edit(frame_of(planar(), tmp_path))
    if kind == "text":
        frame["fy"] = frame["fy"].astype("string")
    frame.to_parquet(tmp_path / "recording.parquet", index=False)
    with pytest.raises(
        RecordingError, match=re.escape(f"{tmp_path / 'recording.parquet'}: ") + ".*" + message
    ) as error:
        read_case(tmp_path)
    assert "\n" not in str(error.value)
    (tmp_path / "recording.parquet").unlink()
    frame.to_csv(tmp_path / "recording.csv", index=False)
    with pytest.raises(RecordingError) as error:
        read_case(tmp_path)
    text, lines = re.subn(r"(data row \d+), line \d+", r"\1", str(error.value))
    assert lines == text.count("data row")
    assert re.search(re.escape(f"{tmp_path / 'recording.csv'}: ") + ".*" + message, text)


def spin_in_body(frame: pd.DataFrame) -> pd.DataFrame:
    """Constant turning about a skew axis that changes in the world: rates given in body axes."""
    t = frame["t"].to_numpy()
    about_z = Rotation.from_rotvec(t[:, None] * [0.0, 0.0, 2.0])
    turn = about_z * Rotation.from_rotvec(t[:, None] * [3.0, 0.0, 0.0])
    world = np.array([0.0, 0.0, 2.0]) + about_z.apply([3.0, 0.0, 0.0])
    x, y, z, w = turn.as_quat().T
    rates = turn.inv().apply(world)
    return frame.assign(qw=w, qx=x, qy=y, qz=z, wx=rates[:, 0], wy=rates[:, 1], wz=rates[:, 2])


SPATIAL_ERRORS = {
    "missing": (lambda f: f.drop(columns="qz"), r"missing column 'qz'; the spatial form needs"),
    "synonym": (lambda f: f.rename(columns={"qw": "quat_w"}), r"Rename 'quat_w' -> 'qw'\?"),
    "part of a force": (lambda f: f.assign(fx=0.0, fy=0.0), r"missing columns 'fz' \[N\], 'px' \[m\], 'py' \[m\]"),
    "force misspelt": (lambda f: f.assign(F_x=0.0), r"unknown column 'F_x'\. Did you mean 'fx' \[N\]\?"),
    "nothing measured": (lambda f: f.assign(z=np.nan), r"column 'z' is NaN in all 122 rows"),
    "torn quaternion": (
        cell("qy", 12, np.nan),
        PLACE_12 + r"columns 'qw', .* must all be numbers or all be NaN, got \[",
    ),
    "no unit": (
        lambda f: f.assign(qw=np.where(f.index == 12, 1.5, f["qw"])),
        PLACE_12 + r"columns .* must be a unit quaternion within 0\.005, got \[1\.5, .* of norm 1\.",
    ),
    "infinite": (cell("wz", 12, np.inf), PLACE_12 + r"column 'wz' must be a finite number in rad/s, got inf"),
    "rates in body axes": (spin_in_body, r"'wx', 'wy', 'wz' agree with 'qw', .* in body axes, not in world"),
    "world to body": (
        times(-1.0, "qx", "qy", "qz"),
        r"agree with .* if they turn world to body; allowed: body to world",
    ),
    "order": (
        lambda f: f.assign(qw=f["qx"], qx=f["qy"], qy=f["qz"], qz=f["qw"]),
        r"columns 'qw', 'qx', 'qy', 'qz' agree with 'wx', 'wy', 'wz' if they are stored as x, y, z, w",
    ),
    "rates in degrees/s": (times(180 / np.pi, "wx", "wy", "wz"), r"probably 'wx', 'wy', 'wz' in degrees/s"),
    "position in mm": (times(1000, "x", "y", "z"), r"probably 'x', 'y', 'z' in mm"),
}


@pytest.mark.parametrize("kind", SPATIAL_ERRORS)
def test_table_in_space_is_refused(kind: str, tmp_path: Path) -> None:
    """The same for the form in space."""
    edit, message = SPATIAL_ERRORS[kind]
    edit(frame_of(spatial(), tmp_path)).to_parquet(tmp_path / "recording.parquet", index=False)
    with pytest.raises(
        RecordingError, match=re.escape(f"{tmp_path / 'recording.parquet'}: ") + ".*" + message
    ) as error:
        read_case(tmp_path)
    assert "\n" not in str(error.value)


@SAVED
@given(row=st.integers(0, 362), column=st.sampled_from([*"xy", "yaw", "vx", "vy", "wz", "fx", "fy", "px", "py"]))
def test_one_lost_cell_anywhere_is_found(row: int, column: str, tmp_path: Path) -> None:
    """Wherever a planar recording holds what is no number, or no command, the message says where."""
    frame = frame_of(planar(), tmp_path)
    frame.loc[row, column] = np.nan if column in ("episode", "t", "fx", "fy", "px", "py") else np.inf
    frame.to_parquet(tmp_path / "recording.parquet")
    with pytest.raises(RecordingError, match=rf"data row {row + 1} .*column '{column}' must be a finite number"):
        read_case(tmp_path)


def test_noise_and_rest_are_no_contradiction(tmp_path: Path) -> None:
    """A box that does nothing but be measured, with coloured noise, is a recording: for each of 20 seeds."""
    for seed in range(20):
        rng = np.random.default_rng(seed)
        t = np.arange(121) / RATE_HZ
        walks = np.cumsum(rng.normal(0, 0.0005, (121, 3)), axis=0)
        rest = Episode(0, t, walks, rng.normal(0, 0.02, (121, 3)), np.zeros((121, 3)), np.zeros((121, 3)))
        write_case(Recording(tmp_path, Form.PLANAR, NOMINAL, (rest,)), tmp_path)
        assert len(read_case(tmp_path).episodes) == 1


def test_a_pose_that_moves_more_than_its_velocity_is_noted(tmp_path: Path) -> None:
    """1.5 times too much is no other unit; it is said, not refused."""
    times(1.5, "x", "y")(frame_of(planar(), tmp_path)).to_parquet(tmp_path / "recording.parquet")
    (note,) = notes_of(read_case(tmp_path))
    assert re.fullmatch(r"'x', 'y' change 1\.\d+ times as much as 'vx', 'vy' say", note)


# What is refused: files ----------------------------------------------------------------------------------------------


def test_broken_parquet_is_refused(tmp_path: Path) -> None:
    """An empty file and one that is something else."""
    frame_of(planar(), tmp_path)
    for content in (b"", b"episode,t,x\n0,0,0\n" * 9):
        (tmp_path / "recording.parquet").write_bytes(content)
        with pytest.raises(RecordingError, match=r"recording\.parquet: can't be read as Parquet: .*[Pp]arquet"):
            read_case(tmp_path)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", r"recording\.csv: is empty; the first line must name the columns"),
        (b"episode;t;x;y\n0;0;0;0\n", r"columns must be separated by commas, got 'episode;t;x;y'"),
        (b"episode,t,x,x\n0,0,0,0\n", r"column 'x' is there 2 times, allowed: once"),
        (b"episode,t,x,y\n0,0,0,0\n\n0,0,0\n", r"data row 2, line 4: has 3 values, the header names 4 columns"),
        (b"episode,t,\xff\n", r"can't be read as CSV: .*decode"),
        (b'episode,t,"x\n', r"can't be read as CSV: unexpected end of data"),
    ],
)
def test_broken_csv_is_refused(content: bytes, message: str, tmp_path: Path) -> None:
    """What a spreadsheet or an editor can do to a table."""
    write_nominal(NOMINAL, tmp_path / "nominal.yaml")
    (tmp_path / "recording.csv").write_bytes(content)
    with pytest.raises(RecordingError, match=message):
        read_case(tmp_path)


def test_duplicated_parquet_columns_are_refused(tmp_path: Path) -> None:
    """Parquet allows two columns of one name, pandas can't tell which is meant."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    write_nominal(NOMINAL, tmp_path / "nominal.yaml")
    names = ["episode", "t", "x", "t"]
    pq.write_table(pa.table([pa.array([0.0])] * 4, names=names), tmp_path / "recording.parquet")
    with pytest.raises(RecordingError, match="column 't' is there 2 times, allowed: once"):
        read_case(tmp_path)


def test_columns_of_other_types_are_refused(tmp_path: Path) -> None:
    """A date is no time in seconds, true is no force."""
    frame = frame_of(planar(), tmp_path)
    for name, values, kind in (
        ("t", pd.to_datetime(frame["t"], unit="s"), "timestamp"),
        ("fx", frame["fx"] > 0, "bool"),
    ):
        frame.assign(**{name: values}).to_parquet(tmp_path / "recording.parquet")
        with pytest.raises(RecordingError, match=rf"column '{name}' must be numbers in \w+, it holds {kind}"):
            read_case(tmp_path)


def test_missing_files_are_named(tmp_path: Path) -> None:
    """A wrong path, a folder without a recording, one without beliefs, one without any case below."""
    write_case(planar(), tmp_path / "box_one")
    with pytest.raises(RecordingError, match=r"box_noe: no such file or folder\. Did you mean '.*box_one'\?"):
        read_case(tmp_path / "box_noe")
    with pytest.raises(RecordingError, match=r"box_noe: no such file or folder\. Did you mean '.*box_one'\?"):
        find_cases(tmp_path / "box_noe")
    (tmp_path / "box_one/recording.parquet").rename(tmp_path / "box_one/train.parquet")
    with pytest.raises(RecordingError, match=r"neither recording\.parquet nor recording\.csv in it, found: 'nominal"):
        read_case(tmp_path / "box_one")
    with pytest.raises(RecordingError, match=r"no case in it or below it; a case is a folder with recording\.parquet"):
        find_cases(tmp_path)
    (tmp_path / "box_one/nominal.yaml").unlink()
    with pytest.raises(RecordingError, match=r"nominal\.yaml: no such file; a case needs .*'half_size', 'mass'"):
        read_case(tmp_path / "box_one/train.parquet")
    (tmp_path / "notes.txt").touch()
    with pytest.raises(RecordingError, match=r"notes\.txt: must be a folder, a \.parquet or a \.csv file"):
        read_case(tmp_path / "notes.txt")


def test_a_second_table_is_noted(tmp_path: Path) -> None:
    """Parquet goes before CSV, and that is said."""
    frame_of(planar(), tmp_path).to_csv(tmp_path / "recording.csv")
    assert notes_of(read_case(tmp_path)) == ("recording.csv beside recording.parquet is not read",)


def test_values_that_do_not_fit_together_are_refused() -> None:
    """Shapes of an episode, a recording without episodes or of mixed forms, a table of another name."""
    three = np.zeros((3, 3))
    with pytest.raises(RecordingError, match=r"episode 4: .* must have the shapes .*, got \(3,\), \(3, 3\), \(2, 3\)"):
        Episode(4, np.arange(3.0), three, three[:2], three, three)
    with pytest.raises(RecordingError, match="a recording needs at least one episode"):
        replace(planar(), episodes=())
    with pytest.raises(RecordingError, match="episode 1 is spatial, not planar"):
        replace(planar(), episodes=(planar_episode(0), spatial_episode(1)))
    with pytest.raises(RecordingError, match=r"table: must be recording\.parquet or recording\.csv, got 'a\.txt'"):
        write_case(planar(), Path("never"), table="a.txt")
