"""The notebook runs, cell after cell, and finds what it says."""

from __future__ import annotations

import ast
import json
from pathlib import Path

import pytest

NOTEBOOK = Path(__file__).parents[1] / "examples" / "first_hour.ipynb"


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


def test_the_notebook_is_true(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its masses come to 3 kg, its lever has 0.15 N m of friction, and what it shows can be shown."""
    monkeypatch.chdir(tmp_path)
    content = json.loads(NOTEBOOK.read_text(encoding="utf-8"))
    assert (content["nbformat"], len({c["id"] for c in content["cells"]})) == (4, len(content["cells"]))
    names: dict = {}
    shown = []
    for cell in content["cells"]:
        if cell["cell_type"] == "code":
            assert (cell["outputs"], cell["execution_count"]) == ([], None)
            shown.append(run_cell("".join(cell["source"]), names))
    assert names["runs"]["mass_final_kg"].to_numpy() == pytest.approx(3.0, rel=0.01)
    assert len(names["axes"].lines) == 5
    assert names["found"].effects == ("joint_friction[hinge]",)
    assert all(hasattr(thing, "_repr_html_") for thing in (shown[0], shown[2], names["found"], names["found"].where))
    assert (tmp_path / "corrected" / "corrected.yaml").is_file()
