"""`runner table`: any number of run folders, one row for each run, in four formats."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from runner.__main__ import main
from runner.api.tables import verdict_table
from runner.commands.table import Format, written

ROWS = [
    {"job": 0, "start": 0.1 + 0.2, "name": "a|b", "error": 1e-17},
    {"job": 1, "start": 2.0, "name": "c", "error": np.nan},
    {"job": 10, "start": 3.0, "name": "d", "error": 1 / 3},
]


@pytest.fixture
def sweep(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Write a sweep of three runs."""
    monkeypatch.chdir(tmp_path)
    for row in ROWS:
        folder = tmp_path / "sweep" / str(row["job"])
        folder.mkdir(parents=True)
        pd.DataFrame([row]).to_parquet(folder / "summary.parquet", index=False)
    return tmp_path / "sweep"


def test_csv_keeps_every_digit(sweep: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """What is printed as CSV reads back exactly, in run order (2 before 10)."""
    assert main(["table", str(sweep), "--format", "csv"]) == 0
    table = pd.read_csv(io.StringIO(capsys.readouterr().out))
    assert table["job"].tolist() == [0, 1, 10]
    for row, (_, got) in zip(ROWS, table.iterrows(), strict=True):
        assert got["start"] == row["start"]
        assert got["error"] == row["error"] or (np.isnan(got["error"]) and np.isnan(row["error"]))


@pytest.mark.parametrize("name", ["t.csv", "t.md", "t.txt", "t.parquet", "deep/er/t.csv"])
def test_file_ending_chooses_the_format(sweep: Path, name: str, capsys: pytest.CaptureFixture[str]) -> None:
    """`out=FILE` writes the format of its ending, in folders that need not be there."""
    assert main(["table", str(sweep), f"out={name}"]) == 0
    assert capsys.readouterr().out == f"3 runs in {name}\n"
    file = sweep.parent / name
    if file.suffix == ".parquet":
        assert len(pd.read_parquet(file)) == 3
    else:
        mark = {".csv": "a|b,", ".md": "| a\\|b |", ".txt": "0.3333"}[file.suffix]
        assert mark in file.read_text()


def test_several_folders_one_table(sweep: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Folders are put together in the order given, a folder's `run` column says where a row is from."""
    assert main(["table", str(sweep / "10"), str(sweep / "0"), "--format=csv"]) == 0
    table = pd.read_csv(io.StringIO(capsys.readouterr().out))
    assert table["job"].tolist() == [10, 0]
    assert [Path(run).name for run in table["run"]] == ["10", "0"]


@pytest.mark.parametrize("runs", [1, 2, 3, 5])
def test_text_fits_the_terminal(runs: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """80 columns, however long a value is; one that fits is as it was."""
    monkeypatch.setenv("COLUMNS", "80")
    rows = pd.DataFrame([{"mass_final_kg": 3.0, "versions": "mujoco 3.17.0, " * 30, "host": "vm"}] * runs)
    text = written(rows, Format.text)
    assert max(map(len, text.splitlines())) <= 80
    assert "…" in text
    assert text.count("vm") == runs


def test_a_verdict_is_read_from_above() -> None:
    """Each explanation once, with its numbers below it, within 80 columns; no probability of 1e-126."""
    names = " + ".join(f"{name}[upper_arm_link]" for name in ("actuator_saturation", "joint_friction", "inertia"))
    ranked = [
        {
            "effects": names.split(" + "),
            "probability": 0.94,
            "gap_closed": 0.861,
            "parameters": {"inertia[upper_arm_link]": {"ratio": 1.27}, "joint_friction[upper_arm_link]": {"a": 2.0}},
            "standard_errors": {"inertia[upper_arm_link]": {"ratio": 0.014}},
        },
        {"effects": ["unknown"], "probability": 0.06, "parameters": {}, "standard_errors": {}},
        {"effects": ["none"], "probability": 1.4e-126, "gap_closed": 0.0, "parameters": {}, "standard_errors": {}},
    ]
    lines = written(verdict_table("results/arm", ranked), Format.text).splitlines()
    assert lines[0] == "results/arm"
    assert lines[2].startswith("       0.94        86 %  actuator_saturation[upper_arm_link] +")
    assert [line.strip() for line in lines if ".ratio" in line] == ["inertia[upper_arm_link].ratio 1.270 ± 0.014"]
    assert lines[-1] == "     < 0.01         0 %  none"
    assert max(map(len, lines)) <= 80


def test_rows_are_named_in_every_block(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a table too wide for the terminal, whose columns stand in blocks below each other."""
    monkeypatch.setenv("COLUMNS", "80")
    columns = {f"a_long_name_of_a_column_{i}": float(i) for i in range(6)}
    text = written(pd.DataFrame([{"run": f"sweep/{i}", **columns} for i in range(4)]), Format.text)
    heads = [line for line in text.splitlines() if "a_long_name" in line]
    assert len(heads) > 1
    assert all(line.startswith("run ") for line in heads)
    assert [text.count(f"sweep/{i}") for i in range(4)] == [len(heads)] * 4


def test_markdown_has_a_cell_for_every_value() -> None:
    """Every row of the Markdown has as many cells as the header, signs that separate cells are escaped."""
    lines = written(pd.DataFrame(ROWS), Format.markdown).splitlines()
    assert len(lines) == 5
    assert {line.replace("\\|", "").count("|") for line in lines} == {5}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "paths: a value is needed (a list of paths, as in [a,b])."),
        (["nowhere"], "paths: no folder 'nowhere'."),
        (["."], "paths: no 'summary.parquet' in '.'"),
        (["x", "--format", "xml"], "format: no 'xml'. Valid: 'csv', 'markdown', 'parquet', 'text'."),
        (["x", "--format", "parquet"], "out: a file is needed for format=parquet."),
    ],
)
def test_refusals(
    tmp_path: Path, arguments: list[str], message: str, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    """What can't be tabulated is one line."""
    monkeypatch.chdir(tmp_path)
    assert main(["table", *arguments]) == 2
    err = capsys.readouterr().err
    assert message in err
    assert err.count("\n") == 1
