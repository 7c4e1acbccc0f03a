"""What a diagnosis is made of knows no kind of object: no word and no size of the box on a floor stands in it.

Read from the syntax trees: names, attributes, keywords, imports and strings, docstrings among them. A word is looked
for as a word: `yaw` is in `yaw_rad` and in `half_yaw`, `box` is in `PlanarBox` and not in `bbox`.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import runner

PACKAGE = Path(runner.__file__).parent
ROOMS = ("inference", "diagnosis", "localise", "simulate", "noise", "report", "outputs", "viewer", "settings")
# `importing` is none of them: it writes each form of a case, which is each kind's own
ROOMS += ("blind/make", "blind/score")
# what stands right in a package of kinds serves all of them, but for what lists the kinds or speaks of each in turn
SHARED = {"systems": ("case.py",), "effects": (), "blind": ("planted.py", "untried.py", "worlds.py")}
FILES = sorted(
    [f for room in ROOMS for f in (PACKAGE / room).rglob("*.py")]
    + [f for name, of_kinds in SHARED.items() for f in (PACKAGE / name).glob("*.py") if f.name not in of_kinds]
)

WORDS = re.compile(r"(?<![a-z])(?:yaw|half_size|floors?|box(?:es)?|planar)(?![a-z])", re.IGNORECASE)
KINDS = ("runner.systems.planar_box", "runner.effects.planar_box")
CHANNELS, PUSH_COLUMNS = 6, 12
SIZES = (CHANNELS, PUSH_COLUMNS)
# which arguments of a call are a shape: how many of the first, or all; the rest fill, or say of what type
SHAPED = {"zeros": 1, "ones": 1, "empty": 1, "full": 1, "eye": 2, "identity": 1, "reshape": None, "resize": None}
SHAPED |= {"broadcast_to": None, "tile": None}
# a shape in words: (6,), (E, 6), (W, n, 6, 6)
SHAPE = re.compile(r"\((?=[^()]*,)(?:[A-Za-z_]\w*, ?)*(?:6|12)(?:, ?(?:[A-Za-z_]\w*|6|12))*,?\)")
OPERATIONS = {("math", "floor"), ("np", "floor")}
# (file, what is found there, whose word it is)
LIBRARIES = (
    ("terminal.py", "box", "the borders of rich's tables: `from rich import box`"),
    ("record_shapes.py", "'box'", "MuJoCo's name of a shape that is drawn"),
    ("drawing.py", "'box' in a string", "the same, where the kinds of shapes are told"),
    ("record_shapes.py", "Boxes3D", "rerun's name of that shape"),
)


def offences(source: str, file: str = "") -> list[str]:
    """Return what in a source speaks of one kind of object, each with its line."""
    tree = ast.parse(source)
    allowed = {what for name, what, _ in LIBRARIES if name == file}
    if "box" in allowed and not any(_is_of_rich(node) for node in ast.walk(tree)):
        allowed.remove("box")
    found = [(node, text) for node in ast.walk(tree) for text in _told(node)]
    return [f"{file}:{getattr(node, 'lineno', 0)}: {text}" for node, text in found if text not in allowed]


def _told(node: ast.AST) -> Iterator[str]:
    """Yield what a node by itself has that it should not."""
    for name in _names(node):
        if WORDS.search(_snake(name)):
            yield name
    for module in _imported(node):
        if any(module == kind or module.startswith(f"{kind}.") for kind in KINDS):
            yield f"import of {module}"
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        for what in (WORDS.search(_snake(node.value)), SHAPE.search(node.value)):
            if what:
                yield repr(node.value) if what.group() == node.value else f"{what.group()!r} in a string"
    if isinstance(node, ast.Call):
        yield from (f"a shape of {size}" for size in _sizes(node))


def _names(node: ast.AST) -> Iterator[str]:
    if isinstance(node, ast.Name):
        yield node.id
    elif isinstance(node, ast.Attribute):
        owner = node.value.id if isinstance(node.value, ast.Name) else ""
        if (owner, node.attr) not in OPERATIONS:
            yield node.attr
    elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
        yield node.name
    elif isinstance(node, ast.arg | ast.keyword):
        yield node.arg or ""
    elif isinstance(node, ast.alias):
        yield node.asname or ""
        yield node.name.rpartition(".")[2]
    elif isinstance(node, ast.MatchAs | ast.MatchStar | ast.ExceptHandler):
        yield node.name or ""


def _imported(node: ast.AST) -> Iterator[str]:
    if isinstance(node, ast.Import):
        yield from (alias.name for alias in node.names)
    elif isinstance(node, ast.ImportFrom):
        yield node.module or ""
        yield from (f"{node.module}.{alias.name}" for alias in node.names)


def _sizes(call: ast.Call) -> Iterator[int]:
    """Yield the sizes of the box's arrays among those that a call names."""
    name = call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")
    if name not in SHAPED:
        return
    shapes = [*call.args[: SHAPED[name]], *(k.value for k in call.keywords if k.arg in ("shape", "newshape", "N", "M"))]
    for shape in shapes:
        for part in shape.elts if isinstance(shape, ast.Tuple | ast.List) else [shape]:
            if isinstance(part, ast.Constant):
                yield from (size for size in SIZES if size == part.value)


def _is_of_rich(node: ast.AST) -> bool:
    return isinstance(node, ast.ImportFrom) and node.module == "rich" and [a.name for a in node.names] == ["box"]


def _snake(text: str) -> str:
    """Set words of camel case apart."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", text)


@pytest.mark.parametrize("file", FILES, ids=lambda f: f.relative_to(PACKAGE).as_posix())
def test_no_kind_of_object_is_known(file: Path) -> None:
    """Neither by a word, nor by an import, nor by the size of an array."""
    assert offences(file.read_text(encoding="utf-8"), file.name) == []


def test_every_room_of_the_diagnosis_is_read() -> None:
    """What was renamed or emptied would otherwise be watched no more, or be let pass without need."""
    assert all(any(f.is_relative_to(PACKAGE / room) for f in FILES) for room in ROOMS)
    for name, of_kinds in SHARED.items():
        assert any(f.parent == PACKAGE / name and f.name != "__init__.py" for f in FILES)
        for file in of_kinds:
            assert offences((PACKAGE / name / file).read_text(encoding="utf-8")), file


@pytest.mark.parametrize(
    ("source", "found"),
    [
        ("yaw_rad = 1", "yaw_rad"),
        ("nominal.half_size_m", "half_size_m"),
        ("def floor(places): ...", "floor"),
        ("def f(floor): ...", "floor"),
        ("f(half_yaw=1)", "half_yaw"),
        ("f('on the floor')", "'floor' in a string"),
        ("f('Floors are even.')", "'Floors' in a string"),
        ("f(f'the {x} box')", "'box' in a string"),
        ("class PlanarBox: ...", "PlanarBox"),
        ("def f():\n    'Return the size of a box.'", "'box' in a string"),
        ("from runner.systems.planar_box.system import OBJECT", "import of runner.systems.planar_box.system"),
        ("import runner.effects.planar_box", "import of runner.effects.planar_box"),
        ("from runner.systems import planar_box as kind", "import of runner.systems.planar_box"),
        ("np.zeros(6)", "a shape of 6"),
        ("np.full((n, 12), 0.0)", "a shape of 12"),
        ("np.eye(6)", "a shape of 6"),
        ("x.reshape(-1, 6)", "a shape of 6"),
        ("x.reshape((w, n, 6))", "a shape of 6"),
        ("np.empty(shape=(6, n))", "a shape of 6"),
        ("def f():\n    'Return the start states, (E, 6).'", "'(E, 6)' in a string"),
        ("def f():\n    'Return the start state, (6,).'", "'(6,)' in a string"),
        ("def f():\n    'Return the columns, (n, 12).'", "'(n, 12)' in a string"),
        ("f(kind='box')", "'box'"),
        ("from rich import box", "box"),
    ],
)
def test_what_speaks_of_the_box_is_found(source: str, found: str) -> None:
    """Each way in which it could."""
    assert found in [text.partition(": ")[2] for text in offences(source)]


@pytest.mark.parametrize(
    "source",
    [
        "math.floor(x) + np.floor(x)",
        "savefig(bbox_inches='tight')",
        "f('flooring and boxing of planarity, yawning')",
        "np.linspace(0.0, 1.0, 6)",
        "np.full((n, 2), 6.0)",
        "np.zeros((2, 3))",
        "fit(iterations=12)",
        "def f():\n    'Return the residuals, (T, C), of 6 channels (or 12), or (12).'",
    ],
)
def test_what_does_not_is_let_pass(source: str) -> None:
    """Words and numbers that only look alike."""
    assert offences(source) == []


@pytest.mark.parametrize(("file", "what", "whose"), LIBRARIES)
def test_every_exception_is_needed(file: str, what: str, whose: str) -> None:
    """One that is no longer there would hide the next."""
    (source,) = [f.read_text(encoding="utf-8") for f in FILES if f.name == file]
    assert any(text.endswith(f": {what}") for text in offences(source)), whose


def test_only_rich_s_own_box_is_let_pass() -> None:
    """Where its name is that of the library's module."""
    assert offences("from rich import box\nTable(box=box.SIMPLE)", "terminal.py") == []
    assert offences("Table(box=box.SIMPLE)", "terminal.py") != []
    assert offences("from rich import box, print", "terminal.py") != []
