"""What takes minutes says what it is at: now and then where there is no terminal, and nothing where it is quick."""

from __future__ import annotations

import re
import time

import pytest
from numba.core.compiler_lock import global_compiler_lock

from runner import progress
from runner.progress import Spoken, Step, observed


def test_a_line_holds_stage_fit_and_best() -> None:
    """Each change makes a line; the best stays when another stage begins, a fit that goes on makes no further line."""
    said: list[str] = []
    observer = Spoken(said.append)
    observer.step(Step.SEARCHING)
    observer.fitting(())
    observer.fitting(("friction",))
    observer.fitting(("friction",))
    observer.best(("friction",), 1.0312, 0.934)
    observer.step(Step.CHECKING, "again")
    assert said == [
        "step 2 of 6, searching",
        "step 2 of 6, searching, fitting the nominal model",
        "step 2 of 6, searching, fitting friction",
        "step 2 of 6, searching, fitting friction; so far best friction (leaves no more than the noise)",
        "step 3 of 6, checking on the episodes left out, again; so far best friction (leaves no more than the noise)",
    ]


def test_compiling_is_told(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """Of a replay and of a diagnosis, as long as it lasts: there nothing else would move."""
    monkeypatch.setattr(progress, "EVERY_S", 0.02)
    monkeypatch.setattr(progress, "PATIENCE_S", 0.05)
    with progress.progress("Replaying", total=8, unit="steps", minutes=True):
        with global_compiler_lock:
            with global_compiler_lock:  # of what it calls
                pass
            time.sleep(0.3)
        compiled = capsys.readouterr().out
        time.sleep(0.2)
    assert " s): compiling, the first time only" in compiled
    assert capsys.readouterr().out.splitlines()[-1].endswith(" s): 0 of 8 steps")


def test_lines_fit_80_columns(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """However many effects are fitted together and named as best: nothing of it is lost but names of a fit."""
    monkeypatch.setattr(progress, "EVERY_S", 0.05)
    monkeypatch.setattr(progress, "USUAL", (1e5, 2e6))
    sets = [f"{name}[upper_arm_link]" for name in ("actuator_saturation", "joint_friction", "asymmetric_friction")]
    with observed("Diagnosing") as observer:
        observer.step(Step.CHECKING)
        observer.fitting(sets)
        observer.best(sets, 9.351, 0.5)
        time.sleep(0.2)
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    first = " ".join(" ".join(lines).split("Diagnosing")[1].split())
    assert re.sub(r"\(0 s of \d+ to \d+ (s|min) as a rule\)", "(0 s)", first) == (
        f"(0 s): step 3 of 6, checking on the episodes left out, fitting {' + '.join(sets[:2])} + 1 more; "
        f"so far best {' + '.join(sets)} (leaves 9.35 times the noise)"
    )


def test_what_a_part_of_the_recording_tells_is_said_to_be_that() -> None:
    """Until all of it is told by."""
    said: list[str] = []
    observer = Spoken(said.append)
    observer.best(("com_offset",), 0.95, 0.97, "flights until the first hit")
    observer.best((), 9.35, 0.0, "flights until the first hit")
    observer.best(("com_offset",), 3.8, 0.03)
    assert said == [
        "so far best com_offset (of flights until the first hit alone, leaves no more than the noise)",
        "so far nothing explains it (of flights until the first hit alone, leaves 9.35 times the noise)",
        "so far best com_offset (leaves 3.8 times the noise)",
    ]


def test_nothing_is_best_that_is_as_good_as_impossible() -> None:
    """While nothing explains a recording, that is said, and not that `none` is best."""
    said: list[str] = []
    Spoken(said.append).best((), 9.35, 0.0)
    assert said == ["so far nothing explains it (leaves 9.35 times the noise)"]


def test_lines_come_now_and_then_without_a_terminal(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Not with every change, but one for each while that goes by, with the time; none after the end."""
    monkeypatch.setattr(progress, "EVERY_S", 0.05)
    with observed("Diagnosing") as observer:
        for k in range(1000):
            observer.fitting((f"effect_{k}",))
        time.sleep(0.4)
    out, err = capsys.readouterr()
    lines = out.splitlines()
    assert 1 <= len(lines) <= 20
    assert lines[-1] == "Diagnosing (0 s): fitting effect_999"
    assert err == ""
    time.sleep(0.15)
    assert capsys.readouterr().out == ""


def test_lines_come_more_rarely_with_time(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """What takes long does not fill a log with what it is at: each pause is half of the time that went by, or more."""
    monkeypatch.setattr(progress, "EVERY_S", 0.01)
    monkeypatch.setattr(progress, "EVERY_SHARE", 0.5)
    with observed("Diagnosing") as observer:
        observer.step(Step.SEARCHING)
        time.sleep(0.5)
    assert 3 <= len(capsys.readouterr().out.splitlines()) <= 12  # 50 otherwise


@pytest.mark.parametrize(
    ("passed_s", "first_s", "compiling_s", "said"),
    [
        (5.0, None, 0.0, ""),
        (10.0, 3.0, 0.0, " of 12 to 90 s as a rule"),
        (10.0, 6.0, 4.0, " of 12 to 64 s as a rule"),
        (10.0, 10.0, 0.0, " of 1 to 5 min as a rule"),
        (100.0, 30.0, 0.0, " of 2 to 15 min as a rule"),
        (901.0, 30.0, 0.0, ", longer than usual"),
    ],
)
def test_how_long_it_usually_takes_is_told_once_there_is_an_explanation(
    passed_s: float, first_s: float | None, compiling_s: float, said: str
) -> None:
    """What is compiled is so once; what takes longer says so."""
    assert progress._usual(passed_s, *(() if first_s is None else (first_s, compiling_s))) == said


def test_it_is_told_beside_the_time_that_went_by(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(progress, "EVERY_S", 0.02)
    monkeypatch.setattr(progress, "USUAL", (600.0, 1300.0))
    with observed("Diagnosing") as observer:
        observer.fitting(())
        time.sleep(0.1)
        before = capsys.readouterr().out
        observer.best((), 9.0, 0.9)
        time.sleep(0.1)
    assert " as a rule" not in before
    assert re.search(r"Diagnosing \(0 s of \d+ to \d+ (s|min) as a rule\): fitting", capsys.readouterr().out)


def test_what_is_quick_says_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    """Less than ten seconds are no reason for a line."""
    with observed("Diagnosing") as observer:
        observer.step(Step.SEARCHING)
    with progress.progress("Diagnosing", total=2, unit="cases", minutes=True) as advance:
        advance()
    assert capsys.readouterr() == ("", "")


def test_cases_are_counted(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """Of many cases the line says how many are done."""
    monkeypatch.setattr(progress, "EVERY_S", 0.05)
    with progress.progress("Diagnosing", total=3, unit="cases", minutes=True) as advance:
        advance(2)
        time.sleep(0.3)
    assert "Diagnosing (0 s): 2 of 3 cases" in capsys.readouterr().out
