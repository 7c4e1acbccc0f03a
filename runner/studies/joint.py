"""The studies `joint_ideal` and `joint_noise`: all parameters from the paper's sequence, without and with noise."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import scipy

from runner.config import registered
from runner.errors import check_range
from runner.estimation.belief import Belief, Prior, observable
from runner.estimation.bound import batch_fit, bound, information
from runner.estimation.copies import COM_X, COM_Y, SIZE, Copies, errors, to_values
from runner.estimation.data import RemoteMotion, measured_sd, motion_of, times
from runner.estimation.joint import Joint, PriorConfig, write_view
from runner.estimation.published import published
from runner.estimation.tracker import Tracker
from runner.estimation.watch import INTERVAL
from runner.progress import progress
from runner.storage.writing import write_parquet
from runner.studies.base import AbstractStudy, Rows
from runner.teleop.estimators import Linear
from runner.teleop.experiment import Experiment
from runner.teleop.parameters import PARAMETERS

OVER_TIME = "over_time.parquet"


def short(parameter: str) -> str:
    """Return a parameter's name without its unit."""
    return parameter.rpartition("_")[0]


def share_within(inside: np.ndarray) -> tuple[float, float, float]:
    """Return the share of hits (n,), and its exact 95 % interval (Clopper & Pearson 1934)."""
    n, k = inside.size, int(inside.sum())
    low = 0.0 if k == 0 else float(scipy.stats.beta.ppf(0.025, k, n - k + 1))
    high = 1.0 if k == n else float(scipy.stats.beta.ppf(0.975, k + 1, n - k))
    return k / n, low, high


@registered("study", "joint_ideal")
@dataclass(frozen=True)
class JointIdeal(AbstractStudy):
    """Exact measurements, start values off in all directions: each of mass, inertia and friction too high or too low.

    By `factor`; the CoM by `com_share` of the half size, to either side along both axes. That makes 32 starts around
    the truth, each a row with the final errors (those of the CoM as share of the half size), and the first update from
    which on all of them stay within 0.1 %. The last row is the batch least-squares answer, from a start much nearer.
    """

    factor: float = 2.0
    com_share: float = 0.3
    prior: PriorConfig = field(default_factory=PriorConfig)

    def __post_init__(self) -> None:
        check_range("factor", self.factor, 1.0, 10.0)
        check_range("com_share", self.com_share, 0.0, 0.9)

    def rows(self, experiment: Experiment, folder: Path) -> Rows:
        motion = motion_of(experiment)
        half = experiment.remote.half_size_m
        signs = np.array(list(itertools.product((1, -1), repeat=SIZE)))
        off = np.full(SIZE, np.log(self.factor))
        off[[COM_X, COM_Y]] = self.com_share
        starts = motion.true_x + signs * off
        tracker = Tracker(Copies(experiment.scene, experiment.local), measured_sd(times(experiment.link.noise, 0.0)))
        belief = tracker.start(Prior(starts, self.prior.sd), np.zeros((len(starts), 6)))
        found, sds = [], []
        windows = motion.windows()
        with progress("Estimating", total=len(windows), unit="updates") as advance:
            for pushes, state in zip(windows, motion.states, strict=True):
                belief = tracker.update(belief, pushes, np.repeat(state[None], len(starts), axis=0))
                found.append(errors(belief.x, motion.true_x))
                sds.append(belief.sd)
                advance()
        error = np.array(found)  # (m, lanes, 5)
        _write_tracks(folder / OVER_TIME, motion, error, np.array(sds))
        within = [_since(motion.times_s, np.abs(error[:, i]).max(axis=1), 1e-3) for i in range(len(starts))]
        write_view(experiment, folder, {"joint": Joint(self.prior)})
        rows: Rows = []
        for i, start in enumerate(starts):
            row: dict[str, Any] = {"estimator": "joint"}
            row |= {f"{p}_start": v for p, v in zip(PARAMETERS, to_values(start, half), strict=True)}
            row |= {f"{short(p)}_final_error": error[-1, i, j] for j, p in enumerate(PARAMETERS)}
            row["all_to_0p1pct_s"] = within[i]
            rows.append(row)
        start = np.concatenate([np.zeros(6), motion.true_x + 0.05 * signs[0] * off])  # far off it finds no way
        fit = batch_fit(tracker.copies, start, motion.pushes, motion.ends, motion.states, tracker.noise_sd)
        row = {"estimator": "batch least squares"}
        row |= {f"{p}_start": v for p, v in zip(PARAMETERS, to_values(start[6:], half), strict=True)}
        last = errors(fit.unknowns[6:], motion.true_x)
        return [*rows, row | {f"{short(p)}_final_error": last[j] for j, p in enumerate(PARAMETERS)}]


def _since(time_s: np.ndarray, error: np.ndarray, limit: float) -> float:
    outside = np.flatnonzero(~(error <= limit))
    first = int(outside[-1]) + 1 if len(outside) else 0
    return float(time_s[first]) if first < len(time_s) else float("nan")


def _write_tracks(path: Path, motion: RemoteMotion, error: np.ndarray, sd: np.ndarray) -> None:
    """Write errors and standard deviations (m, lanes, 5) of all starts."""
    m, lanes, _ = error.shape
    table = pd.DataFrame(
        {
            "time_s": np.repeat(motion.times_s, lanes),
            "start": np.tile(np.arange(lanes), m),
            **{f"{short(p)}_error": error[..., j].ravel() for j, p in enumerate(PARAMETERS)},
            **{f"{short(p)}_sd": sd[..., j].ravel() for j, p in enumerate(PARAMETERS)},
        }
    )
    write_parquet(path, table)


@dataclass(frozen=True)
class Course:
    """How beliefs of many seeds went: estimates and standard deviations at some updates, (k, N, 5) each."""

    at: np.ndarray  # which updates, (k,)
    x: np.ndarray
    sd: np.ndarray
    last: Belief


def follow(
    tracker: Tracker, belief: Belief, motion: RemoteMotion, measured: np.ndarray, every: int, title: str
) -> Course:
    """Update a belief with all measurements (N, m, 6) of a motion, and keep every so many of the results."""
    at, x, sd = [], [], []
    windows = motion.windows()
    with progress(title, total=len(windows), unit="updates") as advance:
        for k, pushes in enumerate(windows):
            belief = tracker.update(belief, pushes, measured[:, k])
            if k % every == every - 1 or k == len(windows) - 1:
                at.append(k)
                x.append(belief.x)
                sd.append(belief.sd)
            advance()
    return Course(np.array(at), np.array(x), np.array(sd), belief)


@registered("study", "joint_noise")
@dataclass(frozen=True)
class JointNoise(AbstractStudy):
    """Noisy measurements, many seeds: the error against the Cramer-Rao bound, beside the paper's linear estimator.

    A row for each parameter and size of noise (`noise_times` that of `link.noise`). `rmse`, `bound`, `stated_sd` and
    `bias` are relative, those of the CoM in shares of the half size; `ratio` is rmse / bound, with its 95 % interval.
    `coverage` is how often the stated 95 % interval held the truth. `batch_difference` is the largest difference from
    the batch least-squares answer over the first seeds, in units of the bound. The paper's estimator is given the true
    friction, and the mass alone to find; `published_rmse` is its error at the end.
    """

    seeds: int = 200
    noise_times: tuple[float, ...] = (1.0, 3.0)
    batch_seeds: int = 3
    prior: PriorConfig = field(default_factory=PriorConfig)

    def __post_init__(self) -> None:
        check_range("seeds", self.seeds, 2, 100_000)
        check_range("batch_seeds", self.batch_seeds, 0, self.seeds)
        for i, factor in enumerate(self.noise_times):
            check_range(f"noise_times[{i}]", factor, 0.0, 100.0, lower_open=True)

    def rows(self, experiment: Experiment, folder: Path) -> Rows:
        motion = motion_of(experiment)
        rows, courses = [], []
        for factor in self.noise_times:
            more, course = self._rows(experiment, motion, factor)
            rows += more
            courses.append(course)
        write_parquet(folder / OVER_TIME, pd.concat(courses, ignore_index=True))
        write_view(experiment, folder, {"joint": Joint(self.prior, experiment.link.noise)})
        return rows

    def _rows(self, experiment: Experiment, motion: RemoteMotion, factor: float) -> tuple[Rows, pd.DataFrame]:
        noise = times(experiment.link.noise, factor)
        seeds = [experiment.seed + i for i in range(self.seeds)]
        measured = motion.measured(noise, seeds)
        copies = Copies(experiment.scene, experiment.local)
        tracker = Tracker(copies, measured_sd(noise))
        prior = self.prior.around(experiment.local)
        info = information(copies, motion.unknowns, motion.pushes, motion.ends, tracker.noise_sd)
        course = follow(tracker, tracker.start(prior, measured[:, 0]), motion, measured, 6, f"Noise x {factor:g}")
        least = bound(info)
        error = course.x - motion.true_x  # logarithms: relative, as they are small at the end
        rmse = np.sqrt((error**2).mean(axis=1))  # (k, 5)
        masses = published(Linear(), copies, experiment, motion, measured)
        off = masses / to_values(motion.true_x, copies.half_size_m)[0] - 1  # (N, m)
        found, sds = course.last.unknowns, np.sqrt(np.diagonal(course.last.covariance, axis1=1, axis2=2))
        differences = [
            self._batch_difference(tracker, motion, measured[i], found[i], sds[i]) for i in range(self.batch_seeds)
        ]
        spread = np.sqrt(scipy.stats.chi2.ppf([0.975, 0.025], self.seeds))
        rows: Rows = []
        for j, parameter in enumerate(PARAMETERS):
            share, low, high = share_within(np.abs(error[-1, :, j]) <= INTERVAL * course.sd[-1, :, j])
            ratio = rmse[-1, j] / least[-1, j]
            rows.append(
                {
                    "noise_times": factor,
                    "parameter": short(parameter),
                    "seeds": self.seeds,
                    "bound": least[-1, j],
                    "rmse": rmse[-1, j],
                    "ratio": ratio,
                    "ratio_low": ratio * np.sqrt(self.seeds) / spread[0],
                    "ratio_high": ratio * np.sqrt(self.seeds) / spread[1],
                    "bias": error[-1, :, j].mean(),
                    "bias_in_standard_errors": error[-1, :, j].mean() / error[-1, :, j].std() * np.sqrt(self.seeds),
                    "stated_sd": np.sqrt((course.sd[-1, :, j] ** 2).mean()),
                    "coverage": share,
                    "coverage_low": low,
                    "coverage_high": high,
                    "observable": bool(observable(course.sd[-1, :, j], prior.sd[j]).all()),
                    "batch_difference": max((d[j] for d in differences), default=np.nan) / least[-1, j],
                    "published_rmse": np.sqrt((off[:, -1] ** 2).mean()) if j == 0 else np.nan,
                }
            )
        return rows, self._course(motion, course, rmse, least, np.sqrt((off**2).mean(axis=0)), factor)

    def _course(
        self,
        motion: RemoteMotion,
        course: Course,
        rmse: np.ndarray,
        least: np.ndarray,
        by_rule: np.ndarray,
        factor: float,
    ) -> pd.DataFrame:
        """Return errors over time; `by_rule` (m,) is that of the mass by the published rule."""
        error = np.abs(course.x - motion.true_x)
        parts = []
        for j, parameter in enumerate(PARAMETERS):
            parts.append(
                pd.DataFrame(
                    {
                        "noise_times": factor,
                        "parameter": short(parameter),
                        "time_s": motion.times_s[course.at],
                        "rmse": rmse[:, j],
                        "bound": least[course.at, j],
                        "published_rmse": by_rule[course.at] if j == 0 else np.nan,
                        "stated_sd": np.sqrt((course.sd[..., j] ** 2).mean(axis=1)),
                        "coverage": (error[..., j] <= INTERVAL * course.sd[..., j]).mean(axis=1),
                    }
                )
            )
        return pd.concat(parts, ignore_index=True)

    @staticmethod
    def _batch_difference(
        tracker: Tracker, motion: RemoteMotion, measured: np.ndarray, found: np.ndarray, sd: np.ndarray
    ) -> np.ndarray:
        """Return how far the batch answer, begun two standard deviations away, is from the recursive one, (5,)."""
        fit = batch_fit(tracker.copies, found + 2.0 * sd, motion.pushes, motion.ends, measured, tracker.noise_sd)
        return np.abs(fit.unknowns[6:] - found[6:])
