"""The Python of the documentation, to be run: blocks of a page, cells of the notebook."""

from __future__ import annotations

import ast
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

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


def run_page(page: str, *, replaced: Mapping[str, str] = MappingProxyType({}), **names: object) -> dict:
    """Run the blocks of a page, in order, and return what they made; `replaced` is what readers edit."""
    code = blocks(page)
    for text, own in replaced.items():
        assert text in code
        code = code.replace(text, own)
    exec(compile(code, page, "exec", dont_inherit=True), names)
    return names


def run_cell(source: str, names: dict) -> object:
    """Run a cell as a notebook does; return what its last line shows."""
    tree = ast.parse(source)
    last = tree.body[-1]
    shown = last.value if isinstance(last, ast.Expr) else None
    if shown is not None:
        tree.body.pop()
    exec(compile(tree, "cell", "exec", dont_inherit=True), names)
    if shown is None:
        return None
    return eval(compile(ast.Expression(shown), "cell", "eval", dont_inherit=True), names)
