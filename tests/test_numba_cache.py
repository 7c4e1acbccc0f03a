"""A compiled function is told apart by the text that it is made of."""

from __future__ import annotations

from pathlib import Path

from runner.storage.numba_cache import fingerprint


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
