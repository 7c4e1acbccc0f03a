"""Files of strangers: read strictly, and no more of them than memory holds; each refusal is one short line."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from runner.__main__ import main
from runner.errors import RunnerError
from runner.physics.forces import CsvForces
from runner.recording import read_case
from runner.recording.model_form import read_model_case
from runner.recording.model_form_mjcf import read_mjcf, referenced_files
from runner.storage import limits
from runner.storage.reading import read_json
from runner.storage.yaml_text import YamlError, check_yaml, read_yaml

EXAMPLE = Path(__file__).parents[1] / "examples" / "cases" / "nothing_differs"
GB = 1_000_000_000


@pytest.fixture
def case(tmp_path: Path) -> Path:
    """Return a copy of a sound case."""
    shutil.copytree(EXAMPLE, tmp_path / "case")
    return tmp_path / "case"


def refused(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """Return the line that a command line is refused with."""
    assert main(arguments) == 2
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    assert len(err) < 2500
    assert "a bug" not in err
    return err


# CSV -----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("t,fx,fy\n0,1,2,3\n1,1,2,3\n", r"data row 1, line 2: has 4 values, the header names 3 columns"),
        ("t,fx,fy\n0,1,2,\n1,1,2,\n", r"data row 1, line 2: has 4 values"),
        ("t,fx,fy\n0,1,2\n\n1,1\n", r"data row 2, line 4: has 2 values"),
        ("t,fx,fy,fx\n0,1,2,3\n1,1,2,3\n", r"column 'fx' is there more than once"),
        ("t;fx;fy\n0;1;2\n", r"columns must be separated by commas"),
        ("t,fx,fy\n0,1_000,2\n1,0,0\n", r"line 2: fx must be a finite number, got '1_000'"),
        ("t,fx,fy\n\n0,1,2\n\n\n1,x,0\n", r"line 6: fx must be a finite number, got 'x'"),
    ],
)
def test_a_file_of_forces_is_read_strictly(text: str, message: str, tmp_path: Path) -> None:
    """No column is shifted in silence, and a line is named as an editor counts it."""
    (tmp_path / "f.csv").write_text(text)
    with pytest.raises(RunnerError, match=message):
        CsvForces(str(tmp_path / "f.csv"))


def test_a_number_with_an_underscore_is_none(case: Path) -> None:
    """Python takes `1_0` for ten; a recording has it from a slip of the keyboard."""
    frame = pq.read_table(case / "recording.parquet").to_pandas()
    (case / "recording.parquet").unlink()
    frame = frame.astype({"x": str})
    frame.loc[3, "x"] = "1_0"
    frame.to_csv(case / "recording.csv", index=False)
    with pytest.raises(RunnerError, match=r"data row 4, line 5: column 'x' must be a number in m, got '1_0'"):
        read_case(case)


def test_a_row_too_long_in_the_model_form(tmp_path: Path) -> None:
    """A mechanism's CSV is read by the same reader."""
    (tmp_path / "model.xml").write_text(
        '<mujoco><worldbody><body><joint name="j"/><geom size=".1"/></body></worldbody></mujoco>'
    )
    (tmp_path / "nominal.yaml").write_text("model: model.xml\nchannels: {q: {joint: j, quantity: position}}\n")
    (tmp_path / "recording.csv").write_text("episode,t,q\n0,0,1,9\n0,1,2,9\n0,2,3,9\n")
    with pytest.raises(RunnerError, match=r"data row 1, line 2: has 4 values, the header names 3 columns"):
        read_model_case(tmp_path)


# YAML ----------------------------------------------------------------------------------------------------------------

BOMB = "a0: &a0 [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]\n" for k in range(1, 9)
)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (BOMB, r"line \d, column \d+: more than 20,000 values, aliases written out"),
        ("[" * 100_000, r"line 1, column 33: nested deeper than 32 levels"),
        ("half_size: " + "[" * 100_000 + "]" * 100_000, r"nested deeper than 32 levels"),
        ("a: &a [*a]", r"alias '\*a' stands within what it names"),
        ("a: &a {b: [1, *a]}", r"alias '\*a' stands within what it names"),
        (
            "mass: !!timestamp 2026-13-45\n",
            r"not valid YAML: a value is not what its form promises \(month must be in 1\.\.12",
        ),
        ('mass: !!int ""\n', r"not valid YAML: a value is not what its form promises"),
        ("mass: !!float x\n", r"not valid YAML: a value is not what its form promises"),
        (f"mass: {'9' * 5000}\n", r"not valid YAML: a value is not what its form promises"),
        ("mass: !!python/object/apply:os.getcwd []\n", r"not valid YAML: could not determine a constructor"),
        ("? [1, 2]\n: 3\n", r"found unhashable key"),
        ("mass: \x00\n", r"not valid YAML"),
    ],
)
def test_yaml_that_is_no_config_is_one_line(
    text: str, message: str, case: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Whatever stands in it: depth, size with aliases written out, and what each value must be."""
    (case / "nominal.yaml").write_text(text)
    with pytest.raises(YamlError, match=message):
        read_yaml(case / "nominal.yaml")
    for command in ("gap", "diagnose"):
        assert "nominal.yaml" in refused(capsys, command, str(case))


def test_yaml_within_the_limits_is_read() -> None:
    """Aliases are allowed, as long as what they stand for is of a size that somebody would write."""
    check_yaml("a: &a [1, 2]\nb: [*a, *a]\nc: {d: *a}\n")
    check_yaml("{" + ", ".join(f"k{i}: {i}" for i in range(9_000)) + "}")
    with pytest.raises(YamlError, match="more than 20,000 values"):
        check_yaml("{" + ", ".join(f"k{i}: {i}" for i in range(10_001)) + "}")


@pytest.mark.parametrize("word", ["4:00", "no", "2026-13-45", "2026-01-01", "0x10"])
def test_a_plain_word_is_what_it_looks_like(word: str, case: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`rate_hz: 4:00` was 240, by YAML 1.1's numbers to the base of 60; `010` was 8."""
    text = (case / "nominal.yaml").read_text()
    (case / "nominal.yaml").write_text(re.sub("rate_hz: .*", f"rate_hz: {word}", text))
    assert f"rate_hz: must be a finite number in Hz, got '{word}'" in refused(capsys, "gap", str(case))
    (case / "numbers.yaml").write_text("[010, 1e-3, -.5, +12, .inf, true, null, ~, 1.]")
    assert read_yaml(case / "numbers.yaml") == [10.0, 0.001, -0.5, 12, float("inf"), True, None, None, 1.0]


def test_json_that_is_deep_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Verdicts and answers."""
    (tmp_path / "v.json").write_text("[" * 200_000)
    assert "nested too deep" in refused(capsys, "score", f"verdicts={tmp_path}/v.json", f"answers={tmp_path}/v.json")
    with pytest.raises(RunnerError, match="nested too deep"):
        read_json(tmp_path / "v.json")


# Size ----------------------------------------------------------------------------------------------------------------


def sparse(path: Path, size: int) -> None:
    """Make a file of a size that takes no room."""
    with path.open("wb") as file:
        file.truncate(size)


@pytest.mark.parametrize(
    ("name", "size", "most"),
    [
        ("recording.parquet", 5 * GB, "1,000 MB"),
        ("recording.csv", 5 * GB, "128 MB"),
        ("nominal.yaml", 5 * GB, "1 MB"),
    ],
)
def test_a_sparse_file_is_refused_by_its_size(
    name: str, size: int, most: str, case: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A size of 5 GB that takes no room on the disk is not read at all."""
    if name.endswith("csv"):
        (case / "recording.parquet").unlink()
    sparse(case / name, size)
    err = refused(capsys, "gap", str(case))
    assert f"{case / name}: has 5,000 MB, at most {most} of such a file are read." in err


# `ru_maxrss` would begin with the size of the process that this one was forked from
MEASURED = """
import re, sys
from pathlib import Path
from runner.__main__ import main
code = main(sys.argv[1:])
print(re.search(r"VmHWM:\\s*(\\d+)", Path("/proc/self/status").read_text())[1])
sys.exit(code)
"""


def test_a_small_file_of_many_rows_is_refused_before_it_is_read(case: Path) -> None:
    """60 million rows of nothing are a few MB; their number stands in the file's own description."""
    rows = 6_000_000
    chunk = pa.table(dict.fromkeys(("episode", "t", "x", "y", "yaw"), pa.nulls(rows, pa.float64())))
    with pq.ParquetWriter(case / "recording.parquet", chunk.schema) as writer:
        for _ in range(10):
            writer.write_table(chunk)
    del chunk
    assert (case / "recording.parquet").stat().st_size < 20_000_000
    done = subprocess.run(
        [sys.executable, "-c", MEASURED, "gap", str(case), f"out={case}/../out"],
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    assert "has 60,000,000 rows, at most 5,000,000 are read; split the recording." in done.stderr
    assert int(done.stdout) < 1_000_000  # KB


def test_a_column_that_is_not_asked_for_is_not_read(case: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Lists of millions behind a few bytes, in a column of no interest, cost nothing."""
    asked: list[str] = []
    read = pq.ParquetFile.read

    def noting(self: pq.ParquetFile, columns: list[str], **options: Any) -> pa.Table:
        asked.extend(columns)
        return read(self, columns, **options)

    monkeypatch.setattr(pq.ParquetFile, "read", noting)
    table = pq.read_table(case / "recording.parquet")
    asked.clear()
    lists = pa.array([np.zeros(2_000_000)] + [None] * (table.num_rows - 1))
    pq.write_table(table.append_column("lists", lists), case / "recording.parquet")
    assert "not part of the planar form and not used: 'lists'" in read_case(case).notes
    assert "x" in asked
    assert "lists" not in asked
    pq.write_table(table.drop_columns("x").append_column("x", lists), case / "recording.parquet")
    with pytest.raises(RunnerError, match=r"column 'x' must be numbers in m, it holds list<"):
        read_case(case)


def test_a_long_text_in_every_row_is_looked_at_once(case: Path) -> None:
    """A dictionary of one text of 10 MB, 100 million times in the file's meaning, is refused as no number."""
    table = pq.read_table(case / "recording.parquet")
    word = pa.DictionaryArray.from_arrays(pa.array([0] * table.num_rows, pa.int32()), pa.array(["9" * 10_000_000]))
    pq.write_table(table.drop_columns("x").append_column("x", word), case / "recording.parquet")
    frame = table.to_pandas()
    with pytest.raises(RunnerError) as error:
        read_case(case)
    assert len(str(error.value)) < 1000
    assert "column 'x' must be" in str(error.value)
    good = pa.array(frame["x"].map(repr)).dictionary_encode()
    pq.write_table(table.drop_columns("x").append_column("x", good), case / "recording.parquet")
    np.testing.assert_array_equal(
        np.concatenate([e.pose[:, 0] for e in read_case(case).episodes]), frame["x"].to_numpy()
    )


def test_a_limit_on_cells(tmp_path: Path) -> None:
    """Rows times columns."""
    limits.check_shape(tmp_path, limits.ROWS, 20)
    with pytest.raises(RunnerError, match="5,000,000 rows of 21 columns, at most 100,000,000 numbers are read"):
        limits.check_shape(tmp_path, limits.ROWS, 21)


# MJCF ----------------------------------------------------------------------------------------------------------------

GEOM = '<geom size=".1"/>'


@pytest.mark.parametrize(
    ("inside", "message"),
    [
        (f'<worldbody><replicate count="1000000000">{GEOM}</replicate></worldbody>', "<replicate> makes 1,000,000,000"),
        (
            f'<worldbody><replicate count="200"><replicate count="200">{GEOM}</replicate></replicate></worldbody>',
            "<replicate> makes 40,000 copies, allowed: 10,000 in all",
        ),
        ('<worldbody><flexcomp type="grid" count="900 900 900" name="f"/></worldbody>', "<flexcomp> makes 729,000,000"),
        ('<size memory="900G"/>', "<size memory> sets aside 900G, allowed: at most 1,000,000,000"),
        (
            '<asset><model name="k" file="k.xml"/></asset><worldbody><replicate count="200">'
            '<frame><attach model="k" body="b" prefix="p"/></frame></replicate></worldbody>',
            "<attach> makes 20,000 copies, allowed: 10,000 in all",
        ),
        ('<worldbody><replicate count="200"><include file="k.xml"/></replicate></worldbody>', "makes 20,000 copies"),
        ('<include file="a.xml"/><include file="a.xml"/>', r"a\.xml: is included more than once"),
        ("<worldbody>" + "<body>" * 300 + "</body>" * 300 + "</worldbody>", "nested deeper than 200 levels"),
    ],
)
def test_a_model_that_stands_for_too_much_is_refused(inside: str, message: str, tmp_path: Path) -> None:
    """Copies, memory and depth are looked at before MuJoCo compiles anything."""
    (tmp_path / "a.xml").write_text("<mujoco/>")
    (tmp_path / "k.xml").write_text(
        f'<mujoco><worldbody><body name="b"><replicate count="100">{GEOM}</replicate></body></worldbody></mujoco>'
    )
    (tmp_path / "model.xml").write_text(f"<mujoco>{inside}</mujoco>")
    with pytest.raises(RunnerError, match=message):
        read_mjcf(tmp_path / "model.xml")


@pytest.mark.parametrize(
    ("inside", "message"),
    [
        (
            '<asset><model name="k" file="model.xml"/></asset>',  # before: the process ended with a segmentation fault
            r"model\.xml: is included more than once, or includes itself",
        ),
        (
            '<asset><model name="k" file="code.xml"/></asset>',
            r"code\.xml: <extension> needs a plugin, which is code",
        ),
        (
            '<asset><model name="k" file="out.xml"/></asset>',
            r"out\.xml: <mesh file>: must lie in the folder of the case",
        ),
        (
            '<compiler meshdir="m"/><asset><mesh name="a" file="link.stl"/></asset>',
            r"a file: must lie in the folder of the case .*, got 'm/link\.stl'",
        ),
    ],
)
def test_what_a_model_takes_in_lies_in_its_folder(inside: str, message: str, tmp_path: Path) -> None:
    """A model that is attached is looked through as an included one is, and a mesh where MuJoCo looks for it."""
    (tmp_path / "elsewhere.stl").write_bytes(b"")
    folder = tmp_path / "case"
    (folder / "m").mkdir(parents=True)
    (folder / "m/link.stl").symlink_to(tmp_path / "elsewhere.stl")
    (folder / "code.xml").write_text('<mujoco><extension><plugin plugin="mujoco.pid"/></extension></mujoco>')
    (folder / "out.xml").write_text('<mujoco><asset><mesh name="a" file="../elsewhere.stl"/></asset></mujoco>')
    (folder / "model.xml").write_text(f"<mujoco>{inside}</mujoco>")
    for read in (read_mjcf, referenced_files):
        with pytest.raises(RunnerError, match=message):
            read(folder / "model.xml")
