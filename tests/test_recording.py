"""What is written is read back, whatever the types of its numbers and the signs of its quaternions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst
from recording_cases import EXAMPLES, NOMINAL, SAVED, assert_same, frame_of, nominals, notes_of, planar, spatial

from runner.errors import RecordingError
from runner.recording import (
    Episode,
    Form,
    Recording,
    find_cases,
    read_case,
    write_case,
)


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


@SAVED
@given(recording=recordings(), table=st.sampled_from(["recording.parquet", "recording.csv"]))
def test_any_recording_is_read_back(recording: Recording, table: str, tmp_path: Path) -> None:
    """Whatever its rate, start time, episode numbers and owner's beliefs."""
    write_case(recording, tmp_path, table=table)
    assert_same(recording, read_case(tmp_path))


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
    assert "'fx', 'fy', 'fz', 'px', 'py' are not measured (NaN) in 61 of 122 rows" in recording.notes


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
    lacking = "'x', 'y', 'z', 'qw', 'qx', 'qy', 'qz' are not measured (NaN) in 10 of 122 rows"
    assert lacking in recording.notes


def test_a_planar_pose_may_be_lost_and_velocities_not_there(tmp_path: Path) -> None:
    """No velocities, and poses that the tracker lost: NaN, a note on what was lost, and the same when read again."""
    frame = frame_of(planar(), tmp_path).drop(columns=["vx", "vy", "wz"])
    frame.loc[20:24, ["x", "y", "yaw"]] = np.nan
    frame.to_parquet(tmp_path / "recording.parquet")
    recording = read_case(tmp_path)
    assert np.isnan(recording.episodes[0].pose[20:25]).all()
    assert np.isfinite(np.delete(recording.episodes[0].pose, slice(20, 25), axis=0)).all()
    assert all(np.isnan(e.twist).all() for e in recording.episodes)
    assert notes_of(recording) == ("'x', 'y', 'yaw' are not measured (NaN) in 5 of 363 rows",)
    write_case(recording, tmp_path / "again")
    again = read_case(tmp_path / "again")
    for one, other in zip(recording.episodes, again.episodes, strict=True):
        np.testing.assert_array_equal(one.pose, other.pose)
        np.testing.assert_array_equal(one.twist, other.twist)


def test_a_turn_is_found_across_a_lost_pose(tmp_path: Path) -> None:
    """A yaw that jumps by a whole turn while the tracker sees nothing is still to be unwrapped."""
    frame = frame_of(planar(), tmp_path)
    frame.loc[20:22, ["x", "y", "yaw"]] = np.nan
    frame.loc[23:120, "yaw"] += 2 * np.pi
    frame.to_parquet(tmp_path / "recording.parquet")
    with pytest.raises(RecordingError, match=r"data row 24 .*column 'yaw' must be unwrapped"):
        read_case(tmp_path)


def test_an_episode_that_nobody_saw_is_refused(tmp_path: Path) -> None:
    """Two poses are no motion."""
    frame = frame_of(planar(), tmp_path)
    frame.loc[2:120, ["x", "y", "yaw"]] = np.nan
    frame.to_parquet(tmp_path / "recording.parquet")
    with pytest.raises(RecordingError, match=r"column 'x' is measured in 2 samples of the episode, at least 3"):
        read_case(tmp_path)


def test_columns_beyond_the_format_are_noted(tmp_path: Path) -> None:
    """They don't hinder, and a note names them; an index that pandas saved is not worth a note."""
    frame = frame_of(planar(), tmp_path).assign(tip_x=0.0, camera="left", z=0.5)
    frame.index = frame.index + 7
    frame.to_parquet(tmp_path / "recording.parquet")
    assert notes_of(read_case(tmp_path)) == ("not part of the planar form and not used: 'tip_x', 'camera', 'z'",)


@pytest.mark.parametrize("dtype", ["float32", "Float64", "string", "category"])
def test_any_type_of_number_is_read(dtype: str, tmp_path: Path) -> None:
    """Halved and nullable floats, text and categories that hold numbers are numbers."""
    frame = frame_of(planar(), tmp_path)
    frame["fx"] = frame["fx"].astype(dtype)
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
    cases = find_cases(EXAMPLES / "cases")
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
    # a table is itself, not its folder
    assert find_cases(tmp_path / "b/recording.parquet") == [tmp_path / "b/recording.parquet"]


def test_what_stops_within_a_sample_is_read(tmp_path: Path) -> None:
    """A velocity in the first sample alone says nothing of a position that never changes; nor do tiny numbers."""
    zero = np.zeros((5, 3))
    twist = zero.copy()
    twist[:2, 0] = 0.09375, 2.2e-311
    episode = Episode(0, np.arange(5) / 5.0, zero, twist, zero, zero)
    write_case(Recording(Path("any"), Form.PLANAR, replace(planar().nominal, rate_hz=5.0), (episode,)), tmp_path)
    assert read_case(tmp_path).episodes[0].twist[0, 0] == 0.09375
