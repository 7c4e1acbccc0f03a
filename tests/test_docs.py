"""The Python of the documentation runs, block after block, and finds what it says; links lead somewhere."""

from __future__ import annotations

import re
import shlex
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import yaml

import runner
from runner import config
from runner.__main__ import main
from runner.api.corrected import Corrected
from runner.blind.mechanism import plants
from runner.effects import mechanism, planar_box
from runner.effects.planar_box import Friction
from runner.noise.measured import measure
from runner.settings import SETTINGS
from runner.settings.declared import by_stage
from runner.simulate.gap import measure_gap
from runner.systems.base import AbstractSystem
from runner.systems.mechanism.settings import MECHANISM
from runner.systems.planar_box.system import PlanarBox
from tests import report_case, servo_arm
from tests.cases import made
from tests.mechanism_cases import write_case
from tests.pages import ROOT, blocks, run_page
from tests.tosses import toss_case, world

sys.path.insert(0, str(ROOT / "docs" / "reference"))
from make_reference import PAGES, described_columns


def test_effects_that_may_be_of_all_are_named() -> None:
    """The page on mechanisms names those that one value for all targets may explain, and no other."""
    page = (ROOT / "docs" / "mechanisms.md").read_text(encoding="utf-8")
    said = page.split("It is among the answers for")[1].split(", in a mechanism")[0]
    assert set(re.findall(r"`(\w+)`", said)) == {effect.name for effect in mechanism.EFFECTS if effect.shared}


def shell(page: str) -> list[str]:
    """Return the lines of a page's blocks of shell code, without comments."""
    code = re.findall(r"```sh\n(.*?)```", (ROOT / page).read_text(encoding="utf-8"), re.DOTALL)
    return [line.partition("#")[0].strip() for block in code for line in block.splitlines()]


@pytest.fixture
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Work in an empty folder but for the examples; what a page registers is forgotten afterwards."""
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)
    yield tmp_path
    for registry in (config._REGISTERED, config._TARGETS):
        for key, cls in list(registry.items()):
            if getattr(sys.modules.get(cls.__module__), cls.__name__, None) is not cls:
                del registry[key]  # ty: ignore[invalid-argument-type]  # the key is of the same one


def test_the_pages_on_tables_and_viewing_are_true(elsewhere: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """What is read back is what was run: masses that come to 3 kg."""
    runs = run_page("docs/tables.md")["runs"]
    assert runs["start.mass_kg"].tolist() == [0.5, 2.0]
    assert runs["mass_final_kg"].to_numpy() == pytest.approx(3.0, rel=0.01)
    read = run_page("docs/viewing.md")
    assert set(read["true_kg"]) == {3.0}
    assert read["told_kg"][-1] == pytest.approx(3.0, rel=0.01)
    assert "episode" in capsys.readouterr().out


def test_the_pages_on_own_parts_are_true(elsewhere: Path) -> None:
    """The effect changes a command and can be told in words, the estimator takes half of a step."""
    try:
        effect = run_page("docs/own_effect.md")["OneSidedGain"]
        (parameter,) = effect.parameters(None)
        weaker = effect.from_vector(np.array([-0.2]), None)
        assert weaker.edit_command(np.array([[-10.0], [10.0]]), 0.01).ravel().tolist() == [-8.0, 10.0]
        assert parameter.lower < -0.2 < parameter.upper
    finally:
        planar_box.EFFECTS.pop("one_sided_gain", None)
    rule = run_page("docs/own_estimator.md")["Halfway"]()
    text = (ROOT / "docs" / "own_estimator.md").read_text(encoding="utf-8")
    values = yaml.safe_load(re.findall(r"```yaml\n(.*?)```", text, re.DOTALL)[-1])
    assert values.pop("defaults") == ["schema_halfway@halfway", "_self_"]
    assert values == {"halfway": {"share": rule.share}}
    seen = SimpleNamespace(local_linear=(4.0, 0.0), remote_linear=(1.0, 0.0))
    assert rule.update(1.0, seen)[0] == 2.0


def test_a_corrected_box_is_replayed_by_the_page_on_contact(elsewhere: Path) -> None:
    """Plain MuJoCo with the model.xml that a diagnosis writes comes near the first push; as believed it is far off."""
    case = runner.read("examples/cases/slippery_floor")
    Corrected(case, (Friction(0.277),)).save("slippery")
    missed = run_page("docs/contact.md")["missed"]
    assert (missed < [0.02, 0.02, 0.04]).all()  # m, m, rad; the noise is 6 mm and 4 mrad
    anew = run_page("docs/contact.md", replaced={"every_s = np.inf": "every_s = 1.0"})["missed"]
    assert (anew < [0.02, 0.02, 0.04]).all()
    Corrected(case, ()).save("slippery")
    assert (run_page("docs/contact.md")["missed"] > 5 * missed).all()


def test_a_mechanism_is_replayed_by_the_page_on_it(elsewhere: Path) -> None:
    """An arm of servos and a tossed body, each by the model as it is believed: as near as `gap` says."""
    arm = servo_arm.written(kp=20.0, mass=0.4)
    runs = [servo_arm.recorded(arm, seed, samples=150, step_s=0.0005) for seed in (1, 2)]
    write_case(elsewhere / "arm", arm, runs, servo_arm.NOMINAL)
    Corrected(runner.read("arm"), ()).save("arm_found")
    page = run_page("docs/replaying.md", replaced={"# model.opt.timestep": "model.opt.timestep"})
    joints = page["rows"][["q_shoulder", "q_elbow"]].to_numpy()
    assert (np.sqrt(np.mean((page["replayed"] - joints) ** 2, axis=0)) < 1.3 * servo_arm.NOISE["q_elbow"]).all()
    toss_case(elsewhere / "toss", world(), tosses=2)
    Corrected(runner.read("toss"), ()).save("toss_found")
    own = {'"arm", "arm_found"': '"toss", "toss_found"', '{"u_shoulder": "shoulder", "u_elbow": "elbow"}': "{}"}
    page = run_page("docs/replaying.md", replaced=own)
    flight = (page["rows"][["x", "y", "z"]].to_numpy() - page["replayed"][:, :3])[:20]
    assert np.sqrt(np.mean(flight**2)) < 1e-3  # m; the noise is 0.1 mm, and what follows is hit


@pytest.mark.parametrize("name", list(PAGES))
def test_the_reference_is_that_of_the_program(name: str) -> None:
    """What is checked in is what `make reference` writes now."""
    written = (ROOT / "docs" / "reference" / name).read_text(encoding="utf-8")
    assert written == PAGES[name](), "make reference"


def test_every_column_is_described(tmp_path: Path) -> None:
    """Those of an experiment, of a gap and of where it is have a line in the reference."""
    assert main([f"out={tmp_path}/run", "forces.pushes=1", "log.rrd=off", "estimator=both"]) == 0
    found = report_case.diagnosis()
    recording, _ = made(episodes=2, seconds=1.5)
    system = PlanarBox(recording)
    gap = measure_gap(system, measure(system), horizons_s=(0.5,))
    tables = {
        "frames.parquet": pd.read_parquet(tmp_path / "run" / "frames.parquet"),
        "summary.parquet": pd.read_parquet(tmp_path / "run" / "summary.parquet"),
        "gap.parquet": gap.table,
        "closure.parquet": found.closure.table,
        "closure_regimes.parquet": found.closure.regimes,
        "where_cells.parquet": found.where.cells,
        "where_gap.parquet": found.where.gap,
    }
    known = described_columns()
    for name, table in tables.items():
        unknown = [c for c in table.columns if not any(p.fullmatch(c) for p in known[name]) and "." not in c]
        assert unknown == ["estimator"] * ("estimator" in unknown), name  # what was set on the command line


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
    return [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


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
    assert [
        p for q in pages()[1:] if (p := str(q.relative_to(ROOT / "docs"))) != "README.md" and f"]({p}" not in index
    ] == []


def test_counts_of_effects_are_those_of_the_vocabulary() -> None:
    """What the page on the diagnosis counts is what there is."""
    page, trust = (" ".join((ROOT / "docs" / name).read_text().split()) for name in ("diagnosis.md", "trust.md"))
    joints = {effect.name for effect in mechanism.EFFECTS}
    planted = set(plants.VOCABULARY) - {"gravity_tilt"}  # gravity has two kinds
    assert f"{len(planar_box.EFFECTS)} of the box" in page
    assert f"and {len(joints)} of mechanisms" in page
    assert f"there are {len(joints)}," in (ROOT / "docs" / "mechanisms.md").read_text(encoding="utf-8")
    assert planted <= joints
    assert f"one of {len(planted)} words" in trust


def test_counts_of_numbers_are_those_of_the_settings() -> None:
    """What the page on statistics counts is what is declared, and of how many effects at once."""
    page = " ".join((ROOT / "docs" / "statistics.md").read_text(encoding="utf-8").split())
    assert f"[{len(list(by_stage(SETTINGS)))} numbers]" in page
    assert f"have {len(list(by_stage(MECHANISM)))} of their own" in page
    assert (PlanarBox.most_effects, AbstractSystem.most_effects) == (3, 6)
    assert "three effects of a box, six of a mechanism" in page


def test_the_force_sequence_of_the_page_on_experiments_is_one(elsewhere: Path) -> None:
    """It is offered under its name, its YAML is of its keys, and it gives the same impulse whatever the step is."""
    names = run_page("docs/experiment.md", __name__="runner.physics.forces")  # where the page says that it stands
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


def test_the_tutorial_is_true(elsewhere: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its logs become the cases that it says. Golden verdicts hold the box's answer, the page on Python a lever's."""
    run_page("docs/tutorial.md")
    for typed in (shlex.split(line)[1:] for line in shell("docs/tutorial.md") if "import tracker" in line):
        assert main(typed) == 0, capsys.readouterr().err
    pushes = pd.read_parquet("pushes/recording.parquet")
    example = pd.read_parquet("examples/cases/slippery_floor/recording.parquet")
    pd.testing.assert_frame_equal(pushes, example, check_dtype=False, check_like=True, rtol=1e-6, atol=1e-6)
    gaps = runner.read("gaps").data["x"].to_numpy()
    kept = example["x"].to_numpy()[example.groupby("episode").cumcount().to_numpy() % 2 == 0]
    assert np.sqrt(np.nanmean((gaps - kept) ** 2)) < 0.01
    typed = [shlex.split(line)[1:] for line in shell("docs/tutorial.md") if line.startswith("runner import lever")]
    proposed, done = typed
    assert main(proposed) == 0
    assert "start: rest" in Path("map.yaml").read_text()
    assert main(done) == 0, capsys.readouterr().err
    lever = runner.read("lever")
    assert len(lever.episodes) == 4
    assert "joint_friction[hinge]" in set(lever.effects["effect"])
