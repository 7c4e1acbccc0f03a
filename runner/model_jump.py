"""The model jump: what an operator would feel when the local model is corrected, and policies that limit it.

At an update the shown cube gets another state and other parameters. The jump is how far its position and velocity go
in no time, and by how much the force changes that the same motion takes: of one physics step from the state before the
update under the same command, the generalised force

    M_new (a_old - a_new)

that would have to be added for the cube with the new parameters to accelerate as it did with the old ones, the friction
of both cubes being MuJoCo's. It is zero where nothing moves: what sticks under both models can't be told apart.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pandas as pd

from runner import law
from runner.config import registered
from runner.errors import check_range
from runner.experiment import Experiment, commands, set_start
from runner.follow import AbstractFollow, Blended, DeadBand, FreeSpace, Immediate, RateLimited
from runner.frames import RunResult
from runner.loop import POSITION, VELOCITY, run_batch
from runner.progress import track
from runner.scene import build, handles
from runner.studies import AbstractStudy, Rows

WEBER_FORCE = 0.1  # Pang, Tan and Durlach 1991: 5 to 10 %
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
    pushes = commands(experiment).pushes[:, law.PUSH_SIZE : 2 * law.PUSH_SIZE]
    per_kg = model.body_inertia[handle.body_id] / model.body_mass[handle.body_id]
    h = experiment.scene.timestep_s

    def acceleration(mass_kg: float, row: int) -> np.ndarray:
        model.body_mass[handle.body_id] = mass_kg
        model.body_inertia[handle.body_id] = per_kg * mass_kg
        mujoco.mj_setConst(model, scratch)
        data.qpos[:], data.qvel[:] = np.split(old[row], 2)
        data.userdata[: law.PUSH_SIZE] = pushes[frame[row] - 1]
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
    mass is over, so that what is corrected from then on is noise and age.
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
            "dead_band": DeadBand(),
        }
        out = []
        for name, policy in track(list(policies.items()), "Following", unit="policies"):
            runs = [replace(experiment, follow=policy, seed=experiment.seed + i) for i in range(self.seeds)]
            results = run_batch(runs)
            felt = [jumps(one, result, next(iter(one.estimator))) for one, result in zip(runs, results, strict=True)]
            felt[0].to_parquet(folder / f"{name}.parquet")
            results[0].updates.table().to_parquet(folder / f"{name}_frames.parquet")
            out.append({"policy": name} | self._row(runs, results, pd.concat(felt)))
        return out

    def _row(self, runs: list[Experiment], results: list[RunResult], felt: pd.DataFrame) -> dict[str, Any]:
        name = next(iter(runs[0].estimator))
        tables = [result.updates.table().assign(seed=i) for i, result in enumerate(results)]
        frames = pd.concat(tables)
        row: dict[str, Any] = {"seeds": len(runs)}
        for label, part, errors in (
            ("start", felt[felt.time_s <= self.settled_s], frames[frames.time_s <= self.settled_s]),
            ("settled", felt[felt.time_s > self.settled_s], frames[frames.time_s > self.settled_s]),
        ):
            for column in ("position_m", "velocity_m_s", "force_n"):
                row[f"{label}_largest_{column}"] = float(part[column].max())
                row[f"{label}_rms_{column}"] = float(np.sqrt((part[column] ** 2).mean()))
            noticed = part.force_n > np.maximum(WEBER_FORCE * part.felt_n, FELT_FORCE_N)
            duration = len(runs) * (part.time_s.max() - part.time_s.min())
            row[f"{label}_noticed_1_s"] = float(noticed.sum() / duration)
            behind = errors[f"{name}_position_error_m"]
            each = np.sqrt((behind**2).groupby(errors["seed"]).mean())
            row[f"{label}_behind_m"], row[f"{label}_behind_se_m"] = float(each.mean()), float(each.sem())
            row[f"{label}_largest_behind_m"] = float(behind.max())
        final = np.array([table[f"{name}_shown_mass_kg"].iloc[-1] for table in tables])
        row["mass_final_error"] = float(np.median(np.abs(final / results[0].parameters[name]["mass_kg"].true - 1)))
        return row
