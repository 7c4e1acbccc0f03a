"""Golden verdicts: every number of a set of diagnoses, as it was when they were last agreed upon.

`make golden` diagnoses them all and says what differs; `make golden ARGS=--refresh` writes them anew, which is a change
of its own. The cases are the examples, small ones that are diagnosed within seconds, a set that the blind test makes
from a fixed seed, and, where they lie beside the project, the practice cases. Numbers may differ by rounding (the order
of sums in linear algebra depends on the machine), not by more.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from runner.blind.make import make_cases
from runner.blind.planar_box.case import PlanarBoxMaker
from runner.diagnosis.pipeline import diagnose
from runner.diagnosis.verdict import ALL
from runner.effects.planar_box import DeadBand, ViscousDrag
from runner.outputs.many import collect, diagnose_many
from runner.outputs.one import write_all
from runner.recording import write_case
from runner.systems.case import open_case
from tests.cases import made

ROOT = Path(__file__).resolve().parents[1]
FILE = ROOT / "tests" / "golden.json"
PRACTICE = ROOT.parent / "shared" / "practice"
SEED, MADE = 18, 8
# Nothing, one effect that a verdict may name and one that it may not, each in so many episodes. Of a size at which
# every number is the same whichever kernels the linear algebra takes: a gap of thousands of squared noises amplifies
# rounding.
SMALL = {
    "small_nothing_differs": ((), 3),
    "small_viscous_drag": ((ViscousDrag(0.3),), 3),
    "small_dead_band": ((DeadBand(0.6),), 4),
}
RTOL = 1e-6  # rounding is amplified by searches that take hundreds of steps
FAINT = 1e-6  # a probability below is none, however many digits it has


def quick(folder: Path) -> dict[str, Path]:
    """Return the cases by name whose making takes no time: examples, and small ones that are made in a folder."""
    return small(folder / "small") | found_in(ROOT / "examples" / "cases")


def small(folder: Path) -> dict[str, Path]:
    """Make the small cases in a folder, and return them by name."""
    for name, (effects, episodes) in SMALL.items():
        recording, _ = made(effects, seed=4, episodes=episodes, seconds=3.0)
        write_case(recording, folder / name)
    return found_in(folder)


def cases(folder: Path) -> dict[str, Path]:
    """Return all cases by name; those that are made are made in a folder."""
    make_cases(MADE, SEED, folder / "made", folder / "answers.json", PlanarBoxMaker())
    return dict(sorted((quick(folder) | found_in(folder / "made", PRACTICE)).items()))


def found_in(*folders: Path) -> dict[str, Path]:
    """Return the cases in folders by name, as far as those are there."""
    every = [p for folder in folders if folder.is_dir() for p in folder.iterdir()]
    return {p.name: p for p in sorted(every) if (p / "nominal.yaml").is_file()}


def differences(found: Any, golden: Any, at: str = "") -> Iterator[str]:
    """Yield what differs between two verdicts, each with its place."""
    if isinstance(found, dict) and isinstance(golden, dict):
        for key in sorted(found.keys() | golden.keys()):
            if (key in found) != (key in golden):
                yield f"{at}.{key}: {'new' if key in found else 'gone'}"
            else:
                yield from differences(found[key], golden[key], f"{at}.{key}")
    elif isinstance(found, list) and isinstance(golden, list):
        if len(found) != len(golden):
            yield f"{at}: {len(golden)} entries, now {len(found)}"
        for i, (a, b) in enumerate(zip(found, golden, strict=False)):
            yield from differences(a, b, f"{at}[{i}]")
    elif isinstance(found, float) and isinstance(golden, int | float):
        if not math.isclose(found, golden, rel_tol=RTOL, abs_tol=FAINT if at.endswith("probability") else 0.0):
            yield f"{at}: {golden!r}, now {found!r}"
    elif found != golden:
        yield f"{at}: {golden!r}, now {found!r}"


def diagnosed(chosen: dict[str, Path], folder: Path) -> dict[str, Any]:
    """Return the verdicts of cases, found side by side."""
    failed = diagnose_many(chosen, folder)
    if failed:
        raise SystemExit("\n".join(f"{name}: {problem}" for name, problem in failed.items()))
    return without_provenance(json.loads((folder / ALL).read_text(encoding="utf-8")))


def diagnosed_here(chosen: dict[str, Path], folder: Path) -> dict[str, Any]:
    """Return the same, found in this process and without reports: no other has to import all of it first."""
    for name, case in chosen.items():
        write_all(diagnose(open_case(case), threads=1), folder / name, report=False, provenance={})
    return without_provenance(collect(folder, chosen))


def without_provenance(found: dict[str, Any]) -> dict[str, Any]:
    """Return verdicts by name as they are compared."""
    # versions and hashes of what was diagnosed are none of what a verdict says
    return {name: {k: v for k, v in verdict.items() if k != "provenance"} for name, verdict in found.items()}


def main(arguments: Sequence[str]) -> int:
    """Compare, or refresh; return the exit code."""
    parser = argparse.ArgumentParser(prog="make golden", description=__doc__)
    parser.add_argument("--refresh", action="store_true", help="write the verdicts anew")
    parser.add_argument("names", nargs="*", help="cases; all by default")
    parsed = parser.parse_args(arguments)
    golden = json.loads(FILE.read_text(encoding="utf-8")) if FILE.exists() else {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        chosen = {n: p for n, p in cases(folder).items() if not parsed.names or n in parsed.names}
        found = diagnosed(chosen, folder / "verdicts")
    if parsed.refresh:
        FILE.write_text(json.dumps(golden | found, indent=1, sort_keys=True) + "\n", encoding="utf-8")
        print(f"{len(found)} verdicts: {FILE}")
        return 0
    wrong = {n: list(differences(v, golden.get(n, {}))) for n, v in found.items()}
    for n, lines in wrong.items():
        print(f"{n}: {'as it was' if not lines else f'{len(lines)} differences'}")
        print("".join(f"  {line}\n" for line in lines[:12]), end="")
    print(f"{sum(not lines for lines in wrong.values())} of {len(wrong)} as they were; {len(golden)} are known")
    return 1 if any(wrong.values()) else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
