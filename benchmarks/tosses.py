"""How far plain MuJoCo is from real tosses of a cube that nothing was fitted to: stock, with a friction, and corrected.

    python benchmarks/tosses.py FOLDER [--corrected RESULTS] [--case CASE]

FOLDER holds `train.parquet` and `episodes.csv` of the ContactNets tosses; which tosses are left out is decided by
`is_left_out` of `examples/tosses/make_cases.py`. Every toss is simulated open loop from the start state that a
ballistic flight with constant spin was fitted to (`fit_*0`). Errors are means over each toss from its first touch on,
then over the tosses: position as a share of the cube's width, and rotation in degrees. RESULTS is the folder of a
`runner diagnose` of the case CASE: its effects are added one by one in the order in which they were found, as the MJCF
that the diagnosis writes for them.
"""

from __future__ import annotations

import argparse
import importlib.util
import tempfile
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
import pandas as pd

import runner
from runner.api.corrected import Corrected

EXAMPLE = Path(__file__).parents[1] / "examples" / "tosses" / "make_cases.py"
AXES, QUATERNION = ["x", "y", "z"], ["qw", "qx", "qy", "qz"]


@dataclass(frozen=True)
class Toss:
    """A toss: times (T,), position (T, 3), orientation (T, 4), the start (13,) as qpos and qvel, the first touch."""

    t_s: np.ndarray
    place: np.ndarray
    turn: np.ndarray
    start: np.ndarray
    touch: int


def tosses_of(folder: Path, chosen: list[int]) -> list[Toss]:
    """Return tosses that have a ballistic start state."""
    table, episodes = pd.read_parquet(folder / "train.parquet"), pd.read_csv(folder / "episodes.csv")
    known = episodes[episodes["ballistic_fit"]].set_index("episode")
    out = []
    for number in chosen:
        if number not in known.index:
            continue
        rows = table.loc[table["episode"] == number].sort_values(by=["t"])
        row = known.loc[[number]].to_dict("records")[0]

        def numbers(names: list[str], row: dict = row) -> np.ndarray:
            return np.array([row[f"fit_{n}0"] for n in names], float)

        turn = numbers(QUATERNION)
        turn /= np.linalg.norm(turn)
        spin = np.empty(3)
        mujoco.mju_rotVecQuat(spin, numbers(["wx", "wy", "wz"]), turn * (1, -1, -1, -1))  # body axes
        start = np.concatenate([numbers(AXES), turn, numbers(["vx", "vy", "vz"]), spin])
        t = rows["t"].to_numpy(float)
        touch = int(row["i_first_touch"])
        out.append(Toss(t - t[0], rows[AXES].to_numpy(float), rows[QUATERNION].to_numpy(float), start, touch))
    return out


def errors(model: mujoco.MjModel, tosses: list[Toss], width_m: float, clock: float = 1.0) -> tuple[float, float]:
    """Return mean position error as a share of the width, and mean rotation error in degrees."""
    data, found = mujoco.MjData(model), []
    for toss in tosses:
        mujoco.mj_resetData(model, data)
        data.qpos[:], data.qvel[:] = toss.start[:7], toss.start[7:]
        steps = int(np.ceil(toss.t_s[-1] / clock / model.opt.timestep)) + 1
        poses = np.empty((steps + 1, 7))
        for k in range(steps + 1):
            poses[k] = data.qpos
            mujoco.mj_step(model, data)
        nearest = np.round(toss.t_s / clock / model.opt.timestep).astype(int)[toss.touch :]
        place = np.linalg.norm(poses[nearest, :3] - toss.place[toss.touch :], axis=1)
        alike = np.abs(np.sum(poses[nearest, 3:] * toss.turn[toss.touch :], axis=1))
        found.append((place.mean() / width_m, np.degrees(2 * np.arccos(np.clip(alike, 0, 1))).mean()))
    share, degrees = np.mean(found, axis=0)
    return float(share), float(degrees)


def steps_of(results: Path, case: Path) -> list[tuple[str, mujoco.MjModel, float]]:
    """Return the corrected models with the first effect, the first two, ...: a name, the MJCF, the clock's ratio."""
    read = runner.read(case)
    effects = Corrected.read(results, read).effects
    out = []
    for k in range(1, len(effects) + 1):
        with tempfile.TemporaryDirectory() as folder:
            Corrected(read, effects[:k]).save(folder)
            model = mujoco.MjModel.from_xml_path(str(Path(folder) / "model.xml"))
        ratio = next((e.report()["ratio"] for e in effects[:k] if e.name == "clock_scale"), 1.0)
        # a step of the model is one of the clock
        model.opt.timestep *= ratio
        out.append((f"+ {effects[k - 1].full_name}", model, ratio))
    return out


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description="Errors of plain MuJoCo on tosses that nothing was fitted to.")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--corrected", type=Path, help="results of a diagnosis")
    parser.add_argument("--case", type=Path, help="what was diagnosed")
    given = parser.parse_args()
    spec = importlib.util.spec_from_file_location("make_cases", EXAMPLE)
    assert spec is not None
    assert spec.loader is not None
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    table = pd.read_parquet(given.folder / "train.parquet")
    left_out = [int(e) for e in sorted(table["episode"].unique()) if example.is_left_out(int(e))]
    tosses = tosses_of(given.folder, left_out)
    rows = [
        ("stock", mujoco.MjModel.from_xml_string(example.model(1.0)), 1.0),
        ("friction 0.18", mujoco.MjModel.from_xml_string(example.model(0.18)), 1.0),
    ]
    if given.corrected is not None and given.case is not None:
        rows += steps_of(given.corrected, given.case)
    print(f"{len(tosses)} tosses left out; mean error from the first touch on")
    for name, model, clock in rows:
        share, degrees = errors(model, tosses, example.SIDE_M, clock)
        print(f"{name:40s} {100 * share:6.1f} %  {degrees:5.1f} degrees")


if __name__ == "__main__":
    main()
