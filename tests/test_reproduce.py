"""`runner reproduce` repeats a stored run from its own folder: the same bits, or a line that says what differs."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pandas as pd
import pytest
import yaml

from runner.__main__ import main
from runner.storage.run_status import FILE

SHORT = ("forces.pushes=1", "forces.rest_s=0.3", "link=noisy")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run with every log, and a sweep of two."""
    place = tmp_path_factory.mktemp("stored")
    assert main([*SHORT, "effect=[viscous_drag]", "log.frames=steps", f"out={place / 'one'}"]) == 0
    assert main(["-m", "start.mass_kg=1,2", *SHORT, "log.rrd=off", f"out={place / 'many'}"]) == 0
    return place


def test_a_run_and_a_run_of_a_sweep_are_reproduced(
    made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Wherever the folder lies now, and from wherever: frames, steps, summary and `.rrd` are the same.

    A name that begins as an option does is none to Rerun, which compares the `.rrd`.
    """
    shutil.copytree(made / "one", tmp_path / "-elsewhere" / "one")
    monkeypatch.chdir(tmp_path)
    assert main(["reproduce", "folder=-elsewhere/one"]) == 0
    files = "summary.parquet, frames.parquet, run.rrd, steps.parquet"
    assert capsys.readouterr().out == f"-elsewhere/one: reproduced bit for bit: {files}.\n"
    assert main(["reproduce", str(made / "many" / "1")]) == 0
    assert "reproduced bit for bit: summary.parquet, frames.parquet." in capsys.readouterr().out
    assert {p.name for p in tmp_path.iterdir()} == {"-elsewhere"}


def _frame(folder: Path) -> None:
    table = pd.read_parquet(folder / "frames.parquet")
    table.loc[3, "remote_x_m"] += 1e-16 + table.loc[3, "remote_x_m"] * 1e-15
    table.to_parquet(folder / "frames.parquet", index=False)


def _row(folder: Path) -> None:
    pd.read_parquet(folder / "summary.parquet").assign(mass_final_kg=3.0).to_parquet(folder / "summary.parquet")


def _gone(folder: Path) -> None:
    (folder / "frames.parquet").unlink()


def _recording(folder: Path) -> None:
    whole = (folder / "run.rrd").read_bytes()
    (folder / "run.rrd").write_bytes(whole[: len(whole) // 2])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (_frame, "frames.parquet: 'remote_x_m' is"),
        (_row, "summary.parquet: 'mass_final_kg' of row 1 is 3.0, now"),
        (_gone, "frames.parquet: is not there."),
        (_recording, "run.rrd: holds something else"),
    ],
)
def test_what_differs_is_named(
    made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], change: Callable[[Path], None], words: str
) -> None:
    """The last bit of one number counts; the exit code is 1."""
    shutil.copytree(made / "one", tmp_path / "one")
    change(tmp_path / "one")
    assert main(["reproduce", str(tmp_path / "one")]) == 1
    out = capsys.readouterr().out
    assert words in out
    assert out.endswith("one: not reproduced.\n")


def test_other_versions_are_said(made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """What made the run stands in it; where that was something else, a line names both."""
    shutil.copytree(made / "many", tmp_path / "many")
    noted = yaml.safe_load((tmp_path / "many" / FILE).read_text())
    noted["sessions"][-1]["versions"]["mujoco"] = "3.16.0"
    (tmp_path / "many" / FILE).write_text(yaml.safe_dump(noted))
    assert main(["reproduce", str(tmp_path / "many" / "0")]) == 0
    assert "made with another program than this (mujoco 3.16.0, now 3.17.0)." in capsys.readouterr().out


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("mass_kg: 1.0", "mass_kg: 1.5", "config.yaml is not what the run was made with"),
        ("mass_kg: 1.0", "mass_kg: [1, 2]", "start.mass_kg: "),
        ("mass_kg: 1.0", "mass_kg: -1.0", "start.mass_kg: must be"),
        ("dof: planar", "dof: flying", "scene.dof: "),
        ("_target_: runner.physics.forces.PaperForces", "_target_: os.system", "no class 'os.system' is registered"),
        ("seed: 0", "seed: *a", "config.yaml: line"),
        ("seed: 0", "seed: 0\nsurplus: 1", "surplus: no such key"),
        ("# runner run", "# runner run +++=", "its first line is no command"),
    ],
)
def test_settings_of_a_stranger(
    made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], old: str, new: str, words: str
) -> None:
    """Changed, wrong, or with classes that nobody registered: one line, exit code 2, nothing executed."""
    (tmp_path / "one").mkdir()
    for name in ("summary.parquet", FILE):
        shutil.copy(made / "one" / name, tmp_path / "one")
    text = (made / "one" / "config.yaml").read_text()
    assert old in text
    (tmp_path / "one" / "config.yaml").write_text(text.replace(old, new, 1))
    assert main(["reproduce", str(tmp_path / "one")]) == 2
    err = capsys.readouterr().err
    assert words in err
    assert err.count("\n") == 1


def test_what_is_no_run(made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A sweep, nothing, a folder without a run, a run that did not end, what another command left."""

    def line(folder: Path) -> str:
        assert main(["reproduce", str(folder)]) == 2
        return capsys.readouterr().err

    assert "is a sweep; name one of its runs" in line(made / "many")
    assert "is no folder" in line(tmp_path / "none")
    assert "holds no run: there is no run.yaml in it" in line(tmp_path)
    shutil.copytree(made / "one", tmp_path / "one")
    (tmp_path / "one" / "summary.parquet").unlink()
    assert "holds no result" in line(tmp_path / "one")
    noted = (tmp_path / "one" / FILE).read_text()
    (tmp_path / "one" / FILE).write_text(noted.replace("command: run", "command: diagnose"))
    assert "holds the results of 'runner diagnose'" in line(tmp_path / "one")
