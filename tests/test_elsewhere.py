"""A folder of cases by a launcher: what came of each is found in its folder, a process that is lost costs its own."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import pytest

from runner.__main__ import main
from runner.diagnosis.verdict import ALL, FILE
from runner.errors import ConfigError, LauncherError
from runner.outputs.elsewhere import NOTE, elsewhere
from runner.outputs.many import diagnose_many
from runner.recording import write_case
from runner.storage.holding import holding
from tests.cases import made


class _Lost(Exception):
    """Stands for a process that is killed: what it would have noted is not there."""


class Nodes:
    """In place of a launcher: makes so many calls at a time, and loses what is at work where one is killed."""

    def __init__(self, together: int) -> None:
        self.together, self.launched = together, list[int]()

    def __call__(self, calls: Sequence[Callable[[], object]]) -> None:
        self.launched.append(len(calls))
        for i in range(0, len(calls), self.together):
            lost = False
            for call in calls[i : i + self.together]:
                try:
                    call()
                except _Lost:
                    lost = True
            if lost:
                raise LauncherError("hydra/launcher: a worker died.")


def _told(what: str) -> str | None:
    """Be a call: well, with a problem, or killed."""
    if what == "killed":
        raise _Lost
    return None if what == "well" else what


def _ended(nodes: Nodes, what: dict[str, str], place: Path) -> dict[str, str | None]:
    calls = {name: partial(_told, words) for name, words in what.items()}
    return dict(elsewhere(nodes, calls, {name: place / name for name in what}))


def test_what_came_of_each_is_known(tmp_path: Path) -> None:
    """Well, or what was wrong; nothing is left of the notes."""
    nodes = Nodes(2)
    what = {"a": "well", "b": "no such column", "c": "well"}
    assert _ended(nodes, what, tmp_path) == {"a": None, "b": "no such column", "c": None}
    assert nodes.launched == [3]
    assert not list(tmp_path.rglob(NOTE))


@pytest.mark.parametrize("together", [1, 2, 5])
def test_a_lost_process_costs_its_own(tmp_path: Path, together: int) -> None:
    """Whatever was beside it and after it is done; it is tried once more alone, and then given up."""
    nodes = Nodes(together)
    what = {"a": "well", "heavy": "killed", "c": "well", "d": "well", "worse": "killed", "f": "well"}
    ended = _ended(nodes, what, tmp_path)
    for name in ("heavy", "worse"):
        assert ended.pop(name) == "its process was killed (the memory may not suffice): hydra/launcher: a worker died."
    assert ended == dict.fromkeys("acdf")
    assert len(nodes.launched) <= 5


def test_a_launcher_that_can_t_begin_gives_all_up(tmp_path: Path) -> None:
    """As where there is no cluster: it is asked no more often than there are calls, and its words are told."""

    def none(calls: Sequence[Callable[[], object]]) -> None:
        raise LauncherError("hydra/launcher: ConnectionError: no cluster.")

    calls = {name: partial(_told, "well") for name in "ab"}
    ended = dict(elsewhere(none, calls, {name: tmp_path / name for name in "ab"}))
    assert all("ConnectionError: no cluster" in str(problem) for problem in ended.values())


def test_what_a_process_is_still_at_is_not_begun(tmp_path: Path) -> None:
    """One that outlives the command, as in a cluster: nothing is done beside it, not even of the others."""
    (tmp_path / "b").mkdir()
    nodes = Nodes(2)
    with holding(tmp_path / "b"), pytest.raises(ConfigError, match=r"b': a process is still at it; end it, or wait\.$"):
        _ended(nodes, {"a": "well", "b": "well"}, tmp_path)
    assert nodes.launched == []
    assert _ended(nodes, {"a": "well", "b": "well"}, tmp_path) == {"a": None, "b": None}


def test_cases_by_a_launcher_are_resumed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Cases that have a verdict are not done again; the verdicts are those of the cases diagnosed here."""
    write_case(made(episodes=2, seconds=1.0)[0], tmp_path / "cases" / "good")
    (tmp_path / "cases" / "bad").mkdir()
    (tmp_path / "cases" / "bad" / "recording.csv").write_text("t,x\n0,0\n")
    (tmp_path / "cases" / "bad" / "nominal.yaml").write_text("mass: 1\n")
    (tmp_path / "out").mkdir()
    monkeypatch.chdir(tmp_path)
    named = {name: Path("cases") / name for name in ("good", "bad")}
    nodes = Nodes(2)
    failed = diagnose_many(named, Path("out"), report=False, spread=nodes)
    assert set(failed) == {"bad"}
    assert nodes.launched == [2]
    verdict = (tmp_path / "out" / "good" / FILE).read_bytes()
    assert set(json.loads((tmp_path / "out" / ALL).read_text())) == {"good"}
    assert diagnose_many(named, Path("out"), report=False, spread=nodes) == failed
    assert nodes.launched == [2, 1]
    assert (tmp_path / "out" / "good" / FILE).read_bytes() == verdict


def test_the_command_takes_a_launcher(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One that is not there is named; a config of somebody else can't bring one."""
    write_case(made(episodes=1, seconds=0.5)[0], tmp_path / "cases" / "a")
    assert main(["diagnose", str(tmp_path / "cases"), "hydra/launcher=slrum", f"out={tmp_path / 'o'}"]) == 2
    err = capsys.readouterr().err
    assert "slrum" in err
    assert err.count("\n") == 1
