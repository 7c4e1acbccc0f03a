"""What is written is read back, and what can't be right is refused with its place."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst
from scipy.spatial.transform import Rotation

from runner.errors import RecordingError
from runner.recording import (
    Contact,
    Episode,
    Form,
    Noise,
    Nominal,
    Recording,
    find_cases,
    read_case,
    read_nominal,
    write_case,
    write_nominal,
)

EXAMPLES = Path(__file__).parent.parent / "examples"
RATE_HZ = 60.0
NOMINAL = Nominal((0.5, 0.5, 0.5), 3.0, 0.3, 9.81, RATE_HZ)
BELIEVED = {"half_size": 0.5, "mass": 3.0, "friction": 0.3, "gravity": 9.81, "rate_hz": 60}
SAVED = settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


def planar_episode(index: int, count: int = 121) -> Episode:
    """A box that swings along a bow while it turns to and fro; poses are the integrals of the velocities."""
    t = np.arange(count) / RATE_HZ
    a = 0.5 + 0.1 * index
    pose = np.stack([a * (1 - np.cos(2 * t)) / 2, 0.3 * np.sin(t + index), (1 - np.cos(3 * t)) * 0.5], axis=1)
    twist = np.stack([a * np.sin(2 * t), 0.3 * np.cos(t + index), 1.5 * np.sin(3 * t)], axis=1)
    force = np.stack([np.where(t < 1, 2.0, 0.0), np.where(t < 1, -1.0, 0.0), 0 * t], axis=1)
    point = np.where(t[:, None] < 1, [0.1, -0.2, 0.05], 0.0)
    return Episode(index, t, pose, twist, force, point)


def spatial_episode(index: int, count: int = 61) -> Episode:
    """A tumbling throw: constant rate about a skew axis, from above."""
    t = np.arange(count) / RATE_HZ
    rate = np.array([1.0 + index, -2.0, 1.5])
    xyzw = Rotation.from_rotvec(t[:, None] * rate).as_quat(canonical=True)
    wxyz = xyzw[:, [3, 0, 1, 2]]
    flips = np.where(np.sum(wxyz[1:] * wxyz[:-1], axis=1) < 0, -1.0, 1.0)
    wxyz[1:] *= np.cumprod(flips)[:, None]
    where = np.stack([t, 0.2 * t, 3.0 + 0.5 * t - 4.905 * t**2], axis=1)
    speed = np.stack([1 + 0 * t, 0.2 + 0 * t, 0.5 - 9.81 * t], axis=1)
    twist = np.hstack([speed, np.tile(rate, (count, 1))])
    nothing = np.full((count, 3), np.nan)
    return Episode(index, t, np.hstack([where, wxyz]), twist, nothing, nothing)


def planar() -> Recording:
    return Recording(Path("planar"), Form.PLANAR, NOMINAL, tuple(planar_episode(i) for i in range(3)))


def spatial() -> Recording:
    return Recording(Path("spatial"), Form.SPATIAL, NOMINAL, tuple(spatial_episode(i) for i in range(2)))


def assert_same(one: Recording, other: Recording) -> None:
    assert (one.form, one.nominal, len(one.episodes)) == (other.form, other.nominal, len(other.episodes))
    for a, b in zip(one.episodes, other.episodes, strict=True):
        assert a.index == b.index
        for name in ("t_s", "pose", "twist", "force_n", "point_m"):
            np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)


def frame_of(recording: Recording, folder: Path) -> pd.DataFrame:
    write_case(recording, folder)
    return pd.read_parquet(folder / "recording.parquet")


# Read and write ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("table", ["recording.parquet", "recording.csv"])
@pytest.mark.parametrize("make", [planar, spatial])
def test_written_case_is_read_back(make: Callable[[], Recording], table: str, tmp_path: Path) -> None:
    """Both forms, as Parquet and as CSV, come back to the last bit."""
    recording = make()
    write_case(recording, tmp_path, table=table)
    again = read_case(tmp_path)
    assert_same(recording, again)
    assert again.path == tmp_path
    assert [p.name for p in sorted(tmp_path.iterdir())] == ["nominal.yaml", table]


@st.composite
def recordings(draw: st.DrawFn) -> Recording:
    """Planar recordings at any rate: slow enough for a box on a floor, otherwise arbitrary."""
    rate_hz = draw(st.floats(5, 1000))
    small = st.floats(-0.1, 0.1)
    episodes = []
    indices = draw(st.lists(st.integers(0, 10**6), min_size=1, max_size=3, unique=True))
    for index in sorted(indices):
        count = draw(st.integers(3, 12))
        twist, force, point = (draw(npst.arrays(float, (count, 3), elements=small)) for _ in range(3))
        force[:, 2] = 0.0
        start = draw(npst.arrays(float, 3, elements=st.floats(-3, 3)))
        pose = start + np.cumsum(twist, axis=0) / rate_hz
        t = draw(st.floats(-5, 5)) + np.arange(count) / rate_hz
        episodes.append(Episode(index, t, pose, twist, 100 * force, point))
    nominal = replace(draw(nominals()), rate_hz=rate_hz)
    return Recording(Path("any"), Form.PLANAR, nominal, tuple(episodes))


@st.composite
def nominals(draw: st.DrawFn) -> Nominal:
    size = st.floats(0.05, 2.0)
    sizes = draw(st.one_of(st.tuples(size, size, size), size.map(lambda h: (h, h, h))))
    mass = draw(st.floats(1.0, 1000.0)) * 8 * sizes[0] * sizes[1] * sizes[2]
    unknown = st.none() | st.floats(1e-6, 1.0)
    moment = 0.3 * mass * (sizes[0] ** 2 + sizes[1] ** 2)
    return Nominal(
        half_size_m=sizes,
        mass_kg=mass,
        friction=draw(st.floats(0.0, 2.0)),
        gravity_m_s2=draw(st.floats(1.0, 25.0)),
        rate_hz=draw(st.floats(1.0, 1000.0)),
        contact=draw(st.sampled_from(list(Contact))),
        noise=Noise(*(draw(unknown) for _ in range(4))),
        com_m=draw(st.none() | st.tuples(*[st.floats(-0.05, 0.05)] * 3)),
        inertia_kg_m2=draw(st.sampled_from([None, moment, (moment, 0.9 * moment, 1.1 * moment)])),
    )


@SAVED
@given(recording=recordings(), table=st.sampled_from(["recording.parquet", "recording.csv"]))
def test_any_recording_is_read_back(recording: Recording, table: str, tmp_path: Path) -> None:
    """Whatever its rate, start time, episode numbers and owner's beliefs."""
    write_case(recording, tmp_path, table=table)
    assert_same(recording, read_case(tmp_path))


@SAVED
@given(nominal=nominals())
def test_any_nominal_is_read_back(nominal: Nominal, tmp_path: Path) -> None:
    """Every key survives, those that are null too."""
    write_nominal(nominal, tmp_path / "nominal.yaml")
    assert read_nominal(tmp_path) == nominal
    assert read_nominal(tmp_path / "nominal.yaml").path == tmp_path / "nominal.yaml"


@SAVED
@given(flips=npst.arrays(bool, 122))
def test_quaternion_signs_do_not_matter(flips: np.ndarray, tmp_path: Path) -> None:
    """q and -q are one orientation: flipped rows come out continuous, but for the sign of the whole episode."""
    recording = spatial()
    frame = frame_of(recording, tmp_path)
    names = ["qw", "qx", "qy", "qz"]
    frame[names] *= np.where(flips, -1.0, 1.0)[:, None]
    frame.to_parquet(tmp_path / "recording.parquet")
    again = read_case(tmp_path)
    for k, (a, b) in enumerate(zip(recording.episodes, again.episodes, strict=True)):
        sign = -1.0 if flips[61 * k] else 1.0
        np.testing.assert_array_equal(a.pose[:, 3:], sign * b.pose[:, 3:])


def test_rounded_quaternions_get_unit_length(tmp_path: Path) -> None:
    """Three decimals are enough; what comes out has norm 1 within rounding of doubles."""
    frame = frame_of(spatial(), tmp_path)
    names = ["qw", "qx", "qy", "qz"]
    frame[names] = frame[names].round(3)
    frame.to_parquet(tmp_path / "recording.parquet")
    norms = np.linalg.norm(read_case(tmp_path).episodes[0].pose[:, 3:], axis=1)
    np.testing.assert_allclose(norms, 1.0, rtol=0, atol=1e-15)


def test_arrays_are_private_and_immutable() -> None:
    """A change to what an episode was made from does not reach it, and it can't be written to."""
    t = np.arange(3.0)
    three = np.zeros((3, 3))
    episode = Episode(0, t, three, three, three, three)
    t[0] = 99.0
    three[0, 0] = 99.0
    assert episode.t_s[0] == 0.0
    assert episode.pose[0, 0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        episode.force_n[0, 0] = 1.0


def test_planar_force_is_horizontal_and_acts_at_mid_height_without_pz(tmp_path: Path) -> None:
    """`fz` is 0, and `pz` is 0 where the file has none."""
    frame = frame_of(planar(), tmp_path).drop(columns="pz")
    frame.to_parquet(tmp_path / "recording.parquet")
    for episode in read_case(tmp_path).episodes:
        assert not episode.force_n[:, 2].any()
        assert not episode.point_m[:, 2].any()
        assert episode.point_m[:, 0].any()
        assert episode.step_s == pytest.approx(1 / 60)


def test_forces_in_space_are_nan_where_not_measured(tmp_path: Path) -> None:
    """A force in half of the rows stays there; the other half stays NaN; a note counts them. No `pz`: mid-height."""
    frame = frame_of(spatial(), tmp_path)
    assert "fx" not in frame
    half = np.arange(len(frame)) < 61
    for name in ("fx", "fy", "fz", "px", "py"):
        frame[name] = np.where(half, 0.25, np.nan)
    frame.to_parquet(tmp_path / "recording.parquet")
    recording = read_case(tmp_path)
    np.testing.assert_array_equal(recording.episodes[0].force_n, 0.25)
    np.testing.assert_array_equal(recording.episodes[0].point_m, np.tile([0.25, 0.25, 0.0], (61, 1)))
    assert np.isnan(recording.episodes[1].force_n).all()
    assert np.isnan(recording.episodes[1].point_m).all()
    assert "'fx' is not measured (NaN) in 61 of 122 rows" in recording.notes


def test_samples_in_space_may_be_missing(tmp_path: Path) -> None:
    """Ten lost poses are NaN in the recording and a note; the sign of the quaternion goes on across them."""
    frame = frame_of(spatial(), tmp_path)
    lost = [*["x", "y", "z"], *["qw", "qx", "qy", "qz"]]
    frame.loc[20:29, lost] = np.nan
    frame.loc[30:60, ["qw", "qx", "qy", "qz"]] *= -1
    frame.to_parquet(tmp_path / "recording.parquet")
    recording = read_case(tmp_path)
    pose, full = recording.episodes[0].pose, spatial().episodes[0].pose
    assert np.isnan(pose[20:30]).all()
    np.testing.assert_array_equal(pose[30:], full[30:])
    assert "'qw' is not measured (NaN) in 10 of 122 rows" in recording.notes


def test_columns_beyond_the_format_are_noted(tmp_path: Path) -> None:
    """They don't hinder, and a note names them; an index that pandas saved is not worth a note."""
    frame = frame_of(planar(), tmp_path).assign(tip_x=0.0, camera="left", z=0.5)
    frame.index = frame.index + 7
    frame.to_parquet(tmp_path / "recording.parquet")
    assert read_case(tmp_path).notes == ("not part of the planar form and not used: 'tip_x', 'camera', 'z'",)


@pytest.mark.parametrize("dtype", ["float32", "Float64", "string", "category"])
def test_any_type_of_number_is_read(dtype: str, tmp_path: Path) -> None:
    """Halved and nullable floats, text and categories that hold numbers are numbers."""
    frame = frame_of(planar(), tmp_path)
    frame["fx"] = frame["fx"].astype(dtype)  # pyright: ignore[reportCallIssue, reportArgumentType]
    frame.to_parquet(tmp_path / "recording.parquet")
    np.testing.assert_array_equal(read_case(tmp_path).episodes[1].force_n, planar().episodes[1].force_n)


def test_times_rounded_to_milliseconds_are_even(tmp_path: Path) -> None:
    """0.017, 0.033, 0.050: rounding is no jitter."""
    frame = frame_of(planar(), tmp_path)
    frame["t"] = frame["t"].round(3)
    frame.to_csv(tmp_path / "recording.csv", index=False)
    (tmp_path / "recording.parquet").unlink()
    assert read_case(tmp_path).episodes[2].t_s[1] == 0.017


def test_csv_from_a_spreadsheet_is_read(tmp_path: Path) -> None:
    """A byte-order mark, blanks after commas, Windows line ends and blank lines at the end do no harm."""
    frame = frame_of(planar(), tmp_path)
    (tmp_path / "recording.parquet").unlink()
    text = frame.to_csv(index=False, lineterminator="\r\n").replace(",", ", ") + "\r\n\r\n"
    (tmp_path / "recording.csv").write_bytes(b"\xef\xbb\xbf" + text.encode())
    assert_same(planar(), read_case(tmp_path))


def test_a_table_and_beliefs_may_be_given_apart(tmp_path: Path) -> None:
    """A file of any name is read with the beliefs that are handed over."""
    frame_of(planar(), tmp_path).to_parquet(tmp_path / "other.parquet")
    nominal = replace(NOMINAL, mass_kg=4.0)
    assert read_case(tmp_path / "other.parquet", nominal=nominal).nominal.mass_kg == 4.0
    assert read_case(tmp_path / "other.parquet").nominal.mass_kg == 3.0


def test_the_examples_are_cases() -> None:
    """Both load without a note, are small, and hold what pandas reads from them."""
    cases = find_cases(EXAMPLES)
    assert [case.name for case in cases] == ["nothing_differs", "slippery_floor"]
    for case in cases:
        assert sum(file.stat().st_size for file in case.iterdir()) < 90_000
        recording = read_case(case)
        frame = pd.read_parquet(case / "recording.parquet")
        assert recording.notes == ()
        assert recording.form is Form.PLANAR
        assert [e.index for e in recording.episodes] == frame["episode"].unique().tolist()
        np.testing.assert_array_equal(np.concatenate([e.pose for e in recording.episodes]), frame[["x", "y", "yaw"]])
        np.testing.assert_array_equal(np.concatenate([e.twist for e in recording.episodes]), frame[["vx", "vy", "wz"]])
        assert recording.nominal.half_size_m == (0.5, 0.5, 0.5)
        assert recording.nominal.yaw_inertia_kg_m2 == pytest.approx(0.5)


def test_cases_are_found_below_a_folder(tmp_path: Path) -> None:
    """Sorted, at any depth, by Parquet or CSV, without hidden folders; a case is its own only find."""
    for name, table in (("b", "recording.parquet"), ("a/deep", "recording.csv"), (".old/c", "recording.csv")):
        write_case(planar(), tmp_path / name, table=table)
    assert find_cases(tmp_path) == [tmp_path / "a/deep", tmp_path / "b"]
    assert find_cases(tmp_path / "b") == [tmp_path / "b"]
    assert find_cases(tmp_path / "b/recording.parquet") == [tmp_path / "b"]


# What is refused: the table ------------------------------------------------------------------------------------------


def cell(column: str, row: int, value: object) -> Callable[[pd.DataFrame], pd.DataFrame]:
    def edit(frame: pd.DataFrame) -> pd.DataFrame:
        if isinstance(value, str):
            frame[column] = frame[column].astype(object)
        frame.loc[row, column] = value  # pyright: ignore[reportCallIssue, reportArgumentType]
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
        lambda f: f.drop(columns="wz"),
        r"missing column 'wz' \[rad/s\]; the planar form needs .*Found:",
    ),
    "two missing": (lambda f: f.drop(columns=["fx", "py"]), r"missing columns 'fx' \[N\], 'py' \[m\];"),
    "other case": (lambda f: f.rename(columns={"x": "X"}), r"missing column 'x' .* Rename 'X' -> 'x'\?"),
    "unit in name": (lambda f: f.rename(columns={"vx": "vx_m_s"}), r"Rename 'vx_m_s' -> 'vx'\?"),
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
    "NaN measurements": (
        lambda f: f.assign(vy=np.where(f.index >= 12, np.nan, f["vy"])),
        PLACE_12 + r"column 'vy' must be a finite number in m/s, got nan \(351 such rows\)",
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
    "nothing measured": (lambda f: f.assign(vz=np.nan), r"column 'vz' is NaN in all 122 rows"),
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
    """Wherever a planar recording lacks a number, the message says where."""
    frame = frame_of(planar(), tmp_path)
    frame.loc[row, column] = np.nan
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
    (note,) = read_case(tmp_path).notes
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
    with pytest.raises(RecordingError, match=r"box_noe: no such folder\. Did you mean '.*box_one'\?"):
        read_case(tmp_path / "box_noe")
    with pytest.raises(RecordingError, match=r"box_noe: no such folder\. Did you mean '.*box_one'\?"):
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
    assert read_case(tmp_path).notes == ("recording.csv beside recording.parquet is not read",)


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


# What is refused: nominal.yaml ---------------------------------------------------------------------------------------


def test_beliefs_are_read(tmp_path: Path) -> None:
    """Every key, with numbers that YAML takes for text, two numbers for the centre of mass, null for unknown noise."""
    text = """
        half_size: [0.1, 2e-1, 0.3]
        mass: 5e0
        friction: 3e-1
        gravity: 9.81
        contact: corners
        rate_hz: 60
        noise: {position: 5e-4, yaw: null, rate: 0.01}
        com: [0.01, -0.02]
        inertia: 0.1
    """
    (tmp_path / "nominal.yaml").write_text(text)
    assert read_nominal(tmp_path) == Nominal(
        half_size_m=(0.1, 0.2, 0.3),
        mass_kg=5.0,
        friction=0.3,
        gravity_m_s2=9.81,
        rate_hz=60.0,
        contact=Contact.CORNERS,
        noise=Noise(position_m=5e-4, rate_rad_s=0.01),
        com_m=(0.01, -0.02, 0.0),
        inertia_kg_m2=0.1,
    )


def test_uniform_yaw_inertia() -> None:
    """A uniform box turns about z with m ((2 hx)^2 + (2 hy)^2) / 12; what is given goes before."""
    box = replace(NOMINAL, half_size_m=(0.1, 0.3, 0.7))
    assert box.yaw_inertia_kg_m2 == pytest.approx(3.0 * (0.2**2 + 0.6**2) / 12)
    assert replace(box, inertia_kg_m2=0.2).yaw_inertia_kg_m2 == 0.2
    assert replace(box, inertia_kg_m2=(0.1, 0.2, 0.25)).yaw_inertia_kg_m2 == 0.25


NOMINAL_ERRORS = [
    ({"mas": 3.0, "mass": None}, r"unknown key 'mas'\. Valid: .* Did you mean 'mass'\?"),
    ({"mu": 0.3}, r"unknown key 'mu'\. .* Did you mean 'friction'\?"),
    ({"mass": None}, r"missing 'mass'; needed: 'half_size', 'mass', 'friction', 'gravity', 'rate_hz'"),
    ({"mass": 0.0}, r"mass: must be a finite number in kg > 0, got 0\.0"),
    ({"mass": -3}, r"mass: must be a finite number in kg > 0, got -3"),
    ({"mass": float("nan")}, r"mass: must be a finite number in kg, got nan"),
    ({"mass": "3 kg"}, r"mass: must be a finite number in kg, got '3 kg'"),
    ({"mass": True}, r"mass: must be a finite number in kg, got True"),
    ({"mass": 3e9}, r"3e\+09 kg make 3e\+09 kg/m3, allowed: 0\.01 to 100000; probably mass in g"),
    ({"half_size": 500}, r"500.* kg make 3e-09 kg/m3, .* probably half_size in mm"),
    ({"half_size": [0.5, 0.5]}, r"half_size: must be 1 or 3 numbers in m, got 2: \[0\.5, 0\.5\]"),
    ({"half_size": [0.5, 0.5, 0]}, r"half_size: must be a finite number in m > 0, got 0"),
    ({"half_size": [0.5, "wide", 0.5]}, r"half_size\[1\]: must be a finite number in m, got 'wide'"),
    ({"friction": -0.1}, r"friction: must be a finite number >= 0 and <= 10, got -0\.1"),
    ({"gravity": -9.81}, r"gravity: must be a finite number in m/s2 \(its magnitude\) > 0 and <= 300, got -9\.81"),
    ({"gravity": 981}, r"gravity: .* <= 300, got 981"),
    ({"rate_hz": 0}, r"rate_hz: must be a finite number in Hz > 0 and <= 1e\+06, got 0"),
    ({"contact": "corner"}, r"contact: unknown 'corner'\. Valid: 'corners', 'patch'\. Did you mean 'corners'\?"),
    ({"noise": 0.01}, r"noise: must be null or hold 'position', 'yaw', 'velocity', 'rate', got 0\.01"),
    ({"noise": {"speed": 1}}, r"unknown key 'noise\.speed'\. Valid: 'position', 'rate', 'velocity', 'yaw'"),
    ({"noise": {"yaw": 0}}, r"noise\.yaw \(null where not known\): must be a finite number in rad > 0, got 0"),
    ({"noise": {"rate": -1}}, r"noise\.rate .*: must be a finite number in rad/s > 0, got -1"),
    ({"noise": {"position": float("nan")}}, r"noise\.position: must be a finite number, got nan"),
    ({"com": 0.1}, r"com: must be 2 or 3 numbers in m, got 1: 0\.1"),
    ({"com": [0, 0.6]}, r"com \(inside the box\): must be a finite number in m >= -0\.5 and <= 0\.5, got 0\.6"),
    ({"inertia": 0}, r"inertia: must be a finite number in kg m2 > 0, got 0"),
    ({"inertia": [1, 1, 3]}, r"inertia: none may exceed the sum of the other two, got \[1\.0, 1\.0, 3\.0\] kg m2"),
    ({"inertia": 500}, r"inertia: 500 kg m2 about z can't be: 3 kg inside this box has at most 1\.5"),
]


@pytest.mark.parametrize(("change", "message"), NOMINAL_ERRORS)
def test_beliefs_are_refused(change: dict[str, object], message: str, tmp_path: Path) -> None:
    """One line with the file, the key, the value and what is allowed."""
    content = {key: value for key, value in (BELIEVED | change).items() if value is not None}
    (tmp_path / "nominal.yaml").write_text(yaml.safe_dump(content))
    with pytest.raises(RecordingError, match=re.escape(f"{tmp_path / 'nominal.yaml'}: ") + ".*" + message) as error:
        read_nominal(tmp_path)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"nominal\.yaml: is empty; it needs 'half_size'"),
        ("- 1\n- 2\n", r"must hold `key: value` lines, got a list"),
        ("mass: 3\nfriction: [0.3\n", r" line 3, column 1: not valid YAML: "),
        ("mass: 3\nfriction: 0.3\nmass: 4\n", r" line 3, column 1: not valid YAML: key 'mass' is given twice"),
        ("mass: \x00", r"not valid YAML: .*not allowed"),
    ],
)
def test_broken_yaml_is_refused(text: str, message: str, tmp_path: Path) -> None:
    """With the line, where there is one."""
    (tmp_path / "nominal.yaml").write_text(text)
    with pytest.raises(RecordingError, match=message) as error:
        read_nominal(tmp_path)
    assert "\n" not in str(error.value)
