"""Files are written whole or not at all: what was there before stays where the disk is full."""

from __future__ import annotations

import errno
import os
import resource
import shutil
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
import rerun as rr
import rerun.blueprint as rrb
import yaml

from runner.__main__ import main
from runner.errors import WriteError
from runner.recording.data import Nominal
from runner.recording.nominal import write_nominal
from runner.storage.writing import replacing, write_json, write_parquet, write_text, write_yaml
from runner.teleop.tables import ROWS, Ledger, append_line, read_summary, whole_lines, write_summary
from runner.viewer.rrd import written

CASE = Path(__file__).parents[1] / "examples" / "cases" / "nothing_differs"
BYTES = 2000  # what the disk takes of each file
NUMBERS = np.random.default_rng(0).random(5000)
TABLE = pd.DataFrame({"x": NUMBERS})


@contextmanager
def full_disk() -> Generator[None]:
    """Let the system refuse whatever goes beyond the first bytes of a file, as a full disk does half-way."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (BYTES, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def draw(path: Path) -> None:
    """Write a figure."""
    figure = plt.figure()
    figure.gca().plot(NUMBERS)
    with replacing(path) as part:
        figure.savefig(part)
    plt.close(figure)


WRITERS: dict[str, Callable[[Path], object]] = {
    "page.html": lambda path: write_text(path, "é" * BYTES),
    "verdict.json": lambda path: write_json(path, list(NUMBERS)),
    "versions.yaml": lambda path: write_yaml(path, {f"key{i}": float(x) for i, x in enumerate(NUMBERS)}),
    "frames.parquet": lambda path: write_parquet(path, TABLE),
    "summary.parquet": lambda path: write_summary([{"x": x} for x in NUMBERS], path.parent),
    "figure.svg": draw,
    "figure.png": draw,
}


@pytest.mark.parametrize("name", WRITERS)
def test_a_full_disk_leaves_the_file_that_was_there(name: str, tmp_path: Path) -> None:
    """One line with the file and the reason; no half file, in its place or beside it. With room, it is replaced."""
    path = tmp_path / name
    WRITERS[name](path)
    path.write_text("what was there")
    with full_disk(), pytest.raises(WriteError, match=rf"{name}: can't be written: .+\.$") as error:
        WRITERS[name](path)
    assert "\n" not in str(error.value)
    assert path.read_text() == "what was there"
    assert [p.name for p in tmp_path.iterdir()] == [name]
    WRITERS[name](path)
    assert path.stat().st_size > BYTES
    assert [p.name for p in tmp_path.iterdir()] == [name]


def test_a_table_by_command_line_on_a_full_disk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """`runner table out=FILE`: one line, exit code 2, and the table of before."""
    write_summary([{"job": 0, "status": "done"}], tmp_path)
    out = tmp_path / "table.csv"
    out.write_text("what was there")

    def half(path: Path, text: str, **_: Any) -> int:
        path.write_bytes(text.encode()[: len(text) // 2])
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(Path, "write_text", half)
        assert main(["table", str(tmp_path), f"out={out}"]) == 2
    assert capsys.readouterr().err == f"{out}: can't be written: No space left on device.\n"
    assert out.read_text() == "what was there"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["summary.parquet", "table.csv"]
    assert main(["table", str(tmp_path), f"out={out}"]) == 0
    assert len(pd.read_csv(out)) == 1


def test_a_log_takes_its_place_when_it_is_whole(tmp_path: Path) -> None:
    """An `.rrd` that is broken off leaves the one of before; nobody sees it while it is written."""
    path = tmp_path / "run.rrd"
    path.write_text("what was there")
    blueprint = rrb.Blueprint(rrb.TextDocumentView(origin="/summary"))

    def broken_off() -> None:
        with written(path, blueprint) as recording:
            recording.log("summary", rr.TextDocument("half"))
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        broken_off()
    assert path.read_text() == "what was there"
    assert [p.name for p in tmp_path.iterdir()] == ["run.rrd"]
    with written(path, blueprint) as recording:
        recording.log("summary", rr.TextDocument("whole"), static=True)
        assert path.read_text() == "what was there"
    assert "/summary" in {chunk.entity_path for chunk in rr.chunk.RrdReader(path).stream()}
    assert [p.name for p in tmp_path.iterdir()] == ["run.rrd"]


def test_a_line_that_was_not_taken_whole_is_said(tmp_path: Path) -> None:
    """Rows are added line by line; the one that a full disk cuts off is no row, those before it are."""
    path = tmp_path / "rows.jsonl"
    append_line(path, [1, 2])
    with full_disk(), pytest.raises(WriteError, match=r"rows.jsonl: can't be written: "):
        append_line(path, list(NUMBERS))
    assert list(whole_lines(path)) == [[1, 2]]
    append_line(path, [3])
    assert list(whole_lines(path)) == [[1, 2], [3]]


def test_what_is_written_is_read_back(tmp_path: Path) -> None:
    """Through every writer; numbers that don't exist are null in JSON, and files are readable by whom others are."""
    write_json(tmp_path / "a.json", {"x": float("nan"), "y": [1, (2.5, float("inf"))]})
    assert (tmp_path / "a.json").read_text() == '{\n "x": null,\n "y": [\n  1,\n  [\n   2.5,\n   null\n  ]\n ]\n}\n'
    write_yaml(tmp_path / "a.yaml", {"b": 1, "a": [1.5]})
    assert yaml.safe_load((tmp_path / "a.yaml").read_text()) == {"b": 1, "a": [1.5]}
    write_summary([{"job": 1}], tmp_path)
    assert read_summary(tmp_path / "summary.parquet") == [{"job": 1}]
    write_nominal(Nominal((0.5, 0.5, 0.5), 3.0, 0.3, 9.81, 60.0), tmp_path / "nominal.yaml")
    (tmp_path / "plain").touch()
    modes = {p.stat().st_mode for p in tmp_path.iterdir()}
    assert len(modes) == 1


@pytest.mark.parametrize("place", ["nowhere/a.txt", "file/a.txt", "folder"])
def test_a_place_that_cannot_be_written_to_is_said(place: str, tmp_path: Path) -> None:
    """A folder that is not there, a file in its place, and a folder in the file's place."""
    (tmp_path / "file").touch()
    (tmp_path / "folder").mkdir()
    with pytest.raises(WriteError, match=rf"{place}: can't be written: "):
        write_text(tmp_path / place, "text")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file", "folder"]


def test_links_in_a_sweep_of_somebody_else_lead_nowhere(tmp_path: Path) -> None:
    """Neither a file of notes nor their folder may be a link: what the user owns elsewhere stays as it is."""
    mine = tmp_path / "mine"
    mine.mkdir()
    (mine / "settings").write_text("mine")
    (tmp_path / "line.jsonl").symlink_to(mine / "settings")
    with pytest.raises(WriteError, match="can't be written"):
        append_line(tmp_path / "line.jsonl", {"job": 0, "rows": []})
    (tmp_path / ROWS).symlink_to(mine)
    with pytest.raises(WriteError, match="is a link"):
        Ledger(tmp_path, 0)
    assert {f.name: f.read_text() for f in mine.iterdir()} == {"settings": "mine"}


def test_folders_of_runs_and_cases_that_are_links_lead_nowhere(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of a sweep that is resumed and of cases that are diagnosed: nothing is written where a link leads to."""
    mine = tmp_path / "mine"
    mine.mkdir()
    sweep = tmp_path / "s"
    sweep.mkdir()
    (sweep / "sweep.txt").write_text("run seed=0,1 forces.pushes=1 log.rrd=off\n")
    (sweep / "1").symlink_to(mine)
    assert main(["run", f"resume={sweep}"]) == 2
    assert capsys.readouterr().err.startswith(f"{sweep}/1: can't be written: is a link, which would lead out of")
    cases, results = tmp_path / "cases", tmp_path / "d"
    shutil.copytree(CASE, cases / "part" / "a")
    results.mkdir()
    (results / "part").symlink_to(mine)
    assert main(["diagnose", str(cases), f"out={results}"]) == 2
    assert f"{results}/part: can't be written: is a link" in capsys.readouterr().err
    assert not list(mine.iterdir())


def test_a_new_name_is_taken_through_to_the_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """First what the file holds, then its place, then the folder that says so."""
    done = []
    fsync, rename = os.fsync, Path.replace
    monkeypatch.setattr(
        os, "fsync", lambda handle: (done.append(Path(f"/proc/self/fd/{handle}").readlink()), fsync(handle))
    )
    monkeypatch.setattr(Path, "replace", lambda part, path: (done.append(path), rename(part, path)))
    write_text(tmp_path / "a.txt", "text")
    part, path, folder = done
    assert part.parent == tmp_path
    assert part.name.startswith(".a.")
    assert (path, folder) == (tmp_path / "a.txt", tmp_path)


@pytest.mark.parametrize("number", [errno.EINVAL, errno.EIO])
def test_folders_that_can_not_be_taken_through_are_no_error(
    number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Some file systems don't know how; one that knows how, and fails, is told."""

    def of_folder(handle: int) -> None:
        if Path(f"/proc/self/fd/{handle}").readlink().is_dir():
            raise OSError(number, os.strerror(number))

    monkeypatch.setattr(os, "fsync", of_folder)
    if number == errno.EINVAL:
        write_text(tmp_path / "a.txt", "text")
    else:
        with pytest.raises(WriteError, match="Input/output error"):
            write_text(tmp_path / "a.txt", "text")
    assert (tmp_path / "a.txt").read_text() == "text"
