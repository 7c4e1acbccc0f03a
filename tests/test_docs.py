"""The Python of the documentation runs, block after block, and finds what it says; links lead somewhere."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

import runner
from runner import config
from runner.__main__ import main
from runner.blind.mechanism import plants
from runner.effects import mechanism, planar_box

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


def test_effects_that_may_be_of_all_are_named() -> None:
    """The page on mechanisms names those that one value for all targets may explain, and no other."""
    page = (ROOT / "docs" / "mechanisms.md").read_text(encoding="utf-8")
    said = page.split("It is among the answers for")[1].split(", in a mechanism")[0]
    assert set(re.findall(r"`(\w+)`", said)) == {effect.name for effect in mechanism.EFFECTS if effect.shared}


def shell(page: str) -> list[str]:
    """Return the lines of a page's blocks of shell code, without comments."""
    code = re.findall(r"```sh\n(.*?)```", (ROOT / page).read_text(encoding="utf-8"), re.DOTALL)
    return [line.partition("#")[0].strip() for block in code for line in block.splitlines()]


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


def pages() -> list[Path]:
    """Return the README and all pages of the documentation."""
    return [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


def anchors(page: Path) -> set[str]:
    """Return what a link may name within a page: its headings in lower case, words joined by hyphens."""
    headings = re.findall(r"^#+ (.+)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", pages(), ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path) -> None:
    """Files, pictures and headings that a page links to are there."""
    links = re.findall(r"\]\(([^)\s]+)\)", page.read_text(encoding="utf-8"))
    for link in (link for link in links if not link.startswith("http")):
        path, _, heading = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        assert target.exists(), link
        assert not heading or heading in anchors(target), link


def test_no_page_is_found_by_chance_alone() -> None:
    """The README, short enough to be read, leads to the index, and that to every page."""
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    index = (ROOT / "docs" / "README.md").read_text(encoding="utf-8")
    assert len(readme.splitlines()) < 150
    assert "](docs/README.md)" in readme
    assert [p.name for p in pages()[1:] if p.name != "README.md" and f"]({p.name}" not in index] == []


def test_counts_of_effects_are_those_of_the_vocabulary() -> None:
    """What the page on the diagnosis counts is what there is."""
    page = " ".join((ROOT / "docs" / "diagnosis.md").read_text(encoding="utf-8").split())
    joints = {effect.name for effect in mechanism.EFFECTS}
    planted = set(plants.VOCABULARY) - {"gravity_tilt"}  # gravity has two kinds
    assert f"{len(planar_box.EFFECTS)} of the box" in page
    assert f"and {len(joints)} of mechanisms" in page
    assert f"there are {len(joints)}," in (ROOT / "docs" / "mechanisms.md").read_text(encoding="utf-8")
    assert planted <= joints
    assert f"one of {len(planted)} words" in page


def test_the_force_sequence_of_the_page_on_experiments_is_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is offered under its name, its YAML is of its keys, and it gives the same impulse whatever the step is."""
    for registry in ("_REGISTERED", "_TARGETS"):
        monkeypatch.setattr(config, registry, dict(getattr(config, registry)))
    names: dict = {"__name__": "runner.physics.forces"}  # where the page says that it stands
    exec(compile(blocks("docs/experiment.md"), "docs/experiment.md", "exec"), names)
    text = (ROOT / "docs" / "experiment.md").read_text(encoding="utf-8")
    values = yaml.safe_load(re.findall(r"```yaml\n(.*?)```", text, re.DOTALL)[-1])
    assert f"{values.pop('defaults')[0]}" == "schema_sawtooth"
    assert config._REGISTERED["forces", "sawtooth"] is names["Sawtooth"]
    forces = names["Sawtooth"](**values)
    for steps in (7, 100, 4800):
        step_s = forces.duration_s / steps
        force, point = forces.columns(np.arange(steps) * step_s, step_s)
        assert force.sum(axis=0) * step_s == pytest.approx([50.0, 0.0, 0.0])  # five triangles of 20 N and 1 s
        assert not point.any()
    assert force.max() == pytest.approx(20.0, rel=1e-3)


def test_the_tutorial_is_true(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its logs become the cases that it says. The page on Python diagnoses the same box and the same lever."""
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)
    exec(compile(blocks("docs/tutorial.md"), "docs/tutorial.md", "exec"), {})
    pushes, example = runner.read("pushes").data, runner.read("examples/cases/slippery_floor").data
    pd.testing.assert_frame_equal(pushes, example, check_dtype=False, rtol=1e-6, atol=1e-6)
    typed = [shlex.split(line)[1:] for line in shell("docs/tutorial.md") if line.startswith("runner import")]
    proposed, done = typed
    assert main(proposed) == 0
    text = Path("map.yaml").read_text()
    assert "start: free" in text
    Path("map.yaml").write_text(text.replace("start: free", "start: rest"))
    assert main(done) == 0, capsys.readouterr().err
    lever = runner.read("lever")
    assert len(lever.episodes) == 4
    assert "joint_friction[hinge]" in set(lever.effects["effect"])
