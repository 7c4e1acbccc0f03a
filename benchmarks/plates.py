"""Where real pushes end that nothing was fitted to, and with what force: as believed, and corrected.

    python benchmarks/plates.py CASES [--corrected RESULTS] [--fit 12]

CASES is what `examples/plates/make_cases.py` has made: for each plate the cases `fitted` and `left_out`. RESULTS holds
a folder for each plate, by its name, with the `corrected.yaml` of a diagnosis of its `fitted` case. Every push of
`left_out` is simulated from where the plate lay, at rest, along the recorded path of the pin. Errors are those at the
end of a push, then means (and medians) over the pushes: position in mm and heading in degrees. The ratio of forces is
the measured impulse over the simulated one, without regard to direction, where a diagnosis counts the force.

With `--fit N` numbers are fitted to the pushes of `fitted` before, N generations of differential evolution (Storn and
Price 1997). For all plates together: where the pin is off in x and y, its friction, and the friction of the floor. For
each plate by itself also the shape of its pressure, three numbers. What is minimised is a mean over samples of
4 (sqrt(1 + z / 2) - 1), z the squared error in units of 1 mm and 8 mrad: pushes that went astray count by their error,
not by its square.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import differential_evolution

from runner.diagnosis.corrected import FILE, read_corrected
from runner.effects.base import Effects
from runner.effects.planar_box import Friction, PinFriction, PinOffset, PressureShape
from runner.systems.case import open_case
from runner.systems.planar_box.simulator import Simulator
from runner.systems.planar_box.system import PlanarBox
from runner.systems.simulator import Run

# of a fit: bounds of the offsets in m, of the pin's friction, of the floor's friction; of each number of a pressure
BOUNDS = ((-2.5e-3, 2.5e-3), (-2.5e-3, 2.5e-3), (0.05, 0.5), (0.15, 0.6))
SHAPE, USUAL = ((-2.5, 2.5),) * 3, 0.7  # ... and how uneven a pressure usually is: few pushes tell little of it
ERRORS = np.array([1e-3, 1e-3, 8e-3])  # m, m, rad
FIT_RATE_HZ, EVERY, POPULATION = 250.0, 8, 5  # steps a second; samples that count; candidates per number


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
    by_sensor = [i for i, channel in enumerate(system.channels) if channel.group == "force"]
    for k, episode in enumerate(system.recording.episodes):
        run = Run(effects, np.array([*episode.pose[0], 0.0, 0.0, 0.0]))
        simulated = simulator.predict(k, [run])[0]
        miss = simulated[-1, :3] - episode.pose[-1]
        measured = system.values()[k][:, by_sensor]
        used = np.isfinite(measured).all(axis=1)
        sizes = [np.linalg.norm(f[used], axis=1).sum() for f in (measured, simulated[:, by_sensor])]
        ratio = float(sizes[0] / sizes[1]) if len(by_sensor) and used.any() else np.nan
        out.append(End(episode.index, 1e3 * float(np.hypot(*miss[:2])), abs(float(np.degrees(miss[2]))), ratio))
    return out


def effects_of(x: np.ndarray) -> Effects:
    """Return what fitted numbers stand for: four, or seven with the shape of the pressure."""
    shape = (PressureShape(x[4], x[5], x[6]),) if len(x) > len(BOUNDS) else ()
    return (PinOffset(x[0], x[1]), PinFriction(x[2]), Friction(x[3]), *shape)


def fitted(systems: list[PlanarBox], generations: int, bounds: tuple[tuple[float, float], ...]) -> np.ndarray:
    """Return the numbers, within bounds, that lead the pushes of these cases nearest to where they went."""
    simulators = [Simulator(s.recording, step_rate_hz=FIT_RATE_HZ) for s in systems]

    def costs(candidates: np.ndarray) -> np.ndarray:
        total = ((candidates[len(BOUNDS) :] / USUAL) ** 2).sum(axis=0)
        for simulator in simulators:
            for k, episode in enumerate(simulator.recording.episodes):
                start = np.array([*episode.pose[0], 0.0, 0.0, 0.0])
                runs = [Run(effects_of(x), start) for x in candidates.T]
                miss = (simulator.predict(k, runs)[:, ::EVERY, :3] - episode.pose[::EVERY]) / ERRORS
                total += (4 * (np.sqrt(1 + (miss**2).sum(axis=2) / 2) - 1)).mean(axis=1)
        return total

    found = differential_evolution(
        costs,
        bounds,
        vectorized=True,
        updating="deferred",
        popsize=POPULATION,
        maxiter=generations,
        polish=False,
        rng=0,
    )
    return found.x


def line(name: str, ends: list[End]) -> str:
    """Return a row of the table."""
    off, turned = np.array([e.off_mm for e in ends]), np.array([e.turned_deg for e in ends])
    ratios = np.array([e.force_ratio for e in ends])
    ratio = f"{np.nanmean(ratios):.2f}" if np.isfinite(ratios).any() else "-"
    of_ends = f"{off.mean():7.2f} {np.median(off):7.2f} {turned.mean():8.2f} {np.median(turned):8.2f}"
    return f"{name:24} {len(ends):3d} {of_ends} {ratio:>7}"


def opened(case: Path) -> PlanarBox:
    """Return the system of a case."""
    system = open_case(case)
    assert isinstance(system, PlanarBox)
    return system


def main() -> None:
    """Simulate the pushes that were left out, and print a row for each plate, and one for all."""
    parser = argparse.ArgumentParser(description="Real pushes, replayed.")
    parser.add_argument("cases", type=Path)
    parser.add_argument("--corrected", type=Path, help="holds a folder for each plate, with corrected.yaml")
    parser.add_argument("--fit", type=int, metavar="N", help="fit numbers first, over N generations")
    given = parser.parse_args()
    plates = sorted(p.parent for p in given.cases.glob("*/left_out"))
    print(f"{'':24} {'n':>3} {'mm':>7} {'median':>7} {'degrees':>8} {'median':>8} {'force':>7}")
    found: dict[str, list[End]] = {}
    common = fitted([opened(p / "fitted") for p in plates], given.fit, BOUNDS) if given.fit else np.empty(0)
    for plate in plates:
        system = opened(plate / "left_out")
        models: dict[str, Effects] = {"as believed": ()}
        if given.fit:
            models["fitted to all"] = effects_of(common)
            own = fitted([opened(plate / "fitted")], given.fit, (*BOUNDS, *SHAPE))
            models["fitted to its own"] = effects_of(own)
            print(
                f"{plate.name}: "
                + ", ".join(f"{v:.4g}" for v in own)
                + "; all: "
                + ", ".join(f"{v:.4g}" for v in common)
            )
        if given.corrected and (given.corrected / plate.name / FILE).is_file():
            models["corrected"], _ = read_corrected(given.corrected / plate.name / FILE, system)
        for name, effects in models.items():
            ends = ends_of(system, effects)
            found.setdefault(name, []).extend(ends)
            print(line(f"{plate.name}, {name}", ends), flush=True)
    for name, ends in found.items():
        print(line(f"all, {name}", ends))


if __name__ == "__main__":
    main()
