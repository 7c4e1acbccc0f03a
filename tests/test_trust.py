"""Configs, sweeps and results folders of strangers run nothing: they are refused in one line with exit code 2."""

from __future__ import annotations

import pickle
import shlex
from pathlib import Path
from typing import Any

import pytest

from runner import commands
from runner.__main__ import main
from runner.commands import _compose
from runner.commands._trust import read_nothing_kept
from runner.teleop.tables import SWEEP

SHORT = ("forces.pushes=2", "forces.rest_s=0.3", "log.rrd=off")


class _Harm:
    """Makes a file when it is unpickled."""

    def __init__(self, done: Path) -> None:
        self.done = done

    def __reduce__(self) -> tuple[Any, ...]:
        return Path.touch, (self.done,)


@pytest.fixture
def harm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the file that is there once something of the stranger's has run: `harm.pkl` or `harm.py` would make it."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    done = tmp_path / "harmed"
    (tmp_path / "harm.pkl").write_bytes(pickle.dumps(_Harm(done)))
    (tmp_path / "harm.py").write_text(f"open({str(done)!r}, 'w')\n")
    with (tmp_path / "harm.pkl").open("rb") as file:  # it would
        pickle.load(file)
    assert done.exists()
    done.unlink()
    return done


CALLBACK = "{_target_: pandas.read_pickle, filepath_or_buffer: harm.pkl}"
# what could run something, and what of it is named
SETTINGS = {
    f"+hydra.callbacks.x={CALLBACK}": "hydra.callbacks: can't be set",
    "+hydra.job.env_set.LD_PRELOAD=harm.so": "hydra.job.env_set: can't be set",
    "+hydra.job_logging.handlers.x={'()': pandas.read_pickle, filepath_or_buffer: harm.pkl}": "hydra.job_logging.h",
    "hydra/job_logging=default": "hydra.job_logging.formatters",
    "hydra.sweeper._target_=harm.Sweeper": "hydra.sweeper._target_: can't be set",
    "hydra.launcher._target_=harm.Launcher": "hydra.launcher._target_: 'harm.Launcher' is none of the launchers",
    "hydra.searchpath=[pkg://harm]": "hydra.searchpath: must be folders, as in [file:///home/me/conf], got 'pkg://harm'.",
    "hydra.searchpath=[structured://harm]": "got 'structured://harm'.",
}


def refused(capsys: pytest.CaptureFixture[str], harm: Path, *arguments: str) -> str:
    """Return the line with which a command line is refused, and see to it that nothing was run or written."""
    before = sorted(harm.parent.rglob("*"))
    assert main(arguments) == 2
    out, err = capsys.readouterr()
    assert not harm.exists()
    assert out == ""
    assert err.count("\n") == 1
    assert sorted(harm.parent.rglob("*")) == before
    return err


@pytest.mark.parametrize("sweep", [(), ("-m", "seed=1,2")], ids=["run", "sweep"])
@pytest.mark.parametrize("setting", SETTINGS)
def test_a_setting_that_runs_something_is_refused(
    setting: str, sweep: tuple[str, ...], harm: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of Hydra's own keys only launcher, mode, searchpath and sweeper.params can be set."""
    assert SETTINGS[setting] in refused(capsys, harm, setting, *sweep, *SHORT)


@pytest.mark.parametrize(
    "setting", [s for s in SETTINGS if "searchpath" in s] + [f"+hydra.callbacks.x={CALLBACK}", "hydra/launcher=ray"]
)
def test_a_sweep_of_a_stranger_runs_nothing(setting: str, harm: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """What its folder sets of Hydra is not taken over, harmless launchers and numbers apart, but shown."""
    folder = harm.parent / "theirs"
    folder.mkdir()
    settings = [setting] if setting != "hydra/launcher=ray" else [setting, "hydra.launcher.address=evil.example:6379"]
    (folder / SWEEP).write_text(shlex.join(["run", "seed=1,2", *SHORT, *settings]) + "\n")
    line = refused(capsys, harm, "resume=theirs")
    assert f"'{settings[-1]}', which may run programs" in line
    assert shlex.quote(settings[-1]) in line


def test_own_sweep_is_resumed_with_its_launcher(harm: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The name of a launcher and numbers are taken from the folder; a text once it is typed again."""
    folder = harm.parent / "own"
    folder.mkdir()
    joblib = ["hydra/launcher=joblib", "hydra.launcher.n_jobs=1", "hydra.launcher.prefer=threads"]
    (folder / SWEEP).write_text(shlex.join(["run", "seed=1,2", *SHORT, *joblib]) + "\n")
    assert "'hydra.launcher.prefer=threads', which may run programs" in refused(capsys, harm, "resume=own")
    assert main(["resume=own", "hydra.launcher.prefer=threads"]) == 0
    assert capsys.readouterr().out == "2 runs in own\n"


EXPERIMENTS = {
    f"hydra: {{callbacks: {{x: {CALLBACK}}}}}": "hydra.callbacks: can't be set",
    "hydra: {job_logging: {handlers: {x: {'()': harm.run}}}}": "hydra.job_logging.handlers",
    "defaults: [{override /hydra/launcher: joblib}]": "hydra.launcher._target_: a launcher starts programs",
    f"remote: {{effects: {{x: {CALLBACK}}}}}": "remote.effects.x._target_: no class 'pandas.read_pickle' is registered",
}


@pytest.mark.parametrize("content", EXPERIMENTS)
@pytest.mark.parametrize("sweep", [(), ("-m", "seed=1,2")], ids=["run", "sweep"])
def test_an_experiment_of_a_stranger_runs_nothing(
    content: str, sweep: tuple[str, ...], harm: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A file may ask for a sweep and say of which values; no class, no launcher, no log handler."""
    folder = harm.parent / "conf/experiment"
    folder.mkdir(parents=True)
    (folder / "theirs.yaml").write_text(f"# @package _global_\n{content}\n")
    words = ("hydra.searchpath=[conf]", "experiment=theirs", *SHORT, *sweep)
    if "effects" in content and sweep:  # what is below the command's own keys is found by the job
        assert main([*words, "out=made"]) == 1
        assert EXPERIMENTS[content] in capsys.readouterr().err
        assert not harm.exists()
    else:
        assert EXPERIMENTS[content] in refused(capsys, harm, *words)


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ("start: {mass_kg: '${oc.env:SECRET}'}", "start.mass_kg"),
        ("start: {mass_kg: '1${ oc.env:SECRET}'}", "start.mass_kg"),
        ("hydra: {sweeper: {params: {seed: '${oc.env:SECRET}'}}}", "hydra.sweeper.params.seed"),
    ],
)
def test_an_experiment_of_a_stranger_does_not_read_the_environment(
    text: str, key: str, harm: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Else it would stand in the results, which are sent on."""
    monkeypatch.setenv("SECRET", "1.2345")
    (harm.parent / "conf/experiment").mkdir(parents=True)
    (harm.parent / "conf/experiment/theirs.yaml").write_text(f"# @package _global_\n{text}\n")
    message = refused(capsys, harm, f"hydra.searchpath=[file://{harm.parent}/conf]", "experiment=theirs", *SHORT)
    assert message.startswith(f"{key}: '")
    assert "is taken from elsewhere than from a key" in message
    assert "1.2345" not in message


def test_an_experiment_of_ones_own_folder_is_found(harm: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A folder of configs may be added, and an experiment in it may be a sweep."""
    folder = harm.parent / "conf/experiment"
    folder.mkdir(parents=True)
    (folder / "mine.yaml").write_text(
        "# @package _global_\nhydra: {mode: MULTIRUN, sweeper: {params: {start.mass_kg: '1,2'}}}\n"
    )
    assert main(["hydra.searchpath=[conf]", "experiment=mine", "out=made", *SHORT]) == 0
    assert capsys.readouterr().out == "2 runs in made\n"


def test_submitit_finds_no_pickle_that_was_there_before(tmp_path: Path) -> None:
    """It reads what a job gave back from a folder whose name nobody can have known."""
    with _compose.composer("run", commands.load("run")) as hydra:
        folders = set()
        for _ in range(2):
            own = hydra.bare(["hydra/launcher=submitit_local"], place=f"'{tmp_path}'")
            read_nothing_kept(own)
            folders.add(own.hydra.launcher.submitit_folder)
    assert len(folders) == 2
    assert all(f.startswith(f"{tmp_path}/.submitit/") and f.endswith("/%j") for f in folders)
