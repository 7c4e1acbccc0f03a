"""The numbers of a diagnosis: each has its unit and reason in `runner.settings`, and no module has one of its own."""

from __future__ import annotations

import ast
import re
from dataclasses import FrozenInstanceError
from pathlib import Path

import pytest

import runner
from runner.settings import SETTINGS
from runner.settings.declared import Declared, by_stage
from runner.systems.mechanism.settings import MECHANISM

PACKAGE = Path(runner.__file__).parent
ROOMS = ("noise", "inference", "localise", "diagnosis")
# of mechanisms, what reads a recording and says over how long a model is replayed; how it is solved and drawn is not
OF_MECHANISMS = "flights initial labels rests scatter scope shapes steps stretches system"
# of recordings, what asks whether a recording can be what it says
OF_RECORDINGS = "kinematics model_form_commands model_form_plausible plausible plausible_forces plausible_pairs units"
# file, name: why no verdict depends on it
ALLOWED = {
    ("inference/variable_projection.py", "DAMPING"): "how a descent steps, not where it rests",
    ("inference/unseen.py", "VALUES_AT_ONCE"): "memory: none of the portions depends on another",
    ("localise/cells.py", "ORDERS_AT_ONCE"): "memory: orders are drawn in the same order in any portions",
    ("localise/likeness.py", "RIDGE"): "keeps the inverse of shapes that are always the same finite",
    ("localise/likeness.py", "SHAPES_SHOWN"): "how much of a list is shown",
    ("diagnosis/abstention.py", "NEAREST_SHOWN"): "how much of a list is shown",
    ("diagnosis/notes.py", "MOST_PLACES"): "how much of a list is shown",
    ("diagnosis/advice.py", "PLENTY"): "how a number is shown",
    ("diagnosis/verdict.py", "RIVALS_SHOWN"): "how much of a list is shown",
    ("diagnosis/score.py", "BINS"): "marks verdicts that have been given",
    ("diagnosis/score.py", "FIRST"): "marks verdicts that have been given",
    ("recording/plausible_pairs.py", "SCALES"): "what one unit is of another",
    ("recording/units.py", "DEGREE"): "what one unit is of another",
    ("recording/units.py", "LENGTH_UNITS"): "what one unit is of another",
    ("recording/units.py", "ANGLE_UNITS"): "what one unit is of another",
    ("systems/mechanism/initial.py", "ITERATIONS"): "Newton's method has converged to rounding long before",
    ("systems/mechanism/initial.py", "CLOSE"): "and this is how it is told",
    ("systems/mechanism/initial.py", "NEAR"): "how it steps, not where it ends",
}
TUNED = re.compile(r"practice|tuning|blind|golden|\bsets? of cases|test set|\bseed\b", re.IGNORECASE)


def numbers_of(source: str) -> set[str]:
    """Return the names that a module gives to numbers, or to what is made of some, outside of functions and classes."""
    found = set()
    for node in ast.parse(source).body:
        targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
        value = getattr(node, "value", None)
        if not isinstance(node, ast.Assign | ast.AnnAssign) or value is None:
            continue
        constants = [n.value for n in ast.walk(value) if isinstance(n, ast.Constant)]
        if any(isinstance(c, int | float) and not isinstance(c, bool) for c in constants):
            found |= {n.id for t in targets if t is not None for n in ast.walk(t) if isinstance(n, ast.Name)}
    return found


def every() -> list[tuple[str, Declared]]:
    """Return all numbers with the stage that they are of."""
    return [*by_stage(SETTINGS), *by_stage(MECHANISM)]


def test_modules_have_no_numbers_of_their_own() -> None:
    """What could change a verdict stands in the settings; what could not is listed here, with the reason."""
    files = [f for room in ROOMS for f in (PACKAGE / room).rglob("*.py")]
    files += [PACKAGE / "systems" / "mechanism" / f"{name}.py" for name in OF_MECHANISMS.split()]
    files += [PACKAGE / "recording" / f"{name}.py" for name in OF_RECORDINGS.split()]
    assert len(files) > 50
    found = {(f.relative_to(PACKAGE).as_posix(), n) for f in files for n in numbers_of(f.read_text(encoding="utf-8"))}
    assert found == set(ALLOWED)


def test_numbers_are_found() -> None:
    """In a tuple, an array, a call, an annotated name; words, sizes of functions and flags are none."""
    source = "A = 1\nB, C = 0.5, x\nD: float = -2.0\nE = np.array([1.0])\nF = Schedule(least=3)\n"
    assert numbers_of(source) == {"A", "B", "C", "D", "E", "F"}
    assert numbers_of('G = "words"\nH = True\ndef f(x=1):\n    return 2\nclass C:\n    n = 3\n') == set()


def test_every_number_has_its_unit_and_reason() -> None:
    """A reason is a sentence about physics, statistics or computation; how cases came out of some set is none."""
    for stage, one in every():
        assert one.unit, (stage, one.name)
        assert re.fullmatch(r"[A-Z0-9](\S* ){5,}.*[.]", one.reason), (stage, one.name, one.reason)
        assert not TUNED.search(one.reason), (stage, one.name, one.reason)


def test_the_page_on_statistics_says_how_many_they_are() -> None:
    """Whoever adds one has to say so."""
    page = " ".join((PACKAGE.parent / "docs" / "statistics.md").read_text(encoding="utf-8").split())
    assert f"[{len(list(by_stage(SETTINGS)))} numbers](reference/numbers.md)" in page
    assert f"mechanisms have {len(list(by_stage(MECHANISM)))} of their own" in page


def test_they_cannot_be_changed_in_passing() -> None:
    """A diagnosis is the same whatever ran before it in the process."""
    with pytest.raises(FrozenInstanceError):
        SETTINGS.search.beam_width = 3  # ty: ignore[invalid-assignment]  # it is tested


def test_what_follows_from_others_is_no_number_of_its_own() -> None:
    """The limits of `unknown` mirror each other; several effects stand out further than one by itself."""
    assert SETTINGS.probability.max_unknown == 1.0 - SETTINGS.probability.min_unknown
    assert SETTINGS.odds.min_errors_alone < SETTINGS.odds.min_errors_beside_others == pytest.approx(2.608, abs=1e-3)
