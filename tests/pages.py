"""The Python blocks of the documentation, to be run."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).parents[1]


def blocks(page: str) -> str:
    """Return the Python blocks of a page, one below the other at their own lines, so that errors name those."""
    lines, inside = [], False
    for line in (ROOT / page).read_text(encoding="utf-8").splitlines():
        if line.startswith("```"):
            inside = line == "```python"
            line = ""
        lines.append(line if inside else "")
    return "\n".join(lines)


def run_page(page: str, **names: object) -> dict:
    """Run the blocks of a page, in order, and return what they made."""
    exec(compile(blocks(page), page, "exec", dont_inherit=True), names)
    return names
