"""Logs of a box that is pushed over a floor: from columns of somebody's tracker to a case."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

from runner.__main__ import main
from runner.importing.entries import Entry, Role
from runner.importing.episodes import Series
from runner.importing.guess.box import column_of
from runner.importing.map_file import Between
from runner.importing.points import with_points
from runner.importing.rows import _means
from runner.importing.signals import Signal
from runner.importing.told import Told
from runner.recording import read_case

BELIEVED = "half_size: [0.08, 0.05, 0.03]\nmass: 1.2\nfriction: 0.3\ngravity: 9.81\n"
RATE_HZ, SAMPLES, PUSHES = 30.0, 60, 3


def tracker() -> pd.DataFrame:
    """Three pushes as a tracker writes them: millimetres, degrees between -180 and 180, whole milliseconds."""
    t = np.arange(SAMPLES) / RATE_HZ
    pushes = []
    for number in range(PUSHES):
        pushed = (t > 0.2) & (t < 0.5)
        way = 0.05 * np.clip(t - 0.2, 0, 0.5) ** 2 * (1 + 0.1 * number)
        turned = np.radians(170) + 20 * way
        pushes.append(
            pd.DataFrame(
                {
                    "trial_no": 7 + number,
                    "cam_ms": np.round(1000 * t) + 5000 * number,
                    "box_x_mm": 1000 * way,
                    "box_y_mm": -500 * way,
                    "theta_deg": (np.degrees(turned) + 180) % 360 - 180,
                    "push_x_N": 5.0 * pushed,
                    "push_y_N": -2.5 * pushed,
                    "contact_u_mm": -80.0,
                    "contact_v_mm": 10.0 * number,
                }
            )
        )
    return pd.concat(pushes, ignore_index=True)


def imported(log: pd.DataFrame, folder: Path, *, sep: str = ",", decimal: str = ".") -> str:
    """Import a log as it is proposed, and return the map."""
    log.to_csv(folder / "pushes.csv", index=False, sep=sep, decimal=decimal)
    (folder / "box.yaml").write_text(BELIEVED)
    arguments = ["import", str(folder / "pushes.csv"), f"model={folder / 'box.yaml'}"]
    assert main([*arguments, f"propose={folder / 'map.yaml'}"]) == 0
    assert main([*arguments, f"map={folder / 'map.yaml'}", f"out={folder / 'case'}"]) == 0
    return (folder / "map.yaml").read_text()


@pytest.mark.parametrize("lost", ["cells", "rows"])
def test_a_tracker_s_log_is_a_case_without_editing(lost: str, tmp_path: Path) -> None:
    """Units, episodes, turns and lost samples: the case holds the motion, NaN where it was lost, and every force."""
    log = tracker()
    gone = np.zeros(len(log), dtype=bool)
    gone[[20, 21, 80, 130]] = True
    whole = log.copy()
    if lost == "cells":
        log.loc[gone, ["box_x_mm", "box_y_mm", "theta_deg"]] = np.nan
    else:
        log = log.loc[~gone]
    text = yaml.safe_load(imported(log, tmp_path))
    assert text["episodes"] == {"by": "column", "signal": "trial_no"}
    assert text["clock"] == {"name": "cam_ms", "unit": "ms"}
    assert text["rows"]["rate_hz"] == RATE_HZ  # whatever whole milliseconds, and lost rows, make of it
    case = read_case(tmp_path / "case")
    assert [e.index for e in case.episodes] == [7, 8, 9]
    assert [len(e) for e in case.episodes] == [SAMPLES] * PUSHES
    pose = np.concatenate([e.pose for e in case.episodes])
    assert np.array_equal(np.isnan(pose).all(axis=1), gone)
    np.testing.assert_allclose(pose[~gone, 0], whole["box_x_mm"][~gone] / 1000, atol=1e-12)
    assert np.nanmax(np.abs(np.diff(pose[:, 2]))) < 0.3  # no jumps by a full turn
    np.testing.assert_allclose(np.cos(pose[~gone, 2]), np.cos(np.radians(whole["theta_deg"][~gone])), atol=1e-12)
    force = np.concatenate([e.force_n for e in case.episodes])
    np.testing.assert_allclose(force[:, 0], whole["push_x_N"])
    assert {float(p) for e in case.episodes for p in e.point_m[:, 0]} == {-0.08}


def test_lost_forces_stand_between_their_neighbours(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Of a force that rises and falls smoothly: in lost rows, and in rows where its cell is empty, all but what it was.

    No row has the force of another one: stamps in whole milliseconds are past their rows or before them.
    """
    log = tracker()
    t = np.tile(np.arange(SAMPLES) / RATE_HZ, PUSHES)
    log["push_x_N"], log["push_y_N"] = 5 * np.sin(2 * t), -2.5 * np.sin(2 * t)
    whole, gone, empty = log.copy(), [20, 21, 80, 130], [40, 100]
    log.loc[empty, ["push_x_N", "push_y_N"]] = np.nan
    imported(log.drop(index=gone), tmp_path)
    said = " ".join(capsys.readouterr().out.split())
    assert "Note: 'fx', 'fy': 6 samples were lost; the curve between those around them is taken" in said
    assert "'vx'" not in said  # nobody has asked for velocities
    text = (tmp_path / "map.yaml").read_text().replace(", between: curve", "")  # means say less of single rows
    (tmp_path / "held.yaml").write_text(text)
    log_file, box = tmp_path / "pushes.csv", tmp_path / "box.yaml"
    assert (
        main(["import", str(log_file), f"model={box}", f"map={tmp_path / 'held.yaml'}", f"out={tmp_path / 'h'}"]) == 0
    )
    force = np.concatenate([e.force_n for e in read_case(tmp_path / "h").episodes])[:, 0]
    lost = np.isin(np.arange(len(whole)), [*gone, *empty])
    np.testing.assert_array_equal(force[~lost], whole["push_x_N"][~lost])
    # a line over three steps is off by the second derivative, 20 N/s2 at most, times the step squared
    np.testing.assert_allclose(force[lost], whole["push_x_N"][lost], atol=20.0 / RATE_HZ**2)


@pytest.mark.parametrize("rate_hz", [30.0, 60.0, 75.0, 240.0])
def test_every_row_has_the_force_of_its_own_sample(rate_hz: float, tmp_path: Path) -> None:
    """Whether a step, in whole nanoseconds, is rounded up or down."""
    log = tracker()
    log["cam_ms"] = 1000 * np.tile(np.arange(SAMPLES), PUSHES) / rate_hz
    log["push_x_N"] = np.random.default_rng(0).normal(size=len(log))
    imported(log, tmp_path)
    force = np.concatenate([e.force_n for e in read_case(tmp_path / "case").episodes])[:, 0]
    np.testing.assert_array_equal(force, log["push_x_N"])


@pytest.mark.parametrize("noise_n", [0.0, 0.02])
def test_where_a_force_acts_is_not_asked_while_there_is_none(
    noise_n: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A log without a contact point while nothing touches loses no rest, and every push acts at its own point only."""
    log = tracker()
    t = np.tile(np.arange(SAMPLES) / RATE_HZ, PUSHES)
    second = (t > 1.0) & (t < 1.5)
    log.loc[second, "push_x_N"] = 5.0
    log.loc[second, "contact_v_mm"] = -30.0
    pushed = log["push_x_N"] > 0
    noise = np.random.default_rng(0).normal(size=(2, len(log)))
    log["push_x_N"] += noise_n * noise[0]
    log["push_y_N"] += noise_n * noise[1]
    log.loc[~pushed, ["contact_u_mm", "contact_v_mm"]] = np.nan
    imported(log, tmp_path)
    said = " ".join(capsys.readouterr().out.split())
    assert f"Note: 'px', 'py': empty in {int((~pushed).sum())} samples in which no force acts" in said
    assert "begin later" not in said
    assert "'px', 'py': no new command" not in said
    case = read_case(tmp_path / "case")
    assert [len(e) for e in case.episodes] == [SAMPLES] * PUSHES
    acts = np.concatenate([e.force_n[:, 0] for e in case.episodes]) > 1.0
    point_mm = 1000 * np.concatenate([e.point_m[:, 1] for e in case.episodes])
    late = t > 0.8
    np.testing.assert_allclose(point_mm[acts & late], -30.0)
    np.testing.assert_allclose(point_mm[acts & ~late], np.repeat(10.0 * np.arange(PUSHES), SAMPLES)[acts & ~late])


def test_a_point_that_is_lost_while_a_force_acts_is_still_a_lost_one(tmp_path: Path) -> None:
    """Rows at the samples themselves take no gap in a command; without a force there is none."""
    force = [0.0, 0.0, 5.0, 5.0, 0.0, 0.0]
    free = [np.nan, np.nan, 0.1, 0.1, np.nan, np.nan]
    lost = [np.nan, np.nan, 0.1, np.nan, np.nan, 0.2]
    for point, filled in ((free, [0.1] * 6), (lost, [0.1, 0.1, 0.1, np.nan, 0.2, 0.2]), ([np.nan] * 6, None)):
        told = Told()
        _, made = with_points([_series("fx", force), _series("px", point, acts=("fx",))], told)
        expected = filled if filled is not None else [0.0, 0.0, np.nan, np.nan, 0.0, 0.0]
        np.testing.assert_array_equal(made.values, expected)
        assert told.sentences()


def _series(column: str, values: list[float], acts: tuple[str, ...] = ()) -> Series:
    at = np.arange(len(values), dtype=np.int64)
    entry = Entry(f"commands.{column}", column, column, Role.COMMAND, acts=acts)
    return Series(entry, Signal(column, "table", np.array(values)), at, 10_000_000 * at, np.array(values))


@pytest.mark.parametrize(("name", "between"), [("push_x_N", "curve"), ("cmd_push_x_N", None)])
def test_a_measured_force_is_a_curve(name: str, between: str | None, tmp_path: Path) -> None:
    """A case holds each row's force, so that of a curve it is the mean until the next row; what was sent was held."""
    log = tracker()
    t = np.arange(SAMPLES) / RATE_HZ
    log["push_x_N"] = np.tile(5.0 * np.sin(9.0 * t), PUSHES)
    log["push_y_N"] = 0.02 * np.random.default_rng(0).normal(size=len(log))  # all of it noise
    text = yaml.safe_load(imported(log.rename(columns={"push_x_N": name}), tmp_path))
    assert text["commands"]["fx"].get("between") == between
    assert text["commands"]["fy"].get("between") == between  # one sensor
    mean = 5.0 / 9.0 * RATE_HZ * (np.cos(9.0 * t) - np.cos(9.0 * t + 9.0 / RATE_HZ))  # the integral over a row
    for episode in read_case(tmp_path / "case").episodes:
        if between:  # the mean of a line is 0.75 % off: (9 / 30)^2 / 12
            np.testing.assert_allclose(episode.force_n[1:-2, 0], mean[1:-2], atol=0.005)
        else:
            np.testing.assert_allclose(episode.force_n[:, 0], 5.0 * np.sin(9.0 * t), atol=1e-9)


def test_what_bends_less_than_it_is_noisy_is_a_line(tmp_path: Path) -> None:
    """Noise makes a curve the worse forecast of a sample, as a line takes the mean of more like neighbours."""
    log, g = tracker(), np.random.default_rng(1)
    t = np.tile(np.arange(SAMPLES) / RATE_HZ, PUSHES)
    log["push_x_N"] = 5.0 * np.sin(3.0 * t) + 0.2 * g.normal(size=len(log))
    log["push_y_N"] = 0.2 * g.normal(size=len(log))
    assert yaml.safe_load(imported(log, tmp_path))["commands"]["fx"]["between"] == "line"


def test_a_line_pushes_as_much_as_it_does_between_rows(tmp_path: Path) -> None:
    """Of a force with stamps of its own, several to a row: rows hold the mean of the line, whatever is in them."""
    g, t_ns = np.random.default_rng(0), np.arange(0, 1_000_000_001, 7_000_000)
    values, rows_ns = np.cumsum(g.normal(size=len(t_ns))), np.arange(0, 900_000_001, 100_000_000)
    entry = Entry("commands.fx", "fx", "f", Role.COMMAND, between=Between.LINE)
    series = Series(entry, Signal("f", "log", values), np.arange(len(t_ns)), t_ns, values)
    held = _means(series, rows_ns, Told())
    fine = np.arange(0, 900_000_001, 1000)
    line = np.interp(fine, t_ns, values)
    wanted = [np.trapezoid(line[k : k + 100_001], dx=1e-6) / 0.1 for k in range(0, len(fine) - 1, 100_000)]
    np.testing.assert_allclose(held[:-1], wanted, rtol=1e-9)
    assert held[-1] == pytest.approx(line[-1])


def test_a_point_that_never_changes_needs_no_signal(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its value stands in the map; beside a signal, or of what is measured, it is refused."""
    log = tracker()
    imported(log, tmp_path)
    arguments = ["import", str(tmp_path / "pushes.csv"), f"model={tmp_path / 'box.yaml'}", f"out={tmp_path / 'new'}"]
    keys = yaml.safe_load((tmp_path / "map.yaml").read_text())
    keys["commands"]["px"] = {"value": 45.0, "unit": "mm"}
    (tmp_path / "fixed.yaml").write_text(yaml.safe_dump(keys))
    assert main([*arguments, f"map={tmp_path / 'fixed.yaml'}"]) == 0
    assert "45 always" in capsys.readouterr().out
    assert {float(p) for e in read_case(tmp_path / "new").episodes for p in e.point_m[:, 0]} == {0.045}
    for group, column, entry in (
        ("commands", "px", {"value": 45.0, "signal": "contact_u_mm"}),
        ("channels", "x", {"value": 1.0}),
    ):
        wrong = {**keys, group: {**keys[group], column: entry}}
        (tmp_path / "wrong.yaml").write_text(yaml.safe_dump(wrong))
        assert main([*arguments, f"map={tmp_path / 'wrong.yaml'}"]) == 2
        assert f"{group}.{column}" in capsys.readouterr().err


def test_over_a_gap_a_force_is_held(tmp_path: Path) -> None:
    """Nothing says that it rose all the while; where nothing differs from what is held nothing is said."""
    t_ns = np.append(np.arange(0, 101_000_000, 10_000_000), np.arange(2_000_000_000, 2_101_000_000, 10_000_000))
    values, told = np.where(t_ns < 1e9, 0.0, 10.0), Told()
    entry = Entry("commands.fx", "fx", "f", Role.COMMAND, between=Between.LINE)
    series = Series(entry, Signal("f", "log", values), np.arange(len(t_ns)), t_ns, values)
    rows_ns = np.arange(0, 2_100_000_001, 100_000_000)
    np.testing.assert_allclose(_means(series, rows_ns, told), np.where(rows_ns < 2e9, 0.0, 10.0), atol=1e-9)
    assert not any("means of the line" in s for s in told.sentences())


def test_where_a_force_acts_is_told_by_the_only_two_lengths_left(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Along axes u and v of a hook; of names that say nothing what is asked for is said, and what it may be."""
    log = tracker().rename(columns={"contact_u_mm": "hook_u_mm", "contact_v_mm": "hook_v_mm"})
    commands = yaml.safe_load(imported(log, tmp_path))["commands"]
    assert {c: commands[c]["signal"] for c in ("px", "py")} == {"px": "hook_u_mm", "py": "hook_v_mm"}
    odd = log.rename(columns={"hook_u_mm": "first_mm", "hook_v_mm": "second_mm"})
    odd.to_csv(tmp_path / "odd.csv", index=False)
    capsys.readouterr()
    main(["import", str(tmp_path / "odd.csv"), f"model={tmp_path / 'box.yaml'}", f"propose={tmp_path / 'odd.yaml'}"])
    said = " ".join(capsys.readouterr().out.split())
    assert "'px' (where the force acts, from the box's middle along its own x axis)" in said
    assert "not used yet, in such a unit: 'first_mm', 'second_mm'" in said


@pytest.mark.parametrize(("count", "said"), [(1, "'x': 1 sample was lost"), (21, "'x': 21 samples were lost")])
def test_one_is_one(count: int, said: str) -> None:
    """A note of one sample is in the singular."""
    told = Told()
    told.add("{names}: {n} samples were lost", count, column="x")
    assert told.sentences() == [said]


def test_decimal_commas_are_seen(tmp_path: Path) -> None:
    """A table that somebody's locale wrote with semicolons and commas is read without a word, and the map says so."""
    log = tracker()
    log.loc[:40, "box_x_mm"] = np.nan  # what the first cells hold does not decide
    log.loc[0, "box_x_mm"] = 0.0
    text = yaml.safe_load(imported(log, tmp_path, sep=";", decimal=","))
    assert text["log"] == {"decimal": ","}
    case = read_case(tmp_path / "case")
    np.testing.assert_allclose(case.episodes[1].pose[:, 0], log["box_x_mm"][60:120] / 1000, atol=1e-12)


@pytest.mark.parametrize("names", [("angriff_x_mm", "angriff_y_mm"), ("Cx (mm)", "Cy (mm)"), ("tip_x_mm", "tip_y_mm")])
def test_the_only_other_place_is_where_the_force_acts(names: tuple[str, str], tmp_path: Path) -> None:
    """Where it acts is told in words that nobody here knows, but the log tells two places only."""
    log = tracker().rename(columns=dict(zip(("contact_u_mm", "contact_v_mm"), names, strict=True)))
    text = yaml.safe_load(imported(log, tmp_path))
    assert [text["commands"][c]["signal"] for c in ("px", "py")] == list(names)
    assert [text["channels"][c]["signal"] for c in ("x", "y")] == ["box_x_mm", "box_y_mm"]


@pytest.mark.parametrize(("pin", "point"), [("", "TODO"), ("pin: {radius: 0.005, friction: 0.2}\n", None)])
def test_a_pushers_path_is_no_point_of_the_box(
    pin: str, point: str | None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A tip that goes farther than the box is large is the path of a pin where one is believed in, else left open."""
    log = tracker().rename(columns={"contact_u_mm": "tip_x_mm", "contact_v_mm": "tip_y_mm"})
    log["tip_x_mm"] += log["box_x_mm"] + 400
    log.to_csv(tmp_path / "pushes.csv", index=False)
    (tmp_path / "box.yaml").write_text(BELIEVED + pin)
    path = tmp_path / "map.yaml"
    assert main(["import", str(tmp_path / "pushes.csv"), f"model={tmp_path / 'box.yaml'}", f"propose={path}"]) == 0
    proposed = yaml.safe_load(path.read_text())
    commands = proposed["commands"]
    assert "fx" in proposed["channels" if pin else "commands"]  # of a pin it is what a sensor has measured
    assert commands.get("px", {}).get("signal") == point
    assert commands.get("tip_x", {}).get("signal") == ("tip_x_mm" if pin else None)
    said = " ".join(capsys.readouterr().out.split())
    assert ("'tip_x_mm': goes beyond the box" in said) == (not pin)


def test_a_box_is_in_the_unit_of_where_the_force_acts(tmp_path: Path) -> None:
    """No name tells a unit: the size of the box tells that of the point, and a log has one for its lengths."""
    log = tracker().rename(columns=lambda name: name.removesuffix("_mm"))
    text = yaml.safe_load(imported(log, tmp_path))
    assert [text["commands"][c]["unit"] for c in ("px", "py")] == ["mm", "mm"]
    assert [text["channels"][c]["unit"] for c in ("x", "y")] == ["mm", "mm"]


def test_what_is_not_recognised_waits_to_be_filled_in(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A column whose name says nothing is left open, and the import refuses the map until it is filled in."""
    log = tracker().rename(columns={"theta_deg": "third"})
    log.to_csv(tmp_path / "pushes.csv", index=False)
    (tmp_path / "box.yaml").write_text(BELIEVED)
    arguments = ["import", str(tmp_path / "pushes.csv"), f"model={tmp_path / 'box.yaml'}"]
    assert main([*arguments, f"propose={tmp_path / 'map.yaml'}"]) == 0
    assert "the signal of 'yaw' and its unit" in " ".join(capsys.readouterr().out.split())
    assert yaml.safe_load((tmp_path / "map.yaml").read_text())["channels"]["yaw"] == {"signal": "TODO", "unit": "TODO"}
    assert main([*arguments, f"map={tmp_path / 'map.yaml'}", f"out={tmp_path / 'case'}"]) == 2
    assert "channels.yaw.signal: is left open" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("  x: {", "  q: {", "channels.q: unknown column"),
        ("at: nearest, rate_hz", "at: all, rate_hz", "need `rate_hz`"),
        ("unit: ms", "unit: s", "are 33 s apart: nearly all rows would be empty"),
        ("unit: deg", "unit: mm", "'mm' is none of what is measured in rad"),
    ],
)
def test_a_wrong_map_is_one_line(
    old: str, new: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Naming the key and what is allowed."""
    text = imported(tracker(), tmp_path)
    assert old in text
    (tmp_path / "map.yaml").write_text(text.replace(old, new))
    capsys.readouterr()
    command = f"import {tmp_path / 'pushes.csv'} model={tmp_path / 'box.yaml'} map={tmp_path / 'map.yaml'}"
    assert main([*command.split(), f"out={tmp_path / 'other'}"]) == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "other").exists()


@pytest.mark.parametrize(
    ("name", "column"),
    [
        ("X [mm]", "x"), ("box_y_mm", "y"), ("pos_x", "x"), ("heading [deg]", "yaw"), ("rot_deg", "yaw"), ("vx", "vx"),
        ("vel_y_mm_s", "vy"), ("yaw_rate_deg_s", "wz"), ("Fx", "fx"), ("force_y", "fy"), ("push_x_N", "fx"),
        ("push_x_mm", "px"), ("contact_v_mm", "py"), ("Fy (N)", "fy"), ("u [mm]", "px"), ("v [mm]", "py"),
        ("v [mm/s]", None),
        ("at_x", "px"), ("force_point_y_mm", "py"), ("tip_x", "tip_x"),
        ("battery", None), ("current_A", None),
    ],
)  # fmt: skip
def test_names_say_what_is_meant(name: str, column: str | None) -> None:
    """By the unit that they end in first, then by their words."""
    assert column_of(name) == column
