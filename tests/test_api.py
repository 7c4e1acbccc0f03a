"""The Python API: quick to import, tables of everything, arrays as cases, errors in one line."""

from __future__ import annotations

import errno
import gc
import inspect
import io
import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pandas as pd
import pytest

import runner
from runner.__main__ import main
from runner.diagnosis.verdict import FILE
from runner.recording import write_case
from runner.recording.model_form import read_model_case
from runner.storage.reading import read_json
from tests.cases import made
from tests.pages import ROOT, run_cell, run_page

FRICTION_NM = 0.15  # of the lever of the page
LEVER = """<mujoco><option timestep="0.001"/><worldbody><body name="lever">
<joint name="hinge" axis="0 -1 0" damping="0.05"/><inertial pos="0 0 -0.3" mass="1" diaginertia="0.01 0.01 0.01"/>
<site name="imu"/></body></worldbody><actuator><motor name="drive" joint="hinge"/></actuator>
<sensor><jointpos name="encoder" joint="hinge"/></sensor></mujoco>"""


def swung() -> dict[str, np.ndarray]:
    """Return a lever that was swung three times, by plain MuJoCo, with noise."""
    model = mujoco.MjModel.from_xml_string(LEVER)
    data, rng, rows = mujoco.MjData(model), np.random.default_rng(0), []
    for episode in range(3):
        mujoco.mj_resetData(model, data)
        for k in range(121):
            data.ctrl[0] = 2.0 * np.sin(2 * np.pi * (0.4 + 0.2 * episode) * k * 0.01 + episode)
            rows.append((episode, 0.01 * k, data.ctrl[0], data.qpos[0], data.qvel[0]))
            mujoco.mj_step(model, data, nstep=10)
    names = ["episode", "t", "u", "q", "dq"]
    table = dict(zip(names, np.array(rows).T, strict=True))
    table["q"] += 1e-3 * rng.standard_normal(len(rows))
    table["dq"] += 1e-2 * rng.standard_normal(len(rows))
    return table


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("model") / "lever.xml"
    path.write_text(LEVER)
    return path


def lever(model: Path, folder: Path | None = None) -> runner.Case:
    table = swung()
    return runner.case_from_arrays(
        model,
        t=table["t"],
        commands={"u_drive": table["u"]},
        channels={"q_hinge": table["q"], "dq_hinge": table["dq"]},
        episodes=table["episode"],
        folder=folder,
    )


@dataclass(frozen=True)
class Page:
    """What the page on Python did.

    Attributes:
        folder: Where.
        names: What its blocks made.
        printed: What they printed, in calls.
    """

    folder: Path
    names: dict[str, Any]
    printed: list[str]


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Page:
    """Run the page in a folder of its own, once for all tests: it diagnoses a lever of its own arrays."""
    folder, printed = tmp_path_factory.mktemp("page"), []
    (folder / "examples").symlink_to(ROOT / "examples")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        names = run_page("docs/python.md", print=lambda *told: printed.append(" ".join(map(str, told))))
    return Page(folder, names, printed)


@pytest.fixture
def found(page: Page, monkeypatch: pytest.MonkeyPatch) -> runner.CaseDiagnosis:
    """The diagnosis of the page, where its case lies."""
    monkeypatch.chdir(page.folder)
    return page.names["diagnosis"]


def test_the_page_on_python_is_true(page: Page) -> None:
    """Every block, in order; the friction that the lever has is found."""
    names = page.names
    assert names["gap"].table["noises"].to_numpy().max() > 10
    assert names["diagnosis"].effects == ("joint_friction[hinge]",)
    assert names["after"].table["noises"].to_numpy().max() < names["before"].table["noises"].to_numpy().max()
    (friction,) = names["table"].query("effects == 'joint_friction[hinge]'")["value"]
    assert friction == pytest.approx(0.15, abs=0.005)
    assert {"diagnosis.png", "results", "corrected", "lever.xml", "lever"} <= {p.name for p in page.folder.iterdir()}
    out = "\n".join(page.printed)
    assert "fitting joint_friction[hinge]" in out
    assert "Joint 'hinge' has more dry friction than in the model: 0.1" in out


def test_the_notebook_is_true(
    page: Page, found: runner.CaseDiagnosis, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Cell after cell: its masses come to 3 kg, its lever is the page's, and what it shows can be shown."""
    (tmp_path / "lever").symlink_to(page.folder / "lever")
    monkeypatch.chdir(tmp_path)

    def diagnosed(case: runner.Case, **how: bool) -> runner.CaseDiagnosis:
        assert how == {"advise": False}
        pd.testing.assert_frame_equal(case.data, found.case.data)
        pd.testing.assert_frame_equal(case.effects, found.case.effects)
        return found

    monkeypatch.setattr(runner, "diagnose", diagnosed)
    content = json.loads((ROOT / "examples" / "first_hour.ipynb").read_text(encoding="utf-8"))
    assert (content["nbformat"], len({c["id"] for c in content["cells"]})) == (4, len(content["cells"]))
    names: dict = {}
    shown = []
    for cell in content["cells"]:
        if cell["cell_type"] == "code":
            assert (cell["outputs"], cell["execution_count"]) == ([], None)
            shown.append(run_cell("".join(cell["source"]), names))
    assert names["runs"]["mass_final_kg"].to_numpy() == pytest.approx(3.0, rel=0.01)
    assert len(names["axes"].lines) == 5
    assert names["found"] is found
    assert all(hasattr(thing, "_repr_html_") for thing in (shown[0], shown[2], found, found.where))
    assert (tmp_path / "corrected" / "corrected.yaml").is_file()


def test_importing_it_imports_nothing_else() -> None:
    """Not even what everything stands on, until it is used."""
    heavy = "mujoco", "numba", "matplotlib", "numpy", "pandas", "rich", "rerun", "runner.api"
    code = f"import sys, runner; dir(runner); print([m for m in {heavy!r} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("[]\n", "")


def test_reading_a_case_is_quiet(tmp_path: Path) -> None:
    """No warning of a missing display, and no line: what is to be said is in the result."""
    left = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY", "MUJOCO_GL")}
    case = tmp_path / "case"
    write_case(made(episodes=2, seconds=1.0)[0], case)
    code = f"import runner; runner.gap(runner.read({str(case)!r})); print('done')"
    done = subprocess.run([sys.executable, "-c", code], env=left, capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("done\n", "")


def test_names_are_there_typed_and_described() -> None:
    """Every name of `__all__` can be used, says what it is, and states the type of everything that it takes."""
    assert set(runner.__all__) <= set(dir(runner))
    for name in runner.__all__:
        value = getattr(runner, name)
        assert inspect.getdoc(value)
        if inspect.isfunction(value):
            signature = inspect.signature(value)
            assert signature.return_annotation is not inspect.Signature.empty
            assert all(p.annotation is not inspect.Parameter.empty for p in signature.parameters.values())
    with pytest.raises(AttributeError, match="no attribute 'diagnos'"):
        runner.diagnos  # noqa: B018


def test_friction_is_found_in_arrays(found: runner.CaseDiagnosis) -> None:
    """Dry friction that plain MuJoCo had and the MJCF lacks; the value within four standard errors."""
    assert found.effects == ("joint_friction[hinge]",)
    assert found.probability > 0.9
    assert next(iter(found.ranked["effects"])) == "joint_friction[hinge]"
    assert found.ranked["probability"].to_numpy().sum() == pytest.approx(1.0)
    assert {"none", "unknown"} <= set(found.ranked["effects"])
    (row,) = found.table().query("effects == 'joint_friction[hinge]'").to_dict("records")
    assert abs(row["value"] - FRICTION_NM) < 4 * row["standard_error"]
    assert list(found.corrected.values["value"]) == [row["value"]]
    assert list(found.closure["channel"]) == ["q_hinge"]
    assert (found.closure["after"].to_numpy() < 0.1 * found.closure["before"].to_numpy()).all()
    assert found.where.sentence
    assert {"share", "q"} <= set(found.where.cells)


def test_it_says_what_it_is_at(page: Page) -> None:
    """Noise, search, check, place, advice; the effects that are fitted, and the best so far."""
    begun = next(i for i, line in enumerate(page.printed) if line.startswith("step 1 of 6, measuring the noise"))
    told = page.printed[begun : page.printed.index(page.names["diagnosis"].sentence)]
    stages = list(dict.fromkeys(", ".join(re.split("[,;] ", line)[:2]) for line in told))
    assert stages[:4] == [
        "step 1 of 6, measuring the noise",
        "step 2 of 6, searching",
        "step 3 of 6, checking on the episodes left out",
        "step 4 of 6, telling where the gap lies",
    ]
    assert any("fitting joint_friction[hinge]" in line for line in told)
    assert "so far best joint_friction[hinge]" in told[-1]


def test_corrected_model_closes_the_gap(found: runner.CaseDiagnosis, tmp_path: Path) -> None:
    """As an object, and as the files that it was saved to, in plain MuJoCo too."""
    before, after = (runner.gap(found.case, model=m).table for m in (None, found.corrected))
    assert after["noises"].to_numpy().max() < 0.2 * before["noises"].to_numpy().max()
    found.corrected.save(tmp_path / "corrected")
    again = runner.gap(found.case, model=tmp_path / "corrected").table
    pd.testing.assert_frame_equal(again, after, rtol=1e-9)
    friction = mujoco.MjModel.from_xml_path(str(tmp_path / "corrected/model.xml")).dof_frictionloss[0]
    # MuJoCo writes six digits, of which the last may be half a unit off
    assert friction == pytest.approx(found.corrected.values["value"].to_numpy()[0], rel=5e-6)


@pytest.mark.usefixtures("undrawn")
def test_report_is_that_of_the_command(
    found: runner.CaseDiagnosis, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The same files, whose table is the same again, from `runner table` too."""
    assert found.report(tmp_path / "out") == tmp_path / "out/report.html"
    assert {"report.html", "diagnosis.rrd", "verdict.json", "corrected.yaml", "model.xml"} <= {
        p.name for p in (tmp_path / "out").iterdir()
    }
    assert read_json(tmp_path / "out" / FILE)["ranked"][0]["effects"] == ["joint_friction[hinge]"]
    written, own = runner.read_table(tmp_path / "out"), found.table()
    assert set(written["case"]) == {str(tmp_path / "out")}
    pd.testing.assert_frame_equal(written.drop(columns="case"), own.drop(columns="case"))
    assert main(["table", str(tmp_path / "out"), "--format", "csv"]) == 0
    pd.testing.assert_frame_equal(pd.read_csv(io.StringIO(capsys.readouterr().out), keep_default_na=True), written)
    (tmp_path / "out/verdict.json").write_text('{"ranked": []}')
    with pytest.raises(runner.RunnerError, match=r"verdict\.json: `ranked` must be a list of explanations"):
        runner.read_table(tmp_path / "out")


def test_figure_and_page_for_notebooks(found: runner.CaseDiagnosis, tmp_path: Path) -> None:
    """The figure has two drawings; the pages hold the verdict and no tag of anybody's name."""
    figure = found.plot()
    assert [ax.get_xlabel() for ax in figure.axes] == ["probability", "missed, in noise levels (dotted: the noise)"]
    figure.savefig(tmp_path / "plot.png")
    assert (tmp_path / "plot.png").stat().st_size > 5000
    assert "more dry friction than in the model" in found._repr_html_()
    for thing in (found.case, found.corrected, found.where, runner.gap(found.case)):
        assert "<table" in thing._repr_html_()


def test_case_of_arrays_is_a_case_on_disk(model: Path, tmp_path: Path) -> None:
    """What is read back are the numbers that were given; a case without a folder lasts as long as it is used."""
    table = swung()
    kept = lever(model, tmp_path / "kept")
    recording = read_model_case(tmp_path / "kept")
    assert [len(e) for e in recording.episodes] == [121] * 3
    np.testing.assert_array_equal(np.concatenate([e.values[:, 0] for e in recording.episodes]), table["q"])
    np.testing.assert_array_equal(np.concatenate([e.commands[:, 0] for e in recording.episodes]), table["u"])
    np.testing.assert_array_equal(kept.data["dq_hinge"], table["dq"])
    assert list(kept.episodes["samples"]) == [121] * 3
    assert "joint_friction[hinge]" in set(kept.effects["effect"])
    assert repr(kept) == f"Case('{tmp_path / 'kept'}': 3 episodes, 363 samples of q_hinge, dq_hinge)"
    passing = lever(model)
    path = passing.path
    assert path.name == "lever"
    assert path.is_dir()
    del passing
    gc.collect()
    assert not path.exists()


def test_orientations_forces_and_sensors(tmp_path: Path) -> None:
    """Arrays of several columns: an orientation, a force on a body, one number of a sensor."""
    (tmp_path / "free.xml").write_text(
        '<mujoco><worldbody><body name="cup"><freejoint/><geom size=".1"/><site name="imu"/></body></worldbody>'
        '<sensor><gyro name="gyro" site="imu"/></sensor></mujoco>'
    )
    t = np.arange(50) * 0.01
    case = runner.case_from_arrays(
        tmp_path / "free.xml",
        t=t,
        channels={"pose": np.tile([1.0, 0, 0, 0], (50, 1)), "x": 0 * t, "spin": 0 * t},
        sources={
            "pose": {"body": "cup", "quantity": "orientation"},
            "x": {"body": "cup", "quantity": "position", "axis": "x"},
            "spin": {"sensor": "gyro", "index": 2},
        },
        forces=[{"body": "cup", "force": np.zeros((50, 3)), "point": np.zeros((50, 3))}],
        noise={"x": 1e-3},
    )
    assert list(case.channels["channel"]) == ["pose.x", "pose.y", "pose.z", "x", "spin"]
    assert case.channels["noise"].to_numpy()[3] == 1e-3


T = np.arange(10) * 0.01
REFUSED: dict[str, tuple[dict[str, Any], str]] = {
    "no such model": ({"model": "nowhere.xml"}, r"model: no file 'nowhere\.xml'\."),
    "length": ({"channels": {"q_hinge": T[1:]}}, r"'q_hinge': must have shape \(10,\), as long as t, got \(9,\)\."),
    "text": ({"channels": {"q_hinge": ["a"] * 10}}, "'q_hinge': must be numbers"),
    "name": ({"channels": {"q_hing": T}}, "channels: 'q_hing' does not say what it measures.*Did you mean 'q_hinge'"),
    "command": ({"commands": {"u_driv": T}}, "commands: 'u_driv' is no actuator.*Valid: 'drive'"),
    "source": ({"sources": {"q": {"joint": "hinge"}}}, "sources: 'q' is neither a channel nor a command"),
    "joint": ({"sources": {"q_hinge": {"joint": "hing", "quantity": "position"}}}, "no joint 'hing' in the model"),
    "time": ({"t": T[::-1]}, "row 2"),
    "episodes": ({"episodes": T}, "column 'episode'"),
    "twice": (
        {"commands": {"drive": T}, "channels": {"drive": T}, "sources": {"drive": {}}},
        "'drive': is there twice",
    ),
    "noise": ({"noise": {"q_hinge": -1.0}}, r"noise\.q_hinge: must be a finite number > 0"),
    "start": ({"start": "sit"}, "start: unknown 'sit'"),
}


@pytest.mark.parametrize("wrong", REFUSED)
def test_wrong_arrays_are_one_line(wrong: str, model: Path) -> None:
    """Which array, what was wrong, what is allowed; no folder that is gone is named."""
    arguments, message = REFUSED[wrong]
    given: dict[str, Any] = {"model": model, "t": T, "channels": {"q_hinge": 0.1 * T}} | arguments
    with pytest.raises(runner.RunnerError, match=message) as error:
        runner.case_from_arrays(**given)
    assert "\n" not in str(error.value)
    assert "/tmp/runner_" not in str(error.value)
    assert f"{model.stem}/" not in str(error.value)  # nor a file that nobody has named


def test_a_case_is_written_over_where_that_is_said(model: Path, tmp_path: Path) -> None:
    """Not over anything else, and not by what is none."""
    folder = tmp_path / "kept"
    given: dict[str, Any] = {"model": model, "t": T, "channels": {"q_hinge": 0.1 * T}}
    backwards: dict[str, Any] = given | {"t": T[::-1]}
    other: dict[str, Any] = given | {"channels": {"q_hinge": 0.2 * T}}
    runner.case_from_arrays(**given, folder=folder)
    with pytest.raises(runner.RunnerError, match="row 2"):
        runner.case_from_arrays(**backwards, folder=folder, overwrite=True)
    assert runner.read(folder).data["q_hinge"].max() == pytest.approx(0.009)
    again = runner.case_from_arrays(**other, folder=folder, overwrite=True)
    assert again.path == folder
    assert runner.read(folder).data["q_hinge"].max() == pytest.approx(0.018)
    (folder / "nominal.yaml").unlink()
    with pytest.raises(runner.RunnerError, match="holds something other than a case"):
        runner.case_from_arrays(**given, folder=folder, overwrite=True)


@pytest.mark.parametrize("fresh", [True, False])
def test_a_case_that_cannot_be_written_leaves_the_one_before(
    fresh: bool, model: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A disk that fills up while the table is copied; what was there is as it was, and nothing is beside it."""
    folder = tmp_path / "kept"
    given: dict[str, Any] = {"model": model, "t": T, "channels": {"q_hinge": 0.1 * T}}
    other: dict[str, Any] = given | {"channels": {"q_hinge": 0.2 * T}}
    if not fresh:
        runner.case_from_arrays(**given, folder=folder)
    before = {path: path.read_bytes() for path in folder.rglob("*")}
    copied = shutil.copy2

    def full(source: str, target: str, **how: Any) -> str:
        if "kept" in str(target) and str(source).endswith(".parquet"):
            raise OSError(errno.ENOSPC, "No space left on device")
        return copied(source, target, **how)

    monkeypatch.setattr(shutil, "copytree", partial(shutil.copytree, copy_function=full))
    with pytest.raises(runner.RunnerError, match=r"'.*kept' can't be written: .*No space left on device"):
        runner.case_from_arrays(**other, folder=folder, overwrite=True)
    assert {path: path.read_bytes() for path in folder.rglob("*")} == before
    assert folder.exists() is not fresh


def test_a_folder_that_cannot_be_looked_into_is_one_line(model: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As where its owner is somebody else."""

    def refused(_: Path) -> Iterator[Path]:
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(Path, "iterdir", refused)
    with pytest.raises(runner.RunnerError, match="can't be looked into: Permission denied"):
        runner.case_from_arrays(model, t=T, channels={"q_hinge": 0.1 * T}, folder=model.parent)


def test_folders_that_hold_something_are_left_alone(model: Path, found: runner.CaseDiagnosis, tmp_path: Path) -> None:
    """A case is not written over anything, a report not over a case."""
    lever(model, tmp_path / "kept")
    with pytest.raises(runner.RunnerError, match="is not empty; name a new one, or write over it with overwrite=True"):
        lever(model, tmp_path / "kept")
    with pytest.raises(runner.RunnerError, match="holds a recording"):
        found.report(tmp_path / "kept")
    with pytest.raises(runner.RunnerError, match="no folder 'nowhere'"):
        runner.read_table("nowhere")
    with pytest.raises(runner.RunnerError, match="no such file or folder"):
        runner.read(tmp_path / "nowhere")
