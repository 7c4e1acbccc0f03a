"""An interrupted diagnosis leaves the answer that it had; one that ends leaves its verdict instead."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from runner.outputs.so_far import FILE, kept_so_far
from runner.processes.interruption import going_on, line
from runner.progress import Spoken


def interrupted(said: list[str], folder: Path) -> None:
    """Find two things, and be interrupted."""
    with (
        going_on("Go on with: runner diagnose x", lambda: None),
        kept_so_far(Spoken(said.append), folder) as observer,
    ):
        observer.best((), 3.0, 0.2)
        observer.best(("mass", "friction"), 1.1, 0.875)
        raise KeyboardInterrupt


def test_the_last_of_what_was_found_is_left(tmp_path: Path) -> None:
    """The file holds the likeliest by then, and the one line of the interruption says so, before the command."""
    said: list[str] = []
    with pytest.raises(KeyboardInterrupt) as raised:
        interrupted(said, tmp_path)
    left = json.loads((tmp_path / FILE).read_text())
    assert left["effects"] == ["mass", "friction"]
    assert left["probability"] == 0.875
    assert left["checked_on_unseen"] is False
    assert said[-1] == "so far best mass + friction (leaves 1.1 times the noise)"
    words = line(raised.value)
    assert (
        words == f"Interrupted. So far: mass + friction, which leaves 1.1 times the noise ({tmp_path / FILE}). "
        "Go on with: runner diagnose x"
    )


def test_nothing_is_left_of_it_at_the_end(tmp_path: Path) -> None:
    """Nor is anything said of it where nothing had been found."""
    with kept_so_far(Spoken(lambda _: None), tmp_path) as observer:
        observer.best(("mass",), 1.0, 0.9)
        assert (tmp_path / FILE).exists()
    assert not (tmp_path / FILE).exists()
    with pytest.raises(KeyboardInterrupt) as raised, kept_so_far(Spoken(lambda _: None), tmp_path):
        raise KeyboardInterrupt
    assert raised.value.args == ()


def interrupted_in_the_air(folder: Path) -> None:
    """Find something in flights alone, and be interrupted."""
    with kept_so_far(Spoken(lambda _: None), folder) as observer:
        observer.best(("com_offset",), 0.95, 0.97, "flights until the first hit")
        raise KeyboardInterrupt


def test_what_flights_alone_tell_is_left_as_that(tmp_path: Path) -> None:
    """In the file and in the line of an interruption."""
    with pytest.raises(KeyboardInterrupt) as raised:
        interrupted_in_the_air(tmp_path)
    assert json.loads((tmp_path / FILE).read_text())["part"] == "flights until the first hit"
    said = "So far of flights until the first hit alone: com_offset, which leaves no more than the noise"
    assert said in line(raised.value)
