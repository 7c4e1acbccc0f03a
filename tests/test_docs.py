"""The Python of the documentation runs, block after block, and finds what it says."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import runner

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


def test_the_page_on_python_is_true(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Every block, in order, in a folder of its own; the friction that the two examples have is found."""
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    exec(compile(blocks("docs/python.md"), "docs/python.md", "exec"), names)
    assert names["diagnosis"].effects == ("friction",)
    assert names["after"].table["noises"].to_numpy().max() < names["gap"].table["noises"].to_numpy().max()
    (friction,) = names["table"].query("effects == 'friction'")["value"]
    assert friction == pytest.approx(0.277, abs=0.005)
    assert {"diagnosis.png", "results", "corrected", "lever.xml"} <= {p.name for p in tmp_path.iterdir()}
    out = capsys.readouterr().out
    assert "searching, fitting friction" in out
    assert "The floor is more slippery than believed" in out
    assert names["found"].effects == ("joint_friction[hinge]",)
    assert "Joint 'hinge' has more dry friction than in the model: 0.1503 ± 0.0006 N m" in out


def test_what_the_readme_says_of_python_is_there() -> None:
    """The names of its block exist; it is the beginning of the page on Python."""
    code = blocks("README.md")
    assert "runner.diagnose(runner.read(" in code
    named = set(re.findall(r"runner\.(\w+)\(", code))
    assert {"diagnose", "read"} <= named <= set(runner.__all__)
    for attribute in set(re.findall(r"diagnosis\.(\w+)", code)):
        assert hasattr(runner.CaseDiagnosis, attribute)


def test_the_page_on_the_architecture_is_that_of_the_tree() -> None:
    """Every room and loose module has a line in it, every path and module that it names is there."""
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    tree = page.split("```")[1]
    inside = [p for p in (ROOT / "runner").iterdir() if p.name not in ("__pycache__", "__init__.py")]
    rooms = {p.name for p in inside if p.is_dir() or p.suffix == ".py"}
    assert rooms == set(re.findall(r"^  (\w+(?:\.py)?)(?=/? )", tree, re.MULTILINE))
    named = re.findall(r"`((?:runner|systems|diagnosis|simulate|tests)/[\w/*]+\.py)`", page)
    assert len(named) > 10
    for path in (n for n in named if "NAME" not in n and "KIND" not in n):
        assert list(ROOT.glob(path)) or list((ROOT / "runner").glob(path)), path


def test_the_readme_links_to_every_page() -> None:
    """No page of the documentation is found by chance alone."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert [p.name for p in (ROOT / "docs").glob("*.md") if f"docs/{p.name}" not in text] == []
