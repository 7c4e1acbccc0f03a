"""`runner run` from its YAML files to its results folder."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

from runner.__main__ import main

CONF = Path(__file__).parents[1] / "conf"
BRIEF = ("forces.pushes=2", "forces.rest_s=0.3", "log.rrd=off")


def test_the_published_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The default command ends below 1e-6, prints its table, and leaves everything in its folder."""
    assert main([f"out={tmp_path}/paper"]) == 0
    out = capsys.readouterr().out
    assert "final relative error" in out
    assert f"runner view {tmp_path}/paper" in "".join(out.splitlines())
    folder = tmp_path / "paper"
    names = {"config.yaml", "versions.yaml", "run.yaml", "frames.parquet", "run.rrd", "summary.parquet"}
    assert names <= {p.name for p in folder.iterdir()}
    (row,) = pd.read_parquet(folder / "summary.parquet").to_dict("records")
    assert (row["mass_true_kg"], row["mass_start_kg"], row["status"]) == (3.0, 1.0, "done")
    assert abs(row["mass_final_error"]) < 1e-6
    assert 10 <= row["simulated_s"] <= 20
    assert yaml.safe_load((folder / "config.yaml").read_text())["remote"]["mass_kg"] == 3.0
    assert yaml.safe_load((folder / "versions.yaml").read_text())["mujoco"] == "3.17.0"


def test_a_run_is_a_recording(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`gap` replays the remote cube: less than a millimetre is missed with the true mass, far more with another."""
    errors = {}
    for mass in (3.0, 2.0):
        folder = tmp_path / f"{mass:g}"
        assert main([f"out={folder}", f"start.mass_kg={mass}", *BRIEF]) == 0
        assert main(["gap", str(folder), f"out={tmp_path}/gap_{mass:g}"]) == 0
        table = pd.read_parquet(tmp_path / f"gap_{mass:g}" / "gap.parquet")
        errors[mass] = float(
            table.query("channel == 'x' and starts == 'fitted' and horizon == 'episode'")["rms"].item()
        )
    assert errors[3.0] < 1e-3  # another grid of base points
    assert errors[2.0] > 0.01
    assert "holds the truth without noise" in capsys.readouterr().out
    (tmp_path / "2" / "config.yaml").write_text("remote: {}\n")
    assert main(["gap", str(tmp_path / "2")]) == 2
    assert "does not say what the run began with" in capsys.readouterr().err


def test_two_runs_leave_the_same_frames(tmp_path: Path) -> None:
    """The same command twice gives the same Parquet file, byte for byte, with `.rrd` and without."""
    for name, log in (("a", "log.rrd=off"), ("b", "log.rrd=full")):
        assert main([f"out={tmp_path}/{name}", "forces.pushes=2", "link=poor", log]) == 0
    assert (tmp_path / "a" / "frames.parquet").read_bytes() == (tmp_path / "b" / "frames.parquet").read_bytes()


def is_study(name: str) -> bool:
    """Whether an experiment is a sweep or a study, or builds upon one."""
    text = yaml.safe_load((CONF / "experiment" / f"{name}.yaml").read_text()) or {}
    chosen = text.get("defaults", [])
    built_upon = [c for c in chosen if isinstance(c, str) and c != "_self_"]
    return "hydra" in text or any("override /study" in c for c in chosen) or any(map(is_study, built_upon))


@pytest.mark.parametrize("name", sorted(p.stem for p in (CONF / "experiment").glob("*.yaml")))
def test_every_experiment_runs_briefly(name: str, tmp_path: Path) -> None:
    """Each file in conf/experiment composes, runs and leaves a row. Studies have tests of their own."""
    if is_study(name):
        pytest.skip("a sweep, or a study")
    assert main([f"out={tmp_path}/x", f"experiment={name}", *BRIEF]) == 0
    assert pd.read_parquet(tmp_path / "x" / "summary.parquet")["status"].tolist() == ["done"]


@pytest.mark.parametrize("group", ["scene", "forces", "start", "link", "follow", "estimator", "log", "remote"])
def test_every_choice_runs_briefly(group: str, tmp_path: Path) -> None:
    """Each file of each group composes and runs."""
    for file in sorted((CONF / group).glob("*.yaml")):
        extra = []
        if group == "forces":
            (tmp_path / "f.csv").write_text("t,fx,fy\n0,0,0\n0.1,20,0\n0.3,0,0\n")
            extra = [f"forces.path={tmp_path}/f.csv"] if file.stem == "csv" else []
        brief = BRIEF if group != "forces" else ("log.rrd=off",)
        assert main([f"out={tmp_path}/{file.stem}", f"{group}={file.stem}", *brief, *extra]) == 0, file


def test_a_sweep_is_a_table_and_failures_are_rows(tmp_path: Path) -> None:
    """Three jobs, the middle one impossible: three rows in order, with what was swept, and one reason."""
    code = main(["-m", f"out={tmp_path}/sweep", "link.rate_hz=60,45,30", *BRIEF])
    assert code != 0
    rows = pd.read_parquet(tmp_path / "sweep" / "summary.parquet")
    assert rows["link.rate_hz"].tolist() == [60, 45, 30]
    assert rows["status"].tolist() == ["done", "failed", "done"]
    assert "link.rate_hz" in rows["reason"].tolist()[1]


def test_a_diverged_run_is_a_row_and_not_a_success(tmp_path: Path) -> None:
    """A run that blows up exits with 1 and says so in its row."""
    code = main([f"out={tmp_path}/x", "start.mass_kg=1e-12", "forces.force_n=1e6", "log.rrd=off"])
    assert code == 1
    row = pd.read_parquet(tmp_path / "x" / "summary.parquet").iloc[0]
    assert row["status"] == "diverged"
    assert row["reason"].startswith("MuJoCo warned")
    assert np.isnan(row["mass_to_1pct_s"])
