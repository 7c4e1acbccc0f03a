"""`list`, `show`, `view` and `doctor`: all names, all of one, the viewer, and whether all is well."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from pathlib import Path

import pytest

from runner.__main__ import main
from runner.commands import _self_test, doctor, view
from runner.commands._catalogue import GROUPS, Kind, files, listed, names
from runner.commands._described import described
from runner.commands._self_test import Comparison, sliding, swinging
from runner.effects import mechanism, planar_box

EFFECTS = sorted({*planar_box.EFFECTS, *(cls.name for cls in mechanism.EFFECTS)})
WIDTH = 80


def said(capsys: pytest.CaptureFixture[str], *arguments: str, code: int = 0) -> str:
    """Return what a command prints, which must fit."""
    assert main(arguments) == code
    out, err = capsys.readouterr()
    assert err == ""
    assert all(len(line) <= WIDTH for line in out.splitlines())
    assert "\x1b" not in out
    return out


@pytest.mark.parametrize("kind", Kind, ids=lambda kind: kind.value)
def test_everything_is_listed_with_what_it_is(kind: Kind, capsys: pytest.CaptureFixture[str]) -> None:
    """Each name, and something of it, within 80 columns."""
    out = said(capsys, "list", kind.value)
    _, rows = listed(kind)
    assert rows
    for row in rows:
        assert row[0] in out
        assert all(cell.strip() for cell in row)


def test_lists_hold_all_effects_and_all_files() -> None:
    """What is registered, and what stands in `conf/`."""
    assert sorted({row[0] for row in listed(Kind.effects)[1]}) == EFFECTS
    for kind in GROUPS:
        assert [row[0] for row in listed(kind)[1]] == [file.stem for file in files(kind)]
    assert {row[0] for row in listed(Kind.numbers)[1]} >= {"noise.window_s", "mechanism.replay.max_length_s"}
    assert {row[0] for row in listed(Kind.formats)[1]} >= {".csv", ".mcap", ".rrd"}


def test_parts_of_one_s_own_are_listed_and_shown(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Those of a folder of configs that `--config-dir` names, beside those that are always there."""
    (tmp_path / "forces").mkdir()
    mine = tmp_path / "forces" / "mine.yaml"
    mine.write_text("# A slow sine.\ndefaults: [schema_chirp, _self_]\nforce_n: 12.0\n")
    own = ["--config-dir", str(tmp_path)]
    assert main(["list", "forces", *own]) == 0
    out = capsys.readouterr().out
    assert "mine" in out
    assert "A slow sine." in out
    assert "chirp" in out
    assert main(["show", "mine", *own]) == 0
    assert "force_n: 12.0" in capsys.readouterr().out
    assert main(["show", "mine"]) == 2


@pytest.mark.parametrize("name", EFFECTS)
def test_every_effect_can_be_shown(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    """All variants: law, every parameter with its bounds, what it is confounded with, what to change."""
    out = said(capsys, "show", name)
    variants = described(name)
    assert variants
    for variant in variants:
        assert variant.effect.label in " ".join(out.split())
        assert all(p.name in out for p in variant.parameters)
        assert all(p.lower <= p.upper and p.scale > 0 for p in variant.parameters)
        assert all(f"Confounded with {other.name}" in out for other in variant.effect.confounded)
        assert " ".join(variant.phrase.remedy.split())[:30] in " ".join(out.split())
    assert out.count("What to change") == len(variants)
    assert "?" not in "".join(v.phrase.amount for v in variants)


def test_a_target_is_left_out_and_files_are_shown(capsys: pytest.CaptureFixture[str]) -> None:
    """As a verdict names it; forces, estimators and experiments by their file; what there is not by the nearest."""
    assert said(capsys, "show", "backlash[elbow]").startswith("backlash[JOINT], of a joint: play between")
    limited = said(capsys, "show", "actuator_saturation[shoulder]")  # which a box has as well
    assert limited.startswith("actuator_saturation[ACTUATOR], of an actuator")
    assert "of a box" not in limited
    guard = said(capsys, "show", "guard")  # an estimator and an experiment
    assert "estimator=guard: conf/estimator/guard.yaml" in guard
    assert "experiment=guard: conf/experiment/guard.yaml" in guard
    assert "# The published experiment" in said(capsys, "show", "paper")
    assert main(["show", "bcklash"]) == 2
    assert "nothing is called 'bcklash'. `runner list effects` has all names." in (err := capsys.readouterr().err)
    assert err.endswith("Did you mean 'backlash'?\n")
    assert set(EFFECTS) < set(names())
    assert main(["list", "effect"]) == 2
    assert "what: no 'effect'. Valid: 'effects', " in capsys.readouterr().err


@pytest.fixture
def opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the file in which a viewer that stands beside Python says how it was called."""
    beside, called = tmp_path / "bin", tmp_path / "called.txt"
    beside.mkdir()
    (beside / "rerun").write_text(f'#!/bin/sh\necho "$@" > {called}\nexit 3\n')
    (beside / "rerun").chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(beside / "python"))
    monkeypatch.setenv("PATH", "/nowhere")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    return called


def test_the_viewer_is_opened(
    opened: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """That of the environment, with the file of the folder; its exit code is handed on."""
    (tmp_path / "out").mkdir()
    (tmp_path / "out/diagnosis.rrd").touch()
    for web in ("--web", "web=true"):
        assert main(["view", str(tmp_path / "out"), web]) == 3
        assert opened.read_text() == f"{tmp_path}/out/diagnosis.rrd --serve-web --bind 127.0.0.1\n"
    assert main(["view", str(tmp_path / "out"), "--web", "bind=0.0.0.0"]) == 3
    assert opened.read_text().endswith("--bind 0.0.0.0\n")
    monkeypatch.setenv("DISPLAY", ":0")
    assert main(["view", "--web", "false", str(tmp_path / "out/diagnosis.rrd")]) == 3
    assert opened.read_text() == f"{tmp_path}/out/diagnosis.rrd\n"
    # a name that begins as an option does is none to the viewer
    monkeypatch.chdir(tmp_path)
    (tmp_path / "out/diagnosis.rrd").rename("--serve.rrd")
    assert main(["view", "path=--serve.rrd"]) == 3
    assert opened.read_text() == f"{tmp_path}/--serve.rrd\n"


def test_what_cannot_be_viewed_is_one_line(
    opened: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """No display, no viewer, no recording, several of them, another file."""
    folder = tmp_path / "out"
    folder.mkdir()

    def refused(*arguments: str) -> str:
        assert main(["view", *arguments]) == 2
        err = capsys.readouterr().err
        assert err.count("\n") == 1
        return err

    assert "no .rrd file in" in refused(str(folder))
    (folder / "a.rrd").touch()
    assert f"serve it with: runner view {folder}/a.rrd --web" in refused(str(folder))
    (folder / "b.rrd").touch()
    assert "several .rrd files in" in refused(str(folder))
    assert "no file or folder 'nowhere'" in refused("nowhere")
    (folder / "x.txt").touch()
    assert "must be an .rrd file" in refused(str(folder / "x.txt"))
    (tmp_path / "bin/rerun").unlink()
    assert "no program 'rerun', neither beside" in refused(str(folder / "a.rrd"), "--web")
    assert not opened.exists()


def test_closed_forms_are_met_and_told_from_others() -> None:
    """A box stops where it should, a pendulum swings as it should; a per mille off is off."""
    for outcome in (sliding(), swinging()):
        assert outcome.off < 1e-4
        assert outcome.passed
    assert sliding().exact == pytest.approx(2.0**2 / (2 * 0.3 * 9.81))
    small = 2 * math.pi * math.sqrt((0.02 + 1.5 * 0.4**2) / (1.5 * 9.81 * 0.4))
    assert swinging().exact == pytest.approx(small * (1 + 1 / 16 + 11 / 3072 + 173 / 737280), rel=1e-4)
    assert not Comparison("", "m", 1.002, 1.0).passed
    assert not Comparison("", "m", math.nan, 1.0).passed


def test_doctor_says_what_is_here(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """Versions, machine and self-test; what is off makes exit code 1."""
    out = said(capsys, "doctor")
    for text in ("mujoco", "cores", "GiB free", "Rerun viewer", "sliding distance", "pendulum's period", "All is well"):
        assert text in out
    monkeypatch.setattr(doctor, "sliding", lambda: Comparison("sliding distance", "m", 1.0, 0.7))
    out = said(capsys, "doctor", code=1)
    assert "OFF" in out
    assert "Something is wrong" in out
    assert doctor.swinging is _self_test.swinging
    assert view.viewer() is not None


def test_colours_are_left_out_where_they_are_not_wanted() -> None:
    """`NO_COLOR` on what rich takes for a terminal: no colour is sent, and 80 columns are kept."""
    code = "import sys; from runner.__main__ import main; sys.exit(main(['list', 'systems']))"
    environment = {**os.environ, "NO_COLOR": "1", "FORCE_COLOR": "1", "COLUMNS": "80", "TERM": "xterm-256color"}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    assert "\x1b[3" not in done.stdout.replace("\x1b[3m", "")  # italics are no colour
    assert "\x1b[4" not in done.stdout
    assert "mechanism" in done.stdout
