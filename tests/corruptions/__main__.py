"""`python -m tests.corruptions [box|mechanism|toss|sound] [CASE ...]`: see the package."""

from __future__ import annotations

import shutil
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from runner.errors import RunnerError
from runner.recording import find_cases
from runner.recording.data import warnings
from runner.recording.model_form import is_model_form
from runner.recording.nominal import FILE, load_mapping
from runner.systems.case import open_case
from tests.corruptions.boxes import BOXES
from tests.corruptions.edits import Edit
from tests.corruptions.mechanisms import mechanisms
from tests.corruptions.tosses import TOSSES
from tests.mechanism_cases import write_case
from tests.servo_arm import NOMINAL, recorded, written

EXAMPLES, CUBE = (Path(__file__).parents[2] / "examples" / name for name in ("cases", "tosses/cube"))


def said(case: Path) -> tuple[str, str]:
    """Return what is done with a case, "refused", "warned", "noted" or "silent", and the first line of it."""
    try:
        system = open_case(case)
    except RunnerError as error:
        return "refused", str(error).replace(f"{case}/", "")
    odd = [*warnings(system.recording.notes), *system.misread()]
    for how, lines in (("warned", odd), ("noted", system.recording.notes)):
        if lines:
            return how, lines[0]
    return "silent", ""


def tried(case: Path, kinds: Mapping[str, Edit]) -> dict[str, tuple[str, str]]:
    """Return what is said of a case that is spoilt in each of these ways."""
    table, out = pd.read_parquet(case / "recording.parquet"), {}
    with tempfile.TemporaryDirectory() as place:
        copy = Path(place) / "case"
        shutil.copytree(case, copy)
        for kind, edit in kinds.items():
            with np.errstate(all="ignore"):
                edit(table).to_parquet(copy / "recording.parquet", index=False)
            out[kind] = said(copy)
    return out


def spoilt(case: Path) -> dict[str, tuple[str, str]]:
    """Return what is said of a case that is spoilt in all ways that there are for its form."""
    if not is_model_form(case):
        return tried(case, BOXES)
    steps = np.diff(pd.read_parquet(case / "recording.parquet", columns=["t"])["t"].to_numpy(float))
    nominal = load_mapping(case / FILE, ("model", "commands", "channels"))
    if any(source.get("quantity") == "orientation" for source in nominal["channels"].values()):
        return tried(case, TOSSES)
    return tried(case, mechanisms(nominal, 1 / float(np.median(steps[steps > 0]))))


def show(cases: Sequence[Path]) -> None:
    """Print a table of all ways, with what is said of the first case and how the others differ."""
    found = {case.name: spoilt(case) for case in cases}
    print(f"| {' | '.join(['what is wrong', *found, 'the line'])} |\n|{' --- |' * (len(found) + 2)}")
    for kind in next(iter(found.values())):
        hows = [ways.get(kind, ("", "")) for ways in found.values()]
        line = next((line for _, line in hows if line), "")
        shown = f"`{line.removeprefix('warning: ')}`".replace("|", "\\|") if line else ""
        print(f"| {kind} | {' | '.join(how for how, _ in hows)} | {shown} |")


def show_sound(folders: Sequence[Path]) -> int:
    """Print what is warned of or refused in recordings that are sound, and how many there are."""
    cases = [case for folder in folders for case in find_cases(folder)]
    odd = {case: found for case in cases if (found := said(case))[0] in ("refused", "warned")}
    for case, (how, line) in odd.items():
        print(f"{case}: {how}: {line}")
    print(f"{len(odd)} of {len(cases)} sound recordings are refused or warned of")
    return 1 if odd else 0


def arm(folder: Path) -> Path:
    """Write a sound recording of an arm of two servos, and return its folder."""
    model = written(6.0, 0.4)
    return write_case(folder, model, [recorded(model, s, samples=400, step_s=0.001) for s in range(4)], NOMINAL)


def main(arguments: Sequence[str]) -> int:
    """Do what is asked for."""
    what, cases = (arguments[0], [Path(a) for a in arguments[1:]]) if arguments else ("", [])
    if what == "sound":
        return show_sound(cases)
    with tempfile.TemporaryDirectory() as place:
        if what in ("", "box"):
            show(cases or sorted(EXAMPLES.iterdir()))
        if what in ("", "mechanism"):
            show(cases or [arm(Path(place) / "arm of two servos")])
        if what in ("", "toss"):
            show(cases or [CUBE])
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
