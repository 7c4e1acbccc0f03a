"""How far models of real mechanisms are from measurements that nothing was fitted to, before and after a diagnosis.

    python examples/mechanisms/make_cases.py FOLDER CASES
    runner diagnose recording=CASES/NAME out=RESULTS/NAME
    python -m benchmarks.mechanisms CASES RESULTS [--folder FOLDER]

For every case that has a result: models are started anew every half second from the measured state (a parabola through
the samples around it), in the episodes that the diagnosis held out; printed is the median over those restarts of how
far each joint is off after half a second, for the model as published and for the corrected one. The published
controller of the EMPS axis is sampled, a thing that a continuous servo is not, so the last figure is of an integrator
of our own: the axis in closed loop with that controller, from FOLDER/emps, over the whole record and over the third of
it that was held out; its error of the force as a share of the recorded force.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numba
import numpy as np
import pandas as pd

import runner
from runner.api.corrected import Corrected
from runner.noise.measured import measure
from runner.systems.windows import windows_of

RESTART_S = 0.5
POSITION_GAIN, VELOCITY_GAIN, DRIVE_N_PER_V, LIMIT_V = 160.18, 243.45, 35.15, 10.0  # 1/s, V s/m
MASS_KG, VISCOUS_N_S_M, DRY_N = 95.11, 203.5, 20.39


def restarts(case: Path, results: Path) -> pd.DataFrame:
    """Return how far each position is off, a row for each: `channel`, `unit`, `before`, `after`, `restarts`."""
    read = runner.read(case)
    system, effects = read.system, Corrected.read(results, read).effects
    held_out = set(json.loads((results / "verdict.json").read_text())["held_out"])
    measured, simulator, values = measure(system), system.simulator(), system.values()
    off: dict[str, list[np.ndarray]] = {"before": [], "after": []}
    for k, episode in enumerate(system.recording.episodes):
        if episode.index not in held_out:
            continue
        # every episode has its own clock
        windows = windows_of([len(v) for v in values], round(RESTART_S / episode.step_s), [k])
        starts = system.initial.guess_windows(measured, windows, smooth=True)
        ends = np.array([values[k][first + windows.samples - 1] for first in windows.first])
        for name, model in (("before", ()), ("after", effects)):
            off[name] += [*np.abs(simulator.predict_windows(model, windows, starts[:, None])[:, 0, -1] - ends)]
    rows = {name: np.nanmedian(far, axis=0) for name, far in off.items()}
    table = pd.DataFrame(rows)
    table.insert(0, "unit", [c.unit for c in system.channels])
    table.insert(0, "channel", [c.name for c in system.channels])
    return table[table["unit"].isin(["rad", "m"])].assign(restarts=len(off["after"]))


@numba.njit(cache=True)
def closed_loop(reference: np.ndarray, start: float, axis: np.ndarray, parts: int) -> np.ndarray:  # pragma: no cover
    """Return the force that the published controller asks for, (T,): one sample per millisecond.

    `axis` holds mass, viscous and dry friction, the differences of both between the directions, and a constant force.
    """
    mass, viscous, dry, viscous_difference, dry_difference, offset = axis
    x, v, last, before_last, step = start, 0.0, start, start, 1e-3 / parts
    out = np.zeros(len(reference))
    for k in range(len(reference)):
        volts = POSITION_GAIN * VELOCITY_GAIN * (reference[k] - x) - VELOCITY_GAIN * (x - before_last) / 2e-3
        out[k] = DRIVE_N_PER_V * min(max(volts, -LIMIT_V), LIMIT_V)
        before_last, last = last, x
        for _ in range(parts):
            side = 0.5 if v > 0 else -0.5
            free = v + step / mass * (out[k] + offset - viscous * (1.0 + side * viscous_difference) * v)
            stop = step / mass * dry * (1.0 + side * dry_difference)
            v = 0.0 if abs(free) <= stop else free - np.sign(free) * stop
            x += step * v
    return out


def emps(folder: Path, case: Path, results: Path) -> list[tuple[str, float, float]]:
    """Return errors of the force, as shares of it, over the record and its last third: as published, and corrected."""
    rows = pd.read_parquet(folder / "emps" / "train.parquet")
    recorded, reference = rows["u_slide"].to_numpy(float), rows["qref_slide"].to_numpy(float)
    axis = np.array([MASS_KG, VISCOUS_N_S_M, DRY_N, 0.0, 0.0, 0.0])
    told = Corrected.read(results, runner.read(case)).values.set_index(["effect", "parameter"])["value"]
    where = {
        ("mass[carriage]", "mass_kg"): 0,
        ("joint_damping[slide]", "damping"): 1,
        ("joint_friction[slide]", "friction"): 2,
        ("asymmetric_friction[slide]", "viscous"): 3,
        ("asymmetric_friction[slide]", "dry"): 4,
    }
    corrected = axis.copy()
    for key, place in where.items():
        corrected[place] = told.get(key, axis[place])
    corrected[5] = told.get(("torque_offset[slide]", "torque"), 0.0)
    left = [str(e) for e in told.index.get_level_values(0) if e not in {e for e, _ in where} | {"torque_offset[slide]"}]
    if left:
        print(f"not in the closed loop: {', '.join(left)}")
    third = slice(2 * len(recorded) // 3, None)
    out = []
    for name, one in (("as published", axis), ("corrected", corrected)):
        off = closed_loop(reference, float(rows["q_slide"].iloc[0]), one, 5) - recorded
        whole, last = (np.mean(off[part] ** 2) / np.mean(recorded[part] ** 2) for part in (slice(None), third))
        out.append((name, float(np.sqrt(whole)), float(np.sqrt(last))))
    return out


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description="Errors of models of real mechanisms on what nothing was fitted to.")
    parser.add_argument("cases", type=Path)
    parser.add_argument("results", type=Path)
    parser.add_argument("--folder", type=Path, help="holds emps")
    given = parser.parse_args()
    for results in sorted(p.parent for p in given.results.glob("*/verdict.json")):
        case = given.cases / results.name
        first = json.loads((results / "verdict.json").read_text())["ranked"][0]
        print(f"{results.name}: {' + '.join(first['effects'])}, probability {first['probability']:.2f}")
        print(restarts(case, results).to_string(index=False, float_format=lambda x: f"{x:.4g}"))
        if given.folder is not None and results.name == "emps":
            for name, whole, third in emps(given.folder, case, results):
                print(f"closed loop, {name}: force off by {100 * whole:.2f} %, in the last third {100 * third:.2f} %")


if __name__ == "__main__":
    main()
