"""What a user can put right is never called a bug: one line, exit code 2."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from runner.__main__ import LONGEST, main
from runner.errors import WriteError
from runner.storage.writing import write_text
from runner.teleop import loop, tables

BRIEF = ("forces.pushes=2", "forces.rest_s=0.3", "log.rrd=off")


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Work in an empty folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def refused(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """Return the line that a command line is refused with."""
    capsys.readouterr()
    assert main(arguments) == 2
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    assert "a bug" not in err
    return err.strip()


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        (
            "start.mass_kg=1e-300",
            "start.mass_kg: 1e-300 kg makes the smallest inertia 1.67e-301 kg m2; MuJoCo takes",
        ),
        ("remote.mass_kg=1e-300", "remote.mass_kg: 1e-300 kg makes the smallest inertia"),
        ("start.inertia_kg_m2=[1e-200,1e-200,1e-200]", "start.mass_kg: 1 kg makes the smallest inertia 1e-200 kg m2"),
        ("start.com_m=[9,0,0]", "start.com_m[0]: must be a finite number in [-0.5, 0.5] m"),
        ("effect=[friction, mass, friction]", "effect: 'friction' is named twice, allowed: once."),
        ("~link.noise", "link.noise: can't be taken out, it must be a section with position_m"),
        ("~start.mass_kg", "start.mass_kg: can't be taken out, it must be a number; set it to another value."),
        ("~start.mas_kg", "start.mas_kg: no such key."),
        ("forces.rest_s=1000", "steps of 0.00208333 s; a run may have 5,000,000."),
    ],
)
def test_settings(setting: str, message: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Masses that are none to MuJoCo, keys that can't be taken out, commands that fill the memory."""
    pushes = ("forces.pushes=10000",) if setting.startswith("forces") else BRIEF
    assert message in refused(capsys, *pushes, setting)
    assert not Path("results").exists()


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"", "it is empty"),
        (b" \n", "it is empty"),
        (bytes(range(128, 256)), "can't decode byte 0x80"),
        (b"run seed=1,2 \0\0\0", "it is binary"),
        (b'run "seed=1,2', "(No closing quotation)"),
        (b"run " + b"x" * 2_000_000, "has 2 MB, at most 1 MB of such a file are read"),
    ],
)
def test_a_sweep_s_memory_that_is_none(content: bytes, reason: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Empty, binary, cut off in a quotation, huge."""
    Path("s").mkdir()
    Path("s", tables.SWEEP).write_bytes(content)
    err = refused(capsys, "resume=s")
    assert "s/sweep.txt" in err
    assert reason in err


def test_a_table_goes_into_files_alone(capsys: pytest.CaptureFixture[str]) -> None:
    """Not into a folder, and never into the place of a device or a pipe."""
    assert main([*BRIEF, "out=r"]) == 0
    Path("here").mkdir()
    assert refused(capsys, "table", "r", "out=here") == "here: can't be written: is a folder; name a file in it."
    os.mkfifo("pipe.csv")
    assert refused(capsys, "table", "r", "out=pipe.csv") == ("pipe.csv: can't be written: is no regular file.")
    assert Path("pipe.csv").is_fifo()
    assert "can't be written" in refused(capsys, "table", "r", "out=/proc/t.csv")


@pytest.mark.parametrize("place", ["/proc/x", "/sys/x", "r.txt", "r.txt/below", "n" * 300])
def test_a_folder_that_can_not_be_made(place: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Read-only, in the place of a file, below one, too long a name."""
    Path("r.txt").write_text("")
    assert refused(capsys, *BRIEF, f"out={place}").startswith(f"out: can't make the folder '{place}': ")


def test_a_name_that_is_too_long(capsys: pytest.CaptureFixture[str]) -> None:
    """Of a recording: what the system says of it."""
    assert refused(capsys, "gap", "n" * 300) == "n" * 300 + ": File name too long."


@pytest.mark.parametrize("sweep", [False, True])
def test_a_folder_that_vanishes(
    sweep: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Taken away while a run is under way."""
    name = "runner.commands.run." + ("run_batch" if sweep else "run")
    before = sys.modules["runner.commands.run"].__dict__[name.rpartition(".")[2]]

    def vanishing(*arguments: Any, **options: Any) -> Any:
        shutil.rmtree("r")
        return before(*arguments, **options)

    monkeypatch.setattr(name, vanishing)
    err = refused(capsys, *(("-m", "start.mass_kg=1,2") if sweep else ()), *BRIEF, "out=r")
    assert "No such file or directory" in err
    assert "r/" in err


def test_memory_that_does_not_suffice(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """The error of NumPy is a MemoryError with a line of its own."""

    def much(*_: Any) -> None:
        raise MemoryError("Unable to allocate 35.8 GiB for an array with shape (4802400240,) and data type int64")

    monkeypatch.setattr(loop, "commands", much)
    assert refused(capsys, *BRIEF).startswith("The memory does not suffice for this: Unable to allocate 35.8 GiB")


def test_a_graphics_library_that_is_not_there() -> None:
    """Nothing is drawn by OpenGL: what MuJoCo was to draw with is not loaded, whether it is there or not."""
    code = "import runner.__main__, mujoco"
    env = {**os.environ, "MUJOCO_GL": "none-such", "PYTHONPATH": str(Path(__file__).parents[1])}
    done = subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.skipif(not Path("/dev/full").is_char_device(), reason="there is no /dev/full")
@pytest.mark.parametrize("command", [["--version"], ["table", "r"]])
def test_a_full_device_behind_stdout(command: list[str]) -> None:
    """What can't be printed is said on stderr, once."""
    assert main([*BRIEF, "out=r"]) == 0
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "runner", *command],
            env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])}, stdout=full, stderr=subprocess.PIPE,
            text=True, check=False,
        )  # fmt: skip
    assert (done.returncode, done.stderr) == (
        2,
        "What was to be printed can't be written: No space left on device.\n",
    )


def test_a_line_is_never_longer_than_can_be_read(capsys: pytest.CaptureFixture[str]) -> None:
    """What a stranger wrote may be long: its middle is left out, what is allowed stands at the end."""
    err = refused(capsys, *BRIEF, f"seed={'x' * 100_000}")
    assert len(err) < LONGEST + 10
    assert err.startswith("seed: must be a whole number")


def test_a_long_name_is_written_beside_its_place(folder: Path) -> None:
    """The name beside the place is not longer than names may be."""
    write_text(folder / ("n" * 250 + ".txt"), "there")
    with pytest.raises(WriteError, match="File name too long"):
        write_text(folder / ("n" * 260 + ".txt"), "there")
