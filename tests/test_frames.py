"""Frames can be read by column and by row, and can't be changed."""

from __future__ import annotations

import numpy as np
import pytest

from runner.errors import ResultError
from runner.teleop.frames import Frames


def frames() -> Frames:
    """Return three frames of two columns."""
    return Frames({"time_s": np.array([0.0, 0.5, 1.0]), "frame": np.arange(3)})


def test_rows_are_views_of_columns() -> None:
    """A frame gives its row's values as plain numbers, by name and by attribute."""
    frame = frames()[1]
    assert frame["time_s"] == frame.time_s == 0.5
    assert dict(frame) == {"time_s": 0.5, "frame": 1}
    assert [f.frame for f in frames()] == [0, 1, 2]
    assert frames()[-1].frame == 2


def test_nothing_can_be_changed() -> None:
    """Columns are read-only copies; frames and the set of columns refuse to be written to."""
    source = np.zeros(3)
    made = Frames({"a": source})
    source[0] = 7
    assert made.column("a")[0] == 0
    with pytest.raises(ValueError, match="read-only"):
        made.column("a")[0] = 1
    with pytest.raises(TypeError):
        made.columns["b"] = source  # ty: ignore[invalid-assignment]  # it is tested
    with pytest.raises(AttributeError, match="can't be changed"):
        made[0].a = 1.0
    table = made.table()
    table.loc[0, "a"] = 5.0
    assert made.column("a")[0] == 0


def test_wrong_names_and_rows_say_what_there_is() -> None:
    """An unknown column names the nearest; a row beyond the end is an IndexError."""
    with pytest.raises(ResultError, match=r"no column 'time'\. Valid: 'frame', 'time_s'\. Did you mean 'time_s'"):
        frames().column("time")
    with pytest.raises(AttributeError, match="Did you mean 'frame'"):
        _ = frames()[0].fram
    with pytest.raises(IndexError, match="frame 3 of 3"):
        frames()[3]
    with pytest.raises(ValueError, match="different lengths"):
        Frames({"a": np.zeros(2), "b": np.zeros(3)})
