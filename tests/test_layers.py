"""Imports go one way, and configuration libraries stay at the edge, read from the syntax tree."""

from __future__ import annotations

import ast
from collections import defaultdict
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import runner

PACKAGE = Path(runner.__file__).parent
FILES = sorted(PACKAGE.rglob("*.py"))

# a layer imports only from those above it; a package counts as one
LAYERS = (
    "errors numerics settings",
    "processes storage",
    "config progress viewer",
    "physics recording",
    "effects importing",
    "systems teleop",
    "noise",
    "simulate",
    "estimation",
    "studies figures",
    "inference localise",
    "diagnosis",
    "report",
    "outputs",
    "api",
    "blind",
    "commands",
    "__main__",
)
LEVEL = {name: level for level, names in enumerate(LAYERS) for name in names.split()}


@cache
def imports(file: Path) -> tuple[ast.Import | ast.ImportFrom, ...]:
    """Return the import statements of a file, wherever in it; parsing all files takes two seconds."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    return tuple(node for node in ast.walk(tree) if isinstance(node, ast.Import | ast.ImportFrom))


def modules_imported(file: Path) -> list[str]:
    """Return the full names of the modules that a file imports, wherever in the file."""
    found = []
    for node in imports(file):
        if isinstance(node, ast.Import):
            found += [alias.name for alias in node.names]
        elif node.module:
            assert node.level == 0, f"{file}: relative import"
            found += [f"runner.{a.name}" for a in node.names] if node.module == "runner" else [node.module]
    return found


def unit(file: Path) -> str:
    """Return the module or package right below `runner` that a file belongs to."""
    return file.relative_to(PACKAGE).parts[0].removesuffix(".py")


def own_imports() -> dict[str, set[str]]:
    """Return which modules and packages below `runner` each of them imports."""
    graph: dict[str, set[str]] = defaultdict(set)
    for file in FILES:
        wanted = {name.split(".")[1] for name in modules_imported(file) if name.startswith("runner.")}
        graph[unit(file)] |= wanted - {unit(file)}
    return graph


def name_of(file: Path) -> str:
    """Return the full name of a module."""
    parts = file.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imports_by_file() -> dict[str, set[str]]:
    """Return which modules of the tree each module of the tree imports; of a package itself, its `__init__`."""
    known = {name_of(f) for f in FILES}
    graph: dict[str, set[str]] = {}
    for file in FILES:
        wanted = set()
        for node in imports(file):
            if isinstance(node, ast.Import):
                wanted |= {alias.name for alias in node.names}
            else:
                # a name of a package is one of its modules, or else stands in its `__init__`
                inside = {alias.name: f"{node.module}.{alias.name}" for alias in node.names}
                wanted |= {full if full in known else str(node.module) for full in inside.values()}
        graph[name_of(file)] = wanted & known
    return graph


def test_every_module_has_its_layer() -> None:
    """What is added to the tree must be put into the order, or nothing would watch it."""
    assert {unit(f) for f in FILES} - {"__init__"} == set(LEVEL)


def test_no_module_imports_in_a_circle() -> None:
    """Modules and packages can be put in one order in which each imports only earlier ones."""
    try:
        order = list(TopologicalSorter(own_imports()).static_order())
    except CycleError as error:
        pytest.fail(f"imports in a circle: {' -> '.join(error.args[1])}")
    assert order.index("errors") < order.index("__main__")


def test_no_file_imports_in_a_circle() -> None:
    """Neither do the modules within a package, whichever they are."""
    graph = imports_by_file()
    assert len(graph) == len(FILES)
    try:
        order = list(TopologicalSorter(graph).static_order())
    except CycleError as error:
        pytest.fail(f"imports in a circle: {' -> '.join(error.args[1])}")
    assert order.index("runner.systems.base") < order.index("runner.systems.case")


def test_kinds_of_systems_do_not_know_each_other() -> None:
    """A kind can be taken away, and another added, without a look at the others; `open_case` alone knows them all."""
    kinds = sorted(d.name for d in (PACKAGE / "systems").iterdir() if (d / "__init__.py").exists())
    assert "planar_box" in kinds
    graph = imports_by_file()
    wrong = []
    for name, others in graph.items():
        _, room, own, *_ = [*name.split("."), "", ""]
        if room not in ("systems", "effects") or name == "runner.systems.case":
            continue
        foreign = [f"runner.{r}.{k}" for r in ("systems", "effects") for k in kinds if k != own]
        wrong += [f"{name} imports {o}" for o in others if any(f"{o}.".startswith(f"{f}.") for f in foreign)]
    assert not wrong
    assert all(any(o.startswith(f"runner.systems.{k}.") for o in graph["runner.systems.case"]) for k in kinds)


def test_layers_import_only_from_above() -> None:
    """The order is the one that is written down."""
    wrong = [
        f"{name} imports {other}"
        for name, others in own_imports().items()
        for other in others
        if name in LEVEL and other in LEVEL and LEVEL[other] > LEVEL[name]
    ]
    assert not wrong


def test_diagnosis_cannot_see_what_was_planted() -> None:
    """Nothing that a diagnosis is made of imports the blind test, which knows the answers."""
    graph = own_imports()
    seen, todo = (
        set(),
        [name for name in ("diagnosis", "inference", "localise", "simulate", "recording") if name in graph],
    )
    while todo:
        name = todo.pop()
        if name not in seen:
            seen.add(name)
            todo += graph[name]
    assert {"recording", "errors"} <= seen
    assert "blind" not in seen


@pytest.mark.parametrize("library", ["hydra", "omegaconf"])
def test_configuration_libraries_stay_at_the_edge(library: str) -> None:
    """Hydra and OmegaConf are imported by `config`, the commands and `__main__` alone."""
    users = {unit(f) for f in FILES if any(m.split(".")[0] == library for m in modules_imported(f))}
    assert "commands" in users
    assert users <= {"config", "commands", "__main__"}
