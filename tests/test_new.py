"""What `runner new` writes works as it stands; completion is a script that bash takes."""

from __future__ import annotations

import importlib.util
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import runner
from runner import commands
from runner.__main__ import main
from runner.commands import _new, completion, new_effect
from runner.effects import mechanism, planar_box


@pytest.fixture
def clone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder in the place of the project's."""
    monkeypatch.setattr(new_effect, "checkout", lambda: tmp_path)
    return tmp_path


@pytest.mark.parametrize("kind", ["planar_box", "mechanism"])
def test_a_new_effect_is_one_that_can_be_told(
    kind: str, clone: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its class is in the vocabulary once its file is run, and its own test passes."""
    assert main(["new", "effect", "weak_side", f"system={kind}"]) == 0
    assert main(["new", "effect", "weak_side", f"system={kind}"]) == 2
    assert "is there already" in capsys.readouterr().err
    assert (clone / "conf" / "effect" / "weak_side.yaml").exists() is (kind == "planar_box")
    file = clone / "runner" / "effects" / kind / "weak_side.py"
    spec = importlib.util.spec_from_file_location("weak_side", file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "weak_side", module)
    known = list(mechanism.EFFECTS)
    try:
        spec.loader.exec_module(module)
        tests: dict = {}
        exec(compile((clone / "tests" / "test_effect_weak_side.py").read_text(), "test", "exec"), tests)
        found = [test() for name, test in tests.items() if name.startswith("test_")]
        assert len(found) == 2
    finally:
        planar_box.EFFECTS.pop("weak_side", None)
        mechanism.EFFECTS[:] = known


@pytest.mark.parametrize(
    ("name", "message"), [("Weak", "must be lower case letters"), ("friction", "there is a 'friction' already")]
)
def test_names_that_can_t_be(name: str, message: str, clone: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One line, and nothing is written."""
    assert main(["new", "effect", name]) == 2
    assert message in capsys.readouterr().err
    assert list(clone.iterdir()) == []


def test_an_installed_program_has_no_place_for_effects(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """It says so, and what to do instead."""
    monkeypatch.setattr(_new, "config_dir", lambda: tmp_path / "conf")
    assert main(["new", "effect", "weak_side"]) == 2
    assert "adds files to a clone of the project" in capsys.readouterr().err


def test_a_new_system_is_a_case(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its script records, its test passes, and the gap shows what the recording has and the model lacks."""
    monkeypatch.chdir(tmp_path)
    assert main(["new", "system", "gripper"]) == 0
    monkeypatch.syspath_prepend(str(tmp_path / "gripper"))
    try:
        tests: dict = {"__file__": str(tmp_path / "gripper" / "test_gripper.py")}
        exec(compile((tmp_path / "gripper" / "test_gripper.py").read_text(), "test", "exec"), tests)
        tests["test_the_model_follows_itself"]()
    finally:
        sys.modules.pop("record", None)
    assert runner.read("gripper").channels["channel"].tolist() == ["q_hinge"]


def test_completion(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """Commands, settings and names are offered; of a command of two words both."""
    monkeypatch.setattr(commands, "names", lambda: ("run", "blind make", "show", "completion"))
    assert main(["completion", "bash"]) == 0
    script = capsys.readouterr().out
    bash = shutil.which("bash")
    if bash is None:
        pytest.skip("no bash on this machine")
    (tmp_path / "zebra.csv").touch()
    for typed, offered in {
        "runner sh": ["show"],
        "runner show backl": ["backlash"],
        "runner blind m": ["make"],
        "runner blind make see": ["seed="],
        "runner run start.m": ["start.mass_kg="],
        "runner run ou": ["out="],
        "runner run forces = pap": ["paper"],
        "runner run forces=pap": ["forces=paper"],
        "runner gap recording = ze": ["zebra.csv"],
        "runner gap ze": ["zebra.csv"],
    }.items():
        words = typed.split()
        ask = f"COMP_WORDS=({typed}); COMP_CWORD={len(words) - 1}; _runner 2>/dev/null; echo ${{COMPREPLY[@]}}"
        done = subprocess.run([bash, "-c", script + ask], capture_output=True, text=True, check=True, cwd=tmp_path)
        assert done.stdout.split() == offered, typed
    monkeypatch.setattr(completion, "script", lambda: "")
    assert main(["completion", "zsh"]) == 0
    assert "bashcompinit" in capsys.readouterr().out


def test_a_folder_of_configs_of_one_s_own(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`--config-dir` finds parts by name, beside those that come along; a folder that is not there is said."""
    (tmp_path / "forces").mkdir()
    own = "defaults: [schema_straight, _self_]\nforce_n: [12.0, 0.0, 0.0]\n"
    (tmp_path / "forces" / "gentle.yaml").write_text(own, encoding="utf-8")
    assert main(["--config-dir", str(tmp_path), "forces=gentle", "--config"]) == 0
    assert "- 12.0" in capsys.readouterr().out
    assert main([f"--config-dir={tmp_path}", "forces=gentel"]) == 2
    assert "forces: no 'gentel'." in capsys.readouterr().err
    assert main(["--config-dir", str(tmp_path / "nowhere"), "forces=gentle"]) == 2
    assert "--config-dir: needs a folder" in capsys.readouterr().err
