"""The model jump: what an operator would feel when the local model is corrected, and policies that limit it.

At an update the shown cube gets another state and other parameters. The jump is how far its position and velocity go
in no time, and by how much the force changes that the same motion takes: of one physics step from the state before the
update under the same command, the generalised force

    M_new (a_old - a_new)

that would have to be added for the cube with the new parameters to accelerate as it did with the old ones, the friction
of both cubes being MuJoCo's. It is zero where nothing moves: what sticks under both models can't be told apart.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pandas as pd

from runner.config import registered
from runner.errors import check_range
from runner.physics import dry_friction
from runner.physics.scene import build, handles
from runner.progress import track
from runner.storage.writing import write_parquet
from runner.studies.base import AbstractStudy, Rows
from runner.teleop.batch import run_batch
from runner.teleop.columns import POSITION, VELOCITY
from runner.teleop.experiment import Experiment, commands, set_start
from runner.teleop.follow import AbstractFollow, Blended, FreeSpace, Immediate, PerceptualDeadBand, RateLimited
from runner.teleop.frames import RunResult
from runner.teleop.sinks import RrdSink

WEBER_FORCE = 0.07  # Pang, Tan and Durlach 1991
FELT_FORCE_N = 0.1  # below this a force is no force; so the fraction is of no use


def jumps(experiment: Experiment, result: RunResult, name: str) -> pd.DataFrame:
    """Return what an operator would feel at each update of a run.

    Args:
        experiment: The run's. Its scene must be planar.
        result: The run.
        name: Of the estimator.

    Returns:
        A row for each update: `time_s`, `position_m`, `angle_rad`, `velocity_m_s`, `rate_rad_s`, `force_n`,
        `torque_nm` (all of the jump), and `felt_n`, the force that acts on the body by its command and friction,
        which the jump of the force may be compared with. The last update of a run has no state after it, and no row.
    """
    after, before = result.steps, result.updates
    body = build(experiment.scene, {name: experiment.local})
    model = mujoco.MjModel.from_xml_string(body.to_xml_string(), body.get_assets())
    data, scratch = mujoco.MjData(model), mujoco.MjData(model)
    handle = handles(model, [name])[name]
    set_start(replace(experiment, estimator={name: experiment.estimator[name]}), model, scratch)
    frame = before.column("frame")
    kept = frame < len(after)
    frame = frame[kept]
    columns = [f"{name}_{c}" for c in (*POSITION[handle.joints], *VELOCITY[handle.joints])]
    old = np.column_stack([before.column(c)[kept] for c in columns])
    new = np.column_stack([after.column(c)[frame] for c in columns])
    change, turning = new - old, handle.nv - 1
    mass = before.column(
        f"{name}_mass_kg" if f"{name}_shown_mass_kg" not in before.columns else f"{name}_shown_mass_kg"
    )
    mass = np.concatenate([[experiment.local.mass_kg], mass])
    pushes = commands(experiment).pushes[:, dry_friction.PUSH_SIZE : 2 * dry_friction.PUSH_SIZE]
    per_kg = model.body_inertia[handle.body_id] / model.body_mass[handle.body_id]
    h = experiment.scene.timestep_s

    def acceleration(mass_kg: float, row: int) -> np.ndarray:
        model.body_mass[handle.body_id] = mass_kg
        model.body_inertia[handle.body_id] = per_kg * mass_kg
        mujoco.mj_setConst(model, scratch)
        data.qpos[:], data.qvel[:] = np.split(old[row], 2)
        data.userdata[: dry_friction.PUSH_SIZE] = pushes[frame[row] - 1]
        mujoco.mj_step(model, data)
        return (data.qvel - old[row, handle.nq :]) / h

    force, felt, product = np.zeros((len(frame), handle.nv)), np.zeros(len(frame)), np.zeros(handle.nv)
    for row in range(len(frame)):
        as_it_was = acceleration(mass[row], row)
        mujoco.mj_mulM(model, data, product, as_it_was)
        felt[row] = np.linalg.norm(pushes[frame[row] - 1][:2])
        if mass[row + 1] != mass[row]:
            difference = as_it_was - acceleration(mass[row + 1], row)
            mujoco.mj_forward(model, data)
            mujoco.mj_mulM(model, data, product, difference)
            force[row] = product
    return pd.DataFrame(
        {
            "time_s": before.column("time_s")[kept],
            "position_m": np.linalg.norm(change[:, :turning], axis=1),
            "angle_rad": np.abs(change[:, turning]),
            "velocity_m_s": np.linalg.norm(change[:, handle.nq : handle.nq + turning], axis=1),
            "rate_rad_s": np.abs(change[:, -1]),
            "force_n": np.linalg.norm(force[:, :turning], axis=1),
            "torque_nm": np.abs(force[:, turning]),
            "felt_n": felt,
        }
    )


@registered("study")
@dataclass(frozen=True)
class ModelJump(AbstractStudy):
    """Policies of following, on the same runs: size of the jump against tracking error, over `seeds` seeds.

    Every seed has its own delays, losses and noise; all policies see the same. `settled_s`: when the search for the
    mass is over, so that what is corrected from then on is noise and age. `run.rrd` shows the first policy's first run.
    """

    seeds: int = 20
    settled_s: float = 3.0
    policies: dict[str, AbstractFollow] | None = None

    def __post_init__(self) -> None:
        check_range("seeds", self.seeds, 1, 10_000)
        check_range("settled_s", self.settled_s, 0.0, 1e4, unit="s")

    def rows(self, experiment: Experiment, folder: Path) -> Rows:
        policies = self.policies or {
            "immediate": Immediate(),
            "rate_limited": RateLimited(),
            "blended": Blended(),
            "free_space": FreeSpace(),
            "dead_band": PerceptualDeadBand(),
        }
        out = []
        for name, policy in track(list(policies.items()), "Following", unit="policies"):
            runs = [replace(experiment, follow=policy, seed=experiment.seed + i) for i in range(self.seeds)]
            results = run_batch(runs)
            felt = [jumps(one, result, next(iter(one.estimator))) for one, result in zip(runs, results, strict=True)]
            write_parquet(folder / f"{name}.parquet", felt[0])
            write_parquet(folder / f"{name}_frames.parquet", results[0].updates.table())
            if not out:
                RrdSink().write(results[0], folder, {"seed": experiment.seed})
            out += self._rows(name, runs, results, felt)
        return out

    def _rows(self, policy: str, runs: list[Experiment], results: list[RunResult], felt: list[pd.DataFrame]) -> Rows:
        name = next(iter(runs[0].estimator))
        frames = [result.updates.columns for result in results]
        felt_columns = [{column: table[column].to_numpy() for column in table.columns} for table in felt]
        out = []
        for phase, early in (("search", True), ("settled", False)):
            row: dict[str, Any] = {"policy": policy, "phase": phase, "seeds": len(runs)}
            chosen = [_part(columns, self.settled_s, early=early) for columns in felt_columns]
            for column in ("position_m", "velocity_m_s", "force_n"):
                sizes = np.concatenate([columns[column] for columns in chosen])
                row[f"largest_{column}"] = float(sizes.max())
                row[f"rms_{column}"] = float(np.sqrt(np.mean(sizes**2)))
            noticed = sum(_noticed(columns["force_n"], columns["felt_n"]) for columns in chosen)
            row["noticed_1_s"] = noticed / sum(np.ptp(columns["time_s"]) for columns in chosen)
            parts = [_part(columns, self.settled_s, early=early) for columns in frames]
            each = np.sqrt([np.mean(columns[f"{name}_position_error_m"] ** 2) for columns in parts])
            row["behind_m"] = float(each.mean())
            row["behind_se_m"] = float(each.std(ddof=1) / np.sqrt(len(each))) if len(each) > 1 else np.nan
            true = results[0].parameters[name]["mass_kg"].true
            final = np.array([columns[f"{name}_shown_mass_kg"][-1] for columns in parts])
            row["mass_error"] = float(np.median(np.abs(final / true - 1)))
            out.append(row)
        return out


def _part(columns: Mapping[str, np.ndarray], time_s: float, *, early: bool) -> dict[str, np.ndarray]:
    """Return what is before, or after, a time."""
    kept = (columns["time_s"] <= time_s) == early
    return {name: column[kept] for name, column in columns.items()}


def _noticed(jump_n: np.ndarray, felt_n: np.ndarray) -> int:
    """Return how many jumps of the force can be felt, by Weber's law."""
    return int((jump_n > np.maximum(WEBER_FORCE * felt_n, FELT_FORCE_N)).sum())
