"""The study `com_eq6`: the CoM by eq. 6 of the paper, where it is right and where not, beside the joint estimator."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pandas as pd

from runner.config import registered
from runner.errors import check_range
from runner.estimation.copies import Copies, to_vector
from runner.estimation.data import measured_sd, motion_of
from runner.estimation.eq6 import ComEq6, Factor
from runner.estimation.joint import Joint, PriorConfig, write_view
from runner.estimation.tracker import Tracker
from runner.physics.forces import AbstractForces, Offcentre, Straight
from runner.storage.writing import write_parquet
from runner.studies.base import AbstractStudy, Rows
from runner.teleop.batch import run_batch
from runner.teleop.experiment import Experiment, RemoteConfig, StartConfig
from runner.teleop.follow import Immediate
from runner.teleop.link import LinkConfig

OVER_TIME = "over_time.parquet"


@dataclass(frozen=True)
class Case:
    """One thing to vary: friction, force, direction, true offset, mass of the local cube over the true mass."""

    about: str
    friction: float = 0.3
    force_n: float = 15.0
    angle_rad: float = 0.0
    offset: float = 0.1  # share of the half size, across the push
    mass_ratio: float = 1.0
    point: float = 0.0  # where the push acts, across it, share of the half size


def _cases(offsets: tuple[float, ...]) -> list[Case]:
    threshold_n = 0.3 * 3.0 * 9.81
    return [
        *(Case("offset", offset=o) for o in offsets),
        *(Case("friction", friction=mu) for mu in (0.0, 0.1, 0.2, 0.3, 0.4, 0.45)),
        *(Case("force over threshold", force_n=r * threshold_n) for r in (1.05, 1.2, 1.5, 2.0, 3.0)),
        *(Case("direction", angle_rad=a) for a in (0.0, math.pi / 8, math.pi / 4, math.pi / 2)),
        *(Case("mass of the local cube", mass_ratio=r) for r in (0.8, 1.0, 1.2)),
        *(Case("mass of the local cube, pushed beside the centre", mass_ratio=r, point=0.2) for r in (0.8, 1.0, 1.2)),
        Case("sticking", force_n=0.9 * threshold_n),
    ]


@registered("study", "com_eq6")
@dataclass(frozen=True)
class ComEq6Study(AbstractStudy):
    """A row for each case and f_difference: one push from rest, the estimate across the push after one update, and
    after all updates of the push, over the true offset (`one_update`, `all_updates`: 1 is right; 0: it never moved).

    The last rows are the joint estimator on the experiment's own sequence, with the mass, inertia and friction known,
    and with all unknown: its errors along both axes in shares of the half size.
    """

    offsets: tuple[float, ...] = (-0.3, -0.1, 0.02, 0.1, 0.3)
    push_s: float = 0.5
    prior: PriorConfig = field(default_factory=PriorConfig)

    def __post_init__(self) -> None:
        check_range("push_s", self.push_s, 0.05, 10.0, unit="s")
        for i, offset in enumerate(self.offsets):
            check_range(f"offsets[{i}]", offset, -0.9, 0.9)

    def rows(self, experiment: Experiment, folder: Path) -> Rows:
        cases = _cases(self.offsets)
        results = run_batch([self._experiment(experiment, case) for case in cases], threads=1)
        rows, courses = [], []
        for case, result in zip(cases, results, strict=True):
            frames, half = result.updates, experiment.remote.half_size_m
            across = (-math.sin(case.angle_rad) * half[0], math.cos(case.angle_rad) * half[1])
            true_m = case.offset * (across[0] ** 2 + across[1] ** 2) ** 0.5
            for name in result.estimators:
                x, y = frames.column(f"{name}_com_x_m"), frames.column(f"{name}_com_y_m")
                told = (-math.sin(case.angle_rad) * x + math.cos(case.angle_rad) * y) / true_m
                rows.append(
                    {
                        "estimator": name,
                        "varied": case.about,
                        "friction": case.friction,
                        "force_n": case.force_n,
                        "angle_rad": case.angle_rad,
                        "offset_m": true_m,
                        "mass_ratio": case.mass_ratio,
                        "point_m": case.point * half[1],
                        "one_update": told[0],
                        "all_updates": told[-1],
                    }
                )
                if case.about == "offset":
                    time_s = frames.column("time_s")
                    courses.append(
                        pd.DataFrame({"estimator": name, "offset_m": true_m, "time_s": time_s, "told": told})
                    )
        write_parquet(folder / OVER_TIME, pd.concat(courses, ignore_index=True))
        shown = self._experiment(experiment, Case("offset"))
        write_view(shown, folder, {**shown.estimator, "joint": Joint(self.prior)})
        return [*rows, *self._joint(experiment)]

    def _experiment(self, experiment: Experiment, case: Case) -> Experiment:
        """One straight push from rest; the true offset lies to the left of it, the local cube's CoM in its middle."""
        half = experiment.remote.half_size_m
        left = np.array([-math.sin(case.angle_rad) * half[0], math.cos(case.angle_rad) * half[1], 0.0])
        force = case.force_n * np.array([math.cos(case.angle_rad), math.sin(case.angle_rad), 0.0])
        x, y, z = (float(v) for v in case.offset * left)
        mass = experiment.remote.mass_kg
        return replace(
            experiment,
            forces=_push(force, case.point * left, self.push_s),
            remote=RemoteConfig(mass, half, (x, y, z), None, case.friction),
            start=StartConfig(case.mass_ratio * mass),
            link=LinkConfig(rate_hz=experiment.link.rate_hz),
            estimator={
                "eq6_free": ComEq6(Factor.free),
                "eq6_sliding": ComEq6(Factor.sliding),
                "eq6_simulated": ComEq6(Factor.simulated),
            },
            follow=Immediate(),
        )

    def _joint(self, experiment: Experiment) -> Rows:
        motion, rows = motion_of(experiment), []
        known = PriorConfig(mass=0.0, com=self.prior.com, yaw_inertia=0.0, friction=0.0)
        start = to_vector(experiment.local)
        for name, prior in (("joint, all else known", known), ("joint, nothing known", self.prior)):
            around = prior.around(experiment.local)
            x = np.where(around.sd > 0, start, motion.true_x)
            tracker = Tracker(Copies(experiment.scene, experiment.local), measured_sd(experiment.link.noise))
            belief = tracker.start(replace(around, x=x), np.zeros((1, 6)))
            for pushes, state in zip(motion.windows(), motion.states, strict=True):
                belief = tracker.update(belief, pushes, state[None])
            off = belief.x[0] - motion.true_x
            rows.append({"estimator": name, "com_x_error": off[1], "com_y_error": off[2]})
        return rows


def _push(force_n: np.ndarray, point_m: np.ndarray, push_s: float) -> AbstractForces:
    fx, fy, fz = (float(v) for v in force_n)
    if not point_m.any():
        return Straight((fx, fy, fz), lead_s=0.0, push_s=push_s, rest_s=0.0)
    px, py, pz = (float(v) for v in point_m)
    return Offcentre((fx, fy, fz), lead_s=0.0, push_s=push_s, rest_s=0.0, point_m=(px, py, pz))
