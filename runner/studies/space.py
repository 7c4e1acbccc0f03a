"""The study `space`: ten inertial parameters of a body that is shaken or tossed, many seeds, against the bound.

What nobody can know: without a force neither the mass nor the size of the inertia leaves a trace in a flight. The table
says so, and has the centre of mass and the inertia as shares of its sum.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import scipy

from runner.config import registered, with_key
from runner.errors import ConfigError, check_range, check_vector
from runner.estimation.space.bound import information, least_covariance
from runner.estimation.space.estimator import SpaceEstimator, numbers_of
from runner.estimation.space.inertial import (
    NAMES,
    SHARES,
    Inertial,
    derivative,
    shares_of,
    units_of,
    values_of,
)
from runner.estimation.space.made import MadeMotion, shaken, tossed
from runner.estimation.space.tracker import SpaceBelief
from runner.estimation.watch import INTERVAL
from runner.physics.scene import BodyConfig
from runner.progress import progress
from runner.storage.writing import write_parquet
from runner.studies.base import AbstractStudy, Rows
from runner.studies.joint import OVER_TIME, share_within
from runner.teleop.experiment import Experiment

Vector = tuple[float, float, float]
_MOST = 600  # readings of an episode: the bound takes each of its wrenches as an unknown


@dataclass(frozen=True)
class Course:
    """How beliefs of N seeds went.

    Attributes:
        time_s: Of the readings, all episodes one after the other, (m,).
        values: (m, N, k).
        sd: (m, N, k).
        covariance: At the end, (N, k, k).
        mass_sd: Of the logarithm of the mass at the end, the median over the seeds.
    """

    time_s: np.ndarray
    values: np.ndarray
    sd: np.ndarray
    covariance: np.ndarray
    mass_sd: float


@registered("study")
@dataclass(frozen=True)
class Space(AbstractStudy):
    """Shake and toss a body, estimate it from noisy readings of many seeds, and hold that against the Cramer-Rao bound.

    A row for each value. `bound`, `rmse`, `bias` and `stated_sd` are shares: of the mass, of the half size, of the mean
    moment of inertia. `ratio` is rmse / bound, with its 95 % interval; `coverage` is how often the stated 95 % interval
    held the truth. `distance2` is the mean squared distance of all values from the truth in terms of the stated
    covariance, which should be `freedom`. `certain_s` is when all intervals had shrunk to `estimator.certain`, the
    median over the seeds. A value that the readings tell nothing of has an infinite bound, and nothing else.

    The true body is the remote, what is believed at first is the start, the rate and the noise of poses and velocities
    are the link's, gravity is the scene's.

    Attributes:
        shakes: Episodes in which the body is held and shaken.
        tosses: Episodes in which it flies, after those.
        seeds: Of the noise.
        shake_s: Length of a shake.
        toss_s: Length of a flight.
        spin_rad_s: How fast it turns at the beginning of a flight.
        products_kg_m2: The true inertia's xy, xz and yz.
        estimator: What is made of it.
    """

    shakes: int = 1
    tosses: int = 0
    seeds: int = 100
    shake_s: float = 1.5
    toss_s: float = 0.6
    spin_rad_s: float = 9.0
    products_kg_m2: Vector = (0.0, 0.0, 0.0)
    estimator: SpaceEstimator = field(default_factory=SpaceEstimator)

    def __post_init__(self) -> None:
        check_range("shakes", self.shakes, 0, 20)
        check_range("tosses", self.tosses, 0, 100)
        if not self.shakes + self.tosses:
            raise ConfigError("shakes, tosses: at least one of them must be above 0.")
        check_range("seeds", self.seeds, 2, 10_000)
        check_range("shake_s", self.shake_s, 0.02, 60.0, unit="s")
        check_range("toss_s", self.toss_s, 0.02, 10.0, unit="s")
        check_range("spin_rad_s", self.spin_rad_s, 0.0, 100.0, unit="rad/s")
        check_vector("products_kg_m2", self.products_kg_m2, 3, unit="kg m2", limit=1e9)

    def rows(self, experiment: Experiment, folder: Path) -> Rows:
        half = np.array(experiment.remote.half_size_m)
        gravity = np.array([0.0, 0.0, -experiment.scene.gravity_m_s2])
        try:
            true = numbers_of(_inertial(experiment.remote.body, self.products_kg_m2), half)
        except ConfigError as error:
            raise ConfigError(with_key("remote, study.products_kg_m2", str(error))) from None
        try:
            prior = self.estimator.prior(_inertial(experiment.local, (0.0, 0.0, 0.0)), half)
        except ConfigError as error:
            raise ConfigError(with_key("start", str(error))) from None
        sensors, noise, step_s = self.estimator.sensors, experiment.link.noise, 1.0 / experiment.link.rate_hz
        sensors.sd(noise)  # refuses what is exact before anything is computed
        episodes = self._episodes(true, half, step_s, gravity, experiment.seed)
        info = np.zeros((len(true), len(true)))
        for made in episodes:
            info += information(made, true, half, sensors, noise, gravity)
        course = self._course(experiment, prior, episodes, half, gravity)
        rows = self._rows(course, true, info, half)
        write_parquet(folder / OVER_TIME, self._over_time(course, true, half))
        return rows

    def _episodes(
        self, true: np.ndarray, half: np.ndarray, step_s: float, gravity: np.ndarray, seed: int
    ) -> list[MadeMotion]:
        for name, lasts in (("shake_s", self.shake_s), ("toss_s", self.toss_s)):
            if not 1 <= round(lasts / step_s) <= _MOST:
                raise ConfigError(
                    f"study.{name}: must be 1 to {_MOST} readings at {1 / step_s:g} Hz (link.rate_hz), got {lasts:g} s."
                )
        shakes = [
            shaken(true, half, step_s=step_s, duration_s=self.shake_s, gravity=gravity, seed=seed + i)
            for i in range(self.shakes)
        ]
        spin = self.spin_rad_s
        return shakes + [
            tossed(true, half, step_s=step_s, duration_s=self.toss_s, gravity=gravity, spin_rad_s=spin, seed=seed + i)
            for i in range(self.tosses)
        ]

    def _course(
        self, experiment: Experiment, prior: Any, episodes: list[MadeMotion], half: np.ndarray, gravity: np.ndarray
    ) -> Course:
        """Update beliefs of all seeds with all readings."""
        noise, step_s = experiment.link.noise, 1.0 / experiment.link.rate_hz
        tracker = self.estimator.tracker(half, step_s, noise, gravity)
        belief: SpaceBelief | None = None
        values, sds, covariance = [], [], np.empty(0)
        count = sum(len(made.acceleration) for made in episodes)
        with progress("Estimating", total=count, unit="readings") as advance:
            for j, made in enumerate(episodes):
                seeds = [(experiment.seed + i, 2, j) for i in range(self.seeds)]
                for k, reading in enumerate(made.measured(self.estimator.sensors, noise, seeds)):
                    if belief is None:
                        belief = tracker.start(prior, reading)
                    else:
                        belief = tracker.begun(belief, reading) if k == 0 else tracker.update(belief, reading)
                    found, covariance = tracker.values(belief, held=self.shakes > 0)
                    values.append(found)
                    sds.append(np.sqrt(np.maximum(np.einsum("nii->ni", covariance), 0.0)))
                    advance()
        assert belief is not None
        by = derivative(values_of, belief.x, half)[:, 0] / values_of(belief.x, half)[:, :1]
        mass_sd = float(np.median(np.sqrt(np.einsum("ni,nij,nj->n", by, belief.x_covariance, by))))
        return Course(np.arange(count) * step_s, np.array(values), np.array(sds), covariance, mass_sd)

    def _rows(self, course: Course, true: np.ndarray, info: np.ndarray, half: np.ndarray) -> Rows:
        held = self.shakes > 0
        function, names = (values_of, NAMES) if held else (shares_of, SHARES)
        truth = function(true, half)
        unit = units_of(truth, half)
        least = np.sqrt(np.diag(least_covariance(info, derivative(function, true, half)))) / unit
        error, sd = (course.values[-1] - truth) / unit, course.sd[-1] / unit
        rmse = np.sqrt((error**2).mean(axis=0))
        # shares add up to one: one direction has no spread
        freedom = len(names) - (not held)
        inverse = np.linalg.pinv(course.covariance / np.outer(unit, unit), rcond=1e-12, hermitian=True)
        distance2 = float(np.einsum("ni,nij,nj->n", error, inverse, error).mean())
        spread = np.sqrt(scipy.stats.chi2.ppf([0.975, 0.025], self.seeds) / self.seeds)
        certain_s = self._certain_s(course, unit)
        rows: Rows = []
        for j, name in enumerate(names):
            share, low, high = share_within(np.abs(error[:, j]) <= INTERVAL * sd[:, j])
            ratio = rmse[j] / least[j]
            row: dict[str, Any] = {"parameter": name, "seeds": self.seeds, "true": float(truth[j])}
            row |= {"bound": float(least[j]), "rmse": float(rmse[j]), "ratio": float(ratio)}
            row |= {"ratio_low": float(ratio / spread[0]), "ratio_high": float(ratio / spread[1])}
            row |= {"bias": float(error[:, j].mean())}
            row |= {"bias_in_standard_errors": float(error[:, j].mean() / error[:, j].std() * np.sqrt(self.seeds))}
            row |= {"stated_sd": float(np.sqrt((sd[:, j] ** 2).mean()))}
            row |= {"coverage": share, "coverage_low": low, "coverage_high": high}
            row |= {"distance2": distance2, "freedom": freedom, "certain_s": certain_s}
            rows.append(row)
        if not held:
            mass = {"parameter": NAMES[0], "seeds": self.seeds, "true": float(values_of(true, half)[0])}
            rows.append(mass | {"bound": float("inf"), "stated_sd": course.mass_sd})
        return rows

    def _certain_s(self, course: Course, unit: np.ndarray) -> float:
        """Return after which time all intervals of a seed are small enough, the median; NaN: never, or not asked."""
        if self.estimator.certain is None:
            return float("nan")
        small = (INTERVAL * course.sd <= self.estimator.certain * unit).all(axis=2)  # (m, N)
        first = np.where(small.any(axis=0), course.time_s[small.argmax(axis=0)], np.inf)
        median = float(np.median(first))
        return median if np.isfinite(median) else float("nan")

    def _over_time(self, course: Course, true: np.ndarray, half: np.ndarray) -> pd.DataFrame:
        """Return errors over time, in the units of the rows."""
        function, names = (values_of, NAMES) if self.shakes else (shares_of, SHARES)
        truth = function(true, half)
        unit = units_of(truth, half)
        error = course.values - truth
        parts = [
            pd.DataFrame(
                {
                    "parameter": name,
                    "time_s": course.time_s,
                    "rmse": np.sqrt((error[..., j] ** 2).mean(axis=1)) / unit[j],
                    "stated_sd": np.sqrt((course.sd[..., j] ** 2).mean(axis=1)) / unit[j],
                    "coverage": (np.abs(error[..., j]) <= INTERVAL * course.sd[..., j]).mean(axis=1),
                }
            )
            for j, name in enumerate(names)
        ]
        return pd.concat(parts, ignore_index=True)


def _inertial(body: BodyConfig, products_kg_m2: Vector) -> Inertial:
    """Return a body's parameters, with products of inertia."""
    inertia = np.diag(body.inertia).astype(float)
    for (i, j), product in zip(((0, 1), (0, 2), (1, 2)), products_kg_m2, strict=True):
        inertia[i, j] = inertia[j, i] = product
    return Inertial(body.mass_kg, np.array(body.com_m, dtype=float), inertia)
