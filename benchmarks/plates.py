"""Where real pushes end that nothing was fitted to, and with what force: as believed, and corrected.

    python benchmarks/plates.py CASES [--corrected RESULTS]

CASES is what `examples/plates/make_cases.py` has made: for each plate the cases `fitted` and `left_out`. RESULTS holds
a folder for each plate, by its name, with the `corrected.yaml` of a diagnosis of its `fitted` case. Every push of
`left_out` is simulated from where the plate lay, at rest, along the recorded path of the pin. Errors are those at the
end of a push, then means (and medians) over the pushes: position in mm and heading in degrees. The ratio of forces is
the measured impulse over the simulated one, without regard to direction, while the pin pushes in the simulation.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from runner.diagnosis.corrected import FILE, read_corrected
from runner.effects.base import Effects
from runner.systems.case import open_case
from runner.systems.planar_box.system import PlanarBox
from runner.systems.simulator import Run

PUSHES = 0.1  # of the plate's friction: a force above it is a push


@dataclass(frozen=True)
class End:
    """How far a push is off at its end, and measured over simulated impulse (NaN: the force was not measured)."""

    push: int
    off_mm: float
    turned_deg: float
    force_ratio: float


def ends_of(system: PlanarBox, effects: Effects) -> list[End]:
    """Return the ends of all pushes of a case with these effects."""
    simulator, out = system.simulator(), []
    for k, episode in enumerate(system.recording.episodes):
        run = Run(effects, np.array([*episode.pose[0], 0.0, 0.0, 0.0]))
        miss = simulator.predict(k, [run])[0][-1, :3] - episode.pose[-1]
        force = np.linalg.norm(simulator.pin_force(k, run), axis=1)
        measured = np.linalg.norm(episode.force_n[:-1], axis=1)
        used = (force > PUSHES * system.context.friction_n) & np.isfinite(measured)
        ratio = float(measured[used].sum() / force[used].sum()) if used.any() else np.nan
        out.append(End(episode.index, 1e3 * float(np.hypot(*miss[:2])), abs(float(np.degrees(miss[2]))), ratio))
    return out


def line(name: str, ends: list[End]) -> str:
    """Return a row of the table."""
    off, turned = np.array([e.off_mm for e in ends]), np.array([e.turned_deg for e in ends])
    ratios = np.array([e.force_ratio for e in ends])
    ratio = f"{np.nanmean(ratios):.2f}" if np.isfinite(ratios).any() else "-"
    of_ends = f"{off.mean():7.2f} {np.median(off):7.2f} {turned.mean():8.2f} {np.median(turned):8.2f}"
    return f"{name:24} {len(ends):3d} {of_ends} {ratio:>7}"


def main() -> None:
    """Simulate the pushes that were left out, and print a row for each plate, and one for all."""
    parser = argparse.ArgumentParser(description="Real pushes, replayed.")
    parser.add_argument("cases", type=Path)
    parser.add_argument("--corrected", type=Path, help="holds a folder for each plate, with corrected.yaml")
    given = parser.parse_args()
    plates = sorted(p.parent for p in given.cases.glob("*/left_out"))
    print(f"{'':24} {'n':>3} {'mm':>7} {'median':>7} {'degrees':>8} {'median':>8} {'force':>7}")
    found: dict[str, list[End]] = {}
    for plate in plates:
        system = open_case(plate / "left_out")
        assert isinstance(system, PlanarBox)
        models: dict[str, Effects] = {"as believed": ()}
        if given.corrected and (given.corrected / plate.name / FILE).is_file():
            models["corrected"] = read_corrected(given.corrected / plate.name / FILE, system.vocabulary)
        for name, effects in models.items():
            ends = ends_of(system, effects)
            found.setdefault(name, []).extend(ends)
            print(line(f"{plate.name}, {name}", ends), flush=True)
    for name, ends in found.items():
        print(line(f"all, {name}", ends))


if __name__ == "__main__":
    main()
