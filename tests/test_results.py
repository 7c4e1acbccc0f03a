"""A result belongs to what it was made from, says what made it, and is told from one that a kill left behind."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
import yaml

from runner.__main__ import main
from runner.diagnosis.verdict import ALL, FILE
from runner.outputs.many import diagnose_many
from runner.recording import write_case
from runner.recording.case import content_hash
from runner.storage import provenance, run_status
from runner.storage.holding import holding
from runner.storage.run_status import Status, status_of
from runner.teleop import tables
from tests.cases import made
from tests.in_place_of_a_diagnosis import noted

BRIEF = ("forces.pushes=2", "forces.rest_s=0.3")
QUICK = (*BRIEF, "log.rrd=off")
EXAMPLES = Path(__file__).parents[1] / "examples" / "cases"


def one_line(capsys: pytest.CaptureFixture[str]) -> str:
    """Return what was said on stderr, which must be one line."""
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    return err


def test_a_folder_of_other_settings_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Frames, log and row of another run never lie beside a config that they are not of."""
    out = tmp_path / "r"
    assert main([f"out={out}", *BRIEF]) == 0
    before = {file.name: file.read_bytes() for file in out.iterdir()}
    capsys.readouterr()
    assert main([f"out={out}", *QUICK, "start.mass_kg=2"]) == 2
    assert one_line(capsys) == (
        f"out: '{out}' holds the results of other settings, see config.yaml in it; name another folder.\n"
    )
    assert main(["gap", str(EXAMPLES / "nothing_differs"), f"out={out}"]) == 2
    assert one_line(capsys) == f"out: '{out}' holds the results of 'runner run'; name another folder.\n"
    assert {file.name: file.read_bytes() for file in out.iterdir()} == before
    assert main([f"out={out}", *BRIEF]) == 0  # the same again takes its own place


def test_results_of_nobody_knows_what_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A folder from before results noted what they belong to is left alone; a user's own files are no results."""
    out = tmp_path / "r"
    assert main([f"out={out}", *QUICK]) == 0
    (out / run_status.FILE).unlink()
    capsys.readouterr()
    assert main([f"out={out}", *QUICK]) == 2
    assert "a run that did not note what they belong to" in one_line(capsys)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/notes.txt").write_text("mine")
    assert main([f"out={tmp_path}/mine", *QUICK]) == 0


def test_what_failed_before_its_first_result_is_in_nobody_s_way(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A run that was refused leaves a folder that the corrected command may have."""
    case = tmp_path / "case"
    shutil.copytree(EXAMPLES / "nothing_differs", case)
    (case / "nominal.yaml").rename(case / "kept.yaml")
    assert main(["gap", str(case), f"out={tmp_path}/g"]) == 2
    assert status_of(tmp_path / "g") is Status.failed
    assert "nominal.yaml" in yaml.safe_load((tmp_path / "g/run.yaml").read_text())["reason"]
    (case / "kept.yaml").rename(case / "nominal.yaml")
    assert main(["gap", str(case), "horizons_s=[0.5]", f"out={tmp_path}/g"]) == 0


def test_another_recording_under_the_same_name_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Results are of what the recording held, not of its path; a recording that was moved is the same."""
    case, out = tmp_path / "case", tmp_path / "g"
    shutil.copytree(EXAMPLES / "nothing_differs", case)
    assert main(["gap", str(case), "horizons_s=[0.5]", f"out={out}"]) == 0
    row = pd.read_parquet(out / "gap.parquet").iloc[0]
    assert row["recording_hash"] == content_hash(case)
    capsys.readouterr()
    shutil.copytree(case, tmp_path / "moved")
    shutil.copyfile(EXAMPLES / "slippery_floor/recording.parquet", case / "recording.parquet")
    assert main(["gap", str(case), "horizons_s=[0.5]", f"out={out}"]) == 2
    assert one_line(capsys) == (
        f"out: '{out}' holds the results of another 'recording', or of this one before its files were changed; name "
        "another folder.\n"
    )
    assert main(["gap", str(tmp_path / "moved"), "horizons_s=[0.5]", f"out={out}"]) == 0


def test_a_verdict_of_what_a_case_held_before_is_made_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Going on keeps the verdicts of cases that are as they were, and no others; those of other cases are refused."""
    monkeypatch.setattr("runner.outputs.many._one", noted)
    cases = {}
    for name in ("a", "b"):
        shutil.copytree(EXAMPLES / "nothing_differs", tmp_path / "cases" / name)
        cases[name] = tmp_path / "cases" / name
    out = tmp_path / "out"
    out.mkdir()
    assert diagnose_many(cases, out, workers=1) == {}
    first = json.loads((out / ALL).read_text())
    shutil.copyfile(EXAMPLES / "slippery_floor/recording.parquet", cases["b"] / "recording.parquet")
    assert diagnose_many(cases, out, workers=1) == {}
    second = json.loads((out / ALL).read_text())
    assert second["a"] == first["a"]
    assert second["b"]["sentence"] != first["b"]["sentence"]
    assert second["b"]["provenance"]["recording_hash"] == content_hash(cases["b"])
    with pytest.raises(Exception, match=r"holds verdicts of other cases \('a'\); name another folder\."):
        diagnose_many({"b": cases["b"]}, out, workers=1)


def test_a_verdict_says_what_made_it(tmp_path: Path) -> None:
    """Versions, commit, hashes of settings and recording stand in the verdict of a real diagnosis, alone or of many."""
    write_case(made(episodes=2, seconds=1.0)[0], tmp_path / "cases/a")
    assert main(["diagnose", str(tmp_path / "cases"), "report=false", "workers=1", f"out={tmp_path}/many"]) == 0
    said = json.loads((tmp_path / "many/a" / FILE).read_text())["provenance"]
    noted = yaml.safe_load((tmp_path / "many" / run_status.FILE).read_text())
    assert said["recording_hash"] == content_hash(tmp_path / "cases/a")
    assert said["config_hash"] == noted["config_hash"]
    assert said["versions"]["mujoco"] == "3.17.0"
    assert {"commit", "changed"} <= said.keys()
    assert noted["status"] == "done"


def test_results_never_go_into_a_recording(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The corrected model has the name that a case's own model mostly has."""
    shutil.copytree(EXAMPLES / "nothing_differs", tmp_path / "case")
    assert main(["diagnose", str(tmp_path / "case"), f"out={tmp_path}/case"]) == 2
    assert "holds a recording" in one_line(capsys)


def test_rows_say_what_made_them(tmp_path: Path) -> None:
    """Of a single run and of each run of a sweep, failed ones too; the hash is that of the settings."""
    assert main([f"out={tmp_path}/one", *QUICK, "start.mass_kg=2"]) == 0
    assert main(["-m", f"out={tmp_path}/s", *QUICK, "start.mass_kg=2,-1,3"]) == 1
    (alone,) = tables.read_summary(tmp_path / "one" / tables.SUMMARY)
    rows = tables.read_summary(tmp_path / "s" / tables.SUMMARY)
    assert "mujoco 3.17.0" in alone["versions"]
    assert {row["versions"] for row in rows} == {alone["versions"]}
    assert rows[0]["config_hash"] == alone["config_hash"]
    assert len({row["config_hash"] for row in rows}) == 3
    assert {row["commit"] for row in rows} == {alone["commit"]}


def test_a_file_of_forces_is_an_input(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its content is in the row, and a folder of results of another content is refused."""
    forces = tmp_path / "f.csv"
    forces.write_text("t,fx,fy\n0,9,0\n0.5,0,0\n1,0,0\n")
    settings = ("forces=csv", f"forces.path={forces}", "log.rrd=off", f"out={tmp_path}/r")
    assert main(settings) == 0
    (row,) = tables.read_summary(tmp_path / "r" / tables.SUMMARY)
    assert len(row["forces_hash"]) == provenance.HEX
    forces.write_text("t,fx,fy\n0,10,0\n0.5,0,0\n1,0,0\n")
    capsys.readouterr()
    assert main(settings) == 2
    assert "of another 'forces'" in one_line(capsys)


@pytest.mark.parametrize(("name", "number"), [("killed", signal.SIGKILL)])
def test_a_killed_run_is_told_from_a_done_one(name: str, number: int, tmp_path: Path) -> None:
    """From its first second a run says that it is running, and once it is killed `table` says that."""
    out = tmp_path / "r"
    long = ["start.mass_kg=2", "forces.pushes=2000", "log.rrd=off", f"out={out}"]
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])}
    process = subprocess.Popen([sys.executable, "-m", "runner", *long], env=environment, stdout=subprocess.DEVNULL)
    try:
        while not (out / run_status.FILE).exists():
            assert process.poll() is None
            time.sleep(0.02)
        assert status_of(out) is Status.running
        (row,) = tables.collect([tmp_path]).to_dict("records")
        assert (row["run"], row["status"]) == (str(out), "running")
    finally:
        process.send_signal(number)
        process.wait()
    assert status_of(out) is Status(name)
    (row,) = tables.collect([tmp_path]).to_dict("records")
    assert row["status"] == name


def test_a_row_of_before_is_not_taken_for_that_of_a_killed_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A run again into its own folder that ends half-way leaves no row that says it was done."""
    out = tmp_path / "r"
    assert main([f"out={out}", *QUICK]) == 0

    def dies(*_: Any) -> None:
        raise MemoryError

    monkeypatch.setattr("runner.commands.run.run", dies)
    assert main([f"out={out}", *QUICK]) == 2
    (row,) = tables.collect([out]).to_dict("records")
    assert (row["status"], row["reason"].split(":")[0]) == ("failed", "MemoryError")


@pytest.mark.parametrize(
    ("noted", "said"), [("running", "killed"), ("interrupted", "interrupted"), ("failed", "failed")]
)
def test_a_row_that_is_still_there_is_not_that_of_a_later_run(noted: str, said: str, tmp_path: Path) -> None:
    """A run again that ends between its first note and the removal of the old row: `run.yaml` has the say."""
    out = tmp_path / "r"
    assert main([f"out={out}", *QUICK]) == 0
    note = (out / run_status.FILE).read_text()
    assert note.startswith("status: done\n")
    (out / run_status.FILE).write_text(note.replace("status: done", f"status: {noted}", 1))
    (row,) = tables.collect([out]).to_dict("records")
    assert row["status"] == said


def test_a_run_that_failed_keeps_its_row(tmp_path: Path) -> None:
    """Its row says when and why; `run.yaml` alone would not."""
    out = tmp_path / "r"
    assert main([f"out={out}", *QUICK]) == 0
    (row,) = tables.read_summary(out / tables.SUMMARY)
    tables.write_summary([{**row, "status": "diverged", "reason": "at 0.2 s"}], out)
    note = (out / run_status.FILE).read_text()
    (out / run_status.FILE).write_text(note.replace("status: done", "status: failed", 1))
    (row,) = tables.collect([out]).to_dict("records")
    assert (row["status"], row["reason"]) == ("diverged", "at 0.2 s")


def test_other_versions_are_said_and_both_are_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A sweep that goes on with another engine says so; each row and `run.yaml` keep which it was."""
    out = tmp_path / "s"
    out.mkdir()
    sweep = ["-m", *QUICK, "start.mass_kg=2,3", f"out={out}"]
    assert main(sweep) == 0
    first = tables.read_summary(out / tables.SUMMARY)
    tables.write_summary(first[:1], out)
    capsys.readouterr()
    other = {**provenance.versions(), "mujoco": "9.9.9"}
    monkeypatch.setattr("runner.storage.provenance.versions", lambda: other)
    assert main([f"resume={out}"]) == 0
    assert "mujoco 3.17.0, now 9.9.9" in one_line(capsys)
    rows = tables.read_summary(out / tables.SUMMARY)
    assert ["mujoco 3.17.0" in row["versions"] for row in rows] == [True, False]
    sessions = yaml.safe_load((out / run_status.FILE).read_text())["sessions"]
    assert [s["versions"]["mujoco"] for s in sessions] == ["3.17.0", "9.9.9"]


def test_a_folder_is_held_by_one(tmp_path: Path) -> None:
    """Held, then free as soon as its holder lets go."""
    with holding(tmp_path) as first, holding(tmp_path) as second:
        assert (first, second) == (True, False)
    with holding(tmp_path) as again:
        assert again
