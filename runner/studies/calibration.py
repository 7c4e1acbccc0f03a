"""The study `calibration`: chosen pushes against the paper's sequence and random pushes, to 1 % on every parameter."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from runner.config import registered
from runner.errors import check_range
from runner.estimation.calibration import (
    Calibrated,
    Chosen,
    LimitsConfig,
    Planner,
    Source,
    Thing,
    calibrate,
    write_pushes,
)
from runner.estimation.copies import Copies, errors
from runner.estimation.data import measured_sd, motion_of, times
from runner.estimation.joint import Joint, PriorConfig, write_view
from runner.estimation.tracker import Tracker
from runner.physics.forces import AbstractForces, CsvForces, PaperForces, RandomForces
from runner.physics.scene import push_columns
from runner.progress import track
from runner.storage.writing import write_parquet
from runner.studies.base import AbstractStudy, Rows
from runner.studies.joint import short
from runner.teleop.experiment import Experiment
from runner.teleop.link import update_steps
from runner.teleop.parameters import PARAMETERS

OVER_TIME, PUSHES = "over_time.parquet", "pushes.csv"


def train(forces: AbstractForces, timestep_s: float, period: int) -> list[Chosen]:
    """Return a sequence of forces as pushes, each with the rest that follows; the first rest has a push of nothing."""
    n = round(forces.duration_s / timestep_s / period) * period
    force, point = forces.columns(np.arange(n) * timestep_s, timestep_s)
    pushed = np.any(force != 0, axis=1)
    begins = np.flatnonzero(pushed & ~np.concatenate([[False], pushed[:-1]])) // period * period
    edges = [0, *begins[begins > 0].tolist(), n]
    out = []
    for a, b in pairwise(edges):
        at = a + int(np.argmax(pushed[a:b]))
        out.append(
            Chosen(push_columns(force[a:b], point[a:b]), force[at], point[at], pushed[a:b].sum() * timestep_s, 0)
        )
    return out


def in_turn(pushes: Sequence[Chosen]) -> Source:
    """Return the source that gives these pushes in turn."""
    left = iter(pushes)
    return lambda belief, steps: next(left, None)


@registered("study", "calibration")
@dataclass(frozen=True)
class Calibration(AbstractStudy):
    """Time and pushes until all 95 % intervals are within `target` of their parameters (of the half size for the CoM).

    A row for each source of pushes and size of noise. All have the same force. `reached` is the share of runs that got
    there, `time_median_s`, `time_longest_s` and `pushes_median` are over these; `faster` is the paper's median time
    over this one. `paper` begins with a rest, as published; `paper_without_lead` does not. `held` is the share of runs
    in which the truth was within `target` for all five parameters at the end; `largest_error` the worst.
    """

    seeds: int = 20
    noise_times: tuple[float, ...] = (1.0, 3.0)
    target: float = 0.01
    longest_s: float = 15.5
    limits: LimitsConfig = field(default_factory=LimitsConfig)
    prior: PriorConfig = field(default_factory=PriorConfig)

    def __post_init__(self) -> None:
        check_range("seeds", self.seeds, 1, 10_000)
        check_range("target", self.target, 0.0, 1.0, lower_open=True)
        check_range("longest_s", self.longest_s, 0.0, 1e4, unit="s", lower_open=True)
        for i, factor in enumerate(self.noise_times):
            check_range(f"noise_times[{i}]", factor, 0.0, 100.0, lower_open=True)

    def rows(self, experiment: Experiment, folder: Path) -> Rows:
        rows, courses = [], []
        for factor in self.noise_times:
            found = self._found(experiment, factor)
            paper = found["paper"]["time_median_s"][0]
            for name, one in found.items():
                runs: list[Calibrated] = one.pop("runs")
                row = {key: value[0] for key, value in one.items()}
                rows.append({"pushes": name, "noise_times": factor, **row, "faster": paper / row["time_median_s"]})
                courses.append(self._course(name, factor, runs[0], experiment))
                if name == "chosen" and factor == self.noise_times[0]:
                    self._view(experiment, runs[0], folder)
        write_parquet(folder / OVER_TIME, pd.concat(courses, ignore_index=True))
        return rows

    def _view(self, experiment: Experiment, run: Calibrated, folder: Path) -> None:
        """Play the chosen pushes of a run again, in the closed loop."""
        write_pushes(folder / PUSHES, run, experiment.scene.timestep_s)
        again = replace(experiment, forces=CsvForces(str(folder / PUSHES)))
        write_view(again, folder, {"joint": Joint(self.prior, experiment.link.noise)})

    def _sources(self, experiment: Experiment, planner: Planner) -> dict[str, Callable[[int], Source]]:
        step_s, force = experiment.scene.timestep_s, self.limits.force_n
        paper = PaperForces(force_n=force)
        reach = max(abs(v) for v in self.limits.offsets) * min(experiment.remote.half_size_m[:2])

        def sequence(forces: AbstractForces) -> Source:
            return in_turn(train(forces, step_s, planner.period))

        return {
            "chosen": lambda seed: lambda belief, steps: planner.next(belief, np.zeros(2)),
            "paper": lambda seed: sequence(paper),
            "paper_without_lead": lambda seed: sequence(replace(paper, lead_s=0.0)),
            "random": lambda seed: sequence(RandomForces(seed=seed, force_n=(force, force), reach_m=reach, lead_s=0.0)),
        }

    def _found(self, experiment: Experiment, factor: float) -> dict[str, dict[str, Any]]:
        motion = motion_of(experiment)
        noise = measured_sd(times(experiment.link.noise, factor))
        copies = Copies(experiment.scene, experiment.local)
        tracker = Tracker(copies, noise)
        period = int(update_steps(experiment.link, experiment.scene.timestep_s, 10_000)[0])
        planner = Planner(tracker, self.limits, period, self.target)
        prior = self.prior.around(experiment.local)
        out: dict[str, dict[str, Any]] = {}
        for name, source in self._sources(experiment, planner).items():
            runs = []
            for i in track(range(self.seeds), f"{name}, noise x {factor:g}", unit="runs"):
                seed = experiment.seed + i
                thing = Thing(copies, motion.true_x, noise, np.random.default_rng([seed, 2]))
                runs.append(
                    calibrate(
                        thing, tracker, prior, source(seed),
                        period=period, target=self.target, longest_s=self.longest_s,
                    )
                )  # fmt: skip
            off = np.array([np.abs(errors(r.belief.x[0], motion.true_x)).max() for r in runs])
            ended = [r for r in runs if r.reached]
            time_s = np.array([r.time_s for r in ended] or [np.nan])
            count = np.array([sum(p.push_s > 0 for _, p in r.pushes) for r in ended] or [np.nan])
            out[name] = {
                "runs": runs,
                "seeds": (self.seeds,),
                "reached": (len(ended) / self.seeds,),
                "time_median_s": (float(np.median(time_s)),),
                "time_longest_s": (float(time_s.max()),),
                "pushes_median": (float(np.median(count)),),
                "held": (float((off <= self.target).mean()),),
                "largest_error": (float(off.max()),),
                "farthest_m": (max(r.reach_m for r in runs),),
            }
        return out

    def _course(self, name: str, factor: float, run: Calibrated, experiment: Experiment) -> pd.DataFrame:
        """Return how the uncertainty of the first run shrank."""
        period_s = 1.0 / experiment.link.rate_hz
        sd = run.track[:, len(PARAMETERS) :]
        columns = {f"{short(p)}_sd": sd[:, j] for j, p in enumerate(PARAMETERS)}
        time_s = period_s * np.arange(1, len(sd) + 1)
        begun = np.searchsorted([start for start, _ in run.pushes], time_s)
        return pd.DataFrame({"pushes": name, "noise_times": factor, "time_s": time_s, "push": begun, **columns})
