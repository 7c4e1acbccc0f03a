"""Fields of a struct are found by their values, and a compiled callback is told apart by the text it is made of."""

from __future__ import annotations

import ctypes
from pathlib import Path

import pytest

from runner.physics.engine_memory import fingerprint, offset_of


def test_a_field_is_found_by_its_value() -> None:
    """The offset is that of the value, as a double or as 64 bits; one that is not there is refused."""
    raw = (ctypes.c_double * 4)(1.5, 2.5, 3.5, 4.5)
    address = ctypes.addressof(raw)
    assert offset_of(address, 3.5, size=32) == 16
    whole = (ctypes.c_uint64 * 3)(11, 22, 33)
    assert offset_of(ctypes.addressof(whole), 33, size=24) == 16
    with pytest.raises(RuntimeError, match=r"pin mujoco==3\.17\.0"):
        offset_of(address, 9.5, size=32)


def test_fingerprint_changes_with_any_of_the_sources(tmp_path: Path) -> None:
    """Whichever file changes, the number does; the order in which they are named does not matter."""
    one, two = tmp_path / "one.py", tmp_path / "two.py"
    one.write_text("a = 1\n", encoding="utf-8")
    two.write_text("b = 2\n", encoding="utf-8")
    before = fingerprint(one, two)
    assert before == fingerprint(two, one)
    assert 0 <= before < 2**60
    for file in (one, two):
        file.write_text(file.read_text(encoding="utf-8") + "c = 3\n", encoding="utf-8")
        assert fingerprint(one, two) != before
        before = fingerprint(one, two)
